"""As-rigid-as-possible editing: its minimum against the whole mesh's, its options, what may go wrong."""

import numpy as np
import pytest

from editing.capped import capped, covariances, moved, patch_of_grid, whole_energy
from morphlet import Cancelled, InputError, Mesh, MeshError
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor, edit
from morphlet.editing.method import Pull
from morphlet.editing.roi import Roi
from morphlet.numerics.optimize import Step
from morphlet.surface.operators import laplacian
from support import beside, blob, tetrahedron

BEND = {"turn": [0.9, 0.4, 0.2], "shift": [0.5, -0.2, 0.4]}
EXACT = Arap(iterations=400, tolerance=0.0)


def pulled(roi: Roi) -> np.ndarray:
    return moved(roi.mesh.vertices[roi.handle], **BEND)


def by_the_book(roi: Roi, start: Mesh, iterations: int) -> np.ndarray:
    """Plain local and global steps on the whole mesh, with dense matrices and singular values."""
    mesh, U = roi.mesh, np.array(start.vertices)
    L = laplacian(mesh).toarray()
    for _ in range(iterations):
        u, _, vt = np.linalg.svd(covariances(mesh, U))
        R = np.array([(b.T * [1, 1, np.linalg.det(a @ b)]) @ a.T for a, b in zip(u, vt, strict=True)])
        right = np.zeros_like(U)
        for face in mesh.faces:
            M, V = R[face].mean(axis=0), mesh.vertices[face]
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                a, b = V[i] - V[k], V[j] - V[k]
                g = 0.5 * (a @ b) / np.linalg.norm(np.cross(a, b)) * M @ (V[i] - V[j])
                right[face[i]] += g
                right[face[j]] -= g
        f = roi.free
        U[f] += np.linalg.solve(L[np.ix_(f, f)], (right - L @ U)[f])
    return U


def test_plain_iterations_are_those_of_the_book():
    roi = capped(blob(2))
    start = edit(roi, pulled(roi), Arap(iterations=1))
    editor = RoiEditor.prepare(roi, Arap(iterations=5, tolerance=0.0, anderson=0))
    found = editor.solve(pulled(roi), start=start.vertices[roi.moving])
    np.testing.assert_allclose(found.vertices, by_the_book(roi, start, 5), atol=1e-6)


def test_acceleration_ends_where_plain_iterations_do():
    roi = capped(blob(1))
    fast = edit(roi, pulled(roi), EXACT)
    slow = by_the_book(roi, edit(roi, pulled(roi), Arap(iterations=3)), 80)
    np.testing.assert_allclose(whole_energy(roi.mesh, fast.vertices), whole_energy(roi.mesh, slow), rtol=1e-6)
    np.testing.assert_allclose(fast.vertices, slow, atol=1e-3)


@pytest.mark.parametrize("smoothing", [0.0, 0.01])
@pytest.mark.parametrize("least", [-np.inf, 0.05])
@pytest.mark.parametrize("anderson", [0, 5])
def test_energy_never_rises(smoothing, least, anderson):
    roi, energies = capped(blob(2)), []
    edit_told = RoiEditor.prepare(roi, Arap(60, 0.0, anderson, smoothing, least))
    edit_told.solve(pulled(roi), on_step=lambda step: energies.append(step.objective))
    assert len(energies) > 5
    assert np.all(np.diff(energies) <= 1e-12 * energies[0])


def test_told_energy_is_that_of_the_whole_mesh():
    roi, steps = capped(blob(2)), []
    RoiEditor.prepare(roi, Arap(3, 0.0)).solve(pulled(roi), on_step=steps.append)
    start = edit(roi, pulled(roi), Arap(2, 0.0))
    assert [step.iteration for step in steps] == [0, 1, 2]
    assert steps[-1].progress == 1.0
    after = []
    RoiEditor.prepare(roi, Arap(1)).solve(pulled(roi), start=start.vertices[roi.moving], on_step=after.append)
    np.testing.assert_allclose(after[0].objective, whole_energy(roi.mesh, start.vertices), rtol=1e-10)


