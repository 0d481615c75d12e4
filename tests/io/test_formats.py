"""Meshes through files: exact round trips, the file's own indexing, and what a template keeps."""

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from morphlet import FileError, InputError, Mesh
from morphlet.io.formats import read, read_attributes, rewrite, write

TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
COLORS = np.array([[0, 1, 2], [255, 254, 253], [127, 128, 129], [10, 20, 200]], np.uint8)
FAN = [[0, 1, 2], [0, 2, 3]]
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

quick = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def meshes(draw):
    n = draw(st.integers(1, 12))
    finite = st.floats(allow_nan=False, allow_infinity=False)
    vertices = draw(hnp.arrays(np.float64, (n, 3), elements=finite))
    faces = draw(hnp.arrays(np.int64, (draw(st.integers(1, 9)), 3), elements=st.integers(0, n - 1)))
    return Mesh(vertices, faces)


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def same_bits(a, b):
    return a.vertices.tobytes() == b.vertices.tobytes() and np.array_equal(a.faces, b.faces)


@quick
@given(mesh=meshes())
@pytest.mark.parametrize("ending", [".ply", ".obj", ".off"])
def test_round_trip_keeps_every_bit(tmp_path, ending, mesh):
    write(tmp_path / f"mesh{ending}", mesh)
    assert same_bits(read(tmp_path / f"mesh{ending}"), mesh)


@quick
@given(mesh=meshes())
@pytest.mark.parametrize("ending", [".ply", ".obj"])
def test_rewriting_a_file_keeps_every_bit_of_the_new_positions(tmp_path, ending, mesh):
    write(tmp_path / f"old{ending}", mesh.with_vertices(np.zeros_like(mesh.vertices)))
    rewrite(tmp_path / f"old{ending}", mesh, tmp_path / f"new{ending}")
    assert same_bits(read(tmp_path / f"new{ending}"), mesh)


def test_glb_keeps_single_precision_and_order(tmp_path):
    write(tmp_path / "a.glb", TETRAHEDRON)
    back = read(tmp_path / "a.glb")
    assert np.array_equal(back.faces, TETRAHEDRON.faces)
    assert np.array_equal(back.vertices, TETRAHEDRON.vertices.astype(np.float32))


@pytest.mark.parametrize("text", [False, True])
def test_stl_merges_corners_at_one_position_in_order_of_appearance(tmp_path, text):
    path = tmp_path / "a.stl"
    write(path, TETRAHEDRON)
    if text:
        path.write_text(trimesh.load(path).export(file_type="stl_ascii"))
    back = read(path)
    order = [0, 2, 1, 3]
    assert np.allclose(back.vertices, TETRAHEDRON.vertices[order], rtol=1e-6)
    assert np.array_equal(np.array(order)[back.faces], TETRAHEDRON.faces)


@pytest.mark.parametrize("ending", [".ply", ".obj", ".glb"])
def test_colors_come_back(tmp_path, ending):
    write(tmp_path / f"a{ending}", TETRAHEDRON, colors=COLORS)
    assert np.array_equal(read_attributes(tmp_path / f"a{ending}").colors, COLORS)
    assert read(tmp_path / f"a{ending}").n_vertices == 4


@pytest.mark.parametrize("ending", [".off", ".stl"])
def test_formats_without_colors_refuse_them(tmp_path, ending):
    with pytest.raises(InputError, match="a format with vertex colours"):
        write(tmp_path / f"a{ending}", TETRAHEDRON, colors=COLORS)


def test_colors_must_fit_the_mesh(tmp_path):
    with pytest.raises(InputError, match=r"colors of shape \(4, 3\)"):
        write(tmp_path / "a.ply", TETRAHEDRON, colors=COLORS[:2])
    with pytest.raises(InputError, match="indices from 0 to 255 in colors"):
        write(tmp_path / "a.ply", TETRAHEDRON, colors=np.full((4, 3), 256))


