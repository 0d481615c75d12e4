"""Laws of paths, on a small body and on a public horse: ends, straight lines, the way back, turned shapes, monotone bands, transfers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Bands, Mesh, Morph, Schedule, TransferSolver, pair_faces, sweep, transfer, wavelet_bands
from morphlet.approximation.surface import ApproximationOptions
from morphlet.motion.face_pairs import FacePairs
from morphlet.motion.morph import edge_log_rms_max, volume_change_max
from morphlet.samples.copies import remeshed
from morphlet.sphere.map import spherical_map
from support import blob, data_mesh, random_rotation

PATHS = ("linear", "gradient", "wavelet")
TIMES = (0.2, 0.5, 0.75)


class Pair:
    """A source, target positions, and their bands."""

    def __init__(self, source: Mesh, target: np.ndarray, bands: Bands):
        self.source, self.target, self.bands = source, target, bands

    def morph(self, path: str, schedule: Schedule | None = None, delay: np.ndarray | None = None) -> Morph:
        return Morph(self.source, self.target, path, self.bands if path == "wavelet" else None, schedule, delay)

    def back(self, path: str, schedule: Schedule | None = None, delay: np.ndarray | None = None) -> Morph:
        mirrored = Bands(self.bands.target, self.bands.source) if path == "wavelet" else None
        return Morph(self.source.with_vertices(self.target), self.source.vertices, path, mirrored, schedule, delay)

    def turned(self, seed: int) -> tuple["Pair", np.ndarray]:
        turn = random_rotation(seed).T
        return Pair(self.source.with_vertices(self.source.vertices @ turn), self.target @ turn,
                    Bands(self.bands.source @ turn, self.bands.target @ turn)), turn  # fmt: skip


def small() -> Pair:
    body = blob(2)
    x, y, z = body.vertices.T
    angle = 1.2 * z  # about x, the more the higher
    target = np.stack([1.1 * x, np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z], axis=1)
    return Pair(body, target, wavelet_bands(spherical_map(body), target, 40, ApproximationOptions(levels=3)))


def horse() -> Pair:
    source, target = data_mesh("meshes/horse.obj"), data_mesh("horse-poses/horse-05.obj").vertices
    return Pair(source, target, wavelet_bands(spherical_map(source), target, 60))


@pytest.fixture(scope="module", params=[small, horse], ids=["body", "horse"])
def pair(request) -> Pair:
    return request.param()


def close(found: np.ndarray, expected: np.ndarray, share: float = 1e-12) -> None:
    """Equal to a share of the size."""
    np.testing.assert_allclose(found, expected, atol=share * np.abs(expected).max())


@pytest.mark.parametrize("path", PATHS)
def test_ends_are_exact(pair, path):
    for delay in (None, sweep(pair.source, [0])):
        morph = pair.morph(path, delay=delay)
        assert morph(0).vertices.tobytes() == pair.source.vertices.tobytes()
        assert morph(1).vertices.tobytes() == pair.target.tobytes()


def test_all_bands_at_constant_speed_are_straight_lines(pair):
    alike = pair.morph("wavelet", Schedule.together(len(pair.bands)))
    for t in TIMES:
        close(alike(t).vertices, (1 - t) * pair.source.vertices + t * pair.target)


def test_the_way_back_is_this_way_reversed(pair):
    delay, schedule = sweep(pair.source, [3]), Schedule.coarse_first(len(pair.bands))
    for t in TIMES:
        close(pair.back("linear")(1 - t).vertices, pair.morph("linear")(t).vertices)
        close(pair.back("linear", None, delay.max() - delay)(1 - t).vertices, pair.morph("linear", None, delay)(t).vertices)
        for own, other in ((None, None), (delay, delay.max() - delay)):
            back = pair.back("wavelet", schedule.mirrored(), other)(1 - t).vertices
            close(back, pair.morph("wavelet", schedule, own)(t).vertices, 1e-11)


@pytest.mark.parametrize("path", PATHS)
def test_turned_shapes_have_turned_paths(pair, path):
    other, turn = pair.turned(4)
    for t in TIMES:
        close(other.morph(path)(t).vertices, pair.morph(path)(t).vertices @ turn, 1e-8)


def test_bands_never_turn_back(pair):
    schedule = Schedule.coarse_first(len(pair.bands))
    shares = np.array([schedule(t) for t in np.linspace(0, 1, 101)])
    assert (np.diff(shares, axis=0) >= -1e-15).all()


def test_gradient_paths_keep_volumes_and_edges(pair):
    turning, straight = (pair.morph(path).frames(5) for path in ("gradient", "linear"))
    assert abs(volume_change_max(turning)) < 1.0
    assert edge_log_rms_max(turning) < edge_log_rms_max(straight) / (1.5 if pair.source.n_vertices < 1000 else 5)


@settings(max_examples=10)
@given(st.floats(0, 1), st.integers(0, 10**6))
def test_any_path_between_equal_shapes_stands_still(t, seed):
    body = blob(2)
    delay = np.random.default_rng(seed).random(body.n_vertices) * 0.9
    for path in ("linear", "gradient"):
        close(Morph(body, body.vertices, path, delay=delay)(t).vertices, body.vertices)


def test_a_horse_takes_its_own_pose():
    source, pose = data_mesh("meshes/horse.obj"), data_mesh("horse-poses/horse-05.obj")
    same = np.arange(source.n_faces)
    found = transfer(source, pose, source, FacePairs(same, same)).vertices
    gap = found - found.mean(axis=0) - pose.vertices + pose.vertices.mean(axis=0)
    assert np.abs(gap).max() < 1e-9 * pose.bbox_diagonal


def test_a_remeshed_cat_takes_the_pose_of_the_cat():
    source = data_mesh("meshes/cat.obj")
    copy, places = remeshed(source)
    solver = TransferSolver.prepare(source, copy, pair_faces(source, copy))
    for number in (2, 3, 5):
        pose = data_mesh(f"cat-poses/cat-{number:02d}.obj")
        found, truth = solver.solve(pose).vertices, places.positions(pose)
        gap = found - found.mean(axis=0) - truth + truth.mean(axis=0)
        assert np.sqrt(np.mean(np.sum(gap**2, axis=1))) < 0.005 * pose.bbox_diagonal
