"""What the pattern of a sparse matrix says about its Cholesky factorization: an order, supernodes, and where everything goes.

Unknowns with the same neighbours are one node; nodes are ordered by nested dissection, and columns of the factor that share their rows
form supernodes (the few zeros that this costs are stored). Subtrees far apart are told as groups that may be factored at the same time.
Arrays only, checked by `linalg`; `supernodal` puts the numbers in.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.numerics.compiled import kernel
from morphlet.numerics.ordering import Graph, dissection

SMALL, MEDIUM = 16, 48
"""Columns of a supernode below which more of its entries may be zeros (as in CHOLMOD): dense blocks pay for them."""

ZEROS_SMALL, ZEROS_MEDIUM, ZEROS_LARGE = 0.4, 0.15, 0.05
"""Largest share of zeros in a supernode made of two, by its number of columns."""

GROUPS = 4
"""Groups of subtrees that may be factored at the same time."""

SPLIT = 0.1
"""A subtree with more than this share of all operations is divided among groups."""


class Tree(NamedTuple):
    """Supernodes in elimination order; all unknowns are counted in that order."""

    first: Int[np.ndarray, "s+1"]  # first column
    row_start: Int[np.ndarray, "s+1"]  # where its rows below the diagonal block start in `rows`
    rows: Int[np.ndarray, "r"]
    relative: Int[np.ndarray, "r"]  # place of each of these rows among the rows of the parent's panel
    panel: Int[np.ndarray, "s+1"]  # where its panel starts
    update: Int[np.ndarray, "s"]  # where its update starts
    child_start: Int[np.ndarray, "s+1"]
    children: Int[np.ndarray, "k"]


class Symbolic(NamedTuple):
    """All that the pattern says about the factorization."""

    order: Int[np.ndarray, "n"]  # unknown at each place of the elimination order
    tree: Tree
    groups: tuple[Int[np.ndarray, "g"], ...]  # supernodes of each group of subtrees, then those above them all
    targets: Int[np.ndarray, "z"]  # place of each value among the panels
    workspace: int  # length of all updates that live at a time


def symbolic(pattern: sp.csc_matrix, points: Float[np.ndarray, "n 3"] | None) -> Symbolic:
    """Order the unknowns, find the supernodes and where everything goes."""
    node, graph, representative = _compress(pattern)
    sizes = np.bincount(node, minlength=len(representative))
    order = dissection(graph, None if points is None else np.ascontiguousarray(points[representative]))
    order = order[_postorder(_elimination(_earlier(graph, order)))]
    order, supernode, parent = _supernodes(graph, order, sizes)
    earlier = _earlier(graph, order)
    nothing = np.zeros(0, np.int64)
    counts = _rows(earlier, supernode, parent, np.zeros(len(parent), np.int64), nothing)
    starts = from_counts(counts)
    rows = np.empty(starts[-1], np.int64)
    _rows(earlier, supernode, parent, starts[:-1].copy(), rows)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    unknowns = np.argsort(place[node], kind="stable")
    tree, groups, workspace = _tree(_Blocks(sizes[order], supernode, parent, starts, rows))
    inverse = np.empty(len(unknowns), np.int64)
    inverse[unknowns] = np.arange(len(unknowns))
    column = np.repeat(inverse, np.diff(pattern.indptr))
    row = inverse[pattern.indices]
    owner = np.repeat(np.arange(len(parent)), np.diff(tree.first))
    targets = _targets(np.minimum(row, column), np.maximum(row, column), owner, tree)
    return Symbolic(unknowns, tree, groups, targets, workspace)


class _Blocks(NamedTuple):
    """Supernodes of nodes: sizes and supernode of each node in order, parents, rows in nodes."""

    sizes: np.ndarray
    supernode: np.ndarray
    parent: np.ndarray
    starts: np.ndarray
    rows: np.ndarray


def from_counts(counts: Int[np.ndarray, "s"]) -> Int[np.ndarray, "s+1"]:
    """Where each of so many things of each kind starts, and where the last ones end."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])


