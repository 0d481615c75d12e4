"""Pictures of meshes: what is drawn, where, in which colours, by which engine."""

import ctypes.util
import importlib.util
import pickle
import subprocess

import numpy as np
import pytest

from morphlet import FileError, InputError, Mesh, MissingExtra
from morphlet.report import engines
from morphlet.report.camera import Camera
from morphlet.report.color import ColorScale
from morphlet.report.look import Look
from morphlet.report.render import Picture, render

PLAIN = Look((120, 90), "matplotlib")
FRONT = Camera(np.eye(3), np.zeros(3), np.ones(2))
SQUARE = Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def ball(n=24):
    """A unit sphere of latitude rings, without its poles' degenerate faces."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, n + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), indexing="ij")
    ring = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=2).reshape(-1, 3)
    vertices = np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]])
    rows, step = n - 1, np.arange(2 * n)
    next_step = (step + 1) % (2 * n)
    faces = [np.stack([2 * n * r + step, 2 * n * r + next_step, 2 * n * (r + 1) + step], 1) for r in range(rows - 1)]
    faces += [np.stack([2 * n * r + next_step, 2 * n * (r + 1) + next_step, 2 * n * (r + 1) + step], 1) for r in range(rows - 1)]
    faces += [np.stack([np.full(2 * n, len(ring)), next_step, step], 1)]
    faces += [np.stack([np.full(2 * n, len(ring) + 1), 2 * n * (rows - 1) + step, 2 * n * (rows - 1) + next_step], 1)]
    return Mesh(vertices, np.concatenate(faces))


def drawn(picture):
    return (picture.pixels < 250).any(axis=2)


def test_a_ball_fills_the_disc_it_should_and_leaves_white_around():
    picture = render(ball(), camera=FRONT, look=PLAIN)
    assert picture.pixels.shape == (90, 120, 3)
    assert picture.pixels.dtype == np.uint8
    radius = 0.92 * 45
    rows, columns = np.mgrid[:90, :120]
    distance = np.hypot(rows - 44.5, columns - 59.5)
    assert drawn(picture)[distance < radius - 1.5].all()
    assert not drawn(picture)[distance > radius + 1.5].any()


def test_the_same_input_gives_the_same_bits():
    first, second = (render(ball(), values=ball().vertices[:, 0], look=PLAIN) for _ in range(2))
    np.testing.assert_array_equal(first.pixels, second.pixels)


def test_up_is_up_and_right_is_right():
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    pixels = render(SQUARE, colors=colors, camera=FRONT, look=Look((100, 100), "matplotlib")).pixels.astype(int)
    assert pixels[90, 10].argmax() == 0
    assert pixels[90, 90].argmax() == 1
    assert pixels[10, 90].argmax() == 2
    assert np.ptp(pixels[10, 10]) < 40


def test_what_is_near_hides_what_is_far():
    two = Mesh(np.concatenate([SQUARE.vertices, SQUARE.vertices + np.array([0, 0, 1])]), np.concatenate([SQUARE.faces + 4, SQUARE.faces]))
    colors = np.repeat([[1.0, 0, 0], [0, 0, 1.0]], 4, axis=0)
    pixels = render(two, colors=colors, camera=FRONT, look=PLAIN).pixels
    assert pixels[45, 60].argmax() == 2


def test_faces_have_their_own_values():
    pixels = render(SQUARE, values=[0.0, 1.0], camera=FRONT, look=Look((90, 90), "matplotlib", scale=ColorScale(0, 1, "gray"))).pixels
    assert pixels[60, 70].max() < 90
    assert pixels[30, 20].min() > 150


def test_as_many_vertices_as_faces_means_vertices():
    tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    right, above = np.array([-1, 1, 0]) / np.sqrt(2), np.array([-1, -1, 2]) / np.sqrt(6)
    onto_the_large_face = Camera(np.stack([right, above, np.ones(3) / np.sqrt(3)]), np.ones(3) / 3, np.ones(2))
    look = Look((90, 90), "matplotlib", scale=ColorScale(0, 1, "gray"))
    pixels = render(tetrahedron, values=[1.0, 0.0, 1.0, 1.0], camera=onto_the_large_face, look=look).pixels
    assert np.ptp(pixels[40:50, 35:55].astype(int)) > 40, "values blend over the face; a value of its own would be even"


def test_an_inside_out_mesh_looks_the_same():
    shell = ball()
    inverted = Mesh(shell.vertices, shell.faces[:, ::-1])
    first, second = (render(mesh, camera=FRONT, look=PLAIN).pixels.astype(int) for mesh in (shell, inverted))
    assert np.abs(first - second).mean() < 0.5


def test_light_comes_from_above():
    pixels = render(ball(), camera=FRONT, look=PLAIN).pixels.astype(int)
    assert pixels[15, 60].mean() > pixels[75, 60].mean() + 30


def test_edges_are_dark_lines():
    plain = render(SQUARE, camera=FRONT, look=PLAIN).pixels
    wired = render(SQUARE, camera=FRONT, look=Look((120, 90), "matplotlib", edges=2.0)).pixels
    assert plain[45, 60].min() > 120
    assert wired[45, 60].max() < 90
    assert wired[45, 75].min() > 120


def test_nothing_and_a_point_are_white():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3)))
    assert (render(empty, look=PLAIN).pixels == 255).all()
    speck = Mesh(np.ones((3, 3)), [[0, 1, 2]])
    assert drawn(render(speck, look=PLAIN)).sum() < 20


def test_values_that_fit_nothing_are_refused():
    with pytest.raises(InputError, match=r"one row per vertex \(4\) or face \(2\); found 3 rows"):
        render(SQUARE, values=[1.0, 2.0, 3.0], look=PLAIN)
    with pytest.raises(InputError, match="values or colors; found both"):
        render(SQUARE, values=[1.0, 2.0], colors=np.ones((2, 3)), look=PLAIN)
    with pytest.raises(InputError, match="finite numbers in values"):
        render(SQUARE, values=[1.0, np.nan], look=PLAIN)


def test_impossible_looks_are_refused():
    with pytest.raises(InputError, match="pixels a side"):
        Look((0, 10))
    with pytest.raises(InputError, match="pixels a side"):
        Look((100, 100_000))
    with pytest.raises(InputError, match="found 'opengl'"):
        Look(engine="opengl")
    with pytest.raises(InputError, match="width of edges"):
        Look(edges=float("nan"))


def test_a_picture_is_saved_whole_or_not_at_all(tmp_path):
    from matplotlib.image import imread

    picture = render(SQUARE, look=PLAIN)
    picture.save(tmp_path / "square.png")
    np.testing.assert_array_equal(np.rint(255 * imread(tmp_path / "square.png")[..., :3]).astype(int), picture.pixels)
    assert [path.name for path in tmp_path.iterdir()] == ["square.png"]
    with pytest.raises(FileError, match="writable folder"):
        picture.save(tmp_path / "missing" / "square.png")


def test_a_picture_keeps_its_own_pixels():
    pixels = np.zeros((2, 2, 3), np.uint8)
    picture = Picture(pixels, "matplotlib", "asked for")
    pixels[:] = 9
    assert picture.pixels.max() == 0
    assert not pickle.loads(pickle.dumps(picture)).pixels.flags.writeable


@pytest.fixture
def _fresh_trial():
    engines._obstacle.cache_clear()
    yield
    engines._obstacle.cache_clear()


def _found(monkeypatch, status):
    """pyvista and its libraries are there; its trial ends with this status."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: name)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: subprocess.CompletedProcess([], status))