def tube(rings: int = 31, around: int = 12) -> Mesh:
    """An open tube of radius 0.5 and length 3."""
    k, turn = np.repeat(np.arange(rings), around), np.tile(2 * np.pi * np.arange(around) / around, rings)
    a = np.arange((rings - 1) * around)
    b = a - a % around + (a + 1) % around
    faces = np.vstack([np.stack([a, b, b + around], axis=1), np.stack([a, b + around, a + around], axis=1)])
    return Mesh(np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), 3 * k / (rings - 1)], axis=1), faces)


@pytest.mark.parametrize("smoothing", [2e-3, 2e-2, 0.1])
def test_smoothed_edits_stop_near_the_minimum(smoothing):
    """On a tube that is twisted, rotations settle slowly and promise little per solve: they are waited for."""
    mesh = tube()
    z = mesh.vertices[:, 2]
    roi = Roi(mesh, np.nonzero(z > 2.7)[0], np.nonzero((z >= 0.3) & (z <= 2.7))[0])
    targets = moved(mesh.vertices[roi.handle], [0, 0, 2.3], [0, 0, 0])
    told: dict[Arap, list[float]] = {Arap(smoothing=smoothing): [], Arap(600, 0.0, smoothing=smoothing): []}
    for method, energies in told.items():
        RoiEditor.prepare(roi, method).solve(targets, on_step=lambda step, kept=energies: kept.append(step.objective))
    by_itself, at_last = told.values()
    assert len(by_itself) < 50
    assert by_itself[-1] <= 1.001 * at_last[-1]


def test_smoothing_draws_rotations_together():
    roi = capped(blob(2))
    spread = []
    for smoothing in (0.0, 0.001, 0.1):
        found = edit(roi, pulled(roi), Arap(200, 0.0, smoothing=smoothing))
        u, _, vt = np.linalg.svd(covariances(roi.mesh, found.vertices))
        R = np.swapaxes(u @ vt, 1, 2)
        i, j = roi.mesh.topology.edges.T
        spread.append(np.sum((R[i] - R[j]) ** 2))
    assert spread[0] > 1.1 * spread[1] > 1.1 * spread[2]


def test_clamped_cotangents_have_a_minimum_of_their_own():
    roi = capped(blob(2))
    raised, plain = (edit(roi, pulled(roi), Arap(300, 0.0, least_cotangent=least)) for least in (0.25, -np.inf))
    assert whole_energy(roi.mesh, raised.vertices, 0.25) < whole_energy(roi.mesh, plain.vertices, 0.25)
    assert whole_energy(roi.mesh, raised.vertices) > whole_energy(roi.mesh, plain.vertices)


def test_stiff_handles_are_hard_ones():
    hard, soft = capped(blob(2)), capped(blob(2), weight=1e7)
    a, b = (edit(roi, pulled(roi), EXACT).vertices for roi in (hard, soft))
    np.testing.assert_allclose(a, b, atol=1e-5)


def test_soft_handles_balance():
    """At the minimum the pull of the springs is the energy's slope: moving a handle vertex either way costs the same."""
    roi = capped(blob(1), weight=0.5)
    targets = pulled(roi)
    found = np.array(edit(roi, targets, EXACT).vertices)
    assert np.linalg.norm(found[roi.handle] - targets, axis=1).max() > 1e-3
    stiffness = 0.5 * laplacian(roi.mesh).diagonal()[roi.handle]

    def total(positions: np.ndarray) -> float:
        return whole_energy(roi.mesh, positions) + float(stiffness @ np.sum((positions[roi.handle] - targets) ** 2, axis=1))

    for vertex in (roi.handle[0], roi.free[0]):
        for axis in range(3):
            sides = []
            for sign in (1, -1):
                other = found.copy()
                other[vertex, axis] += sign * 1e-4
                sides.append(total(other))
            assert abs(sides[0] - sides[1]) / 2e-4 < 1e-4 * total(found)