def _compress(pattern: sp.csc_matrix) -> tuple[Int[np.ndarray, "n"], Graph, Int[np.ndarray, "m"]]:
    """Node of each unknown, the graph of the nodes, an unknown of each: unknowns with the same neighbours share a node."""
    ones = sp.csc_matrix((np.ones(pattern.nnz, np.int8), pattern.indices, pattern.indptr), pattern.shape)
    whole = (ones + ones.T).tocsr()
    whole.sort_indices()
    starts, columns, degree = whole.indptr.astype(np.int64), whole.indices.astype(np.int64), np.diff(whole.indptr)
    twin = _twins(starts, columns)
    own = twin == np.arange(len(twin))
    representative = np.nonzero(own)[0]
    number = np.cumsum(own) - 1
    row = np.repeat(np.arange(len(twin)), degree)
    kept = own[row] & own[columns] & (row != columns)
    counts = np.bincount(number[row[kept]], minlength=len(representative))
    return number[twin], Graph(from_counts(counts).astype(np.int32), number[columns[kept]].astype(np.int32)), representative


def _twins(starts: Int[np.ndarray, "n1"], columns: Int[np.ndarray, "z"]) -> Int[np.ndarray, "n"]:
    """The first unknown with the same neighbours, itself among them; found by hashing, then compared."""
    salt = np.random.default_rng(0).integers(0, 2**62, len(starts) - 1)
    _, first, group = np.unique(np.add.reduceat(salt[columns], starts[:-1]), return_index=True, return_inverse=True)
    twin, degree = first[group], np.diff(starts)
    alike = (degree[twin] == degree) & (twin != np.arange(len(twin)))
    row = np.repeat(np.arange(len(twin)), np.where(alike, degree, 0))
    within = np.arange(len(row)) - np.repeat(from_counts(np.where(alike, degree, 0))[:-1], np.where(alike, degree, 0))
    differs = columns[starts[row] + within] != columns[starts[twin[row]] + within]
    alike[row[differs]] = False
    return np.where(alike, twin, np.arange(len(twin)))


