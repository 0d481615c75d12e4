"""A mesh into wavelet networks and back: `approximate`, `reconstruct`."""

import numpy as np
import pytest

from cli.calls import call
from cli.test_verbs import told
from mapping.stars import blob
from morphlet import Mesh, Picture, compare, read, write
from morphlet.approximation.rows import RowApproximation
from support import data_file, torus

SIX = ["mexican_hat", "slog1", "polywog1", "beta1", "beta2", "beta3"]
APPROXIMATE = [
    "mse", "mse_relative", "psnr", "deformation_rate", "counts", "wavelets", "blocks",
    "block_error_max", "grid_mse_relative", "over", "size", "layout", "bytes", "repairs",
]  # fmt: skip
SPHERE = [key for key in APPROXIMATE if key not in ("block_error_max", "grid_mse_relative", "size", "layout")]
RECONSTRUCT = ["vertices", "faces", "wavelets", "blocks", "counts"]
SMALL = ("--size", 17)


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    write(path, blob(2))
    return path


def approximated(capsys, mesh, *words, output="ic.npz"):
    """What `approximate` tells of a run that ended well."""
    return told(call(capsys, "approximate", mesh, "-o", mesh.parent / output, *words, "--json"), "approximate", *APPROXIMATE)


def test_there_and_back(capsys, tmp_path, ball):
    """`reconstruct` has the file alone, in another folder."""
    mesh = read(ball)
    result = approximated(capsys, ball, "--wavelets", 6, "--size", 33)
    (tmp_path / "elsewhere").mkdir()
    ic = (tmp_path / "ic.npz").rename(tmp_path / "elsewhere" / "ic.npz")
    ball.unlink()
    answer = call(capsys, "reconstruct", ic, "-o", tmp_path / "elsewhere" / "back.obj", "--json")
    again = told(answer, "reconstruct", *RECONSTRUCT)
    assert (again["vertices"], again["faces"]) == (162, 320)
    assert {key: again[key] for key in RECONSTRUCT[2:]} == {key: result[key] for key in RECONSTRUCT[2:]}
    assert (result["wavelets"], result["blocks"], result["bytes"]) == (6 * 33, 33, ic.stat().st_size)
    assert list(result["counts"]) == SIX
    assert sum(result["counts"].values()) == result["wavelets"]
    back = read(tmp_path / "elsewhere" / "back.obj")
    np.testing.assert_array_equal(back.faces, mesh.faces)
    figures = compare(mesh, back)
    assert figures["mse"] == pytest.approx(result["mse"])
    assert figures["psnr"] == pytest.approx(result["psnr"])
    assert result["mse_relative"] == pytest.approx(result["mse"] / mesh.bbox_diagonal**2)
    assert 0 < result["grid_mse_relative"] < result["mse_relative"] < 1e-3


def test_fifteen_wavelets_in_129_rows_unless_told_otherwise(capsys, ball):
    result = approximated(capsys, ball)
    assert (result["wavelets"], result["blocks"], result["size"], result["layout"], result["over"]) == (
        129 * 15,
        129,
        129,
        "octahedral",
        "rows",
    )


def test_one_network_over_the_whole_sphere(capsys, tmp_path, ball):
    """The other kind of file is told apart by `reconstruct` itself."""
    words = ("approximate", ball, "-o", tmp_path / "whole.npz", "--over", "sphere", "--wavelets", 40, "--residual", "--json")
    result = told(call(capsys, *words), "approximate", *SPHERE)
    assert (result["over"], result["blocks"], result["wavelets"]) == ("sphere", 1, 40)
    assert list(result["counts"]) == SIX
    assert result["counts"]["beta1"] + result["counts"]["beta2"] == 40
    again = told(call(capsys, "reconstruct", tmp_path / "whole.npz", "-o", tmp_path / "back.ply", "--json"), "reconstruct", *RECONSTRUCT)
    assert (again["wavelets"], again["blocks"], again["counts"]) == (40, 1, result["counts"])
    np.testing.assert_allclose(read(tmp_path / "back.ply").vertices, read(ball).vertices, atol=1e-12)


