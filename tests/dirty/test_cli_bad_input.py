"""Bad input through the real command line: mended and said so, or refused in three parts; never a traceback, never half a file."""

import re

import numpy as np
import pytest

from cli.calls import call, finished, start
from mapping.stars import blob
from morphlet import Mesh, MeshError, VertexPairs, embed, spherical_map, write, write_pairs
from morphlet.surface.repair import close
from support import beside, data_file, icosphere, tetrahedron, torus

THREE_PARTS = re.compile(r"morphlet \w+: needed .+; found .+; .+\n")
VERBS = {
    "info": (),
    "repair": ("-o", "out.ply"),
    "sphere": ("-o", "out.npz"),
    "image": ("-o", "out.png", "--size", "17"),
}
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n"
PLY += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.fixture
def attempt(capsys, tmp_path, monkeypatch):
    """Run a verb in an empty folder: an answer that is either whole or a refusal in three parts."""
    outputs = tmp_path / "outputs"
    outputs.mkdir()
    monkeypatch.chdir(outputs)

    def run(verb, path, *options):
        for old in outputs.iterdir():
            old.unlink()
        answer = call(capsys, verb, path, *VERBS[verb], *options, "--json", "--quiet")
        left = [file.name for file in outputs.iterdir()]
        assert answer.result["verb"] == verb
        if answer.code == 0:
            assert answer.err == ""
            assert left == answer.result["outputs"] == list(VERBS[verb][1:2])
        else:
            assert answer.code == answer.result["exit_code"]
            assert THREE_PARTS.fullmatch(answer.err), answer.err
            assert left == []
        return answer

    return run


def sheet_with_handle() -> Mesh:
    """A torus with a hole: open, and of genus 1."""
    return Mesh(torus().vertices, torus().faces[2:])


UNREADABLE = {
    "empty.obj": b"",
    "words.obj": b"Dear reader,\nthis is a letter.\n",
    "words.txt": b"Dear reader,\nthis is a letter.\n",
    "picture.obj": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256)),
    "nan.off": TETRAHEDRON.replace("1 0 0", "nan 0 0").encode(),
    "infinite.obj": b"v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n",
    "range.off": TETRAHEDRON.replace("3 1 2 3", "3 1 2 9").encode(),
    "zero.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    "cut.ply": PLY + bytes(50),
    "cut.off": TETRAHEDRON[:40].encode(),
    "huge.ply": PLY.replace(b"vertex 4", b"vertex 99999999999999") + bytes(96),
    "array.npz": b"PK\x03\x04" + bytes(60),
    "points.obj": b"v 0 0 0\nv 1 0 0\n",
    "points.off": b"OFF\n2 0 0\n0 0 0\n1 0 0\n",
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_mesh_file_is_refused(attempt, tmp_path, name, verb):
    (tmp_path / name).write_bytes(UNREADABLE[name])
    answer = attempt(verb, tmp_path / name)
    assert answer.code == 4
    assert name in answer.err or "file" in answer.err


@pytest.mark.parametrize("verb", VERBS)
def test_folders_and_missing_files_are_refused(attempt, tmp_path, verb):
    for path in (tmp_path, tmp_path / "gone.obj", tmp_path / ("long" * 100), ""):
        assert attempt(verb, path).code == 4


UNFIT = {
    "a torus": (torus(), r"genus 0.*found a genus 1 surface.*--cut-handles 1"),
    "a sphere beside a torus": (
        beside(icosphere(2), torus((5, 0, 0))),
        "one connected surface.*found 2 conn.*--component largest",
    ),
    "two spheres": (beside(icosphere(1), icosphere(1).with_vertices(icosphere(1).vertices + 5)), "2 connected components"),
    "an open sheet with a handle": (sheet_with_handle(), "genus 1 surface"),
    "one triangle": (Mesh(np.eye(3), [[0, 1, 2]]), "at least 4 vertices.*found 3 vertices and 1 face"),
    "flat faces only": (Mesh(np.eye(3), [[0, 1, 1], [0, 0, 2]]), "at least 4 vertices.*found no faces"),
}


@pytest.mark.parametrize("name", UNFIT)
def test_meshes_without_a_spherical_map_are_refused_with_the_reason(attempt, tmp_path, name):
    mesh, match = UNFIT[name]
    write(tmp_path / "mesh.ply", mesh)
    for verb in ("sphere", "image"):
        answer = attempt(verb, tmp_path / "mesh.ply")
        assert answer.code == 3
        assert re.search(match, answer.err), answer.err
        assert "mesh.ply" in answer.err
    facts = attempt("info", tmp_path / "mesh.ply").result
    assert facts["fit_for_sphere"] is False
    left = attempt("repair", tmp_path / "mesh.ply")
    assert left.code == (3 if name == "flat faces only" else 0)
    assert left.code == 0 or re.search("faces to keep in .*found none of 2", left.err)