def _supernodes(
    graph: Graph, order: Int[np.ndarray, "m"], sizes: Int[np.ndarray, "m"]
) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"], Int[np.ndarray, "s"]]:
    """Final order of the nodes, their supernodes, and the parents of these."""
    earlier = _earlier(graph, order)
    parent = _elimination(earlier)
    counts = _counts(earlier, parent, sizes[order])
    m = len(order)
    chained = (parent[:-1] == np.arange(1, m)) & (counts[:-1] == counts[1:] + sizes[order][:-1])
    last = np.nonzero(np.append(~chained, True))[0]
    supernode = np.searchsorted(last, np.arange(m))
    above = np.where(parent[last] < 0, -1, supernode[parent[last]])
    columns = np.bincount(supernode, sizes[order]).astype(np.int64)
    below, into = counts[last] - sizes[order][last], np.arange(len(last))
    _relax(above, columns, below, columns * (columns + 1) // 2 + columns * below, into)
    kept, supernode = np.unique(into[supernode], return_inverse=True)
    above = np.where(above[kept] < 0, -1, np.searchsorted(kept, into[above[kept]]))
    by_supernode = np.argsort(supernode, kind="stable")
    return order[by_supernode], supernode[by_supernode], above


def _tree(blocks: _Blocks) -> tuple[Tree, tuple[Int[np.ndarray, "g"], ...], int]:
    """From nodes to unknowns; where panels and updates go; which supernodes can be factored apart."""
    start = from_counts(blocks.sizes)
    n_supernodes = len(blocks.parent)
    first = from_counts(np.bincount(blocks.supernode, blocks.sizes, n_supernodes).astype(np.int64))
    size = blocks.sizes[blocks.rows]
    rows = np.repeat(start[blocks.rows] - from_counts(size)[:-1], size) + np.arange(size.sum())
    row_start = from_counts(size)[blocks.starts]
    c, r = np.diff(first), np.diff(row_start)
    children = np.argsort(blocks.parent, kind="stable")[np.count_nonzero(blocks.parent < 0) :]
    child_start = from_counts(np.bincount(blocks.parent[blocks.parent >= 0], minlength=n_supernodes))
    group, groups = _divide(blocks.parent, c * (c + r) ** 2)
    update, workspace = _stacks(blocks.parent, group, r * r)
    tree = Tree(first, row_start, rows, np.empty_like(rows), from_counts(c * (c + r)), update, child_start, children)
    _relative(tree)
    return tree, groups, int(workspace)


def _divide(parent: Int[np.ndarray, "s"], work: Int[np.ndarray, "s"]) -> tuple[Int[np.ndarray, "s"], tuple[np.ndarray, ...]]:
    """Group of each supernode, and its members: heaviest subtree first, to the least loaded; the last group is above them all."""
    total, inside = _subtrees(parent, work)
    loads = np.zeros(GROUPS)
    group = np.full(len(parent), GROUPS)
    roots = np.nonzero(inside == np.arange(len(parent)))[0]
    for root in roots[np.argsort(-total[roots], kind="stable")]:
        group[root] = int(np.argmin(loads))
        loads[group[root]] += total[root]
    group = np.where(inside >= 0, group[inside], GROUPS)
    return group, tuple(np.nonzero(group == g)[0] for g in range(GROUPS + 1))


def _subtrees(parent: Int[np.ndarray, "s"], work: Int[np.ndarray, "s"]) -> tuple[Int[np.ndarray, "s"], Int[np.ndarray, "s"]]:
    """Operations of the subtree of each supernode; the root of the largest light subtree it is in, -1 if it is in none."""
    above, total = parent.tolist(), work.tolist()
    for s, p in enumerate(above):
        if p >= 0:
            total[p] += total[s]
    most = SPLIT * int(work.sum())
    inside = [-1] * len(above)
    for s in range(len(above) - 1, -1, -1):
        if above[s] >= 0 and inside[above[s]] >= 0:
            inside[s] = inside[above[s]]
        elif total[s] <= most:
            inside[s] = s
    return np.array(total), np.array(inside)


def _stacks(parent: Int[np.ndarray, "s"], group: Int[np.ndarray, "s"], size: Int[np.ndarray, "s"]) -> tuple[Int[np.ndarray, "s"], int]:
    """Where each update starts, and the room for all: in each group those of even and of odd depth form two stacks."""
    above, groups, sizes = parent.tolist(), group.tolist(), size.tolist()
    stack, freed, start = [0] * len(above), [0] * len(above), [0] * len(above)
    top, peak = [0] * (2 * GROUPS + 2), [0] * (2 * GROUPS + 2)
    for s in range(len(above) - 1, -1, -1):
        stack[s] = 2 * groups[s] + (1 - stack[above[s]] % 2 if above[s] >= 0 else 0)
    for s, p in enumerate(above):
        k = stack[s]
        start[s] = top[k]
        top[k] += sizes[s]
        peak[k] = max(peak[k], top[k])
        top[k ^ 1] -= freed[s]
        if p >= 0 and groups[p] == groups[s]:
            freed[p] += sizes[s]
    return np.array(start) + from_counts(np.array(peak))[np.array(stack)], sum(peak)


@kernel
def _earlier(graph, order):  # type: ignore[no-untyped-def]
    """The neighbours of each place of the order that come before it."""
    place, starts = np.empty(len(order), np.int32), np.zeros(len(order) + 1, np.int32)
    for i in range(len(order)):
        place[order[i]] = i
    nodes = np.empty(len(graph.nodes) // 2, np.int32)
    n = 0
    for i in range(len(order)):
        for q in range(graph.starts[order[i]], graph.starts[order[i] + 1]):
            k = place[graph.nodes[q]]
            if k < i:
                nodes[n] = k
                n += 1
        starts[i + 1] = n
    return Graph(starts, nodes)


@kernel
def _elimination(earlier):  # type: ignore[no-untyped-def]
    """Parent of each node in the elimination tree, -1 for roots (Liu 1990)."""
    n = len(earlier.starts) - 1
    parent, ancestor = np.full(n, -1), np.full(n, -1)
    for i in range(n):
        for q in range(earlier.starts[i], earlier.starts[i + 1]):
            k = earlier.nodes[q]
            while k != -1 and k < i:
                above = ancestor[k]
                ancestor[k] = i
                if above == -1:
                    parent[k] = i
                k = above
    return parent


@kernel
def _postorder(parent):  # type: ignore[no-untyped-def]
    """The nodes of a forest, each after all of its subtree."""
    n = len(parent)
    child, sibling, order = np.full(n + 1, -1), np.full(n, -1), np.empty(n, np.int64)
    for v in range(n - 1, -1, -1):
        sibling[v] = child[parent[v]]  # roots are children of entry -1, the last
        child[parent[v]] = v
    stack, n_stack, n_done = np.empty(n, np.int64), 0, 0
    root = child[n]
    while root != -1:
        stack[0], n_stack = root, 1
        while n_stack > 0:
            v = stack[n_stack - 1]
            down = child[v]
            if down == -1:
                order[n_done] = v
                n_done += 1
                n_stack -= 1
            else:
                child[v] = sibling[down]
                stack[n_stack] = down
                n_stack += 1
        root = sibling[root]
    return order


@kernel
def _counts(earlier, parent, sizes):  # type: ignore[no-untyped-def]
    """Rows of each node's column of the factor, its own among them (row subtrees, Gilbert et al. 1994)."""
    counts, seen = np.zeros(len(parent), np.int64), np.full(len(parent), -1)
    for i in range(len(parent)):
        counts[i] += sizes[i]
        seen[i] = i
        for q in range(earlier.starts[i], earlier.starts[i + 1]):
            k = earlier.nodes[q]
            while seen[k] != i:
                seen[k] = i
                counts[k] += sizes[i]
                k = parent[k]
    return counts


@kernel
def _relax(parent, columns, below, entries, into):  # type: ignore[no-untyped-def]
    """Write the supernode that each one ends in, when children join their parents for few zeros; columns and entries follow."""
    for s in range(len(parent)):
        p = parent[s]
        if p >= 0:
            c = columns[s] + columns[p]
            total = c * (c + 1) // 2 + c * below[p]
            share = ZEROS_SMALL if c <= SMALL else ZEROS_MEDIUM if c <= MEDIUM else ZEROS_LARGE
            if total - entries[s] - entries[p] <= share * total:
                into[s], columns[p] = p, c
                entries[p] += entries[s]
    for s in range(len(parent) - 1, -1, -1):
        into[s] = into[into[s]]


@kernel
def _rows(earlier, supernode, parent, at, rows):  # type: ignore[no-untyped-def]
    """Write the rows below each supernode from place `at` on, ascending (or only count them, if there is no room); the places after."""
    seen = np.full(len(parent), -1)
    for i in range(len(supernode)):
        for q in range(earlier.starts[i], earlier.starts[i + 1]):
            s = supernode[earlier.nodes[q]]
            while s != supernode[i] and seen[s] != i:
                seen[s] = i
                if len(rows) > 0:
                    rows[at[s]] = i
                at[s] += 1
                s = parent[s]
    return at


@kernel
def _relative(tree):  # type: ignore[no-untyped-def]
    """Fill `relative`: the parent has every row of the child."""
    for p in range(len(tree.first) - 1):
        n_columns = tree.first[p + 1] - tree.first[p]
        for k in range(tree.child_start[p], tree.child_start[p + 1]):
            child, at = tree.children[k], tree.row_start[p]
            for q in range(tree.row_start[child], tree.row_start[child + 1]):
                row = tree.rows[q]
                if row < tree.first[p + 1]:
                    tree.relative[q] = row - tree.first[p]
                else:
                    while tree.rows[at] != row:
                        at += 1
                    tree.relative[q] = n_columns + at - tree.row_start[p]


@kernel
def _targets(low, high, owner, tree):  # type: ignore[no-untyped-def]
    """Place among the panels of the entry at column `low`, row `high`."""
    targets = np.empty(len(low), np.int64)
    for k in range(len(low)):
        s = owner[low[k]]
        begin, end = tree.row_start[s], tree.row_start[s + 1]
        n_columns, row = tree.first[s + 1] - tree.first[s], high[k] - tree.first[s]
        column = tree.panel[s] + (low[k] - tree.first[s]) * (n_columns + end - begin)
        if row >= n_columns:
            a, b = begin, end - 1
            while a < b:
                middle = (a + b) // 2
                if tree.rows[middle] < high[k]:
                    a = middle + 1
                else:
                    b = middle
            row = n_columns + a - begin
        targets[k] = column + row
    return targets