def test_unknown_ending_lists_the_known_ones(tmp_path):
    with pytest.raises(FileError, match=r"\.ply, \.obj, \.off, \.stl, \.glb; found '\.xyz'"):
        write(tmp_path / "a.xyz", TETRAHEDRON)


def test_writing_leaves_nothing_behind_when_it_fails(tmp_path):
    (tmp_path / "a.ply").mkdir()
    with pytest.raises(FileError, match="to write"):
        write(tmp_path / "a.ply", TETRAHEDRON)
    with pytest.raises(FileError, match="a writable folder"):
        write(tmp_path / "missing" / "a.ply", TETRAHEDRON)
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]


@pytest.mark.parametrize("source", [".ply", ".obj", ".off", ".stl", ".glb"])
@pytest.mark.parametrize("ending", [".data", ".obj", ".ply", ".off", ".stl", ".glb"])
def test_the_content_decides_not_the_ending(tmp_path, source, ending):
    write(tmp_path / f"a{source}", TETRAHEDRON)
    path = put(tmp_path, f"b{ending}", (tmp_path / f"a{source}").read_bytes())
    assert same_bits(read(path), read(tmp_path / f"a{source}"))


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4",
        "f -4 -3 -2 -1",
        "f 1/1 2/2 3/3 4/4",
        "f 1//1 2//2 3//3 4//4",
        "f 1/1/1 2/2/2 3/3/3 4/4/4",
        "f 1 2 \\\n 3 4",
        "o part\ng a b\nusemtl x\ns off\nf 1 2 3\ng c\nf 1 3 4",
        "  f\t1 2 3 4  # a comment",
        "f +1 2 3 4\r",
        "l 1 2\np 1\nf 1 2\nf 1 2 3 4",
    ],
)
def test_obj_faces_in_all_their_forms(tmp_path, faces):
    mesh = read(put(tmp_path, "a.obj", f"# square\n{SQUARE}{faces}\n"))
    assert mesh.faces.tolist() == FAN
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_obj_negative_indices_count_from_their_own_line(tmp_path):
    lines = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n"
    assert read(put(tmp_path, "a.obj", lines)).faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_obj_is_not_split_at_texture_seams(tmp_path):
    text = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .5\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4\n"
    path = put(tmp_path, "a.obj", text)
    assert read(path).n_vertices == 4
    assert read_attributes(path).uv is None
    assert read_attributes(put(tmp_path, "b.obj", text.replace("1/5", "1/1"))).uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_obj_old_mac_line_ends_and_scientific_numbers(tmp_path):
    mesh = read(put(tmp_path, "a.obj", "v 1e-3 -.5 +2.\rv 1E2 0 0 1.0\rv 0 1 0\rf 1 2 3\r"))
    assert mesh.vertices.tolist() == [[0.001, -0.5, 2], [100, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    "head",
    ["OFF\n4 1 0", "OFF 4 1 0", "OFF4 1 0", "# made by hand\nOFF\n# counts\n\n4 1 0", "off comes later\n4 1 0", "4 1", "OFF\r\n4 1 0\r"],
)
def test_off_headers(tmp_path, head):
    head = head.replace("off comes later", "OFF # a comment")
    mesh = read(put(tmp_path, "a.off", f"{head}\n0 0 0\n1 0 0 # second\n\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n"))
    assert mesh.faces.tolist() == FAN


def test_off_with_colors_and_normals(tmp_path):
    body = "1 0 0\n" + "\n".join(f"{x} {x + 1} 0  0 0 1  {c} 0 9 255" for x, c in enumerate([7, 8, 9]))
    path = put(tmp_path, "a.off", f"CNOFF\n3 1 0\n{body[6:]}\n3 0 1 2\n")
    assert read(path).vertices.tolist() == [[0, 1, 0], [1, 2, 0], [2, 3, 0]]
    assert read_attributes(path).colors.tolist() == [[7, 0, 9], [8, 0, 9], [9, 0, 9]]
    with pytest.raises(FileError, match="a text OFF file in three dimensions"):
        read(put(tmp_path, "b.off", "4OFF\n1 1 0\n0 0 0 1\n3 0 0 0\n"))


def ply(form, body, lists="uchar int"):
    vertex = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    face = f"element face 2\nproperty list {lists} vertex_indices\n"
    return f"ply\nformat {form} 1.0\ncomment made by hand\n{vertex}{face}end_header\n".encode() + body


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def test_ply_text_with_mixed_polygons(tmp_path):
    body = b"0 0 0\n1 0 0\n\n1 1 0\n0 1 0\n4 0 1 2 3\n3 3 2 1\n"
    for ends in (b"\n", b"\r\n", b"\r"):
        mesh = read(put(tmp_path, "a.ply", ply("ascii", body).replace(b"\n", ends)))
        assert mesh.faces.tolist() == [*FAN, [3, 2, 1]]


@pytest.mark.parametrize(("form", "order"), [("binary_little_endian", "<"), ("binary_big_endian", ">")])
@pytest.mark.parametrize("count", ["u1", "u2", "i4"])
def test_ply_binary_with_mixed_polygons(tmp_path, form, order, count):
    kinds = {"u1": "uchar", "u2": "ushort", "i4": "int"}
    rows = [[0, 1, 2, 3], [3, 2, 1]]
    lists = b"".join(np.array(len(r), order + count).tobytes() + np.array(r, order + "u4").tobytes() for r in rows)
    mesh = read(put(tmp_path, "a.ply", ply(form, CORNERS.astype(order + "f4").tobytes() + lists, f"{kinds[count]} uint")))
    assert mesh.faces.tolist() == [*FAN, [3, 2, 1]]
    assert np.array_equal(mesh.vertices, CORNERS)


def test_ply_strips_turn_every_second_triangle_and_drop_degenerate_ones(tmp_path):
    strip = [0, 1, 2, 3, -1, 4, 4, 5, 0, 1, -1, 2, 3]
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    rows = "".join(f"{i} {i * i} 0\n" for i in range(6))
    mesh = read(put(tmp_path, "a.ply", f"{head}{rows}{len(strip)} {' '.join(map(str, strip))}\n"))
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [5, 4, 0], [5, 0, 1]]


