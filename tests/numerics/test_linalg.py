"""Factorizations against dense solves, on exact small cases, random matrices, meshes and broken input."""

import importlib.util
from typing import get_args

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.errors import InputError, MissingExtra, SolveError
from morphlet.numerics import elimination, linalg, ordering, supernodal

BACKENDS = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            name == "cholmod" and importlib.util.find_spec("sksparse") is None, reason="scikit-sparse is not installed"
        ),
    )
    for name in get_args(linalg.Backend)
]
backends = pytest.mark.parametrize("backend", BACKENDS)


def grid_points(rows: int, columns: int) -> np.ndarray:
    """A grid, slightly bent."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.stack([x.ravel(), y.ravel(), 0.1 * np.sin(x.ravel())], axis=1).astype(float)


def grid_laplacian(rows: int, columns: int) -> sp.csc_matrix:
    """Graph Laplacian of a triangulated grid, shifted to be definite."""
    number = np.arange(rows * columns).reshape(rows, columns)
    i = np.r_[number[:, :-1].ravel(), number[:-1].ravel(), number[:-1, :-1].ravel()]
    j = np.r_[number[:, 1:].ravel(), number[1:].ravel(), number[1:, 1:].ravel()]
    A = sp.coo_matrix((np.ones(len(i)), (i, j)), shape=(rows * columns,) * 2)
    A = A + A.T
    return sp.csc_matrix(sp.diags(np.asarray(A.sum(axis=1)).ravel() + 0.1) - A)


def two_per_vertex(rows: int, columns: int) -> sp.csc_matrix:
    """Two adjacent unknowns per vertex, as in Newton steps on the sphere."""
    A = sp.csc_matrix(sp.kron(grid_laplacian(rows, columns), np.array([[2.0, 0.5], [0.5, 1.0]])))
    A.sort_indices()
    return A


def lower(A: sp.csc_matrix) -> sp.csc_matrix:
    L = sp.csc_matrix(sp.tril(A))
    L.sort_indices()
    return L


def assert_solves(A: sp.csc_matrix, factor: linalg.Factor, k: int = 3) -> None:
    """The residual is rounding, relative to matrix and solution."""
    b = np.random.default_rng(1).normal(size=(A.shape[0], k))
    x = factor.solve(b)
    scale = abs(A).sum(axis=1).max() * np.abs(x).max()
    assert x.shape == b.shape
    assert np.abs(A @ x - b).max() <= 1e-13 * scale * np.sqrt(A.shape[0])


@backends
def test_exact_two_unknowns(backend):
    factor = linalg.factorize(sp.csc_matrix([[4.0, 2.0], [2.0, 5.0]]), backend=backend)
    np.testing.assert_allclose(factor.solve(np.array([8.0, 12.0])), [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(factor.solve(np.array([[8.0, 4.0], [12.0, 2.0]])), [[1.0, 1.0], [2.0, 0.0]], atol=1e-15)


@backends
@pytest.mark.parametrize("n", [1, 2, 3, 200])
def test_diagonal(backend, n):
    values = 1.0 + np.arange(n)
    factor = linalg.factorize(sp.csc_matrix(sp.diags(values)), backend=backend)
    np.testing.assert_allclose(factor.solve(values), np.ones(n), rtol=1e-14)


@backends
def test_no_unknowns(backend):
    factor = linalg.analyse(np.zeros(1, int), np.zeros(0, int), backend=backend).factor(np.zeros(0))
    assert factor.solve(np.zeros((0, 3))).shape == (0, 3)
    assert factor.solve(np.zeros(0)).shape == (0,)


@backends
def test_no_right_hand_side(backend):
    assert linalg.factorize(grid_laplacian(3, 3), backend=backend).solve(np.zeros((9, 0))).shape == (9, 0)


@backends
@settings(max_examples=25, deadline=None, derandomize=True)
@given(n=st.integers(1, 60), density=st.floats(0, 0.5), seed=st.integers(0, 2**20))
def test_random_definite_matrices(backend, n, density, seed):
    rng = np.random.default_rng(seed)
    B = sp.random(n, n, density, random_state=rng, data_rvs=rng.standard_normal)
    A = sp.csc_matrix(B @ B.T + sp.identity(n))
    b = rng.normal(size=(n, 2))
    expected = np.linalg.solve(A.toarray(), b)
    np.testing.assert_allclose(linalg.factorize(A, backend=backend).solve(b), expected, atol=1e-9 * np.abs(expected).max())


@settings(max_examples=15, deadline=None, derandomize=True)
@given(n=st.integers(90, 400), degree=st.floats(0.5, 6), seed=st.integers(0, 2**20), placed=st.booleans())
def test_random_graphs_are_cut(n, degree, seed, placed):
    """Larger than a leaf: parts are cut, also if the graph has several pieces or no small separator."""
    rng = np.random.default_rng(seed)
    i, j = rng.integers(0, n, (2, int(n * degree / 2) + 1))
    A = sp.csc_matrix((np.full(len(i), 0.5), (np.maximum(i, j), np.minimum(i, j))), shape=(n, n))
    A = sp.csc_matrix(A + A.T)
    A = sp.csc_matrix(A + sp.diags(np.asarray(A.sum(axis=1)).ravel() + 1.0))
    assert_solves(A, linalg.factorize(A, rng.normal(size=(n, 3)) if placed else None))


@backends
@pytest.mark.parametrize("placed", [False, True])
def test_meshes(backend, placed):
    L = grid_laplacian(31, 37)
    points = grid_points(31, 37) if placed else None
    for A in (L, sp.csc_matrix(L @ L), two_per_vertex(31, 37)):
        assert_solves(A, linalg.factorize(A, points, backend))


@backends
def test_several_pieces(backend):
    A = sp.csc_matrix(sp.block_diag([grid_laplacian(12, 12), sp.identity(50), grid_laplacian(9, 30), two_per_vertex(8, 8)]))
    mixed = np.random.default_rng(0).permutation(A.shape[0])
    assert_solves(A, linalg.factorize(A, backend=backend))
    assert_solves(A[mixed][:, mixed], linalg.factorize(A[mixed][:, mixed], backend=backend))


def test_star_and_dense():
    """A hub comes last; a graph without small separators is still ordered."""
    n = 500
    hub = sp.lil_matrix(sp.identity(n) * n)
    hub[0, :] = hub[:, 0] = 1.0
    hub[0, 0] = n
    factor = linalg.factorize(sp.csc_matrix(hub))
    assert_solves(sp.csc_matrix(hub), factor)
    assert factor.nnz is not None
    assert factor.nnz < 20 * n
    full = sp.csc_matrix(np.ones((150, 150)) + 150 * np.eye(150))
    assert_solves(full, linalg.factorize(full))


@backends
def test_other_values_on_one_pattern(backend):
    A = two_per_vertex(15, 17)
    L = lower(A)
    analysis = linalg.analyse(L.indptr, L.indices, backend=backend)
    first, second = analysis.factor(L.data), analysis.factor(3.0 * L.data)
    assert_solves(A, first)
    assert_solves(3.0 * A, second)


@backends
@pytest.mark.parametrize("index", [np.int32, np.int64])
def test_index_types_and_read_only_input(backend, index):
    L = lower(grid_laplacian(11, 13))
    arrays = [L.indptr.astype(index), L.indices.astype(index), L.data.copy(), np.ones(L.shape[0])]
    for array in arrays:
        array.flags.writeable = False
    x = linalg.analyse(arrays[0], arrays[1], backend=backend).factor(arrays[2]).solve(arrays[3])
    assert x.flags.writeable
    np.testing.assert_allclose(x, 10.0, rtol=1e-10)  # constant: every row of the Laplacian sums to the shift, 0.1


@backends
def test_lower_triangle_is_enough(backend):
    A = grid_laplacian(7, 9)
    b = np.arange(63.0)
    whole, half = linalg.factorize(A, backend=backend), linalg.factorize(lower(A), backend=backend)
    np.testing.assert_array_equal(whole.solve(b), half.solve(b))


@backends
def test_same_input_same_bits(backend):
    A, points = two_per_vertex(40, 40), grid_points(40, 40)
    b = np.random.default_rng(0).normal(size=(A.shape[0], 2))
    x, y = (linalg.factorize(A, points, backend).solve(b) for _ in range(2))
    np.testing.assert_array_equal(x, y)


def test_groups_do_not_change_the_bits(monkeypatch):
    A = lower(two_per_vertex(40, 40))
    pattern = sp.csc_matrix((np.arange(A.nnz), A.indices, A.indptr), shape=A.shape)
    panels = []
    for groups in (1, 2, 5):
        monkeypatch.setattr(elimination, "GROUPS", groups)
        panels.append(supernodal.factor(elimination.symbolic(pattern, None), A.data)[0])
    np.testing.assert_array_equal(panels[0], panels[1])
    np.testing.assert_array_equal(panels[0], panels[2])


def test_order_is_a_permutation_with_little_fill():
    """Both orders beat elimination row by row by far: a grid of side s needs O(s^2 log s) entries instead of s^3."""
    A = lower(grid_laplacian(100, 100))
    pattern = sp.csc_matrix((np.arange(A.nnz), A.indices, A.indptr), shape=A.shape)
    for points in (None, grid_points(100, 100)):
        plan = elimination.symbolic(pattern, points)
        np.testing.assert_array_equal(np.sort(plan.order), np.arange(10000))
        assert plan.tree.panel[-1] < 100**3 / 2


def test_separator_separates():
    """In the last order of a long strip, no edge joins what comes before the middle separator on different sides."""
    A = sp.csr_matrix(grid_laplacian(4, 100) - sp.diags(grid_laplacian(4, 100).diagonal()))
    A.eliminate_zeros()
    graph = ordering.Graph(A.indptr.astype(np.int32), A.indices.astype(np.int32))
    order = ordering.dissection(graph, None)
    np.testing.assert_array_equal(np.sort(order), np.arange(400))
    rest = sp.csr_matrix(A)[order[:-6]][:, order[:-6]]  # the first separator has 4 to 6 nodes
    assert sp.csgraph.connected_components(rest)[0] >= 2


def test_twins_share_a_node():
    node, graph, representative = elimination._compress(lower(two_per_vertex(5, 5)))
    np.testing.assert_array_equal(node, np.repeat(np.arange(25), 2))
    np.testing.assert_array_equal(representative, np.arange(0, 50, 2))
    assert len(graph.nodes) == 2 * (2 * 20 + 16)


@backends
def test_indefinite_matrix_is_refused(backend):
    A = sp.lil_matrix(grid_laplacian(10, 10))
    A[37, 37] = -1.0
    with pytest.raises(SolveError, match="positive definite"):
        linalg.factorize(sp.csc_matrix(A), backend=backend)


@backends
def test_singular_matrix_is_refused(backend):
    with pytest.raises(SolveError, match="positive definite"):
        linalg.factorize(sp.csc_matrix(([1.0, 0.0, 2.0], [0, 1, 2], [0, 1, 2, 3])), backend=backend)


@backends
def test_the_bad_pivot_is_named(backend):
    values = np.ones(30)
    values[17] = -2.0
    with pytest.raises(SolveError, match="row 17 of 30") as caught:
        linalg.factorize(sp.csc_matrix(sp.diags(values)), backend=backend)
    assert caught.value.elements == [17]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_values_are_refused(bad):
    L = lower(grid_laplacian(3, 3))
    analysis = linalg.analyse(L.indptr, L.indices)
    values = L.data.copy()
    values[4] = bad
    with pytest.raises(InputError, match="finite numbers in values"):
        analysis.factor(values)
    with pytest.raises(InputError, match="finite numbers in b"):
        analysis.factor(L.data).solve(np.full(9, bad))


@pytest.mark.parametrize(
    ("indptr", "indices", "needed"),
    [
        ([0, 2, 1], [0, 1], "indptr rising"),
        ([0, 1, 1], [0], "columns that start with their diagonal"),
        ([0, 2, 3], [1, 0, 1], "columns that start with their diagonal"),
        ([0, 3, 4, 5], [0, 2, 1, 1, 2], "ascending rows"),
        ([0, 3, 4], [0, 1, 1, 1], "ascending rows"),
        ([0, 2, 3], [0, 5, 1], "indices from 0 to 1"),
        ([], [], "indptr rising"),
    ],
)
def test_broken_patterns_are_refused(indptr, indices, needed):
    with pytest.raises(InputError, match=needed):
        linalg.analyse(np.array(indptr, int), np.array(indices, int))


def test_wrong_lengths_are_refused():
    analysis = linalg.analyse(np.array([0, 1, 2]), np.array([0, 1]))
    with pytest.raises(InputError, match=r"values of shape \(2\)"):
        analysis.factor(np.ones(3))
    with pytest.raises(InputError, match=r"b of shape \(2\)"):
        analysis.factor(np.ones(2)).solve(np.ones(3))
    with pytest.raises(InputError, match="divides 2 unknowns"):
        linalg.analyse(np.array([0, 1, 2]), np.array([0, 1]), np.zeros((3, 3)))


def test_unfit_matrices_are_refused():
    with pytest.raises(InputError, match="a symmetric matrix"):
        linalg.factorize(sp.csc_matrix([[2.0, 1.0], [0.5, 2.0]]))
    with pytest.raises(InputError, match="a symmetric matrix"):
        linalg.factorize(sp.csc_matrix([[2.0, 1.0], [0.0, 2.0]]))
    with pytest.raises(InputError, match="columns that start with their diagonal"):
        linalg.factorize(sp.csc_matrix([[1.0, 0.0], [0.0, 0.0]]))
    with pytest.raises(InputError, match="a square sparse matrix"):
        linalg.factorize(sp.csc_matrix(np.ones((2, 3))))
    with pytest.raises(InputError, match="one of supernodal"):
        linalg.factorize(sp.csc_matrix(np.eye(2)), backend="best")


def test_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "sksparse", None)
    with pytest.raises(MissingExtra, match=r"morphlet\[cholmod\]"):
        linalg.factorize(sp.csc_matrix(np.eye(2)), backend="cholmod")


def assert_rough(A: sp.csc_matrix, points: np.ndarray | None, backend: linalg.Backend) -> None:
    """The rough solver, in elimination order, agrees with the exact one to single precision in the energy norm."""
    L = lower(A)
    analysis = linalg.analyse(L.indptr, L.indices, points, backend)
    factor, order = analysis.factor(L.data), analysis.order
    assert sorted(order) == list(range(A.shape[0]))
    b = np.random.default_rng(2).normal(size=(A.shape[0], 3))
    exact, found = factor.solve(b), np.empty_like(b)
    found[order] = factor.rough()(b[order])
    error = found - exact
    assert np.sqrt(np.vdot(error, A @ error) / np.vdot(exact, b)) < 1e-4


@backends
@pytest.mark.parametrize("placed", [False, True])
def test_rough_solves_of_meshes(backend, placed):
    assert_rough(grid_laplacian(23, 31), grid_points(23, 31) if placed else None, backend)


@backends
@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_rough_solves_of_small_and_dense_matrices(backend, n):
    """Panels of every width, from one column to all."""
    B = np.random.default_rng(n).normal(size=(n, n))
    assert_rough(sp.csc_matrix(B @ B.T + n * np.eye(n)), None, backend)
    assert_rough(sp.csc_matrix(sp.diags(1.0 + np.arange(n))), None, backend)


@backends
def test_rough_solves_of_nothing(backend):
    analysis = linalg.analyse(np.zeros(1, int), np.zeros(0, int), backend=backend)
    assert analysis.factor(np.zeros(0)).rough()(np.zeros((0, 3))).shape == (0, 3)
    assert len(analysis.order) == 0
