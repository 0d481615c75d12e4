"""Indices and rows of every output are those of the input file, whatever was mended on the way."""

import numpy as np
import pytest

from cli.calls import call
from mapping.stars import blob
from morphlet import Mesh, SurfacePoints, VertexPairs, read, write, write_pairs
from support import relabelled

STRAY = 5
"""Vertices in no face, put first so that they shift every index."""


def messy(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """A soup of the mesh, every third face reversed, with strays and a speck; and the clean vertex behind each soup vertex."""
    corners = mesh.faces.copy()
    corners[::3] = corners[::3, ::-1]
    origin = corners.ravel()
    soup = STRAY + np.arange(len(origin)).reshape(-1, 3)
    stray, speck = mesh.vertices[:STRAY] + 1e-3, 0.01 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) + mesh.vertices[7]
    more = STRAY + len(origin) + np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    return Mesh(np.vstack([stray, mesh.vertices[origin], speck]), np.vstack([more, soup])), origin


def quads(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A cube of 6 n^2 quads blown up to a lopsided ball."""
    line = np.linspace(-1, 1, n + 1)
    u, v = (x.ravel() for x in np.meshgrid(line, line, indexing="ij"))
    sides = [np.roll(np.stack([u, v, np.full_like(u, sign)], axis=1), axis, axis=1) for axis in range(3) for sign in (-1, 1)]
    cell = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    square = np.stack([cell, cell + n + 1, cell + n + 2, cell + 1], axis=1)
    faces = np.concatenate([k * len(u) + (square if k % 2 else square[:, ::-1]) for k in range(6)])
    points, number = np.unique(np.concatenate(sides).round(12), axis=0, return_inverse=True)
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    lumps = 1 + 0.3 * np.exp(3 * (points @ [1, 0, 0] - 1)) + 0.5 * np.exp(5 * (points @ [0, 0.6, 0.8] - 1))
    return points * lumps[:, None], number.ravel()[faces]


def test_sphere_has_a_point_for_every_vertex_of_the_file(capsys, tmp_path):
    mesh, origin = messy(blob(2))
    write(tmp_path / "soup.ply", mesh)
    answer = call(capsys, "sphere", tmp_path / "soup.ply", "-o", tmp_path / "s.npz", "--component", "largest", "--json")
    assert answer.code == 0
    assert {repair["what"].split()[0] for repair in answer.result["repairs"]} >= {"dropped", "welded", "reversed"}
    with np.load(tmp_path / "s.npz", allow_pickle=False) as file:
        points, faces, valid = file["points"], file["faces"], file["valid"]
    assert points.shape == (mesh.n_vertices, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-12)
    soup = points[STRAY:-4]
    first = np.unique(origin, return_index=True)[1]
    np.testing.assert_array_equal(soup, soup[first][origin])  # twins of a seam share one point, to the last bit
    assert len(np.unique(soup, axis=0)) == origin.max() + 1
    assert valid.tolist() == [False] * STRAY + [True] * len(origin) + [False] * 4
    near = points[STRAY:-4][[np.argmin(np.linalg.norm(mesh.vertices[STRAY:-4] - v, axis=1)) for v in mesh.vertices[~valid]]]
    np.testing.assert_array_equal(points[~valid], near)  # vertices without an answer take that of the nearest
    np.testing.assert_array_equal(np.sort(faces, axis=1), np.sort(mesh.faces[4:], axis=1))
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.einsum("fd,fd->f", a, np.cross(b, c)) > 0).all()  # as they were mapped: oriented alike, none inverted


def located(path, target_vertices, target_faces):
    """Where the rows of a map lie on a target, read with nothing but the file's own words."""
    with np.load(path, allow_pickle=False) as file:
        faces, weights = file["faces"], file["weights"]
    assert faces.dtype == np.int64
    assert weights.dtype == np.float64
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
    return np.einsum("kc,kcd->kd", weights, target_vertices[target_faces[faces]])


def test_correspondence_onto_reversed_soup_with_strays(capsys, tmp_path):
    clean, place = relabelled(blob(2))
    mesh, origin = messy(blob(2))
    chosen = np.arange(0, 162, 9)
    soup_of = STRAY + np.array([np.flatnonzero(origin == v)[-1] for v in chosen])
    write(tmp_path / "a.obj", clean)
    write(tmp_path / "b.ply", mesh)
    write_pairs(tmp_path / "ab.csv", VertexPairs(place[chosen], soup_of))
    write_pairs(tmp_path / "ba.csv", VertexPairs(soup_of, place[chosen]))
    for names, source, target in (("ab", clean, mesh), ("ba", mesh, clean)):
        files = [tmp_path / ("a.obj" if name == "a" else "b.ply") for name in names]
        words = ("--pairs", tmp_path / f"{names}.csv", "-o", tmp_path / f"{names}.npz", "--component", "largest", "--json")
        answer = call(capsys, "correspond", *files, *words)
        assert (answer.code, answer.result["folds_sphere"], answer.result["pairs"]) == (0, 0, len(chosen))
        found = located(tmp_path / f"{names}.npz", target.vertices, target.faces)
        edge = np.sqrt(clean.area / clean.n_faces)
        error = np.linalg.norm(found - source.vertices, axis=1)
        assert error.max() < 0.2 * edge  # both are mapped on their own, to within a twentieth of an edge; another order gives several edges


def test_faces_of_polygons_count_as_fans_in_file_order(capsys, tmp_path):
    vertices, squares = quads(6)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()] + [f"f {a} {b} {c} {d}" for a, b, c, d in (squares + 1).tolist()]
    (tmp_path / "quads.obj").write_text("\n".join(lines), encoding="utf-8")
    fans = np.stack([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    write(tmp_path / "a.ply", Mesh(vertices, fans))
    every = np.arange(0, len(vertices), 20)
    write_pairs(tmp_path / "p.csv", VertexPairs(every, every))
    words = ("--pairs", tmp_path / "p.csv", "-o", tmp_path / "c.npz", "--quiet")
    assert call(capsys, "correspond", tmp_path / "a.ply", tmp_path / "quads.obj", *words).code == 0
    np.testing.assert_allclose(
        located(tmp_path / "c.npz", vertices, fans), vertices, atol=0.005
    )  # maps are optimised, to a fiftieth of an edge; another face order gives edges


@pytest.mark.parametrize(("path", "ending"), [("linear", "ply"), ("gradient", "obj"), ("wavelet", "ply")])
def test_frames_keep_count_order_and_faces_of_the_source_file(capsys, tmp_path, no_drawing, path, ending):
    mesh, origin = messy(blob(1))
    write(tmp_path / "a.ply", mesh)
    write(tmp_path / "b.ply", blob(2))
    words = ("-o", tmp_path / "out", "--frames", 3, "--path", path, "--format", ending, "--component", "largest", "--json")
    assert call(capsys, "morph", tmp_path / "a.ply", tmp_path / "b.ply", *words).code == 0
    frames = [read(tmp_path / "out" / f"frame-{k:03d}.{ending}") for k in range(3)]
    for frame in frames:
        np.testing.assert_array_equal(frame.faces, mesh.faces)
    np.testing.assert_array_equal(frames[0].vertices, mesh.vertices)
    straight = np.abs(frames[1].vertices - (frames[0].vertices + frames[2].vertices) / 2).max()
    assert straight < 1e-12 if path == "linear" else straight > 1e-9
    for frame in frames[1:]:
        soup = frame.vertices[STRAY:-4]
        np.testing.assert_array_equal(soup, soup[np.unique(origin, return_index=True)[1]][origin])  # twins move together


def test_morphing_a_file_into_itself_moves_nothing_far(capsys, tmp_path, no_drawing):
    write(tmp_path / "a.ply", blob(2))
    answer = call(capsys, "morph", tmp_path / "a.ply", tmp_path / "a.ply", "-o", tmp_path / "out", "--frames", 2, "--json")
    assert answer.code == 0
    assert answer.result["ambiguous"] is False
    first, last = (read(tmp_path / "out" / f"frame-00{k}.ply") for k in range(2))
    edge = np.sqrt(first.area / first.n_faces)
    assert np.linalg.norm(first.vertices - last.vertices, axis=1).max() < 0.05 * edge


def test_seams_of_an_obj_stay_one_vertex(capsys, tmp_path):
    """A vertex with two texture coordinates is one vertex of the file, and of the output."""
    ball = blob(1)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices.tolist()] + ["vt 0 0", "vt 1 0", "vt 0 1"]
    lines += [f"f {a}/{1 + k % 3} {b}/{1 + (k + 1) % 3} {c}/{1 + (k + 2) % 3}" for k, (a, b, c) in enumerate((ball.faces + 1).tolist())]
    (tmp_path / "uv.obj").write_text("\n".join(lines), encoding="utf-8")
    assert call(capsys, "sphere", tmp_path / "uv.obj", "-o", tmp_path / "s.npz", "--quiet").code == 0
    assert np.load(tmp_path / "s.npz", allow_pickle=False)["points"].shape == (ball.n_vertices, 3)


def test_rows_of_a_saved_map_make_surface_points(capsys, tmp_path):
    write(tmp_path / "a.ply", blob(1))
    assert call(capsys, "correspond", tmp_path / "a.ply", tmp_path / "a.ply", "-o", tmp_path / "c.npz", "--quiet").code == 0
    with np.load(tmp_path / "c.npz", allow_pickle=False) as file:
        assert len(SurfacePoints(file["faces"], file["weights"])) == 42
