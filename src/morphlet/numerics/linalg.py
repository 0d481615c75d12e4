"""Sparse solves that factor once and answer many times: the only home of a factorization.

A symmetric positive definite matrix is given by its LOWER triangle, diagonal included, column by column with ascending
rows (CSC). Its pattern is analysed once, its values are factored as often as they change, each factor answers any
number of right-hand sides. The same input gives the same bits. Values are float64 and must be finite.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from morphlet import _arrays
from morphlet.errors import InputError, MissingExtra, SolveError
from morphlet.numerics import elimination, stiffer, supernodal

Backend = Literal["supernodal", "superlu", "cholmod"]
"""Who factors: the package's own Cholesky, SuperLU of scipy, or CHOLMOD of scikit-sparse (an extra). Never chosen by what is installed."""

SYMMETRY = 1e-9
"""Largest difference of mirrored entries, relative to the largest entry, of a symmetric matrix: assembly rounds to 1e-15."""

Solver = Callable[[np.ndarray], np.ndarray]
"""From finite float64 right-hand sides (n, k) to the solutions (n, k)."""


@dataclass(frozen=True, eq=False)
class Factor:
    """A factored matrix: a map from right-hand sides to solutions.

    Parameters
    ----------
    n
        Number of unknowns.
    nnz
        Stored entries of the triangular factor, zeros of its dense blocks among them; None where the backend does not tell.
    answer
        The prepared triangular solves.
    prepare_rough
        Prepares a faster solver of single precision, for three right-hand sides in elimination order; None where there is none.
    prepare_stiffer
        Prepares the factor of a matrix with more on the diagonal, from checked unknowns and stiffness; None where it cannot.
    """

    n: int
    nnz: int | None
    answer: Solver
    prepare_rough: Callable[[], Solver] | None = None
    prepare_stiffer: Callable[[np.ndarray, np.ndarray], "Factor | None"] | None = None

    def rough(self) -> Solver:
        """A solver for three right-hand sides (n, 3) whose rows, like the answer's, are in elimination order (`Analysis.order`).

        Returns
        -------
        solver
            Good to single precision, some 1e-5 of the answer: for corrections in an iteration that measures its own residual.
            To double precision where the backend has no faster way.

        Notes
        -----
        Preparing it inverts the diagonal blocks of the factor, a tenth of the factorization's work, once for a factor and all
        that `stiffened` makes of it. A solve then is matrix products alone: three times as fast as `solve`.

        Examples
        --------
        >>> import numpy as np, scipy.sparse as sp
        >>> from morphlet.numerics.linalg import factorize
        >>> solver = factorize(sp.csc_matrix(np.diag([2.0, 4.0]))).rough()
        >>> round(float(solver(np.array([[2.0, 4.0, 6.0], [2.0, 4.0, 6.0]])).max()), 5)
        3.0
        """
        return self.answer if self.prepare_rough is None else self.prepare_rough()

    def stiffened(self, unknowns: Int[np.ndarray, "k"], stiffness: Float[np.ndarray, "k"]) -> "Factor | None":
        """The factor of the same matrix with more on its diagonal.

        Parameters
        ----------
        unknowns
            Where, ascending.
        stiffness
            How much more, positive; infinite holds the unknown at 0, whatever its right-hand side.

        Returns
        -------
        factor
            None where a factorization would cost less than this, in frames to come at least; where the backend cannot; or for a factor
            that was made so itself: make another from the first.

        Raises
        ------
        InputError
            If the unknowns do not ascend, are none of the matrix, or a stiffness is not positive.

        Notes
        -----
        The factor is kept as it is. Of the half-solved right-hand sides, ``L^-1 b``, a projection takes what the new stiffness resists:
        it touches only the m rows on the ways from these unknowns to the root of the elimination tree. To prepare it costs k solves
        with these rows and ``m k^2`` operations, to use it ``2 m k`` per right-hand side.

        References
        ----------
        Yeung, Crouch, Pothen, Interactively cutting and constraining vertices in meshes using augmented matrices, ACM Transactions on
        Graphics 35, 2016.

        Examples
        --------
        >>> import numpy as np, scipy.sparse as sp
        >>> from morphlet.numerics.linalg import factorize
        >>> chain = sp.diags([-np.ones(4), np.full(5, 2.0), -np.ones(4)], [-1, 0, 1], format="csc")
        >>> (factorize(chain).stiffened([2], [np.inf]).solve(np.ones(5)).round(12) + 0.0).tolist()
        [1.0, 1.0, 0.0, 1.0, 1.0]
        """
        chosen = _arrays.index(unknowns, "unknowns", (None,), self.n)
        more = np.array(stiffness, dtype=np.float64)
        if more.shape != chosen.shape or np.any(np.diff(chosen) <= 0) or not np.all(more > 0):
            found = f"{len(chosen)} unknowns and stiffness of shape {more.shape}"
            raise InputError("ascending unknowns, a positive stiffness for each", found, "sort them, leave out what is not stiffer")
        return None if self.prepare_stiffer is None else self.prepare_stiffer(chosen, more)

    def solve(self, b: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """The x with A x = b, one column per right-hand side.

        Parameters
        ----------
        b
            One right-hand side (n,) or several (n, k).

        Returns
        -------
        x
            Of the shape of b, writable.

        Raises
        ------
        InputError
            If b has another shape or holds NaN or infinite values.

        Notes
        -----
        O(nnz) per right-hand side; several at once read the factor only once.

        Examples
        --------
        >>> import numpy as np, scipy.sparse as sp
        >>> from morphlet.numerics.linalg import factorize
        >>> factor = factorize(sp.csc_matrix([[2.0, 1.0], [1.0, 2.0]]))
        >>> factor.solve(np.array([3.0, 3.0])).round(12).tolist()
        [1.0, 1.0]
        """
        columns = np.ndim(b) == 2
        checked = _arrays.real(b, "b", (self.n, None) if columns else (self.n,))
        x = self.answer(checked.reshape(self.n, -1)) if checked.size else np.zeros((self.n, checked.size))
        return x.reshape(checked.shape)


@dataclass(frozen=True, eq=False)
class Analysis:
    """A pattern made ready to factor any values on it.

    Parameters
    ----------
    n
        Number of unknowns.
    n_values
        Entries of the lower triangle.
    backend
        Who factors.
    order
        The unknowns as they are eliminated, where the backend tells (as they are numbered elsewhere): neighbours in it share
        memory, so data kept in this order is read faster.
    numeric
        The prepared numeric factorization of checked values.
    """

    n: int
    n_values: int
    backend: Backend
    order: Int[np.ndarray, "n"]
    numeric: Callable[[np.ndarray], Factor]

    def factor(self, values: Float[np.ndarray, "z"]) -> Factor:
        """Factor the matrix with these values.

        Parameters
        ----------
        values
            Entries of the lower triangle, in the order of the analysed pattern.

        Returns
        -------
        factor
            Independent of this analysis and of later factors.

        Raises
        ------
        InputError
            If there are fewer or more values than entries, or NaN or infinite ones.
        SolveError
            If the matrix is not positive definite; `elements` holds the row of the first pivot that is not positive.

        Examples
        --------
        >>> import numpy as np
        >>> from morphlet.numerics.linalg import analyse
        >>> analysis = analyse(np.array([0, 2, 3]), np.array([0, 1, 1]))
        >>> analysis.factor(np.array([4.0, 2.0, 3.0])).solve(np.array([8.0, 8.0])).round(12).tolist()
        [1.0, 2.0]
        """
        return self.numeric(_arrays.real(values, "values", (self.n_values,)))


def analyse(
    indptr: Int[np.ndarray, "n1"],
    indices: Int[np.ndarray, "z"],
    points: Float[np.ndarray, "p 3"] | None = None,
    backend: Backend = "supernodal",
) -> Analysis:
    """Prepare the factorization of every matrix with this pattern.

    Parameters
    ----------
    indptr, indices
        Lower triangle of the pattern in CSC form: every diagonal entry present, rows ascending in each column.
    points
        Where the unknowns are, for a better elimination order: p divides n, unknown i is at point i p // n.
    backend
        Who factors.

    Returns
    -------
    analysis
        To factor values with.

    Raises
    ------
    InputError
        If the pattern is not such a lower triangle, the points do not fit it, or the backend is unknown.
    MissingExtra
        If CHOLMOD is asked for and scikit-sparse is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.linalg import analyse
    >>> analyse(np.array([0, 1, 2]), np.array([0, 1])).factor(np.array([4.0, 16.0])).solve(np.ones(2)).tolist()
    [0.25, 0.0625]
    """
    if backend not in get_args(Backend):
        raise InputError(f"one of {', '.join(get_args(Backend))} as backend", repr(backend), "choose one of these")
    pattern = _pattern(indptr, indices)
    n = pattern.shape[0]
    places = None if points is None else _places(points, n)
    return Analysis(n, pattern.nnz, backend, *_PREPARE[backend](pattern, places))


def factorize(
    matrix: sp.csc_matrix,
    points: Float[np.ndarray, "p 3"] | None = None,
    backend: Backend = "supernodal",
) -> Factor:
    """Analyse and factor one matrix: the one-off twin of `analyse(...).factor(...)`.

    Parameters
    ----------
    matrix
        Symmetric positive definite; the whole matrix, or its lower triangle alone.
    points, backend
        See `analyse`.

    Returns
    -------
    factor
        To solve with.

    Raises
    ------
    InputError
        If the matrix is not square, not symmetric, not finite, or its diagonal has a hole.
    SolveError
        If the matrix is not positive definite.
    MissingExtra
        If CHOLMOD is asked for and scikit-sparse is not installed.

    Examples
    --------
    >>> import numpy as np, scipy.sparse as sp
    >>> from morphlet.numerics.linalg import factorize
    >>> x = factorize(sp.csc_matrix([[4.0, 1.0], [1.0, 3.0]])).solve(np.array([1.0, 2.0]))
    >>> (11 * x).round(12).tolist()
    [1.0, 7.0]
    """
    lower = _lower(matrix)
    return analyse(lower.indptr, lower.indices, points, backend).factor(lower.data)


def _lower(matrix: sp.csc_matrix) -> sp.csc_matrix:
    """The sorted lower triangle of a square matrix that is symmetric, or lower already."""
    if not sp.issparse(matrix) or matrix.shape[0] != matrix.shape[1]:
        raise InputError("a square sparse matrix", f"{type(matrix).__name__} {np.shape(matrix)}", "pass a scipy.sparse matrix")
    upper = sp.triu(matrix, 1, format="csc")
    lower = sp.tril(matrix, 0, format="csc").astype(np.float64)
    lower.sum_duplicates()
    if upper.nnz:
        apart = abs(upper - sp.tril(matrix, -1, format="csc").T)
        bad = np.nonzero(apart.max(axis=0).toarray().ravel() > SYMMETRY * abs(matrix).max())[0]
        if len(bad):
            raise InputError("a symmetric matrix", f"{len(bad)} columns unlike their rows", "pass (A + A.T) / 2", bad)
    return lower


Prepared = tuple[Int[np.ndarray, "n"], Callable[[np.ndarray], Factor]]
"""Elimination order, and the numeric factorization of checked values."""


def _pattern(indptr: Any, indices: Any) -> sp.csc_matrix:
    """The checked pattern; its data are the numbers of its entries, from 0."""
    starts = np.array(_arrays.index(indptr, "indptr", (None,), np.size(indices) + 1))
    n = len(starts) - 1
    rows = np.array(_arrays.index(indices, "indices", (None,), max(n, 1)))
    if n < 0 or starts[0] != 0 or starts[-1] != len(rows) or np.any(np.diff(starts) < 0):
        raise InputError("indptr rising from 0 to the number of indices", f"{len(starts)} entries that do not", "pass a CSC pattern")
    empty = np.nonzero(np.diff(starts) == 0)[0]
    missing = empty if len(empty) else np.nonzero(rows[starts[:-1]] != np.arange(n))[0]
    if len(missing):
        raise InputError(
            "columns that start with their diagonal entry",
            f"{len(missing)} that do not",
            "pass the sorted lower triangle, with explicit zeros on the diagonal",
            missing,
        )
    falling = np.diff(rows) <= 0
    falling[starts[1:-1] - 1] = False
    if falling.any():
        bad = np.unique(np.searchsorted(starts, np.nonzero(falling)[0], side="right") - 1)
        raise InputError("ascending rows in each column", f"{len(bad)} columns without", "sort the indices and sum duplicates", bad)
    return sp.csc_matrix((np.arange(len(rows)), rows, starts), shape=(n, n))


def _places(points: Any, n: int) -> np.ndarray:
    """One point per unknown."""
    places = _arrays.real(points, "points", (None, 3))
    if len(places) == 0 or n % len(places):
        raise InputError(f"a number of points that divides {n} unknowns", str(len(places)), "pass one point per vertex")
    return np.repeat(places, n // len(places), axis=0)


def _refuse(row: int, pivot: str, n: int) -> SolveError:
    return SolveError(
        "a positive definite matrix",
        f"{pivot} at row {row} of {n}",
        "fix an unknown, add mass, or project the Hessian",
        [row],
    )


def _whole(pattern: sp.csc_matrix) -> sp.csc_matrix:
    """The full symmetric pattern; its data say which entry of the lower triangle each one takes."""
    numbers = pattern.copy()
    numbers.data = numbers.data + 1  # a zero would vanish from the sum
    whole = (numbers + sp.triu(numbers.T, 1)).tocsc()
    whole.sort_indices()
    whole.data -= 1
    return whole


def _prepare_superlu(pattern: sp.csc_matrix, _points: np.ndarray | None) -> Prepared:
    """SuperLU in symmetric mode: it orders anew for every factorization.

    The unknowns are shuffled first: on regular meshes in their natural order its numbers take a hundred times as long.
    """
    n = pattern.shape[0]
    shuffle = np.random.default_rng(0).permutation(n)
    whole = _whole(pattern)[shuffle][:, shuffle].tocsc()
    whole.sort_indices()

    def numeric(values: np.ndarray) -> Factor:
        matrix = sp.csc_matrix((values[whole.data], whole.indices, whole.indptr), shape=(n, n))
        return _superlu(matrix, shuffle) if n else Factor(0, 0, np.array)

    return np.arange(n), numeric


def _superlu(matrix: sp.csc_matrix, shuffle: Int[np.ndarray, "n"]) -> Factor:
    """Diagonal pivots only; those of a positive definite matrix are positive."""
    try:
        lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise SolveError("a positive definite matrix", str(error), "fix an unknown, add mass, or project the Hessian") from error
    order, pivots = np.argsort(lu.perm_c), lu.U.diagonal()
    bad = np.nonzero(~(pivots > 0) | (lu.perm_r != lu.perm_c)[order])[0]
    if len(bad):
        raise _refuse(int(shuffle[order[bad[0]]]), f"pivot {pivots[bad[0]]:.3g}", len(order))

    def answer(b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        x[shuffle] = lu.solve(b[shuffle])
        return x

    return Factor(len(order), lu.L.nnz, answer)


def _prepare_supernodal(pattern: sp.csc_matrix, points: np.ndarray | None) -> Prepared:
    """The package's own Cholesky: everything but the numbers is found once."""
    n = pattern.shape[0]
    if n == 0:
        return np.arange(0), lambda _: Factor(0, 0, np.array)
    plan = elimination.symbolic(pattern, points)

    def numeric(values: np.ndarray) -> Factor:
        panels, row = supernodal.factor(plan, values)
        if row >= 0:
            raise _refuse(row, "a pivot that is not positive", n)
        return _Panels(plan, panels).factor(supernodal.NOTHING)

    return plan.order, numeric


@dataclass(frozen=True, eq=False)
class _Panels:
    """What the factor of a matrix and those of stiffer ones share."""

    plan: elimination.Symbolic
    panels: Float[np.ndarray, "p"]

    @cached_property
    def inverse(self) -> supernodal.Inverse:
        """For rough solutions."""
        return supernodal.inverse(self.plan, self.panels)

    def factor(self, projection: supernodal.Projection) -> Factor:
        """With this projection between the two halves of a solve."""
        again = None if len(projection.rows) else self.stiffened
        answer = partial(supernodal.solve, self.plan, self.panels, projection)
        return Factor(len(self.plan.order), len(self.panels), answer, partial(self.rough, projection), again)

    def rough(self, projection: supernodal.Projection) -> Solver:
        """With the panels inverted."""
        return partial(supernodal.solve_singly, self.plan, self.inverse, projection)

    def stiffened(self, unknowns: np.ndarray, stiffness: np.ndarray) -> Factor | None:
        """The projection is found where that is not too much work."""
        place = np.empty(len(self.plan.order), np.int64)
        place[self.plan.order] = np.arange(len(place))
        chosen = place[unknowns]
        down = np.argsort(-chosen)
        projection = stiffer.projection(self.plan.tree, self.panels, chosen[down], stiffness[down])
        return None if projection is None else self.factor(projection)


def _prepare_cholmod(pattern: sp.csc_matrix, _points: np.ndarray | None) -> Prepared:
    """CHOLMOD, supernodal, with its own ordering."""
    try:
        from sksparse import cholmod
    except ImportError as error:
        raise MissingExtra("scikit-sparse for backend 'cholmod'", str(error), "pip install 'morphlet[cholmod]'") from error
    n = pattern.shape[0]
    if n == 0:
        return np.arange(0), lambda _: Factor(0, 0, np.array)
    whole = _whole(pattern)
    cholesky = _cholmod_analysed(cholmod, whole) if hasattr(cholmod, "analyze") else partial(_cholmod_whole, cholmod)

    def numeric(values: np.ndarray) -> Factor:
        matrix = sp.csc_matrix((values[whole.data], whole.indices, whole.indptr), shape=(n, n))
        return Factor(n, None, cholesky(matrix))

    return np.arange(n), numeric


def _cholmod_analysed(cholmod: Any, whole: sp.csc_matrix) -> Callable[[sp.csc_matrix], Solver]:
    """By scikit-sparse 0.4: analysed once."""
    ones = sp.csc_matrix((np.ones(whole.nnz), whole.indices, whole.indptr), shape=whole.shape)
    analysed = cholmod.analyze(ones, mode="supernodal")

    def cholesky(matrix: sp.csc_matrix) -> Solver:
        try:
            return analysed.cholesky(matrix)
        except cholmod.CholmodNotPositiveDefiniteError as error:
            raise _refuse(int(analysed.P()[error.column]), "a pivot that is not positive", len(analysed.P())) from error

    return cholesky


def _cholmod_whole(cholmod: Any, matrix: sp.csc_matrix) -> Solver:
    """By scikit-sparse 0.5, whose factors change in place: analysed anew, so that factors stay independent."""
    try:
        return cholmod.cho_factor(sp.csc_array(matrix)).solve
    except cholmod.CholmodNotPositiveDefiniteError as error:
        raise SolveError("a positive definite matrix", str(error), "fix an unknown, add mass, or project the Hessian") from error


_PREPARE: dict[str, Callable[[sp.csc_matrix, np.ndarray | None], Prepared]] = {
    "supernodal": _prepare_supernodal,
    "superlu": _prepare_superlu,
    "cholmod": _prepare_cholmod,
}
