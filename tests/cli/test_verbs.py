"""Every verb does what it says and tells what was promised."""

import hashlib
import json

import numpy as np
import pytest

from cli.calls import Answer, call
from mapping.stars import blob
from morphlet import Mesh, read, read_pairs, write
from morphlet.samples.catalogue import CATALOGUE, Entry
from support import icosphere, tetrahedron, torus

HEAD = ["verb", "inputs", "outputs", "seconds", "cpu_seconds"]
INFO = [
    "vertices", "faces", "components", "boundary_loops", "genus", "nonmanifold_edges", "duplicate_directed_edges",
    "unreferenced_vertices", "degenerate_faces", "area", "volume", "bbox_diagonal", "fit_for_sphere", "advice",
]  # fmt: skip
SPHERE = ["inverted", "degree", "iso_mean", "iso_p99", "iso_max", "angle_mean_deg", "area_log_std", "symmetric_dirichlet"]
CORRESPOND = ["folds_sphere", "folds_surface_percent", "energy", "energy_mean", "pairs", "pairs_rmse", "margin", "ambiguous"]
MORPH = [*CORRESPOND, "frames", "volume_change_max", "edge_log_rms_max", "self_intersections_max", "mse", "deformation_rate"]


@pytest.fixture
def ball(tmp_path):
    """A lopsided ball, as a file with a space and an umlaut in its name."""
    path = tmp_path / "a bäll.ply"
    write(path, blob(2))
    return path


def told(answer: Answer, verb: str, *keys: str) -> dict:
    """The result of a run that ended well, once it is certain that it has these keys."""
    assert answer.code == 0, answer.err
    assert "Traceback" not in answer.err
    result = answer.result
    assert list(result)[:5] == HEAD
    assert result["verb"] == verb
    assert result["seconds"] >= 0
    assert set(keys) <= set(result)
    return result


def test_info(capsys, ball):
    result = told(call(capsys, "info", ball, "--json"), "info", *INFO)
    assert result["inputs"] == [str(ball)]
    assert (result["vertices"], result["faces"], result["genus"], result["fit_for_sphere"]) == (162, 320, 0, True)


def test_info_for_people(capsys, ball):
    answer = call(capsys, "info", ball)
    assert answer.code == 0
    assert "vertices                  162\n" in answer.out
    assert "fit_for_sphere            yes\n" in answer.out


def test_info_of_an_unfit_mesh_is_an_answer_not_an_error(capsys, tmp_path):
    write(tmp_path / "ring.off", torus())
    result = told(call(capsys, "info", tmp_path / "ring.off", "--json"), "info", *INFO)
    assert (result["genus"], result["fit_for_sphere"]) == (1, False)
    assert "--cut-handles 1" in result["advice"]


def test_repair(capsys, tmp_path):
    ball, speck = icosphere(1), Mesh(np.eye(3) + 9, [[0, 1, 2]])
    faces = np.vstack([ball.faces[:-1], ball.faces[0, ::-1] * 0 + ball.n_vertices + speck.faces[0]])
    write(tmp_path / "a.obj", Mesh(np.vstack([ball.vertices, speck.vertices]), faces))
    answer = call(capsys, "repair", tmp_path / "a.obj", "-o", tmp_path / "b.ply", "--fill", "all", "--json")
    result = told(answer, "repair", "before", "after", "repairs")
    assert set(INFO) == set(result["before"]) == set(result["after"])
    assert result["repairs"] == [
        {"what": "dropped components other than the largest", "count": 1},
        {"what": "filled boundary loops of 3 edges", "count": 1},
    ]
    assert (result["before"]["components"], result["after"]["components"], result["after"]["boundary_loops"]) == (2, 1, 0)
    assert read(tmp_path / "b.ply").topology.euler_characteristic == 2


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        (["--component", "all"], "components"),
        (["--fill", "none"], "boundary_loops"),
        (["--no-orient", "--no-split", "--fill", "none"], "duplicate_directed_edges"),
    ],
)
def test_repairs_can_be_turned_off(capsys, tmp_path, options, kept):
    ball, speck = icosphere(4), tetrahedron()
    faces = np.vstack([ball.faces[1:], ball.n_vertices + speck.faces])
    faces[-10] = faces[-10, ::-1]
    write(tmp_path / "a.off", Mesh(np.vstack([ball.vertices, 0.1 * speck.vertices + 2]), faces))
    whole = told(call(capsys, "repair", tmp_path / "a.off", "-o", tmp_path / "b.off", "--json"), "repair")
    partly = told(call(capsys, "repair", tmp_path / "a.off", "-o", tmp_path / "c.off", "--json", *options), "repair")
    assert whole["after"][kept] < partly["after"][kept]


def test_sphere(capsys, tmp_path, ball):
    answer = call(capsys, "sphere", ball, "-o", tmp_path / "s.npz", "--p", "0.5", "--weights", "area", "--json")
    result = told(answer, "sphere", *SPHERE, "iterations", "virtual_vertices", "repairs")
    assert (result["inverted"], result["virtual_vertices"], result["repairs"]) == (0, 0, [])
    assert result["outputs"] == [str(tmp_path / "s.npz")]
    assert result["iterations"] > 0
    with np.load(tmp_path / "s.npz", allow_pickle=False) as file:
        assert (str(file["kind"]), str(file["fingerprint"])) == ("sphere", read(ball).fingerprint)
        assert {"points", "faces", "version"} <= set(file.files)