@pytest.mark.usefixtures("_fresh_trial")
class TestFallback:
    def test_without_pyvista_the_picture_says_so(self, monkeypatch):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
        picture = render(SQUARE, look=Look((60, 40)))
        assert (picture.engine, picture.reason) == ("matplotlib", "pyvista is not installed")
        assert drawn(picture).any()

    def test_without_graphics_libraries_nothing_is_loaded(self, monkeypatch):
        _found(monkeypatch, 0)
        monkeypatch.setattr("sys.platform", "linux")
        monkeypatch.setattr(ctypes.util, "find_library", lambda name: None if name == "EGL" else name)
        assert render(SQUARE, look=Look((60, 40))).reason == "libraries missing for pyvista: EGL"

    def test_a_trial_that_crashes_is_survived(self, monkeypatch):
        _found(monkeypatch, -11)
        assert render(SQUARE, look=Look((60, 40))).reason == "the trial of pyvista ended with status -11"

    def test_a_trial_that_hangs_is_survived(self, monkeypatch):
        def hang(*_, **__):
            raise subprocess.TimeoutExpired("python", 1)

        _found(monkeypatch, 0)
        monkeypatch.setattr(subprocess, "run", hang)
        assert render(SQUARE, look=Look((60, 40))).engine == "matplotlib"

    def test_asking_for_pyvista_by_name_is_an_error_where_it_does_not_work(self, monkeypatch):
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(MissingExtra, match=r"pyvista is not installed; pip install morphlet\[render\]"):
            render(SQUARE, look=Look((60, 40), "pyvista"))

    def test_the_trial_is_made_once(self, monkeypatch):
        calls = []
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: calls.append(name))
        for _ in range(3):
            render(SQUARE, look=Look((60, 40)))
        assert calls == ["pyvista"]


def test_both_engines_draw_the_same_picture():
    obstacle = engines._obstacle()
    if obstacle:
        pytest.skip(obstacle)
    shell = ball()
    ours, theirs = (render(shell, values=shell.vertices[:, 0], look=Look((120, 90), name)) for name in ("matplotlib", "pyvista"))
    assert theirs.engine == "pyvista"
    assert np.abs(ours.pixels.astype(int) - theirs.pixels).mean() < 2
