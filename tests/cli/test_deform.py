"""`deform`: every method from a file, what comes out, in whose indices, and what is refused."""

import json

import numpy as np
import pytest

from cli.calls import call
from cli.test_verbs import told
from morphlet import Mesh, read, sample, write
from morphlet.editing.falloff import rate
from morphlet.editing.roi import Roi
from morphlet.io.formats import read_attributes
from support import data_file, icosphere, tetrahedron

METHODS = ["arap", "rotations", "laplacian", "biharmonic", "direct", "mls", "ffd"]
KEYS = [
    "method", "iterations", "energy", "volume_change", "edge_strain_rms", "laplacian_error", "self_intersections",
    "deformation_rate", "prepare_seconds", "frame_seconds",
]  # fmt: skip
LIFT = "handle = {center = [0, 0, 1], radius = 0.3}\nroi = {radius = 0.8}\ntranslate = [0, 0, 0.2]\n"
"""The cap of the unit ball, pulled off a little."""
BALL = icosphere(3)
CAP = np.flatnonzero(np.linalg.norm(BALL.vertices - [0, 0, 1], axis=1) <= 0.3)
REGION = Roi.within(BALL, CAP, 0.8)


def spec(tmp_path, text, name="lift.toml"):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / name


@pytest.fixture
def ball(tmp_path):
    write(tmp_path / "ball.ply", BALL)
    return tmp_path / "ball.ply"


@pytest.mark.parametrize("method", METHODS)
def test_every_method(capsys, tmp_path, ball, method):
    out = tmp_path / "out.ply"
    answer = call(capsys, "deform", ball, spec(tmp_path, f"method = '{method}'\n" + LIFT), "-o", out, "--json")
    result = told(answer, "deform", *KEYS)
    assert (result["method"], result["handle"], result["free"]) == (method, len(CAP), len(REGION.free))
    found = read(out)
    np.testing.assert_array_equal(found.faces, BALL.faces)
    np.testing.assert_array_equal(found.vertices[REGION.anchors], BALL.vertices[REGION.anchors])
    np.testing.assert_allclose(found.vertices[CAP], BALL.vertices[CAP] + [0, 0, 0.2], atol=2e-3 if method == "ffd" else 1e-15)
    assert result["iterations"] > 1 if method == "arap" else result["iterations"] == 1
    assert result["self_intersections"] == 0
    assert 0 < result["volume_change"] < 8
    assert 0 < result["edge_strain_rms"] < 30
    assert 0 < result["laplacian_error"] < 200
    assert result["energy"] > 0
    assert result["handle_rms"] < 1e-3
    expected = rate(REGION, found)
    assert result["deformation_rate"] == {
        "literal": pytest.approx(expected.literal), "literal_max": pytest.approx(expected.literal_max),
        "displacement": pytest.approx(expected.displacement), "residual": None,
    }  # fmt: skip


def test_the_default_is_arap_and_it_has_the_least_energy(capsys, tmp_path, ball):
    energy = {}
    for method in ("", *METHODS):
        text = (f"method = '{method}'\n" if method else "") + LIFT
        answer = call(capsys, "deform", ball, spec(tmp_path, text), "-o", tmp_path / "out.ply", "--json", "--force")
        energy[method] = told(answer, "deform")["energy"]
    assert energy[""] == energy["arap"] == min(energy.values())


def test_nothing_told_nothing_moved(capsys, tmp_path, ball):
    text = "handle = [0]\nroi = {radius = '30%'}\ntranslate = [0, 0, 0]"
    result = told(call(capsys, "deform", ball, spec(tmp_path, text), "-o", tmp_path / "out.ply", "--json"), "deform")
    np.testing.assert_allclose(read(tmp_path / "out.ply").vertices, BALL.vertices, atol=1e-12)
    figures = [result[key] for key in ("energy", "volume_change", "edge_strain_rms", "laplacian_error")]
    np.testing.assert_allclose(figures, 0, atol=1e-9)


