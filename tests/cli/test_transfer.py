"""`transfer`: a file per pose, in the vertices and with the attributes of the target; what is refused."""

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.spatial.transform import Rotation

from cli.calls import call
from cli.test_indices import STRAY, messy
from cli.test_verbs import told
from morphlet import Mesh, Picture, VertexPairs, read, write, write_pairs
from morphlet.io.formats import read_attributes
from morphlet.report import rows
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature
from morphlet.samples.poses import POSES
from support import blob, data_file

KEYS = ["poses", "prepare_seconds", "pose_seconds", "pairs", "face_pairs", "warnings", "repairs"]
ANIMAL = Creature.prepare("grazer", n_vertices=1500)
FOX = ANIMAL.posed(proportions=SPECIES["predator"])
"""The same connectivity in other proportions: its poses are known."""
SHADES = (np.arange(3 * FOX.n_vertices).reshape(-1, 3) % 256).astype(np.uint8)
EVERY = np.arange(0, FOX.n_vertices, 12)
BALL = blob(2)
SOME = np.arange(0, BALL.n_vertices, 7)


def bent(vertices: np.ndarray) -> np.ndarray:
    """A pose that changes each face otherwise."""
    x, y, z = vertices.T
    return np.stack([x, y + 0.7 * x * x, 2 * z + 0.5 * x * y], axis=1)


def off(found: Mesh, truth: Mesh) -> float:
    """Rms distance per bounding-box diagonal, after translation."""
    gaps = found.vertices - found.vertices.mean(axis=0) - truth.vertices + truth.vertices.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))) / np.linalg.norm(np.ptp(truth.vertices, axis=0)))


@pytest.fixture
def animals(tmp_path):
    """A grazer at rest and in two poses, a coloured fox, and pairs between them."""
    write(tmp_path / "rest.off", ANIMAL.mesh)
    for name in ("walking", "leaping"):
        write(tmp_path / f"{name}.obj", ANIMAL.posed(POSES[name]))
    write(tmp_path / "fox.ply", FOX, colors=SHADES)
    write_pairs(tmp_path / "pairs.csv", VertexPairs(EVERY, EVERY))
    return tmp_path


@pytest.fixture
def balls(tmp_path):
    """A body, the same bent, and pairs of it with itself."""
    write(tmp_path / "rest.ply", BALL)
    write(tmp_path / "long.ply", BALL.with_vertices(bent(BALL.vertices) + 5))
    write_pairs(tmp_path / "pairs.csv", VertexPairs(SOME, SOME))
    return tmp_path


def words(folder, *poses, to="rest.ply", rest="rest.ply"):
    return ("transfer", folder / rest, *(folder / pose for pose in poses), "--to", folder / to, "-o", folder / "out", "--json")


def test_a_file_for_every_pose_with_the_targets_colours(capsys, animals):
    answer = call(capsys, *words(animals, "walking.obj", "leaping.obj", to="fox.ply", rest="rest.off"), "--pairs", animals / "pairs.csv")
    result = told(answer, "transfer", *KEYS)
    made = [animals / "out" / f"{name}.ply" for name in ("walking", "leaping")]
    assert result["outputs"] == sorted(map(str, made))
    assert result["inputs"] == [str(animals / name) for name in ("rest.off", "walking.obj", "leaping.obj", "fox.ply", "pairs.csv")]
    assert (result["poses"], result["pairs"], result["warnings"]) == (2, len(EVERY), [])
    assert result["face_pairs"] >= FOX.n_faces
    assert result["prepare_seconds"] > 0 < result["pose_seconds"]
    for name, file in zip(("walking", "leaping"), made, strict=True):
        found, truth = read(file), ANIMAL.posed(POSES[name], SPECIES["predator"])
        np.testing.assert_array_equal(found.faces, FOX.faces)
        np.testing.assert_array_equal(read_attributes(file).colors, SHADES)
        np.testing.assert_allclose(found.vertices.mean(axis=0), FOX.vertices.mean(axis=0), atol=1e-9)
        assert off(found, truth) < 0.02 < off(FOX, truth)


