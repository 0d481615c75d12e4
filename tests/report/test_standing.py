"""Public models are shown upright, whichever axis their file has up."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from morphlet import Mesh
from morphlet.report.camera import view
from morphlet.report.look import Look
from morphlet.report.render import render

DATA = os.environ.get("MORPHLET_DATA")
UPWARD = {"y": np.array([0.0, 1, 0]), "z": np.array([0.0, 0, 1])}


@pytest.mark.skipif(not DATA, reason="MORPHLET_DATA does not name the folder of public test meshes")
@pytest.mark.parametrize(
    ("file", "up"),
    [("meshes/horse.obj", "y"), ("meshes/lion.obj", "y"), ("meshes/homer.obj", "y"), ("tosca/wolf0.off", "z"), ("tosca/wolf1.off", "z")],
)
def test_a_public_model_stands_upright_and_fills_its_picture(file, up):
    raw = trimesh.load(Path(DATA) / file, process=False)
    mesh = Mesh(raw.vertices, raw.faces)
    camera = view(mesh)
    assert camera.axes[1] @ UPWARD[up] > 0.9
    drawn = (render(mesh, camera=camera, look=Look((200, 150), "matplotlib")).pixels < 250).any(axis=2)
    assert 0.1 < drawn.mean() < 0.7
    rows, columns = np.nonzero(drawn.any(axis=1))[0], np.nonzero(drawn.any(axis=0))[0]
    assert max(np.ptp(rows) / 150, np.ptp(columns) / 200) > 0.88
