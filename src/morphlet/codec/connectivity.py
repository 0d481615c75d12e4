"""The faces of any triangle mesh as a few bits each, vertices in an order of the coder's choosing.

A region grows over the mesh face by face. Its border is a set of closed chains of half-edges; the coder says for one of
them, the gate, what lies behind it: a face with a vertex not seen before, one that closes the gap to the border's half-edge
before or after the gate, one whose third vertex lies elsewhere on the border, or nothing. The gate then moves around its
tail until no gap is left there, and so the region grows in a spiral and most steps are of two kinds. Contexts are the numbers
of faces that the vertices around the gate have already. Only edges with one half-edge in each direction are crossed, so
boundaries, handles, parts, flipped faces and edges of many faces are all allowed. After Touma & Gotsman, Triangle mesh
compression, Graphics Interface 1998, and Gumhold & Strasser, Real time compression of triangle mesh connectivity, SIGGRAPH 1998.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, WRITES, code_bit, code_magnitude
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel

NEW, BEFORE, AFTER, SECOND, NOTHING, ELSEWHERE = range(6)
"""What lies behind a gate, in the order in which it is asked: SECOND is the border vertex before the one before."""

OPEN, CLOSED_OFF = -1, -2
"""Twins of half-edges whose other side is not known yet, and of those that have none."""

MOST = 9
"""Valences from here on share contexts."""
VALENCES = MOST + 1
PASTS = 16
SHAPES = 8
ASKED = 5
"""Decisions that name one of six."""
OWN_CONTEXTS = VALENCES**2 * SHAPES * PASTS
RING_CONTEXTS = VALENCES**3 * SHAPES
PLAN = OWN_CONTEXTS + 2 * RING_CONTEXTS
NEAR = 16
"""Border vertices on each side of the gate that are asked one by one for ELSEWHERE."""
MANY = 256
"""Half-edges at a vertex that are looked through for its place on the border."""
NEAR_CONTEXT = ASKED * PLAN
FAR_CONTEXT = NEAR_CONTEXT + 2 * NEAR
PLACE_CONTEXT = FAR_CONTEXT + SLOTS
SEED_CONTEXT = PLACE_CONTEXT + 2
CONTEXTS = SEED_CONTEXT + 1
NEAR_MIXER = ASKED * VALENCES
FAR_MIXER = NEAR_MIXER + 1
MIXERS = FAR_MIXER + SLOTS


class Border(NamedTuple):
    """The region that grows (numba type)."""

    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    following: Int[np.ndarray, "h"]
    before: Int[np.ndarray, "h"]
    link: Int[np.ndarray, "h"]
    out: Int[np.ndarray, "n"]
    valence: Int[np.ndarray, "n"]


class Plan(NamedTuple):
    """What the writer knows of the mesh, and how far it has come (numba type); all empty for the reader."""

    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    old: Int[np.ndarray, "h"]
    new: Int[np.ndarray, "h"]
    vertex: Int[np.ndarray, "n"]
    order: Int[np.ndarray, "n"]


def twins(corner: Int[np.ndarray, "h"], n: int) -> Int[np.ndarray, "h"]:
    """The opposite half-edge where an edge has exactly one in each direction, else -1."""
    twin = np.full(len(corner), OPEN, np.int64)
    _pair_up(np.ascontiguousarray(corner), np.full((4, n), -1, np.int64), np.empty((2, len(corner)), np.int64), twin)
    return twin


@inlined_kernel
def succ(h):  # half-edge after h in its face
    return h - 2 if h % 3 == 2 else h + 1


@inlined_kernel
def pred(h):  # half-edge before h in its face
    return h + 2 if h % 3 == 0 else h - 1


@kernel
def _pair_up(corner, ends, links, twin):  # ends (4, n): first half-edge out of and into a vertex, and how many; links (2, h)
    for h in range(corner.shape[0]):
        for side in range(2):
            v = corner[h] if side == 0 else corner[succ(h)]
            links[side, h], ends[side, v] = ends[side, v], h
            ends[2 + side, v] += 1
    for h in range(corner.shape[0]):
        a, b = corner[h], corner[succ(h)]
        few, many = (a, b) if ends[2, a] + ends[3, a] < ends[2, b] + ends[3, b] else (b, a)
        own = back = np.int64(0)
        found = np.int64(-1)
        for side in range(2):  # half-edges between both ends are found at the one that has fewer
            e = ends[side, few]
            while e >= 0:
                if (corner[succ(e)] if side == 0 else corner[e]) == many:
                    if corner[e] == a:
                        own += 1
                    else:
                        back, found = back + 1, e
                e = links[side, e]
        if own == 1 and back == 1 and a != b:
            twin[h] = found


@inner_kernel
def _what_is_behind(plan, h, border):  # (NEW .. ELSEWHERE, old half-edge across the gate, border half-edge out of its third vertex)
    nothing = np.int64(-1)
    t = plan.twin[plan.old[h]]
    if t < 0 or plan.new[t] >= 0:
        return NOTHING, t, nothing
    if plan.vertex[plan.corner[pred(t)]] < 0:
        return NEW, t, nothing
    before, after = plan.twin[succ(t)], plan.twin[pred(t)]
    if before >= 0 and plan.new[before] == border.before[h] and border.before[h] >= 0:
        return BEFORE, t, nothing
    if after >= 0 and plan.new[after] == border.following[h] and border.following[h] >= 0:
        return AFTER, t, nothing
    g = before
    while g >= 0 and plan.new[g] < 0:  # around the third vertex, to the first face that is known
        g = plan.twin[pred(g)]
        if g == before:  # all around: the vertex is known from another fan of faces
            return ELSEWHERE, t, nothing
    if g >= 0:
        return ELSEWHERE, t, plan.new[g]
    g = after
    while g >= 0 and plan.new[g] < 0:
        g = plan.twin[succ(g)]
    return ELSEWHERE, t, (border.following[plan.new[g]] if g >= 0 else nothing)


@inner_kernel
def _ask(coder, border, h, op, past):  # which of NEW .. ELSEWHERE
    a, b = border.corner[h], border.corner[succ(h)]
    r, l = border.before[h], border.following[h]
    back, ahead = border.twin[r] == OPEN, border.twin[l] == OPEN
    before, after = border.corner[r], border.corner[succ(l)]
    shape = (1 if before == after else 0) + (2 if back else 0) + (4 if ahead else 0)
    va, vb = min(border.valence[a], MOST), min(border.valence[b], MOST)
    vr, vl = min(border.valence[before], MOST), min(border.valence[after], MOST)
    c0 = ((va * VALENCES + vb) * SHAPES + shape) * PASTS + past
    c1 = OWN_CONTEXTS + ((va * VALENCES + vr) * VALENCES + vb) * SHAPES + shape
    c2 = OWN_CONTEXTS + RING_CONTEXTS + ((va * VALENCES + vl) * VALENCES + vr) * SHAPES + shape
    for q in range(ASKED):
        p = q * PLAN
        if code_bit(coder, np.int64(op != q), p + c0, p + c1, p + c2, q * VALENCES + va) == 0:
            return np.int64(q)
    return np.int64(ELSEWHERE)


@inner_kernel
def _near(coder, border, h, g):  # half-edge g of the border near the gate whose tail is the third vertex; -1: not here
    back, ahead = border.before[border.before[h]], border.following[border.following[h]]
    for k in range(2 * NEAR):
        if k % 2 == 0:
            ahead = border.following[ahead]
            candidate = ahead
        else:
            back = border.before[back]
            candidate = back
        valence = NEAR_CONTEXT + 2 * NEAR - 1 - min(border.valence[border.corner[candidate]], MOST)
        if code_bit(coder, np.int64(candidate != g), NEAR_CONTEXT + k, NEAR_CONTEXT + k, valence, NEAR_MIXER) == 0:
            return candidate
    return np.int64(-1)


@inner_kernel
def _number(coder, w, known):  # a vertex by its age
    f, m = FAR_CONTEXT, FAR_MIXER
    age = code_magnitude(coder, known - 1 - w, np.int64(0), f, f, f, m)
    if age >= known:
        coder.state[FAULT] = MALFORMED
        return np.int64(0)
    return known - 1 - age


@inner_kernel
def _far(coder, border, w, g, known):  # (vertex, its border half-edge; -1: it is not on the border, or its place is not told)
    w = _number(coder, w, known)
    e, k = border.out[w], 0
    while e >= 0 and k < MANY:
        if border.twin[e] < 0 and code_bit(coder, np.int64(e != g), PLACE_CONTEXT, PLACE_CONTEXT, PLACE_CONTEXT, NEAR_MIXER) == 0:
            return w, e
        e, k = border.link[e], k + 1
    return w, np.int64(-1)


@inlined_kernel
def _join(border, g, h):  # h follows g on the border
    border.following[g] = h
    border.before[h] = g


@inlined_kernel
def _pair(border, g, h):
    border.twin[g] = h
    border.twin[h] = g


@inlined_kernel
def _touch(border, h, v):  # half-edge h leaves v
    border.corner[h] = v
    border.valence[v] += 1
    border.link[h] = border.out[v]
    border.out[v] = h


@kernel
def conquer(coder, plan, border, stack, totals):  # totals (vertices, faces): most, and then how many; False: a fault, or no room
    writes = coder.state[WRITES] == 1
    n, m, room = totals[0], totals[1], border.corner.shape[0] // 3
    faces = known = top = scan = seed = past = np.int64(0)
    while faces < m:
        if faces >= room or coder.state[FAULT] > 0:
            totals[0], totals[1] = known, faces
            return False
        while writes and plan.new[3 * seed] >= 0:
            seed += 1
        h = 3 * faces
        for k in range(3):
            v = known
            if writes:
                old = plan.corner[3 * seed + k]
                v = plan.vertex[old] if plan.vertex[old] >= 0 else known
                plan.vertex[old], plan.order[v] = v, old
                plan.old[h + k], plan.new[3 * seed + k] = 3 * seed + k, h + k
            if code_bit(coder, np.int64(v < known), SEED_CONTEXT, SEED_CONTEXT, SEED_CONTEXT, NEAR_MIXER) == 1:
                v = _number(coder, v, known)
            elif known >= n:
                coder.state[FAULT] = MALFORMED
                return False
            else:
                v, known = known, known + 1
            _touch(border, h + k, v)
            _join(border, pred(h + k), h + k)
            border.twin[h + k] = OPEN
        faces += 1
        while faces < m:
            if h < 0 or border.twin[h] != OPEN:
                h = np.int64(-1)
                while top > 0 and h < 0:
                    top -= 1
                    h = stack[top] if border.twin[stack[top]] == OPEN else h
                while h < 0 and scan < 3 * faces:
                    h = scan if border.twin[scan] == OPEN else h
                    scan += 1
                if h < 0:
                    break
            if faces >= room or coder.state[FAULT] > 0:
                totals[0], totals[1] = known, faces
                return False
            op = np.int64(0)
            t = g = w = np.int64(-1)
            r, l = border.before[h], border.following[h]
            second = border.before[r]
            if writes:
                op, t, g = _what_is_behind(plan, h, border)
                w = plan.vertex[plan.corner[pred(t)]] if t >= 0 else w
                g = np.int64(-1) if g in (h, l) else g
                op = np.int64(SECOND) if op == ELSEWHERE and g >= 0 and g == second else op
            op = _ask(coder, border, h, op, past)
            past = (4 * past + min(op, 3)) & (PASTS - 1)
            if op == NOTHING:
                border.twin[h] = CLOSED_OFF
                h = r
                continue
            if op == NEW:
                w, known = known, known + 1
            elif op == BEFORE:
                w = border.corner[r]
            elif op == AFTER:
                w = border.corner[succ(l)]
            elif op == SECOND:
                g = second
            else:
                near = _near(coder, border, h, g)
                if near >= 0:
                    g = near
                else:
                    w, g = _far(coder, border, w, g, known)
            wrong = known > n or (op == BEFORE and border.twin[r] != OPEN) or (op == AFTER and border.twin[l] != OPEN)
            if wrong or (op >= SECOND and g in (h, l)):
                coder.state[FAULT] = MALFORMED
                return False
            w = border.corner[g] if g >= 0 else w
            a, b, f = border.corner[h], border.corner[succ(h)], 3 * faces
            _touch(border, f, b)
            _touch(border, f + 1, a)
            _touch(border, f + 2, w)
            _pair(border, h, f)
            border.twin[f + 1] = border.twin[f + 2] = OPEN
            faces += 1
            if writes:
                plan.vertex[plan.corner[pred(t)]], plan.order[w] = w, plan.corner[pred(t)]
                plan.old[f], plan.old[f + 1], plan.old[f + 2] = t, succ(t), pred(t)
                plan.new[t], plan.new[succ(t)], plan.new[pred(t)] = f, f + 1, f + 2
            if op == BEFORE:
                _pair(border, f + 1, r)
                if second == l and border.twin[l] == OPEN and border.corner[succ(l)] == w:
                    _pair(border, f + 2, l)
                    h = np.int64(-1)
                else:
                    _join(border, second, f + 2)
                    _join(border, f + 2, l)
                    h = f + 2
            elif op == AFTER:
                _pair(border, f + 2, l)
                _join(border, f + 1, border.following[l])
                _join(border, r, f + 1)
                h = f + 1
            elif g >= 0:
                e = border.before[g]
                _join(border, r, f + 1)
                _join(border, e, f + 2)
                _join(border, f + 1, g)
                _join(border, f + 2, l)
                h = f + 1
                stack[top], top = f + 2, top + 1
            else:
                _join(border, r, f + 1)
                _join(border, f + 1, f + 2)
                _join(border, f + 2, l)
                h = f + 1
    totals[0], totals[1] = known, faces
    return coder.state[FAULT] == 0