@pytest.mark.parametrize("paired", [True, False])
def test_seams_strays_and_reversed_faces_on_either_side(capsys, balls, paired):
    """A soup of the body bends as the body does; twins stay together, strays and specks go along."""
    soup, origin = messy(BALL)
    # without specks: a map of the sphere needs one piece
    soup = soup if paired else Mesh(soup.vertices[: STRAY + len(origin)], soup.faces[4:])
    soup = Mesh(soup.vertices, np.vstack([[[STRAY, STRAY, STRAY + 1]] * 3, soup.faces]))  # three that repair drops: numbers shift
    write(balls / "soup.ply", soup)
    write(balls / "soup-long.ply", soup.with_vertices(bent(soup.vertices)))
    seconds = STRAY + np.array([np.flatnonzero(origin == v)[-1] for v in SOME])
    write_pairs(balls / "ab.csv", VertexPairs(SOME, seconds))
    write_pairs(balls / "ba.csv", VertexPairs(seconds, SOME))
    pairs = (("--pairs", balls / "ab.csv"), ("--pairs", balls / "ba.csv")) if paired else ((), ())
    told(call(capsys, *words(balls, "long.ply", to="soup.ply"), *pairs[0]), "transfer")
    found = read(balls / "out" / "long.ply")
    np.testing.assert_array_equal(found.faces, soup.faces)
    body = found.vertices[STRAY : STRAY + len(origin)]
    clean = body[np.unique(origin, return_index=True)[1]]
    np.testing.assert_array_equal(body, clean[origin])
    truth = BALL.with_vertices(bent(BALL.vertices))
    assert off(BALL.with_vertices(clean), truth) < (1e-3 if paired else 0.02) < off(BALL, truth)
    near = np.array([np.argmin(np.linalg.norm(BALL.vertices - v, axis=1)) for v in soup.vertices[:STRAY]])
    np.testing.assert_allclose(found.vertices[:STRAY] - clean[near], soup.vertices[:STRAY] - BALL.vertices[near], atol=1e-12)
    told(call(capsys, *words(balls, "soup-long.ply", rest="soup.ply"), *pairs[1], "--force"), "transfer")
    assert off(read(balls / "out" / "soup-long.ply"), truth) < (1e-3 if paired else 0.02)


@pytest.mark.parametrize(("degrees", "told_of"), [(0, 0), (30, 0), (90, 1)])
def test_a_target_that_stands_otherwise_is_told(capsys, balls, degrees, told_of):
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    write(balls / "turned.ply", BALL.with_vertices(BALL.vertices @ turn))
    answer = call(capsys, *words(balls, "long.ply", to="turned.ply"), "--pairs", balls / "pairs.csv")
    assert len(told(answer, "transfer")["warnings"]) == told_of
    assert answer.err.count("stands turned by 90 degrees against the reference") == told_of


def test_pinned_vertices_keep_their_places_and_the_ground_holds(capsys, balls):
    pairs = ("--pairs", balls / "pairs.csv")
    told(call(capsys, *words(balls, "long.ply"), *pairs, "--pin", 5, "--pin", 40), "transfer")
    found = read(balls / "out" / "long.ply").vertices
    np.testing.assert_allclose(found[[5, 40]], read(balls / "rest.ply").vertices[[5, 40]], atol=1e-12)
    assert np.abs(found - BALL.vertices).max() > 0.1
    told(call(capsys, *words(balls, "long.ply"), *pairs, "--ground", "z", "--force"), "transfer")
    grounded = read(balls / "out" / "long.ply").vertices
    assert grounded[:, 2].min() == pytest.approx(BALL.vertices[:, 2].min(), abs=1e-6)
    answer = call(capsys, *words(balls, "long.ply"), *pairs, "--pin", 162, "--force")
    assert (answer.code, "--pin" in answer.err) == (2, True)


def test_texture_coordinates_of_an_obj_stay(capsys, balls):
    corners = "".join(f"f {a}/1 {b}/2 {c}/3\n" for a, b, c in (BALL.faces + 1).tolist())
    lines = "usemtl skin\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in BALL.vertices.tolist()) + "vt 0 0\nvt 1 0\nvt 0 1\n"
    (balls / "skin.obj").write_text(lines + corners, encoding="utf-8")
    told(call(capsys, *words(balls, "long.ply", to="skin.obj"), "--pairs", balls / "pairs.csv"), "transfer")
    text = (balls / "out" / "long.obj").read_text(encoding="utf-8")
    assert text.startswith("usemtl skin\n")
    assert text.endswith("vt 0 0\nvt 1 0\nvt 0 1\n" + corners)
    assert off(read(balls / "out" / "long.obj"), read(balls / "long.ply")) < 1e-3


