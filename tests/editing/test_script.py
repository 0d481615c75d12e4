"""An edit told in a file: what each key means, and how each mistake is told."""

import tomllib

import numpy as np
import pytest

from morphlet import FileError, InputError, Mesh
from morphlet.editing.arap import Arap
from morphlet.editing.detail import Multiresolution
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.falloff import Direct
from morphlet.editing.guard import Guarded
from morphlet.editing.lattice import Lattice
from morphlet.editing.linear import DualLaplacian, Laplacian, SimilarityLaplacian
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.editing.roi import Roi
from morphlet.editing.script import EVERY, KEYS, METHODS, EditSpec, read_edit, read_spec
from morphlet.editing.shell import Shell
from support import icosphere

BALL = icosphere(3)
DIAGONAL = float(np.sqrt(12))
"""Of the bounding box of the unit ball, nearly."""
START = "handle = [3, 1, 2]\nanchors = [400, 401]\n"


def spec(text):
    """An edit told by a text."""
    return EditSpec("lift.toml", tomllib.loads(text))


def edit(text, mesh=BALL):
    return spec(text).on(mesh)


def refused(text, message, mesh=BALL):
    with pytest.raises(InputError, match=message):
        edit(text, mesh)


def test_the_least_that_must_be_told():
    found = edit(START + "translate = [0, 0, 1]")
    assert (found.name, found.method, found.sequence) == ("arap", Arap(), False)
    assert found.roi.handle.tolist() == [3, 1, 2]
    assert found.roi.anchors.tolist() == [400, 401]
    assert found.roi.weight is None
    np.testing.assert_array_equal(found.pulls[0].targets, BALL.vertices[[3, 1, 2]] + [0, 0, 1])
    assert not found.pulls[0].turns.any()


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("method = 'arap'", Arap()),
        ("smoothing = 0.02", Arap(smoothing=0.02)),
        ("volume = false", Arap()),
        ("volume = true", Shell(thickness=0.0)),
        ("guard = 'self-intersection'", Guarded(Shell(volume="free"))),
        ("volume = true\nguard = 'self-intersection'", Guarded(Shell(volume="kept"))),
        ("detail = 'multiresolution'", Multiresolution(Arap())),
        ("method = 'biharmonic'\ndetail = 'multiresolution'", Multiresolution(Laplacian(order=2))),
        ("method = 'rotations'", EstimatedRotations()),
        ("method = 'laplacian'", Laplacian(order=1)),
        ("method = 'biharmonic'", Laplacian(order=2)),
        ("method = 'similarity'", SimilarityLaplacian()),
        ("method = 'dual'", DualLaplacian()),
        ("method = 'dual'\niterations = 3", DualLaplacian(3)),
        ("method = 'direct'", Direct("gaussian")),
        ("method = 'direct'\nfalloff = 'literal'", Direct("literal")),
        ("method = 'mls'", MovingLeastSquares()),
        ("method = 'mls'\n[mls]\nkind = 'similarity'\nalpha = 2", MovingLeastSquares("similarity", 2.0)),
        ("method = 'ffd'", Lattice()),
        ("method = 'ffd'\n[ffd]\nlattice = [4, 5, 6]\nbasis = 'bernstein'", Lattice((4, 5, 6), "bernstein")),
    ],
)
def test_every_method(text, method):
    found = spec(START + "translate = [0, 0, 1]\n" + text).method
    assert type(found) is type(method)
    assert repr(found) == repr(method)


def test_all_methods_can_be_named():
    named = {"arap", "rotations", "laplacian", "biharmonic", "similarity", "dual", "direct", "mls", "ffd"}
    assert set(METHODS) == set(EVERY) == named


def test_a_handle_as_a_ball_and_a_region_as_a_radius():
    centre, shift = BALL.vertices[7].tolist(), "translate = [0, 0, 1]\n"
    found = edit(f"handle = {{center = {centre}, radius = 0.3}}\nroi = {{radius = 0.5}}\n{shift}")
    near = np.flatnonzero(np.linalg.norm(BALL.vertices - centre, axis=1) <= 0.3)
    np.testing.assert_array_equal(found.roi.handle, near)
    np.testing.assert_array_equal(found.roi.free, Roi.within(BALL, near, 0.5).free)