def test_ply_steps_over_other_elements_and_lists(tmp_path):
    head = "ply\nformat binary_little_endian 1.0\nelement extra 2\nproperty list uchar short odd\nproperty char last\n"
    head += "element vertex 3\nproperty double z\nproperty double y\nproperty uchar red\nproperty double x\n"
    head += "element face 1\nproperty list uchar float texcoord\nproperty list uchar short vertex_index\nend_header\n"
    extra = b"\x02" + np.array([5, 6], "<i2").tobytes() + b"\x07" + b"\x00\x07"
    rows = np.array([(0, 0, 9, 1), (0, 1, 9, 0), (1, 0, 9, 0)], "<f8,<f8,u1,<f8").tobytes()
    face = b"\x02" + np.zeros(2, "<f4").tobytes() + b"\x03" + np.array([2, 1, 0], "<i2").tobytes()
    mesh = read(put(tmp_path, "a.ply", head.encode() + extra + rows + face))
    assert mesh.vertices.tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.faces.tolist() == [[2, 1, 0]]


def test_glb_scene_in_world_coordinates_mirrored_nodes_turned(tmp_path):
    scene = trimesh.Scene()
    geometry = TETRAHEDRON.to_trimesh()
    scene.add_geometry(geometry, node_name="first")
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[0, 3] = 5
    scene.add_geometry(geometry, node_name="second", transform=mirror)
    mesh = read(put(tmp_path, "a.glb", scene.export(file_type="glb")))
    assert mesh.n_vertices == 8
    assert np.allclose(mesh.vertices[4:], TETRAHEDRON.vertices * [-1, 1, 1] + [5, 0, 0], atol=1e-6)
    assert mesh.volume == pytest.approx(2 * TETRAHEDRON.volume, rel=1e-6)
    rewrite(tmp_path / "a.glb", mesh.with_vertices(2 * mesh.vertices), tmp_path / "b.glb")
    again = read(tmp_path / "b.glb")
    assert np.allclose(again.vertices, 2 * mesh.vertices, atol=1e-6)
    assert np.array_equal(again.faces, mesh.faces)


