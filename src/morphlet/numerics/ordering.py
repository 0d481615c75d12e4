"""An elimination order with little fill: nested dissection of a graph along coordinates of its nodes.

A graph is `starts` (n+1,), `nodes`: the neighbours of v are `nodes[starts[v]:starts[v + 1]]`, without v itself. A part is
cut across whichever coordinate cuts fewest edges for its balance; the ends of the cut edges on one side separate it, and local
moves thin that separator (Fiduccia & Mattheyses 1982, on nodes as Hendrickson & Rothberg 1998). Small parts are ordered
by minimum degree, counting the separators around them. Arrays only; nothing here knows meshes or matrices.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int32

from morphlet.numerics.compiled import njit

LEAF = 120
"""Nodes of a part that is not cut further: minimum degree orders it better than cutting, until its dense table gets slow."""

HUB = 16.0
"""A node with more neighbours than this times sqrt(n) comes last: it belongs to no part."""

FAIR = 0.3
"""Least share of a part on one side of its first cut."""

BINS = 128
"""Levels tried along a coordinate."""

BALANCE = 0.62
"""Largest share of a part on one side of its separator."""

ELIMINATED = 2**62
"""Degree of a node that is gone."""

PATIENCE = 60
"""Moves without gain after which a pass of thinning gives up."""

PASSES = 3
"""Passes of thinning per separator: the third rarely finds anything."""

OUTSIDE, LOW, HIGH, CUT, LOGGED = 0, 1, 2, 3, 4
"""Sides of a node; in a tally, how many are on each, and how many moves are logged."""

SIDE, N_LOW, N_HIGH, MOVED = 0, 1, 2, 3
"""Columns of the state (n, 4) of the nodes: its side, its neighbours on either side, whether it moved."""

SEPARATOR, LOG = 0, 1
"""Rows of the lists (2, n): the nodes of the separator; moves, as 4 v + the side v had."""

SWEEPS = 3
"""Coordinates found by breadth-first sweeps inside a part: the distances from two far ends, and their difference."""


OUTER = njit(cache=True, error_model="numpy")
"""Kernels called from Python."""

INNER = njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Kernels called by kernels: without wrappers they compile in three quarters of the time."""


class Graph(NamedTuple):
    """Neighbours of each node, in one array; int32, since walks over it wait for memory."""

    starts: Int32[np.ndarray, "n1"]
    nodes: Int32[np.ndarray, "e2"]


def dissection(graph: Graph, points: Float[np.ndarray, "n 3"] | None) -> Int[np.ndarray, "n"]:
    """Nodes in the order of their elimination.

    Parameters
    ----------
    graph
        Neighbours of each node; symmetric.
    points
        Positions to cut along; breadth-first distances alone if there are none.

    Returns
    -------
    order
        A permutation of the nodes.

    Notes
    -----
    O(n log n) on graphs with small separators.

    References
    ----------
    A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973) 345-363.
    B. Hendrickson, E. Rothberg, Improving the run time and quality of nested dissection ordering, SIAM J. Sci. Comput. 20
    (1998) 468-489.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.ordering import Graph, dissection
    >>> star = Graph(np.array([0, 3, 4, 5, 6], np.int32), np.array([1, 2, 3, 0, 0, 0], np.int32))
    >>> dissection(star, None).tolist()
    [1, 2, 0, 3]
    """
    n = len(graph.starts) - 1
    degree = np.diff(graph.starts)
    hubs = degree > HUB * np.sqrt(n)
    order = np.argsort(np.where(hubs, degree, 0), kind="stable")
    n_parted = n - int(hubs.sum())
    coordinates = np.zeros((SWEEPS, n)) if points is None else np.concatenate([np.zeros((SWEEPS, n)), points.T])
    _dissect(graph, coordinates, order, n_parted)
    return order