@pytest.mark.parametrize("flat", [0, 1])
def test_maps_want_area_on_both_sides(capsys, tmp_path, flat):
    ball = icosphere(2)
    meshes = [ball, ball]
    meshes[flat] = ball.with_vertices(ball.vertices * [1, 0, 0])
    files = [tmp_path / f"{k}.ply" for k in range(2)]
    for file, mesh in zip(files, meshes, strict=True):
        write(file, mesh)
    (tmp_path / "pairs.csv").write_text("source,target\n0,0\n1,1\n2,2\n3,3\n")
    answer = call(capsys, "correspond", *files, "--pairs", tmp_path / "pairs.csv", "-o", tmp_path / "map.npz")
    assert answer.code == 3
    assert re.search(rf"a surface with area in .*{flat}\.ply; found 320 faces without any", answer.err)
    with pytest.raises(MeshError, match="a surface with area"):
        embed(close(meshes[0]), spherical_map(meshes[1]), VertexPairs([0, 1, 2, 3], [0, 1, 2, 3]))


def test_what_was_refused_is_done_when_asked_for(attempt, tmp_path):
    write(tmp_path / "both.ply", beside(icosphere(2), torus((5, 0, 0)).with_vertices(torus().vertices * 0.2 + 5)))
    write(tmp_path / "ring.ply", torus())
    assert attempt("sphere", tmp_path / "both.ply", "--component", "largest").result["repairs"]
    done = attempt("sphere", tmp_path / "ring.ply", "--cut-handles", "1").result
    assert "cut handles" in done["repairs"][0]["what"]
    assert done["inverted"] == 0


def ball_with(change) -> Mesh:
    ball = icosphere(2)
    vertices, faces = ball.vertices.copy(), ball.faces.copy()
    return Mesh(*change(vertices, faces))


MENDED = {
    "a reversed face": (ball_with(lambda v, f: (v, np.vstack([f[:-1], f[-1:, ::-1]]))), "reversed"),
    "all faces reversed": (ball_with(lambda v, f: (v, f[:, ::-1])), "turned closed components outwards"),
    "a repeated face": (ball_with(lambda v, f: (v, np.vstack([f, f[:1]]))), "vertices of an earlier face"),
    "a face that repeats a vertex": (ball_with(lambda v, f: (v, np.vstack([f, [[0, 0, 1]]]))), "repeat a vertex"),
    "a stray vertex": (ball_with(lambda v, f: (np.vstack([v, [[3, 3, 3]]]), f)), "vertices in no face"),
    "soup": (ball_with(lambda v, f: (v[f].reshape(-1, 3), np.arange(f.size).reshape(-1, 3))), "welded"),
    "a hole": (ball_with(lambda v, f: (v, f[6:])), "filled"),
    "an open sheet": (Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]), "filled"),
}


@pytest.mark.parametrize("name", MENDED)
def test_what_can_be_mended_is_mended_and_said(attempt, capsys, tmp_path, name):
    mesh, what = MENDED[name]
    write(tmp_path / "mesh.ply", mesh)
    for verb in ("sphere", "image"):
        answer = attempt(verb, tmp_path / "mesh.ply")
        assert answer.code == 0, answer.err
        assert any(what in repair["what"] and repair["count"] > 0 for repair in answer.result["repairs"])
    assert f"mesh.ply: {answer.result['repairs'][0]['what']}" in call(capsys, "sphere", tmp_path / "mesh.ply", "-o", tmp_path / "s.npz").err
    advice = attempt("info", tmp_path / "mesh.ply").result["advice"]
    assert advice.startswith("ready for a spherical map once mended: ")
    assert what in advice