def test_gltf_with_its_buffers_beside_it(tmp_path):
    for name, data in trimesh.Scene(TETRAHEDRON.to_trimesh()).export(file_type="gltf").items():
        put(tmp_path, name, data)
    assert np.array_equal(read(tmp_path / "model.gltf").faces, TETRAHEDRON.faces)


def moved(path):
    mesh = read(path)
    return mesh.with_vertices(mesh.vertices[:, [1, 2, 0]] + 1 / 3)


def test_rewrite_obj_changes_only_positions(tmp_path):
    old = "# title\r\nmtllib a.mtl\ng one\nv 0 0 0 .1 .2 .3\n  v  1 0 0 1 0 0 # here\nv 0 1 \\\n 0 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    old += "usemtl skin\nf 1/1 2/2 3/3\nl 1 2\n"
    path = put(tmp_path, "old.obj", old)
    rewrite(path, moved(path), tmp_path / "new.obj")
    assert same_bits(read(tmp_path / "new.obj"), moved(path))
    new = (tmp_path / "new.obj").read_bytes().decode()
    third = 1 / 3
    assert f"v {third} {third} {third} .1 .2 .3\n" in new
    assert "1 0 0 # here\n" in new
    for kept in ("# title\r\nmtllib a.mtl\ng one\n", "vt 0 1\nusemtl skin\nf 1/1 2/2 3/3\nl 1 2\n"):
        assert kept in new