def _dissect(graph: Graph, coordinates: Float[np.ndarray, "c n"], order: Int[np.ndarray, "n"], n_parted: int) -> None:
    """Reorder the first n_parted of order in place: low part, high part, separator, each part likewise."""
    n = len(order)
    state, lists = np.zeros((n, 4), np.int32), np.zeros((2, n), np.int64)
    todo = [(0, n_parted)]
    while todo:
        begin, end = todo.pop()
        part = order[begin:end]
        if end - begin <= LEAF:
            _minimum_degree(graph, part, state)
            continue
        tally = _cut(graph, coordinates, part, state, lists)
        _thin(graph, part, state, lists, tally)
        _sort_sides(part, state, tally)
        low, high = begin + int(tally[LOW]), begin + int(tally[LOW] + tally[HIGH])
        if begin < low < high:
            todo += [(begin, low), (low, high)]
        else:
            order[begin:end] = part[np.argsort(np.diff(graph.starts)[part], kind="stable")]


@OUTER
def _cut(graph, coordinates, part, state, lists):  # type: ignore[no-untyped-def]
    """Label the part low and high across its best coordinate, or its pieces; the tally, all low if no cut is fair."""
    tally = np.zeros(5, np.int64)
    tally[LOW] = _pieces(graph, part, state, lists[SEPARATOR])
    if tally[LOW] == len(part):
        _sweeps(graph, coordinates, part, lists[SEPARATOR])
        best, best_axis, best_level = np.inf, -1, 0.0
        for axis in range(len(coordinates)):
            cost, level = _best_level(graph, coordinates[axis], part, state)
            if cost < best:
                best, best_axis, best_level = cost, axis, level
        if best_axis >= 0:
            for v in part:
                if coordinates[best_axis, v] > best_level:
                    state[v, SIDE] = HIGH
                    tally[LOW] -= 1
    tally[HIGH] = len(part) - tally[LOW]
    return tally


@INNER
def _pieces(graph, part, state, queue):  # type: ignore[no-untyped-def]
    """Label low whole connected pieces until they hold half of the part, the rest high; how many are low."""
    for v in part:
        state[v, SIDE] = HIGH
    head = tail = 0
    for first in part:
        if 2 * tail >= len(part):
            break
        if state[first, SIDE] == HIGH:
            state[first, SIDE] = LOW
            queue[tail] = first
            tail += 1
        while head < tail:
            v = queue[head]
            head += 1
            for q in range(graph.starts[v], graph.starts[v + 1]):
                if state[graph.nodes[q], SIDE] == HIGH:
                    state[graph.nodes[q], SIDE] = LOW
                    queue[tail] = graph.nodes[q]
                    tail += 1
    return tail


@INNER
def _best_level(graph, x, part, state):  # type: ignore[no-untyped-def]
    """The level of x that cuts fewest edges for the balance of its sides, and its cost; infinite if every cut is unfair."""
    low, high = x[part[0]], x[part[0]]
    for v in part:
        low, high = min(low, x[v]), max(high, x[v])
    scale = BINS / (high - low) if high > low else 0.0
    count, cuts = np.zeros(BINS + 1, np.int64), np.zeros(BINS + 1, np.int64)
    for v in part:
        at = int((x[v] - low) * scale)
        count[at] += 1
        for q in range(graph.starts[v], graph.starts[v + 1]):
            u = graph.nodes[q]
            if x[u] > x[v] and state[u, SIDE] != OUTSIDE:
                cuts[at] += 1
                cuts[int((x[u] - low) * scale)] -= 1
    best, level, n_low, n_cut = np.inf, low, 0, 0
    for at in range(BINS):
        n_low += count[at]
        n_cut += cuts[at]
        n_high = len(part) - n_low
        if min(n_low, n_high) >= FAIR * len(part) and n_cut < best * n_low * n_high:
            best, level = n_cut / (n_low * n_high), low + (at + 1) / scale
    return best, level


@OUTER
def _sort_sides(part, state, tally):  # type: ignore[no-untyped-def]
    """Low nodes first, then high ones, then the separator, each in their old order; their sides are cleared."""
    old = part.copy()
    at = np.zeros(4, np.int64)
    at[HIGH], at[CUT] = tally[LOW], tally[LOW] + tally[HIGH]
    for v in old:
        side = state[v, SIDE]
        part[at[side]] = v
        at[side] += 1
        state[v, SIDE] = OUTSIDE