DEGENERATE = {
    "all vertices equal": icosphere(2).with_vertices(np.ones((162, 3))),
    "needles": blob(2).with_vertices(blob(2).vertices * [1, 1e-7, 1e4]),
    "flat": icosphere(2).with_vertices(icosphere(2).vertices * [1, 1, 0]),
    "tiny": blob(2).with_vertices(blob(2).vertices * 1e-150),
    "huge": blob(2).with_vertices(blob(2).vertices * 1e100),
    "far away": blob(2).with_vertices(blob(2).vertices + 1e9),
    "a tetrahedron": tetrahedron(),
    "coincident neighbours": icosphere(2).with_vertices(np.where(np.arange(162)[:, None] < 30, 1.0, icosphere(2).vertices)),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_positions_still_give_a_map_without_folds(attempt, tmp_path, name):
    """Topology decides on a map; positions only on how good it is."""
    write(tmp_path / "mesh.ply", DEGENERATE[name])
    done = attempt("sphere", tmp_path / "mesh.ply")
    assert (done.code, done.result["inverted"], done.result["degree"]) == (0, 0, pytest.approx(1)), done.err
    for verb in ("info", "repair", "image"):
        assert attempt(verb, tmp_path / "mesh.ply").code == 0


PAIRS = {
    "another header": ("a,b\n1,2\n", 4, r"the header source,target\[,weight\]\[,label\]"),
    "no header": ("0,0\n5,5\n", 4, "the header source,target"),
    "an empty file": ("", 4, "the header source,target"),
    "no integer": ("source,target\n1.5,2\n", 4, "a vertex index from 0 as source on line 2.*'1.5'"),
    "a negative index": ("source,target\n0,0\n-1,2\n", 4, "line 3.*'-1'"),
    "a word": ("source,target\nnose,2\n", 4, "'nose'"),
    "a missing column": ("source,target\n1\n", 4, "2 columns on line 2"),
    "a negative weight": ("source,target,weight\n1,2,-1\n", 4, "a positive number as weight on line 2"),
    "out of range": ("source,target\n0,0\n3,99999\n", 2, "indices from 0 to 161 in the target column of the pairs"),
    "none": ("source,target\n", 2, "needed pairs in .*; found a header without any"),
    "two that contradict": ("source,target\n3,3\n3,9\n", 2, "fixed pairs that name each vertex once"),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pairs_that_cannot_be_used_are_refused(capsys, tmp_path, name):
    text, code, match = PAIRS[name]
    write(tmp_path / "a.ply", blob(2))
    (tmp_path / "pairs.csv").write_text(text, encoding="utf-8")
    for verb, output in (("correspond", "c.npz"), ("morph", "out")):
        files = (tmp_path / "a.ply", tmp_path / "a.ply", "--pairs", tmp_path / "pairs.csv", "-o", tmp_path / output)
        answer = call(capsys, verb, *files, "--quiet", "--json")
        assert answer.code == answer.result["exit_code"] == code, answer.err
        assert THREE_PARTS.fullmatch(answer.err)
        assert re.search(match, answer.err), answer.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "pairs.csv"]


@pytest.mark.parametrize("times", [1, 3])
def test_one_pair_of_meshes_without_features_is_answered_and_said_to_be_too_little(capsys, tmp_path, times):
    write(tmp_path / "a.ply", blob(2))
    (tmp_path / "pairs.csv").write_text("source,target\n" + times * "3,3\n", encoding="utf-8")
    files = (tmp_path / "a.ply", tmp_path / "a.ply", "--pairs", tmp_path / "pairs.csv", "-o", tmp_path / "c.npz")
    answer = call(capsys, "correspond", *files, "--json")
    assert (answer.code, answer.result["folds_sphere"]) == (0, 0)
    assert any("give more landmarks" in warning or "give pairs" in warning for warning in answer.result["warnings"])
    assert answer.result["warnings"][0] in answer.err


def test_repeated_pairs_among_others_do_no_harm(capsys, tmp_path):
    write(tmp_path / "a.ply", blob(2))
    once = np.array([3, 40, 80, 120])
    for name, chosen in (("once", once), ("twice", np.repeat(once, 2))):
        write_pairs(tmp_path / f"{name}.csv", VertexPairs(chosen, chosen))
        words = ("--pairs", tmp_path / f"{name}.csv", "-o", tmp_path / f"{name}.npz", "--quiet", "--json")
        assert call(capsys, "correspond", tmp_path / "a.ply", tmp_path / "a.ply", *words).result["pairs_rmse"] < 1e-4


def test_an_unfit_target_is_named(capsys, tmp_path):
    write(tmp_path / "a.ply", blob(1))
    write(tmp_path / "b.ply", torus())
    answer = call(capsys, "morph", tmp_path / "a.ply", tmp_path / "b.ply", "-o", tmp_path / "out", "--quiet")
    assert answer.code == 3
    assert "b.ply" in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("frames", [-1, 0, 1])
def test_too_few_frames_are_refused_before_the_work(capsys, tmp_path, frames):
    answer = call(capsys, "morph", "gone.ply", "gone.ply", "-o", tmp_path / "out", f"--frames={frames}")
    assert answer.code == 2
    assert f"at least 2 frames, the source and the target; found {frames}" in answer.err


def test_a_refusal_of_the_real_process(tmp_path):
    write(tmp_path / "ring.ply", torus())
    answer = finished(start("sphere", "ring.ply", "-o", "s.npz", "--json", cwd=tmp_path))
    assert answer.code == answer.result["exit_code"] == 3
    assert THREE_PARTS.fullmatch(answer.err)
    assert [path.name for path in tmp_path.iterdir()] == ["ring.ply"]


BAD = ("beetle-alt.obj", "suzanne.obj", "spot.obj", "truck.obj", "cube_40k.obj")
CLEAN = {"spot.obj"}
"""Closed by its position indices: there is nothing to mend."""


@pytest.mark.parametrize("name", BAD)
def test_public_bad_meshes(attempt, name):
    path = data_file(f"bad/{name}")
    fit = attempt("info", path).result["fit_for_sphere"]
    assert attempt("sphere", path).code == (0 if fit else 3)
    for verb in ("repair", "image"):
        answer = attempt(verb, path, "--component", "largest")
        assert answer.code == 0, answer.err
        assert bool(answer.result["repairs"]) == (name not in CLEAN)


def test_public_mesh_of_triangle_strips(attempt):
    facts = attempt("info", data_file("bad/igea.ply")).result
    assert (facts["vertices"], facts["faces"], facts["fit_for_sphere"]) == (134345, 268686, True)


def test_fertility_is_refused_with_its_genus(attempt):
    answer = attempt("sphere", data_file("meshes/fertility.off"))
    assert answer.code == 3
    assert "a genus 4 surface" in answer.err
