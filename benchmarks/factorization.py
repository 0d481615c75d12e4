"""Factorizations side by side, in one run: the package's own Cholesky, SuperLU, and CHOLMOD if it is installed.

python benchmarks/factorization.py [--subdivisions 6] [--repeats 7] [--json FILE] [--markdown]

Each backend analyses, factors and solves (3 right-hand sides) the graph Laplacian of a subdivided icosahedron with a small
shift, its square, and the pattern of two unknowns per vertex. Times are medians in milliseconds; CPU time counts all threads.
nnz(L) of the own Cholesky counts the zeros in its dense panels. SuperLU and CHOLMOD find their own order.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any, get_args

import numpy as np
import scipy.sparse as sp
import trimesh

from book import Sheet, Table, add_options
from morphlet.errors import MissingExtra
from morphlet.numerics import linalg

HEADS = ["", "analyse ms", "factor ms", "factor CPU ms", "CPU ratio", "solve 3 ms", "nnz(L)/1e6", "residual"]
SHIFT = 1e-3
"""Makes the Laplacian definite."""


def laplacian(mesh: trimesh.Trimesh) -> sp.csc_matrix:
    """Valence minus adjacency, shifted."""
    i, j = mesh.edges_unique.T
    ones = np.ones(len(i))
    A = sp.coo_matrix((np.r_[ones, ones], (np.r_[i, j], np.r_[j, i])), shape=(len(mesh.vertices),) * 2)
    return sp.csc_matrix(sp.diags(np.asarray(A.sum(axis=1)).ravel() + SHIFT) - A)


def problems(subdivisions: int) -> dict[str, sp.csc_matrix]:
    """The matrices by name."""
    L = laplacian(trimesh.creation.icosphere(subdivisions=subdivisions))
    two = sp.csc_matrix(sp.kron(L, np.array([[2.0, 0.5], [0.5, 1.0]])))
    return {"laplacian": L, "bilaplacian": sp.csc_matrix(L @ L), "two per vertex": two}


def timed(action: Callable[[], Any], repeats: int) -> tuple[Any, float, float]:
    """The last result, median CPU and wall time in milliseconds."""
    times = []
    for _ in range(repeats):
        cpu, wall = time.process_time(), time.perf_counter()
        result = action()
        times.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu, wall = 1000 * np.median(times, axis=0)
    return result, cpu, wall


def measured(A: sp.csc_matrix, backend: linalg.Backend, repeats: int) -> dict[str, Any]:
    """Times, fill and relative residual of one backend."""
    lower = sp.csc_matrix(sp.tril(A))
    lower.sort_indices()
    analysis, _, analyse = timed(lambda: linalg.analyse(lower.indptr, lower.indices, backend=backend), 2)
    factor, cpu, wall = timed(lambda: analysis.factor(lower.data), repeats)
    b = np.random.default_rng(0).normal(size=(A.shape[0], 3))
    x, _, solve = timed(lambda: factor.solve(b), repeats)
    nnz = factor.nnz or (factor.answer.L().nnz if hasattr(factor.answer, "L") else 0)
    residual = np.abs(A @ x - b).max() / (abs(A).sum(axis=1).max() * np.abs(x).max())
    return {"analyse": analyse, "factor cpu": cpu, "factor wall": wall, "solve": solve, "nnz": nnz / 1e6, "residual": residual}


def main() -> None:
    """Measure all and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subdivisions", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=7)
    add_options(parser)
    options = parser.parse_args()
    sheet = Sheet.of(options)
    linalg.factorize(sp.csc_matrix(2.0 * np.eye(2))).solve(np.ones(2))  # compiles
    for name, A in problems(options.subdivisions).items():
        reference, rows = None, []
        for backend in get_args(linalg.Backend):
            try:
                m = measured(A, backend, options.repeats)
            except MissingExtra as error:
                sheet.miss(backend, str(error))
                continue
            reference = reference or m["factor cpu"]
            times = [f"{m[key]:.1f}" for key in ("analyse", "factor wall", "factor cpu")]
            ratio, solve, nnz = f"{m['factor cpu'] / reference:.2f}", f"{m['solve']:.1f}", f"{m['nnz']:.2f}"
            rows.append([backend, *times, ratio, solve, nnz, f"{m['residual']:.1e}"])
        sheet.add(Table(f"{name}: {A.shape[0]} unknowns", HEADS, rows))


if __name__ == "__main__":
    main()