@INNER
def _sweeps(graph, coordinates, part, queue):  # type: ignore[no-untyped-def]
    """Breadth-first distances within the connected part, whose last reached node ends the queue: the first rows of its coordinates."""
    queue[0] = queue[len(part) - 1]
    queue[0] = _sweep(graph, coordinates[0], part, queue)
    _sweep(graph, coordinates[1], part, queue)
    for v in part:
        coordinates[2, v] = coordinates[0, v] - coordinates[1, v]


@INNER
def _sweep(graph, distance, part, queue):  # type: ignore[no-untyped-def]
    """Edges from the first node of the queue, within the connected part; distances outside it are not negative. The last node."""
    for v in part:
        distance[v] = -1.0
    distance[queue[0]] = 0.0
    head, tail = 0, 1
    while head < tail:
        v = queue[head]
        head += 1
        for q in range(graph.starts[v], graph.starts[v + 1]):
            u = graph.nodes[q]
            if distance[u] < 0.0:
                distance[u] = distance[v] + 1.0
                queue[tail] = u
                tail += 1
    return queue[tail - 1]


@OUTER
def _thin(graph, part, state, lists, tally):  # type: ignore[no-untyped-def]
    """Turn the shorter side of the cut into a separator, then move nodes out of it while it shrinks."""
    low_ends = high_ends = 0
    for v in part:
        _count(graph, v, state)
        low_ends += state[v, SIDE] == LOW and state[v, N_HIGH] > 0
        high_ends += state[v, SIDE] == HIGH and state[v, N_LOW] > 0
    shorter, across = (LOW, N_HIGH) if low_ends <= high_ends else (HIGH, N_LOW)
    for v in part:
        if state[v, SIDE] == shorter and state[v, across] > 0:
            lists[SEPARATOR, tally[CUT]] = v
            tally[CUT] += 1
    for k in range(tally[CUT]):
        state[lists[SEPARATOR, k], SIDE] = CUT
    tally[shorter] -= tally[CUT]
    for _ in range(PASSES if tally[CUT] > 0 else 0):
        before = tally[CUT]
        _pass(graph, state, lists, tally)
        if tally[CUT] == before:
            break


@INNER
def _count(graph, v, state):  # type: ignore[no-untyped-def]
    """Neighbours of v on the low and on the high side."""
    low = high = 0
    for q in range(graph.starts[v], graph.starts[v + 1]):
        s = state[graph.nodes[q], SIDE]
        low += s == LOW
        high += s == HIGH
    state[v, N_LOW] = low
    state[v, N_HIGH] = high


@INNER
def _pass(graph, state, lists, tally):  # type: ignore[no-untyped-def]
    """One sequence of best moves out of the separator, undone back to its thinnest state."""
    kept = waited = 0
    tally[LOGGED] = 0
    for k in range(tally[CUT]):
        _count(graph, lists[SEPARATOR, k], state)
    thinnest, evenest = tally[CUT], abs(tally[LOW] - tally[HIGH])
    while waited < PATIENCE:
        at, to = _best_move(state, lists, tally)
        v = lists[SEPARATOR, at]
        if at < 0 or tally[LOGGED] + graph.starts[v + 1] - graph.starts[v] >= lists.shape[1]:
            break
        _move(graph, state, lists, tally, (at, to))
        waited += 1
        uneven = abs(tally[LOW] - tally[HIGH])
        if tally[CUT] < thinnest or (tally[CUT] == thinnest and uneven < evenest):
            thinnest, evenest, kept, waited = tally[CUT], uneven, tally[LOGGED], 0
    _undo(state, lists, tally, kept)


@INNER
def _best_move(state, lists, tally):  # type: ignore[no-untyped-def]
    """Place in the separator of the node that draws fewest others into it, towards the smaller side if equal; -1 if none may."""
    total = tally[LOW] + tally[HIGH] + tally[CUT]
    best, best_at, best_to = total * total, -1, LOW
    may_low, may_high = tally[LOW] + 1 <= BALANCE * total, tally[HIGH] + 1 <= BALANCE * total
    for at in range(tally[CUT]):
        v = lists[SEPARATOR, at]
        if state[v, MOVED] == 0:
            low, high = state[v, N_HIGH] * total + tally[LOW], state[v, N_LOW] * total + tally[HIGH]
            if may_low and low < best:
                best, best_at, best_to = low, at, LOW
            if may_high and high < best:
                best, best_at, best_to = high, at, HIGH
    return best_at, best_to