@pytest.mark.parametrize("metric", ["geodesic", "euclidean", "edges"])
def test_radii_in_percent_of_the_diagonal(metric):
    share = f"roi = {{radius = '20 %', metric = '{metric}'}}\n"
    found = edit("handle = {center = [0, 0, 1.2], radius = '10%'}\ntranslate = [0, 0, 1]\n" + share)
    diagonal = BALL.bbox_diagonal
    near = np.flatnonzero(np.linalg.norm(BALL.vertices - [0, 0, 1.2], axis=1) <= 0.1 * diagonal)
    np.testing.assert_array_equal(found.roi.handle, near)
    np.testing.assert_array_equal(found.roi.free, Roi.within(BALL, near, 0.2 * diagonal, metric).free)


def test_anchors_as_a_ball():
    found = edit("handle = [0]\nanchors = {center = [0, 0, -1], radius = 0.5}\ntranslate = [0, 0, 1]")
    assert (BALL.vertices[found.roi.anchors, 2] < -0.8).all()


def test_it_scales_then_turns_then_shifts():
    found = edit(START + "scale = 2\nrotate = {axis = [0, 0, 3], degrees = 90}\ntranslate = [1, 2, 3]").pulls[0]
    rest = BALL.vertices[[3, 1, 2]]
    middle = rest.mean(axis=0)
    arm = 2 * (rest - middle)
    expected = np.stack([-arm[:, 1], arm[:, 0], arm[:, 2]], axis=1) + middle + [1, 2, 3]
    np.testing.assert_allclose(found.targets, expected, atol=1e-12)


def test_a_turn_about_a_place():
    found = edit(START + "rotate = {axis = [1, 0, 0], degrees = 180, center = [0, 5, 0]}\nscale = 3").pulls[0]
    x, y, z = (3 * (BALL.vertices[[3, 1, 2]] - [0, 5, 0])).T
    np.testing.assert_allclose(found.targets, np.stack([x, 5 - y, -z], axis=1), atol=1e-12)


def test_turns_are_told_to_each_piece_of_the_handle():
    """Full turns too, which positions do not show."""
    found = edit("handle = [0, 300]\nanchors = [500]\nrotate = {axis = [0, 2, 0], degrees = 450, center = 'handle'}")
    assert found.roi.handle_parts.tolist() == [0, 1]
    np.testing.assert_allclose(found.pulls[0].turns, [[0, 2.5 * np.pi, 0]] * 2)


def test_targets():
    found = edit(START + "targets = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]")
    np.testing.assert_array_equal(found.pulls[0].targets, np.eye(3))


def test_a_path_is_told_from_rest_frame_by_frame():
    """Turns of positions add up over the frames, beyond a half turn."""
    frames = ", ".join(f"{{rotate = {{axis = [0, 0, 1], degrees = {d}}}, translate = [0, 0, {d}]}}" for d in (90, 180, 270))
    found = edit(START + f"path = [{frames}]")
    assert found.sequence
    assert [pull.targets[0, 2] - BALL.vertices[3, 2] for pull in found.pulls] == pytest.approx([90, 180, 270])
    assert [pull.turns[0, 2] for pull in found.pulls] == pytest.approx([np.pi / 2, np.pi, 1.5 * np.pi])
    by_targets = ", ".join(f"{{targets = {(pull.targets).tolist()}}}" for pull in found.pulls)
    again = edit("handle = [3, 1, 2]\nanchors = [400, 401]\n" + f"path = [{by_targets}]")
    assert len(np.unique(again.roi.handle_parts)) == 3  # so nothing can be seen of a turn
    assert not again.pulls[2].turns.any()
    patch = Roi(BALL, [0], []).grown(1).moving.tolist()
    whole = edit(f"handle = {patch}\nanchors = [400]\npath = [{frames}]")
    again = edit(
        f"handle = {patch}\nanchors = [400]\npath = [" + ", ".join(f"{{targets = {p.targets.tolist()}}}" for p in whole.pulls) + "]"
    )
    np.testing.assert_allclose(again.pulls[2].turns, [[0, 0, 1.5 * np.pi]], atol=1e-6)