def test_an_error_over_the_sphere_stops_early_or_leaves_nothing(capsys, tmp_path, ball):
    words = ("approximate", ball, "-o", tmp_path / "whole.npz", "--over", "sphere", "--json")
    result = told(call(capsys, *words, "--error", "2%"), "approximate", *SPHERE)
    assert result["wavelets"] < 100
    assert result["psnr"] > 20 * np.log10(50) - 1  # by area there, by vertices here
    answer = call(capsys, *words, "--error", "0.001%", "--wavelets", 3, "--force")
    assert answer.code == 1
    assert "in the worst, with at most 3 wavelets" in answer.err + answer.out


def test_refined_networks_are_nearer(capsys, ball):
    plain, moved = (approximated(capsys, ball, *SMALL, "--wavelets", 4, *more) for more in ((), ("--refinement", "interleaved", "--force")))
    assert moved["block_error_max"] < plain["block_error_max"]
    assert moved["wavelets"] == plain["wavelets"]


def test_a_residual_brings_the_mesh_back(capsys, tmp_path, ball):
    plain = approximated(capsys, ball, "--wavelets", 3, *SMALL)
    exact = approximated(capsys, ball, "--wavelets", 3, *SMALL, "--residual", output="exact.npz")
    assert exact["bytes"] > plain["bytes"]
    assert exact["mse_relative"] < 1e-30 < plain["mse_relative"]
    assert call(capsys, "reconstruct", tmp_path / "exact.npz", "-o", tmp_path / "back.ply", "--quiet").code == 0
    np.testing.assert_allclose(read(tmp_path / "back.ply").vertices, read(ball).vertices, atol=1e-12)


def test_an_error_in_percent_is_one_of_the_diagonal(capsys, ball):
    limit = 0.004 * read(ball).bbox_diagonal
    relative = approximated(capsys, ball, "--error", "0.4%", *SMALL)
    absolute = approximated(capsys, ball, "--error", repr(limit), *SMALL, "--force")
    assert relative["block_error_max"] == pytest.approx(absolute["block_error_max"])
    assert 0 < relative["block_error_max"] <= limit
    assert relative["wavelets"] == absolute["wavelets"]
    finer = approximated(capsys, ball, "--error", "0.1%", *SMALL, "--force")
    assert finer["wavelets"] > relative["wavelets"]


def test_an_error_that_cannot_be_met_leaves_nothing(capsys, tmp_path, ball):
    answer = call(capsys, "approximate", ball, "-o", tmp_path / "ic.npz", "--error", "0.01%", "--wavelets", 2, *SMALL, "--json")
    assert answer.code == answer.result["exit_code"] == 1
    assert "with at most 2 wavelets; allow more --wavelets, or a larger --error" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["ball.ply"]


def test_mothers_of_ones_own_choice(capsys, tmp_path, ball):
    result = approximated(capsys, ball, "--mothers", "slog1, beta2(4,8)", *SMALL)
    assert list(result["counts"]) == [*SIX, "beta2(4,8)"]
    assert {name for name, count in result["counts"].items() if count} == {"slog1", "beta2(4,8)"}
    answer = call(capsys, "reconstruct", tmp_path / "ic.npz", "-o", tmp_path / "back.off", "--json")
    assert told(answer, "reconstruct")["counts"] == result["counts"]


def test_the_other_ways_to_cut_and_choose(capsys, ball):
    words = {
        "separate": ("--coordinates", "separate", "--wavelets", 4),
        "rows": ("--block-rows", 4, "--wavelets", 9),
        "latlong": ("--layout", "latlong"),
        "mp": ("--method", "mp"),
        "none": ("--wavelets", 0),
    }
    results = {name: approximated(capsys, ball, *SMALL, *way, output=f"{name}.npz") for name, way in words.items()}
    assert {name: result["blocks"] for name, result in results.items()} == {"separate": 51, "rows": 5, "latlong": 17, "mp": 17, "none": 17}
    assert results["rows"]["wavelets"] == 45
    assert results["latlong"]["wavelets"] == 15 * 15  # none at the poles
    assert results["none"]["wavelets"] == 0
    assert results["none"]["mse"] == max(result["mse"] for result in results.values())