def test_image(capsys, tmp_path, ball):
    result = told(call(capsys, "image", ball, "-o", tmp_path / "i.png", "--size", 33, "--json"), "image", "size", "rmse")
    assert (tmp_path / "i.png").read_bytes().startswith(b"\x89PNG")
    assert result["size"] == 33
    assert 0 < result["rmse"] < 0.2  # the mesh is twice as large, its edges about 0.3
    answer = call(capsys, "image", ball, "-o", tmp_path / "i.npz", "--size", 17, "--layout", "latlong", "--json")
    told(answer, "image")
    with np.load(tmp_path / "i.npz", allow_pickle=False) as file:
        assert file["positions"].shape == (17, 34, 3)


def test_correspond(capsys, tmp_path, ball):
    answer = call(capsys, "correspond", ball, ball, "-o", tmp_path / "c.npz", "--json")
    result = told(answer, "correspond", *CORRESPOND)
    assert (result["folds_sphere"], result["pairs"], result["pairs_rmse"], result["ambiguous"]) == (0, 0, None, False)
    assert "the spheres were turned by a search" in answer.err
    assert any("give pairs" in warning for warning in result["warnings"])
    assert result["energy"] == pytest.approx(1, abs=0.02)  # A onto itself


def test_compare(capsys, tmp_path, ball):
    mesh = read(ball)
    write(tmp_path / "b.obj", mesh.with_vertices(mesh.vertices + np.array([0, 0, 2])))
    result = told(call(capsys, "compare", ball, tmp_path / "b.obj", "--json"), "compare", "hausdorff", "psnr")
    assert (result["mse"], result["rms"]) == (pytest.approx(4), pytest.approx(2))
    assert (result["volume_change"], result["edge_log_rms"]) == (pytest.approx(0, abs=1e-9), pytest.approx(0, abs=1e-9))
    assert told(call(capsys, "compare", ball, ball, "--json"), "compare")["psnr"] is None  # infinite


def test_sample_depends_on_the_seed_alone(capsys, tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        arguments = ("-o", tmp_path / f"{name}.ply", "--vertices", 1500, "--seed", seed, "--json")
        assert told(call(capsys, "sample", "blob", *arguments), "sample")["vertices"] == 1500
    a, b, c = ((tmp_path / f"{name}.ply").read_bytes() for name in "abc")
    assert a == b != c


def test_fetch(capsys, tmp_path, monkeypatch):
    content = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "mirror").mkdir()
    (tmp_path / "mirror" / "toy.obj").write_bytes(content)
    monkeypatch.setitem(CATALOGUE, "toy.obj", Entry("https://example.org/toy.obj", hashlib.sha256(content).hexdigest(), "CC0"))
    found = told(call(capsys, "fetch", "toy.obj", "--mirror", tmp_path / "mirror", "--json"), "fetch", "path", "sha256", "licence")
    assert found["outputs"] == [found["path"]] == [str(tmp_path / "mirror" / "toy.obj")]
    answer = call(capsys, "fetch", "toy.obj", "--mirror", tmp_path / "mirror", "-o", tmp_path / "copy.obj", "--json")
    assert told(answer, "fetch")["path"] == str(tmp_path / "copy.obj")
    assert (tmp_path / "copy.obj").read_bytes() == content
    (tmp_path / "mirror" / "toy.obj").write_bytes(content + b"#")
    assert call(capsys, "fetch", "toy.obj", "--mirror", tmp_path / "mirror").code == 4


def test_warmup(capsys):
    told(call(capsys, "warmup", "--json"), "warmup")
    assert told(call(capsys, "warmup", "--json"), "warmup")["compiled_before"] is True


def test_demo_does_the_main_job(capsys, tmp_path):
    """The whole of `morph` too: what it tells, on stdout and in result.json, and what it writes."""
    folder = tmp_path / "new" / "démo"
    result = told(call(capsys, "demo", "-o", folder, "--vertices", 1500, "--picture", tmp_path / "sheet.png", "--json"), "demo", *MORPH)
    assert result["self_intersections_max"] == 0
    assert (result["folds_sphere"], result["frames"]) == (0, 24)
    pairs = read_pairs(folder / "meshes" / "grazer-predator.csv")
    assert result["pairs"] == len(pairs) > 10
    files = {f"morph/frame-{k:03d}.ply" for k in range(24)} | {f"morph/{name}" for name in ("morph.glb", "report.html", "result.json")}
    files |= {"morph/contact-sheet.png", "meshes/grazer.obj", "meshes/predator.obj", "meshes/grazer-predator.csv"}
    written = {str(folder / name) for name in files} | {str(tmp_path / "sheet.png")}
    assert set(result["outputs"]) == written == {str(p) for p in tmp_path.rglob("*") if p.is_file()}
    kept = json.loads((folder / "morph" / "result.json").read_text("utf-8"))
    assert kept.keys() == result.keys()
    assert {key: kept[key] for key in MORPH} == {key: result[key] for key in MORPH}
    assert read(folder / "morph" / "frame-000.ply").fingerprint == read(folder / "meshes" / "grazer.obj").fingerprint