def test_a_soft_handle():
    assert edit(START + "translate = [0, 0, 1]\nweight = 2.5").roi.weight.tolist() == [2.5] * 3


def test_copies_of_a_vertex_are_one():
    """Vertices 0 and 4 of the file are one of the mesh; the rows of the targets are those of the file."""
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    places = np.array([3, 1, 2, 0, 3, -1])
    start = "handle = [0, 1, 4]\nanchors = [2]\n"
    found = spec(start + "targets = [[9, 0, 0], [5, 0, 0], [9, 0, 0]]").on(square, places)
    assert found.roi.handle.tolist() == [3, 1]
    assert found.pulls[0].targets.tolist() == [[9, 0, 0], [5, 0, 0]]
    assert spec(start + "translate = [1, 0, 0]").on(square, places).pulls[0].targets.tolist() == [[1, 1, 0], [2, 0, 0]]
    with pytest.raises(InputError, match=r"one target for handle vertices at one place; found 1 that differ \(first: 2\)"):
        spec(start + "targets = [[9, 0, 0], [5, 0, 0], [8, 0, 0]]").on(square, places)
    with pytest.raises(InputError, match=r"vertices that belong to faces as handle in lift.toml; found 1 that do not \(first: 5\)"):
        spec("handle = [5, 1]\nanchors = [2]\nscale = 2").on(square, places)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("handel = [1]", "'handel'; did you mean 'handle'?"),
        ("passes = 5", "needed known keys in lift.toml: method, handle, .*; found 'passes'"),
        ("iterations = 5", "keys for the method arap in lift.toml; found 'iterations', which is for dual; remove it"),
        ("scale = 2\nmethod = 'dual'\niterations = 2.5", "needed an integer as iterations; found 2.5"),
        ("method = 'similarity'\ndetail = 'multiresolution'", "keys for the method similarity in lift.toml; found 'detail'"),
        ("method = 'magic'\nscale = 2", "one of arap, .*, ffd as method in lift.toml; found 'magic'"),
        ("method = 'aarap'\nscale = 2", "did you mean 'arap'"),
        ("method = 'arap'\nscale = 2\nfalloff = 'gaussian'", "keys for the method arap in lift.toml; found 'falloff', which is for direct"),
        ("method = 'mls'\nscale = 2\nweight = 1", "found 'weight', which is for arap and rotations and laplacian and biharmonic"),
        ("scale = 2\n[ffd]\nbasis = 'bspline'", "found 'ffd', which is for ffd"),
        ("method = 'mls'\nscale = 2\nvolume = true", "found 'volume', which is for arap"),
        ("scale = 2\nvolume = 1", "true or false as volume; found 1"),
        ("scale = 2\nguard = true", "'self-intersection' as guard; found True"),
        ("scale = 2\nsmoothing = 0.1\nguard = 'self-intersection'", "smoothing alone, or volume and guard; found both"),
        ("scale = 2\ndetail = 'fine'", "'multiresolution' as detail; found 'fine'"),
        ("method = 'mls'\nscale = 2\ndetail = 'multiresolution'", "found 'detail', which is for arap and rotations"),
        ("scale = 2\nsmoothing = 'a bit'", "a number as smoothing; found 'a bit'"),
        ("method = 'direct'\nscale = 2\nfalloff = 'box'", "as falloff; found 'box'"),
        ("method = 'mls'\nscale = 2\n[mls]\nbeta = 2", "known keys in mls: kind, alpha; found 'beta'"),
        ("method = 'mls'\nscale = 2\n[mls]\nalpha = 'much'", "a number as alpha; found 'much'"),
        ("method = 'ffd'\nscale = 2\n[ffd]\nlattice = [1, 2, 3]", "at least 2 control points along each axis"),
        ("method = 'ffd'\nscale = 2\nffd = 4", "a table with lattice and basis as ffd; found 4"),
        ("", "where the handle goes in lift.toml: translate/rotate/scale or targets or path; found none of them"),
        ("scale = 2\ntargets = [[0, 0, 0]]", "where the handle goes .*; found scale and targets"),
        ("scale = 2\nroi = {radius = 1}", "what may move in lift.toml: anchors or roi; found anchors and roi"),
        ("path = []", "a list of tables as path in lift.toml"),
        ("path = [1]", "a list of tables as path"),
        ("path = [{weight = 1}]", "known keys in path in lift.toml: translate, rotate, scale, targets; found 'weight'"),
        ("path = [{}]", "a motion in each frame of the path in lift.toml: .*; found none of them"),
        ("path = [{scale = 2, targets = [[0, 0, 0]]}]", "a motion in each frame of the path"),
        ("translate = [1, 2]", "translate of shape"),
        ("translate = [1, 2, nan]", "finite numbers in translate"),
        ("translate = 'up'", "an array of numbers as translate"),
        ("scale = 0", "a scale above 0; found 0"),
        ("scale = true", "a number as scale; found True"),
        ("scale = inf", "a number as scale; found inf"),
        ("rotate = 5", "a table with axis and degrees and center as rotate; found 5"),
        ("rotate = {axis = [0, 0, 1]}", "needed degrees in rotate; found axis"),
        ("rotate = {axis = [0, 0, 0], degrees = 5}", "an axis with a direction in rotate"),
        ("rotate = {axis = [0, 0, 1], degrees = 5, centre = [0, 0, 0]}", "found 'centre'; did you mean 'center'"),
        ("rotate = {axis = [0, 0, 1], degrees = 5, center = 'anchors'}", "an array of numbers as center"),
        ("targets = [[0, 0, 0]]", "targets of shape"),
        ("scale = 2\nweight = 0", "positive weights of handle vertices"),
    ],
)
def test_mistakes(text, message):
    """Each names the key; the file where the key alone would not do."""
    refused(START + text, message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("anchors = [1]\nscale = 2", "a handle in lift.toml; found none"),
        ("handle = [0]\nscale = 2", "what may move in lift.toml: anchors or roi; found none of them"),
        ("handle = [0, 0]\nanchors = [1]\nscale = 2", r"each vertex of handle once in lift.toml; found 1 repeated"),
        ("handle = [642]\nanchors = [1]\nscale = 2", "indices from 0 to 641 in handle"),
        ("handle = []\nanchors = [1]\nscale = 2", "needed a handle; found no handle vertex"),
        ("handle = [0]\nanchors = [0]\nscale = 2", "handle or anchor; found 1 that are both"),
        ("handle = 'nose'\nanchors = [0]\nscale = 2", "integer indices in handle"),
        ("handle = {center = [0, 0, 9], radius = 1}\nanchors = [0]\nscale = 2", "a vertex within 1 of"),
        ("handle = {center = [0, 0, 1]}\nanchors = [0]\nscale = 2", "needed radius in handle in lift.toml; found center"),
        ("handle = [0]\nroi = {radius = '5'}\nscale = 2", "a number or a text like \"5%\" as radius; found '5'"),
        ("handle = [0]\nroi = {radius = 'wide%'}\nscale = 2", "as radius; found 'wide%'"),
        ("handle = [0]\nroi = {radius = '-5%'}\nscale = 2", "a radius above 0"),
        ("handle = [0]\nroi = {metric = 'edges'}\nscale = 2", "needed radius in roi in lift.toml; found metric"),
        ("handle = [0]\nroi = {radius = 1, metric = 'taxi'}\nscale = 2", "as metric; found 'taxi'"),
        ("handle = [0]\nroi = 3\nscale = 2", "a table with radius and metric as roi in lift.toml; found 3"),
    ],
)
def test_mistakes_about_the_region(text, message):
    refused(text, message)


def test_files(tmp_path):
    file = tmp_path / "lift.toml"
    file.write_text(START + "translate = [0, 0, 1]", encoding="utf-8")
    assert read_edit(file, BALL).pulls[0].targets.shape == (3, 3)
    with pytest.raises(FileError, match=r"a TOML file at .*none\.toml; found No such file"):
        read_spec(tmp_path / "none.toml")
    file.write_text("handle = [1, 2", encoding="utf-8")
    with pytest.raises(FileError, match=r"a TOML file at .*lift\.toml; found Unclosed array"):
        read_spec(file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match="a TOML file at"):
        read_spec(file)


def test_each_key_is_for_a_method_there_is():
    assert all(set(methods) <= set(EVERY) and methods for methods in KEYS.values())
