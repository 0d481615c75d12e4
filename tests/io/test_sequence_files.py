"""Sequences as numbered files."""

import numpy as np
import pytest

from morphlet import FileError, InputError, Mesh, MeshSequence
from morphlet.io.formats import read, read_attributes, write
from morphlet.io.sequences import write_sequence

MESH = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def growing(frames):
    return MeshSequence(MESH.topology, np.stack([MESH.vertices * (1 + k) / 3 for k in range(frames)]), np.arange(float(frames)))


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off"])
def test_frames_come_back_exactly(tmp_path, ending):
    sequence = growing(3)
    files = write_sequence(tmp_path / "deep" / "er", sequence, ending=ending)
    assert [file.name for file in files] == [f"frame-00{k}{ending}" for k in range(3)]
    for k, file in enumerate(files):
        assert read(file).fingerprint == sequence[k].fingerprint


def test_more_than_a_thousand_frames_get_more_digits(tmp_path):
    files = write_sequence(tmp_path, growing(1001), ending=".off")
    assert (files[0].name, files[-1].name) == ("frame-0000.off", "frame-1000.off")
    assert len(write_sequence(tmp_path / "b", growing(1000), ending=".off")[-1].stem) == len("frame-999")


def test_frames_keep_what_the_template_carries(tmp_path):
    colors = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.uint8)
    write(tmp_path / "template.obj", MESH, colors=colors)
    for ending in (".ply", ".obj", ".glb"):
        for k, file in enumerate(write_sequence(tmp_path, growing(2), template=tmp_path / "template.obj", ending=ending)):
            assert np.allclose(read(file).vertices, growing(2).positions[k], atol=1e-7)
            assert np.array_equal(read_attributes(file).colors, colors)


def test_template_of_another_size_and_unknown_ending(tmp_path):
    write(tmp_path / "template.ply", Mesh(np.eye(4, 3), [[0, 1, 2]]))
    with pytest.raises(InputError, match="4 vertices, as in"):
        write_sequence(tmp_path / "out", growing(2), template=tmp_path / "template.ply")
    with pytest.raises(FileError, match="an ending out of"):
        write_sequence(tmp_path / "out", growing(2), ending=".fbx")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="a folder at"):
        write_sequence(tmp_path / "file", growing(2))