def test_a_path_becomes_a_sequence(capsys, tmp_path, ball):
    frames = ", ".join(f"{{translate = [0, 0, {z}]}}" for z in (0.1, 0.2, 0.3))
    text = f"handle = {CAP.tolist()}\nroi = {{radius = 0.8}}\npath = [{frames}]\n"
    arguments = (ball, spec(tmp_path, text), "-o", tmp_path / "walk")
    result = told(call(capsys, "deform", *arguments, "--picture", tmp_path / "walk.png", "--json"), "deform", *KEYS, "frames")
    assert result["frames"] == 3
    names = [f"frame-{k:03d}.ply" for k in range(3)]
    assert result["outputs"] == [str(tmp_path / "walk" / name) for name in (*names, "result.json")] + [str(tmp_path / "walk.png")]
    for k, name in enumerate(names):
        np.testing.assert_allclose(read(tmp_path / "walk" / name).vertices[CAP], BALL.vertices[CAP] + [0, 0, 0.1 * (k + 1)], atol=1e-15)
    kept = json.loads((tmp_path / "walk" / "result.json").read_text("utf-8"))
    assert kept.keys() == result.keys()
    assert {key: kept[key] for key in KEYS} == {key: result[key] for key in KEYS}
    assert call(capsys, "deform", *arguments).code == 4
    assert call(capsys, "deform", *arguments, "--force").code == 0