def test_the_file_does_not_depend_on_threads(capsys, tmp_path, ball):
    for threads in (1, 4):
        approximated(capsys, ball, *SMALL, "--threads", threads, output=f"{threads}.npz")
    one, four = (RowApproximation.load(tmp_path / f"{threads}.npz") for threads in (1, 4))
    np.testing.assert_array_equal(one.mesh().vertices, four.mesh().vertices)


def test_every_vertex_of_a_torn_file_comes_back(capsys, tmp_path, ball):
    """Vertices one per corner, a hole, strays before, a speck behind: count, order and faces stay."""
    whole = read(ball)
    corners = whole.faces[1:].ravel()
    soup, speck = 2 + np.arange(len(corners)).reshape(-1, 3), np.array([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0]])
    faces = np.vstack([soup, 2 + len(corners) + np.arange(3)])
    write(tmp_path / "torn.ply", Mesh(np.vstack([np.eye(3)[:2], whole.vertices[corners], speck]), faces))
    unfit = call(capsys, "approximate", tmp_path / "torn.ply", "-o", tmp_path / "ic.npz", "--json")
    assert unfit.code == 3
    assert "--component largest" in unfit.err or "largest" in unfit.err
    result = approximated(capsys, tmp_path / "torn.ply", "--component", "largest", *SMALL)
    assert {repair["what"].split()[0] for repair in result["repairs"]} >= {"welded", "filled", "dropped"}
    assert call(capsys, "reconstruct", tmp_path / "ic.npz", "-o", tmp_path / "back.ply", "--quiet").code == 0
    back = read(tmp_path / "back.ply")
    np.testing.assert_array_equal(back.faces, faces)
    inside = back.vertices[2:-3]
    _, first, twin = np.unique(corners, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(inside, inside[first][twin])
    assert result["mse"] == pytest.approx(np.mean(np.sum((inside - whole.vertices[corners]) ** 2, axis=1)))


def test_pictures(capsys, tmp_path, ball, monkeypatch):
    """The original beside what comes back; what comes back alone."""
    pixels = np.zeros((2, 3, 3), np.uint8)
    for name in ("rows", "render"):
        monkeypatch.setattr(f"morphlet.report.{name}.render", lambda *_, **__: Picture(pixels, "none", "a test"))
    from matplotlib.image import imread

    result = approximated(capsys, ball, *SMALL, "--picture", tmp_path / "both.png")
    assert result["outputs"] == [str(tmp_path / "ic.npz"), str(tmp_path / "both.png")]
    assert imread(tmp_path / "both.png").shape[:2] == (2, 6)
    words = ("-o", tmp_path / "back.ply", "--picture", tmp_path / "one.png", "--json")
    assert len(told(call(capsys, "reconstruct", tmp_path / "ic.npz", *words), "reconstruct")["outputs"]) == 2
    assert imread(tmp_path / "one.png").shape[:2] == (2, 3)


WRONG = [
    (("--over", "sphere", "--size", 33), "no --size, --layout, --method, --coordinates, --block-rows or --refinement with --over sphere"),
    (("--over", "sphere", "--error", "small"), "a length like 0.01"),
    (("--over", "sphere", "--mothers", "sine"), "one of mexican_hat"),
    (("--wavelets", -1), "n_wavelets >= 0"),
    (("--wavelets", "many"), 'unable to convert "many" into int'),
    (("--mothers", "mexican_hat,unicorn"), "one of mexican_hat.*found 'unicorn'"),
    (("--mothers", "beta2(4)"), "a name like"),
    (("--mothers", "slog1,slog1"), "each mother once"),
    (("--mothers", ""), "one of mexican_hat.*found ''"),
    (("--error", "small"), "a length like 0.01, or 0.1%.*found 'small'"),
    (("--error=-1%",), "a finite error of 0 or more"),
    (("--error", "nan"), "a finite error of 0 or more"),
    (("--error", "1%2"), "a length like 0.01"),
    (("--size", 2), "a size of 3 or more; found 2"),
    (("--block-rows", 0), "1 or more rows per block"),
    (("--block-rows", 200), "1 to 129 rows per block; found 200"),
    (("--method", "best"), "'ols', 'omp', and 'mp'|ols.*omp.*mp"),
    (("--over", "cube"), "rows"),
]


@pytest.mark.parametrize(("words", "match"), WRONG)
def test_wrong_options_are_refused_before_the_work(capsys, tmp_path, ball, monkeypatch, words, match):
    monkeypatch.setattr("morphlet.sphere.map.map_surface", lambda *_: pytest.fail("the work began"))
    answer = call(capsys, "approximate", ball, "-o", tmp_path / "ic.npz", *words, "--json")
    assert answer.code == answer.result["exit_code"] == 2
    with pytest.raises(ValueError, match=match):
        raise ValueError(answer.result["error"]["message"])
    assert [path.name for path in tmp_path.iterdir()] == ["ball.ply"]


def test_a_mesh_that_is_no_sphere_is_unfit(capsys, tmp_path):
    write(tmp_path / "ring.off", torus())
    answer = call(capsys, "approximate", tmp_path / "ring.off", "-o", tmp_path / "ic.npz", "--json")
    assert answer.code == answer.result["exit_code"] == 3
    assert "ring.off" in answer.err


@pytest.mark.parametrize("content", ["none", "text", "mesh", "map"])
def test_other_files_are_no_networks(capsys, tmp_path, ball, content):
    files = {"none": tmp_path / "none.npz", "text": tmp_path / "text.npz", "mesh": ball, "map": tmp_path / "s.npz"}
    files["text"].write_text("text", encoding="utf-8")
    assert call(capsys, "sphere", ball, "-o", files["map"], "--quiet").code == 0
    answer = call(capsys, "reconstruct", files[content], "-o", tmp_path / "back.ply", "--json")
    assert answer.code == answer.result["exit_code"] == 4
    assert files[content].name in answer.err
    assert not (tmp_path / "back.ply").exists()


@pytest.mark.parametrize("verb", ["approximate", "reconstruct"])
def test_help_explains_every_option(capsys, verb):
    answer = call(capsys, verb, "--help")
    assert answer.code == 0
    rows = [line.strip("│ ") for line in answer.out.splitlines() if line.startswith("│")]
    assert not [row for row in rows if row.startswith("--") and len(row.split()) < 3 and row != "--version"]


def test_the_horse_of_the_paper(capsys, tmp_path):
    """The call that the paper's tables count wavelets of, and its size in Table 1."""
    horse = data_file("meshes/horse.obj")
    answer = call(capsys, "approximate", horse, "--wavelets", 15, "-o", tmp_path / "ic.npz", "--json")
    result = told(answer, "approximate", *APPROXIMATE)
    assert (result["wavelets"], result["blocks"]) == (1935, 129)
    assert min(result["counts"].values()) > 100
    assert result["mse_relative"] < 2.3e-5
    assert result["psnr"] > 46.4
    assert result["deformation_rate"] < 0.42
    assert result["bytes"] < 240_000
    answer = call(capsys, "reconstruct", tmp_path / "ic.npz", "-o", tmp_path / "horse.obj", "--json")
    again = told(answer, "reconstruct", *RECONSTRUCT)
    assert (again["vertices"], again["faces"]) == (8431, 16843)
    np.testing.assert_array_equal(read(tmp_path / "horse.obj").faces, read(horse).faces)