@INNER
def _move(graph, state, lists, tally, move):  # type: ignore[no-untyped-def]
    """Take a node out of the separator; its neighbours across come in."""
    at, to = move
    v, across = lists[SEPARATOR, at], LOW + HIGH - to
    tally[CUT] -= 1
    tally[to] += 1
    lists[SEPARATOR, at] = lists[SEPARATOR, tally[CUT]]
    state[v, SIDE], state[v, MOVED] = to, 1
    lists[LOG, tally[LOGGED]] = 4 * v + CUT
    tally[LOGGED] += 1
    for q in range(graph.starts[v], graph.starts[v + 1]):
        u = graph.nodes[q]
        if state[u, SIDE] == across:
            state[u, SIDE] = CUT
            lists[LOG, tally[LOGGED]] = 4 * u + across
            lists[SEPARATOR, tally[CUT]] = u
            tally[across] -= 1
            tally[LOGGED] += 1
            tally[CUT] += 1
            for r in range(graph.starts[u], graph.starts[u + 1]):
                if state[graph.nodes[r], SIDE] == CUT:
                    _count(graph, graph.nodes[r], state)
    for q in range(graph.starts[v], graph.starts[v + 1]):
        if state[graph.nodes[q], SIDE] == CUT:
            _count(graph, graph.nodes[q], state)


@INNER
def _undo(state, lists, tally, kept):  # type: ignore[no-untyped-def]
    """Take back the moves after the first `kept` entries of the log; list the separator anew and forget who moved."""
    n_listed, n_logged = tally[CUT], tally[LOGGED]
    for k in range(n_logged - 1, -1, -1):
        v, s = lists[LOG, k] // 4, lists[LOG, k] % 4
        state[v, MOVED] = 0
        if k >= kept:
            tally[state[v, SIDE]] -= 1
            tally[s] += 1
            state[v, SIDE] = s
    n_cut = 0
    for k in range(n_listed + n_logged):
        v = lists[SEPARATOR, k] if k < n_listed else lists[LOG, k - n_listed] // 4
        if state[v, SIDE] == CUT and state[v, MOVED] == 0:
            state[v, MOVED] = 1
            lists[SEPARATOR, n_cut] = v
            n_cut += 1
    for k in range(n_cut):
        state[lists[SEPARATOR, k], MOVED] = 0


@OUTER
def _minimum_degree(graph, part, state):  # type: ignore[no-untyped-def]
    """Sort the part by least degree, counting the nodes around it; column MOVED is zero before and after."""
    m = len(part)
    around = m
    for i in range(m):
        state[part[i], MOVED] = i + 1
    for v in part:
        for q in range(graph.starts[v], graph.starts[v + 1]):
            if state[graph.nodes[q], MOVED] == 0:
                around += 1
                state[graph.nodes[q], MOVED] = around
    table = np.zeros((m, around), np.uint8)
    degree = np.zeros(m, np.int64)
    for i in range(m):
        for q in range(graph.starts[part[i]], graph.starts[part[i] + 1]):
            table[i, state[graph.nodes[q], MOVED] - 1] = 1
            degree[i] += 1
    for v in part:
        state[v, MOVED] = 0
        for q in range(graph.starts[v], graph.starts[v + 1]):
            state[graph.nodes[q], MOVED] = 0
    nodes = part.copy()
    for k in range(m):
        part[k] = nodes[_eliminate(table, degree)]


@INNER
def _eliminate(table, degree):  # type: ignore[no-untyped-def]
    """Join the neighbours of the node of least degree, first in order; its degree becomes the largest number."""
    i = 0
    for j in range(len(degree)):
        if degree[j] < degree[i]:
            i = j
    degree[i] = ELIMINATED
    for j in range(len(table)):
        if table[i, j]:
            total = 0
            for c in range(table.shape[1]):
                joined = table[j, c] | table[i, c]
                table[j, c] = joined
                total += joined
            table[j, i] = table[j, j] = 0
            degree[j] = total - 2
    return i