def test_frames_of_a_large_turn_add_up(capsys, tmp_path):
    """The end of a tube turned by 270 degrees in three steps: the far end is turned as told, the middle by half of it."""
    side, rings = 12, 31
    turn = 2 * np.pi * np.arange(side) / side
    points = np.concatenate([np.stack([np.cos(turn), np.sin(turn), np.full(side, 0.25 * k)], axis=1) for k in range(rings)])
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(side), indexing="ij")
    a, b, c, d = ((i + x) * side + (j + y) % side for x, y in ((0, 0), (0, 1), (1, 1), (1, 0)))
    tube = Mesh(points, np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]))
    write(tmp_path / "tube.off", tube)
    last, middle = list(range((rings - 1) * side, rings * side)), slice((rings // 2) * side, (rings // 2 + 1) * side)
    frames = ", ".join(f"{{rotate = {{axis = [0, 0, 1], degrees = {d}}}}}" for d in (90, 180, 270))
    text = f"method = 'rotations'\nhandle = {last}\nanchors = {list(range(side))}\npath = [{frames}]"
    told(call(capsys, "deform", tmp_path / "tube.off", spec(tmp_path, text), "-o", tmp_path / "turned", "--json"), "deform")
    found = read(tmp_path / "turned" / "frame-002.off").vertices[middle]
    turned = np.angle(np.exp(1j * (np.arctan2(found[:, 1], found[:, 0]) - turn)))
    np.testing.assert_allclose(turned, np.radians(135), atol=0.05)


def test_volume_and_crossings_can_be_minded(capsys, tmp_path, ball):
    """The cap of the ball pushed in: the plain answer loses volume."""
    push = LIFT.replace("0.2]", "-0.3]")
    figures = {}
    for extra in ("", "volume = true\n", "volume = true\nguard = 'self-intersection'\n"):
        answer = call(capsys, "deform", ball, spec(tmp_path, extra + push), "-o", tmp_path / "out.ply", "--json", "--force")
        figures[extra] = told(answer, "deform")
    change = [result["volume_change"] for result in figures.values()]
    assert change[0] < -1
    np.testing.assert_allclose(change[1:], 0, atol=0.01)
    assert [result["self_intersections"] for result in figures.values()] == [0, 0, 0]


def test_copies_of_seam_vertices_move_together(capsys, tmp_path):
    """A ball cut into single triangles, with strays in no face: all copies of a vertex go one way, and the indices are the file's."""
    soup = Mesh(np.vstack([[[0, 0, 1.001]], BALL.vertices[BALL.faces.ravel()]]), 1 + np.arange(3 * BALL.n_faces).reshape(-1, 3))
    write(tmp_path / "soup.ply", soup)
    origin = BALL.faces.ravel()
    listed = (1 + np.flatnonzero(np.isin(origin, CAP))).tolist()
    text = f"handle = {listed}\nroi = {{radius = 0.8}}\ntranslate = [0, 0, 0.2]"
    result = told(call(capsys, "deform", tmp_path / "soup.ply", spec(tmp_path, text), "-o", tmp_path / "out.ply", "--json"), "deform")
    assert (result["handle"], result["free"], result["anchors"]) == (len(CAP), len(REGION.free), len(REGION.anchors))
    assert {repair["what"].split()[0] for repair in result["repairs"]} == {"dropped", "welded"}
    found = read(tmp_path / "out.ply")
    np.testing.assert_array_equal(found.faces, soup.faces)
    whole = np.zeros_like(BALL.vertices)
    whole[origin] = found.vertices[1:]
    np.testing.assert_array_equal(whole[origin], found.vertices[1:])
    np.testing.assert_allclose(whole[CAP], BALL.vertices[CAP] + [0, 0, 0.2], atol=1e-15)
    np.testing.assert_allclose(found.vertices[0], [0, 0, 1.201], atol=1e-12)  # as the vertex next to it
    text = "handle = [0, 1]\nroi = {radius = 0.8}\ntranslate = [0, 0, 0.2]"
    answer = call(capsys, "deform", tmp_path / "soup.ply", spec(tmp_path, text), "-o", tmp_path / "o.ply", "--json")
    assert (answer.code, answer.result["error"]["elements"]) == (2, [0])


def test_texture_and_materials_stay(capsys, tmp_path):
    lines = [
        "mtllib skin.mtl",
        *(f"v {x!r} {y!r} {z!r}" for x, y, z in BALL.vertices.tolist()),
        "vt 0 0",
        "vt 1 0",
        "vt 0 1",
        "usemtl skin",
    ]
    lines += [f"f {a}/1 {b}/2 {c}/3" for a, b, c in (BALL.faces + 1).tolist()]
    (tmp_path / "ball.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
    told(call(capsys, "deform", tmp_path / "ball.obj", spec(tmp_path, LIFT), "-o", tmp_path / "out.obj", "--json"), "deform")
    text = (tmp_path / "out.obj").read_text("utf-8").splitlines()
    assert [line for line in text if not line.startswith("v ")] == [line for line in lines if not line.startswith("v ")]
    moved = np.array([line.split()[1:4] for line in text if line.startswith("v ")], float)
    np.testing.assert_allclose(moved[CAP], BALL.vertices[CAP] + [0, 0, 0.2], atol=1e-15)


@pytest.mark.parametrize("ending", ["ply", "glb"])
def test_colours_stay(capsys, tmp_path, ending):
    colors = np.random.default_rng(0).integers(0, 255, (BALL.n_vertices, 3)).astype(np.uint8)
    write(tmp_path / f"ball.{ending}", BALL, colors=colors)
    told(call(capsys, "deform", tmp_path / f"ball.{ending}", spec(tmp_path, LIFT), "-o", tmp_path / f"out.{ending}", "--json"), "deform")
    np.testing.assert_array_equal(read_attributes(tmp_path / f"out.{ending}").colors, colors)


def test_the_picture_shows_rest_and_edit_in_three_colours(capsys, tmp_path, ball):
    from matplotlib.image import imread

    picture = tmp_path / "lift.png"
    result = told(call(capsys, "deform", ball, spec(tmp_path, LIFT), "-o", tmp_path / "o.ply", "--picture", picture, "--json"), "deform")
    assert result["outputs"] == [str(tmp_path / "o.ply"), str(picture)]
    pixels = imread(picture)[..., :3]
    assert pixels.shape == (600, 1600, 3)
    red, green, blue = np.moveaxis(pixels, -1, 0)
    for half in (np.s_[:, :800], np.s_[:, 800:]):
        handle, free, stays = (red > 2 * green), (red > 1.6 * blue) & (red < 1.6 * green), (red < 1.3 * blue) & (red < 0.99)
        assert min(np.sum(part[half]) for part in (handle, free, stays)) > 500


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("handle = [0]\nroi = {radius = 1}\nscale = 2\nspeed = 3", 2, "'speed'"),
        ("handle = [9999]\nroi = {radius = 1}\nscale = 2", 2, "indices from 0 to 641 in handle"),
        ("handle = [0]\nroi = {radius = 1}\ntranslate = [0, 0, nan]", 2, "finite numbers in translate"),
        ("handle = [0", 4, "a TOML file at"),
        ("method = 'direct'\nhandle = [0]\nroi = {radius = 100}\nscale = 2", 2, "anchors, which the ratio of Eq"),
    ],
)
def test_mistakes_leave_nothing(capsys, tmp_path, ball, text, code, message):
    answer = call(capsys, "deform", ball, spec(tmp_path, text), "-o", tmp_path / "out.ply", "--json")
    assert answer.code == answer.result["exit_code"] == code
    assert message in answer.err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["ball.ply", "lift.toml"]


def test_files_that_are_missing_or_there(capsys, tmp_path, ball):
    lift = spec(tmp_path, LIFT)
    assert call(capsys, "deform", tmp_path / "no.ply", lift, "-o", tmp_path / "out.ply").code == 4
    assert call(capsys, "deform", ball, tmp_path / "no.toml", "-o", tmp_path / "out.ply").code == 4
    assert call(capsys, "deform", ball, lift, "-o", tmp_path / "out.txt").code == 4
    assert call(capsys, "deform", ball, lift, "-o", ball).code == 4  # it exists


def test_a_piece_that_nothing_holds(capsys, tmp_path):
    """A speck within the region that no face joins to handle or anchors."""
    speck = tetrahedron().vertices * 0.01 + [0, 0, 1.1]
    both = Mesh(np.vstack([BALL.vertices, speck]), np.vstack([BALL.faces, tetrahedron().faces + BALL.n_vertices]))
    write(tmp_path / "both.ply", both)
    text = LIFT.replace("radius = 0.8", "radius = 0.8, metric = 'euclidean'").replace("radius = 0.3", "radius = 0.05")
    answer = call(capsys, "deform", tmp_path / "both.ply", spec(tmp_path, text), "-o", tmp_path / "out.ply", "--json")
    assert answer.code == 3
    assert set(answer.result["error"]["elements"]) <= set(range(BALL.n_vertices, BALL.n_vertices + 4))


def test_a_creature_s_limb(capsys, tmp_path):
    """The whole of it on a body with limbs, told in percent; without anchors in reach of one another nothing crosses."""
    body = sample("grazer", n_vertices=1500)
    write(tmp_path / "grazer.obj", body)
    tip = body.vertices[np.argmax(body.vertices[:, 2])]
    text = f"handle = {{center = {tip.tolist()}, radius = '4%'}}\nroi = {{radius = '30%'}}\ntranslate = [0, 0.1, 0]\n"
    result = told(
        call(capsys, "deform", tmp_path / "grazer.obj", spec(tmp_path, text), "-o", tmp_path / "o.obj", "--json"), "deform", *KEYS
    )
    assert result["self_intersections"] == 0
    assert abs(result["volume_change"]) < 3


@pytest.mark.parametrize("method", METHODS)
def test_the_horse(capsys, tmp_path, method):
    """A public mesh that is neither closed nor free of obtuse angles: its tail is lifted."""
    text = "handle = {center = [0.0219085, 0.220572, -0.54641], radius = '5%'}\nroi = {radius = '45%'}\ntranslate = [0, 0.2, 0]\n"
    path = data_file("meshes/horse.obj")
    answer = call(capsys, "deform", path, spec(tmp_path, f"method = '{method}'\n{text}"), "-o", tmp_path / "o.obj", "--json")
    result = told(answer, "deform", *KEYS)
    assert (result["handle"], result["free"]) == (112, 1420)
    assert abs(result["volume_change"]) < 8
    rest, found = read(path), read(tmp_path / "o.obj")
    assert np.sum((rest.vertices != found.vertices).any(axis=1)) <= 112 + 1420
    np.testing.assert_array_equal(found.faces, rest.faces)