def test_soft_handles_keep_the_answers_order():
    """Some hard, some soft: hard ones are at their targets exactly."""
    roi = capped(blob(2))
    weight = np.where(np.arange(len(roi.handle)) % 2, np.inf, 1.0)
    mixed = Roi(roi.mesh, roi.handle, roi.free, weight)
    found = edit(mixed, pulled(roi)).vertices
    np.testing.assert_array_equal(found[roi.handle[1::2]], pulled(roi)[1::2])
    assert np.all(found[roi.handle[::2]] != pulled(roi)[::2])


def test_half_turns_go_the_way_they_are_told():
    """Targets alone cannot tell a half turn from the opposite one; the side the free vertices pass on can."""
    tube = blob(2).with_vertices(blob(2).vertices * [0.4, 0.4, 2.0])
    roi = capped(tube)
    targets = moved(tube.vertices[roi.handle], [0, 0, np.pi], [0, 0, 0])
    editor = RoiEditor.prepare(roi, Arap(30))
    ways = [editor.solve(targets, turns=[[0, 0, sign * np.pi]]).vertices for sign in (1, -1)]
    middle = roi.free[np.argsort(np.abs(tube.vertices[roi.free, 2]))[:40]]
    turned = [np.cross(tube.vertices[middle], way[middle])[:, 2].sum() for way in ways]
    assert turned[0] > 0 > turned[1]


def test_nothing_free():
    roi = Roi(tetrahedron(), [0, 1, 2, 3], [])
    assert edit(roi, tetrahedron().vertices + 1.0).vertices.tolist() == (tetrahedron().vertices + 1.0).tolist()


def test_all_free_but_one_handle_vertex():
    """Nothing else holds the mesh: it goes along."""
    mesh = blob(1)
    roi, shift = Roi(mesh, [5], np.delete(np.arange(mesh.n_vertices), 5)), np.array([1.0, 2.0, 3.0])
    found = edit(roi, mesh.vertices[[5]] + shift)
    np.testing.assert_allclose(found.vertices, mesh.vertices + shift, atol=1e-10)


@pytest.mark.parametrize("handle", [[40], [40, 41], [40, 200]])
def test_few_handle_vertices(handle):
    """One, or a line: finite, at the targets, and lower than the start."""
    base = capped(blob(2))
    handle = base.free[handle[: len(handle)]] if max(handle) < len(base.free) else base.free[[4, 50]]
    roi = Roi(base.mesh, handle, np.setdiff1d(base.free, handle))
    energies = []
    targets = base.mesh.vertices[handle] + [0.3, 0.1, 0.2]
    found = RoiEditor.prepare(roi).solve(targets, on_step=lambda step: energies.append(step.objective))
    np.testing.assert_array_equal(found.vertices[handle], targets)
    assert np.isfinite(found.vertices).all()
    assert energies[-1] <= energies[0]


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_size_does_not_matter(scale):
    mesh = blob(2)
    large = mesh.with_vertices(scale * mesh.vertices)
    roi = capped(mesh)
    expected, found = edit(roi, pulled(roi)), edit(capped(large), scale * pulled(roi))
    np.testing.assert_allclose(found.vertices / scale, expected.vertices, atol=1e-6)