def test_the_picture_has_poses_above_what_they_became(capsys, balls, monkeypatch):
    shades = iter(range(4))
    monkeypatch.setattr(rows, "render", lambda *_, **__: Picture(np.full((2, 3, 3), 60 * next(shades), np.uint8), "none", "a test"))
    out = balls / "sheet.png"
    result = told(call(capsys, *words(balls, "long.ply"), "--pairs", balls / "pairs.csv", "--picture", out), "transfer")
    assert result["outputs"][-1] == str(out)
    tiles = (255 * imread(out)[::2, ::3, 0]).round().astype(int)
    assert tiles.tolist() == [[0, 60], [120, 180]]


UNFIT = {
    "another": (2, r"a pose of the reference's 162 vertices and 320 faces in .*pose\.ply; found 42 vertices, 80 faces"),
    "turned": (2, r"in .*pose\.ply; found 162 vertices, 320 faces of others"),
    "nan": (4, r"pose\.off"),
    "missing": (4, r"a mesh file at .*pose\.ply"),
    "target": (4, r"an ending out of .*; found '\.xyz'"),
    "few": (2, "at least 3 pairs with different source vertices; found 2"),
    "none": (2, "at least 3 pairs with different source vertices; found 0"),
    "range": (2, "indices from 0 to 161 in the target column of the pairs"),
}


@pytest.mark.parametrize("case", UNFIT)
def test_what_does_not_fit_is_refused_and_leaves_nothing(capsys, balls, case):
    pose, to = "pose.off" if case == "nan" else "pose.ply", "rest.xyz" if case == "target" else "rest.ply"
    shapes = {"another": blob(1), "turned": Mesh(BALL.vertices, BALL.faces[:, [1, 2, 0]])}
    if case == "nan":
        write(balls / pose, BALL)
        lines = (balls / pose).read_text().splitlines()
        (balls / pose).write_text("\n".join([*lines[:2], "nan 0 0", *lines[3:]]))
    elif case != "missing":
        write(balls / pose, shapes.get(case, BALL))
    ends = {"few": ([0, 9], [0, 9]), "none": ([], []), "range": ([0, 1, 2], [0, 1, 999])}.get(case, (SOME, SOME))
    write_pairs(balls / "pairs.csv", VertexPairs(*ends))
    before = sorted(balls.iterdir())
    answer = call(capsys, *words(balls, pose, to=to), "--pairs", balls / "pairs.csv")
    code, match = UNFIT[case]
    assert answer.code == answer.result["exit_code"] == code, answer.err
    with pytest.raises(AssertionError, match=match):
        raise AssertionError(answer.err)
    assert sorted(balls.iterdir()) == before


def test_a_mesh_without_a_sphere_needs_pairs(capsys, balls):
    write(balls / "two.ply", Mesh(np.vstack([BALL.vertices, BALL.vertices + 9]), np.vstack([BALL.faces, BALL.faces + BALL.n_vertices])))
    unfit = call(capsys, *words(balls, "long.ply", to="two.ply"))
    assert unfit.code == 3
    assert "two.ply" in unfit.err
    told(call(capsys, *words(balls, "long.ply", to="two.ply"), "--pairs", balls / "pairs.csv"), "transfer")
    first = read(balls / "out" / "long.ply").vertices[: BALL.n_vertices]
    assert off(BALL.with_vertices(first), read(balls / "long.ply")) < 0.01


def test_a_cats_poses_on_a_lion(capsys, tmp_path):
    cat, poses = data_file("meshes/cat.obj"), [data_file(f"cat-poses/cat-0{k}.obj") for k in (1, 3)]
    lion, pairs = data_file("meshes/lion.obj"), data_file("markers/cat-lion.csv")
    answer = call(capsys, "transfer", cat, *poses, "--to", lion, "--pairs", pairs, "-o", tmp_path / "out", "--json")
    result = told(answer, "transfer", *KEYS)
    assert (result["poses"], result["pairs"]) == (2, 55)
    for pose in poses:
        found = read(tmp_path / "out" / pose.name)
        np.testing.assert_array_equal(found.faces, read(lion).faces)
        assert found.volume == pytest.approx(read(lion).volume * read(pose).volume / read(cat).volume, rel=0.15)