def test_rewrite_obj_renews_normals_that_belong_to_one_vertex(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 1 0 0\nvn 1 0 0\nvn 1 0 0\nf 1//3 2//2 3//1\n"
    path = put(tmp_path, "old.obj", text)
    rewrite(path, read(path), tmp_path / "new.obj")
    assert (tmp_path / "new.obj").read_text().count("vn 0.0 0.0 1.0\n") == 3


def test_rewrite_obj_drops_normals_of_creases(tmp_path):
    text = SQUARE + "vt 0 0\nvn 0 0 1\nvn 0 1 0\nf 1/1/1 2/1/1 3/1/1\nf 1//2 3//2 4//2\n"
    path = put(tmp_path, "old.obj", text)
    rewrite(path, read(path), tmp_path / "new.obj")
    new = (tmp_path / "new.obj").read_text()
    assert "vn" not in new
    assert "f 1/1 2/1 3/1\nf 1 3 4\n" in new
    assert same_bits(read(tmp_path / "new.obj"), read(path))


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_rewrite_ply_keeps_properties_and_elements(tmp_path, form):
    names = ["x", "y", "z", "nx", "ny", "nz", "s", "t"]
    kinds = [*((name, "float") for name in names), ("red", "uchar"), ("green", "uchar"), ("blue", "uchar")]
    order = ">" if "big" in form else "<"
    rows = np.zeros(3, [(name, "u1" if kind == "uchar" else order + "f4") for name, kind in kinds])
    rows["x"], rows["y"], rows["nx"], rows["s"], rows["green"] = [0, 1, 0], [0, 0, 1], 1, [0.25, 0.5, 0.75], [3, 4, 5]
    head = f"ply\nformat {form} 1.0\nelement vertex 3\n" + "".join(f"property {kind} {name}\n" for name, kind in kinds)
    head += "element face 1\nproperty list uchar int vertex_indices\nproperty uchar flag\nend_header\n"
    face = b"\x03" + np.array([0, 1, 2], order + "i4").tobytes() + b"\x2a"
    text = "\n".join(" ".join(str(v) for v in row) for row in rows.tolist()) + "\n3 0 1 2 42\n"
    path = put(tmp_path, "old.ply", head.encode() + (text.encode() if form == "ascii" else rows.tobytes() + face))
    rewrite(path, moved(path), tmp_path / "new.ply")
    assert same_bits(read(tmp_path / "new.ply"), moved(path))
    kept = read_attributes(tmp_path / "new.ply")
    assert kept.colors.tolist() == [[0, 3, 0], [0, 4, 0], [0, 5, 0]]
    assert kept.uv[:, 0].tolist() == [0.25, 0.5, 0.75]
    new = (tmp_path / "new.ply").read_bytes()
    assert b"property double x\n" in new
    assert b"property float nx\n" in new
    assert new.endswith(b"3 0 1 2 42\n" if form == "ascii" else face)
    normals = trimesh.load(tmp_path / "new.ply", process=False).vertex_normals
    assert np.allclose(normals, moved(path).vertex_normals, atol=1e-6)


def test_rewrite_glb_keeps_texture_coordinates_and_material(tmp_path):
    geometry = TETRAHEDRON.to_trimesh()
    uv = np.array([[0, 0], [1, 0], [0, 1], [0.25, 0.5]])
    material = trimesh.visual.material.PBRMaterial(name="skin", baseColorFactor=[255, 0, 0, 255])
    geometry.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    path = put(tmp_path, "old.glb", geometry.export(file_type="glb", include_normals=True))
    rewrite(path, moved(path), tmp_path / "new.glb")
    (new,) = trimesh.load_scene(tmp_path / "new.glb", process=False).geometry.values()
    assert np.allclose(new.visual.uv, uv)
    assert new.visual.material.name == "skin"
    assert new.visual.material.baseColorFactor.tolist() == [255, 0, 0, 255]
    assert np.allclose(new.vertices, moved(path).vertices, atol=1e-6)
    assert np.allclose(new.vertex_normals, moved(path).vertex_normals, atol=1e-5)


@pytest.mark.parametrize("source", [".obj", ".ply", ".glb"])
@pytest.mark.parametrize("ending", [".obj", ".ply", ".glb"])
def test_rewrite_across_formats_keeps_colors_and_uv(tmp_path, source, ending):
    text = "".join(f"v {x} {x * x} 0 {r / 255:.6f} 0 1\nvt {x / 4} 0.5\n" for x, r in enumerate([1, 2, 3])) + "f 1/1 2/2 3/3\n"
    first = put(tmp_path, "first.obj", text)
    template = tmp_path / f"template{source}"
    rewrite(first, read(first), template)
    rewrite(template, moved(template), tmp_path / f"new{ending}")
    kept = read_attributes(tmp_path / f"new{ending}")
    assert kept.colors.tolist() == [[1, 0, 255], [2, 0, 255], [3, 0, 255]]
    assert np.allclose(kept.uv, [[0, 0.5], [0.25, 0.5], [0.5, 0.5]])


def test_rewrite_to_formats_without_attributes_writes_the_geometry(tmp_path):
    write(tmp_path / "old.ply", TETRAHEDRON, colors=COLORS)
    rewrite(tmp_path / "old.ply", moved(tmp_path / "old.ply"), tmp_path / "new.off")
    assert same_bits(read(tmp_path / "new.off"), moved(tmp_path / "old.ply"))


def test_rewrite_wants_as_many_vertices_as_the_template(tmp_path):
    path = put(tmp_path, "old.obj", SQUARE + "f 1 2 3 4\n")
    with pytest.raises(InputError, match="4 vertices, as in"):
        rewrite(path, Mesh(np.zeros((3, 3)), [[0, 1, 2]]), tmp_path / "new.obj")