def test_region_at_the_boundary():
    mesh = patch_of_grid(8)
    roi = Roi(mesh, [0, 1, 8, 9], [v for v in range(64) if v % 8 < 6 and v // 8 < 6 and v not in (0, 1, 8, 9)])
    found = edit(roi, mesh.vertices[roi.handle] + [0, 0, 1.5])
    assert np.isfinite(found.vertices).all()
    assert whole_energy(mesh, found.vertices) < 0.5 * whole_energy(
        mesh, np.where(np.isin(np.arange(64), roi.handle)[:, None], found.vertices, mesh.vertices)
    )


def test_flat_and_doubled_faces_do_not_spoil_the_rest():
    """A vertex laid on its neighbour, one on an edge, and a face twice: stiff, but finite."""
    base = blob(2)
    roi = capped(base)
    vertices, faces = np.array(base.vertices), np.array(base.faces)
    inner = [f for f in range(len(faces)) if np.isin(faces[f], roi.free).all()]
    a, b, _ = faces[inner[10]]
    vertices[a] = vertices[b]
    d, e, f = faces[inner[60]]
    vertices[d] = 0.5 * (vertices[e] + vertices[f])
    bad = Mesh(vertices, np.vstack([faces, faces[inner[20:21]]]))
    energies = []
    found = RoiEditor.prepare(Roi(bad, roi.handle, roi.free)).solve(pulled(roi), on_step=lambda step: energies.append(step.objective))
    assert np.isfinite(found.vertices).all()
    assert energies[-1] < energies[0]
    assert np.linalg.norm(found.vertices[a] - found.vertices[b]) < 1e-3


def test_loose_pieces_are_refused():
    two = beside(tetrahedron(), blob(1))
    with pytest.raises(MeshError, match="joined to the handle or to anchors; found 4 that are not") as caught:
        RoiEditor.prepare(Roi(two, [10], [0, 1, 2, 3, 11, 12]))
    assert caught.value.elements == [0, 1, 2, 3]


def test_loose_vertices_are_refused_or_stay():
    loose = Mesh(np.vstack([tetrahedron().vertices, [[5, 5, 5]]]), tetrahedron().faces)
    with pytest.raises(MeshError, match="found 1 that are not"):
        RoiEditor.prepare(Roi(loose, [0], [1, 4]))
    assert edit(Roi(loose, [0, 4], [1]), [[0, 0, 0], [6, 6, 6]]).vertices[4].tolist() == [6, 6, 6]


def test_points_for_faces_are_refused():
    with pytest.raises(MeshError, match="2 in single points only") as caught:
        RoiEditor.prepare(Roi(Mesh(np.zeros((4, 3)), tetrahedron().faces), [0], [1, 2]))
    assert caught.value.elements == [1, 2]


@pytest.mark.parametrize(
    "options",
    [{"iterations": 0}, {"tolerance": -1.0}, {"tolerance": np.nan}, {"anderson": -1}, {"smoothing": -0.1}, {"smoothing": np.inf}],
)
def test_options_that_make_no_sense(options):
    with pytest.raises(InputError, match="at least 1 iteration"):
        Arap(**options)


@pytest.mark.parametrize(
    ("pull", "match"),
    [
        (lambda t: Pull(t[:-1]), r"targets of shape"),
        (lambda t: Pull(np.where(np.arange(len(t))[:, None] == 2, np.nan, t)), "finite numbers in targets"),
        (lambda t: Pull(t, turns=np.zeros((2, 3))), r"turns of shape \(1, 3\)"),
        (lambda t: Pull(t, start=np.zeros((3, 3))), r"start of shape"),
        (lambda t: Pull(t, start=np.full((135, 3), np.inf)), "start"),
    ],
)
def test_pulls_that_do_not_fit(pull, match):
    roi = capped(blob(2))
    with pytest.raises(InputError, match=match):
        RoiEditor.prepare(roi).positions(pull(pulled(roi)))


def test_a_caller_may_stop_it():
    def stop(step: Step) -> None:
        if step.iteration == 1:
            raise Cancelled()

    roi = capped(blob(1))
    with pytest.raises(Cancelled):
        RoiEditor.prepare(roi).solve(pulled(roi), on_step=stop)


def test_tolerance_stops_early():
    roi, counts = capped(blob(2)), []
    for tolerance in (1e-2, 1e-4, 1e-7):
        steps = []
        RoiEditor.prepare(roi, Arap(tolerance=tolerance)).solve(pulled(roi), on_step=steps.append)
        counts.append(len(steps))
    assert counts[0] < counts[1] < counts[2] < 100
