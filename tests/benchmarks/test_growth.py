"""The growth benchmark: its meshes, its fits, and what it says where a size cannot be run."""

import importlib.util
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"

if not FOLDER.exists():
    pytest.skip("benchmarks are not here", allow_module_level=True)


@pytest.fixture(scope="module")
def growth():
    """The script; what it needs to find the others is taken off the path."""
    before = list(sys.path)
    sys.path.insert(0, str(FOLDER))
    spec = importlib.util.spec_from_file_location("benchmarks_growth", FOLDER / "growth.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    sys.path[:] = before


def test_a_subdivided_animal_is_closed_and_as_large_as_wanted(growth):
    mesh, other = growth.animal(16_000, "standing"), growth.animal(16_000, growth.POSE)
    assert abs(mesh.n_vertices - 16_000) < 0.02 * 16_000
    assert mesh.n_faces == 2 * mesh.n_vertices - 4
    assert not mesh.topology.boundary_loops
    assert (mesh.faces == other.faces).all()
    assert abs(mesh.vertices - other.vertices).max() > 0.01 * mesh.bbox_diagonal


def test_exponents_of_powers(growth):
    sizes = [1000, 4000, 16_000]
    assert growth.exponent(sizes, [1e-9 * n**1.5 for n in sizes]) == "1.50"
    assert growth.exponent([1000], [1.0]) == "-"
    assert growth.exponent(sizes, [0.0, 1.0, 2.0]) == "-"


def test_one_line_per_step_over_all_sizes_and_the_last_two(growth):
    cost = {1000: 1.0, 4000: 1.0, 16_000: 4.0}
    steps = [growth.Step("sphere", n, cost[n], cost[n], 10.0, n / 1000) for n in cost]
    assert growth.exponents(steps) == [["sphere", "1000 .. 16000", "0.50", "1.00", "1.00", "1.00"]]


def test_a_job_that_does_not_end_is_told(growth):
    assert growth.measured("sphere", 1500, 0.01) == "more than 0.01 s"


def test_a_job_that_breaks_is_told(growth):
    assert growth.measured("nothing", 1500, 60.0) == "KeyError: 'nothing'"


def test_larger_sizes_are_left_out_after_one_that_failed(growth, monkeypatch):
    tried = []

    def measured(job, count, seconds):
        tried.append((job, count))
        return "killed by signal 9" if count > 4000 else [growth.Step(job, count, 1.0, 1.0, 10.0, 1.0)]

    monkeypatch.setattr(growth, "measured", measured)
    sheet = growth.Sheet()
    steps, notes = growth.grown(sheet, ["sphere", "codec"], 64_000, 1.0)
    assert tried == [(job, count) for job in ("sphere", "codec") for count in (1500, 4000, 16_000)]
    assert [(step.name, step.vertices) for step in steps] == [("sphere", 1500), ("sphere", 4000), ("codec", 1500), ("codec", 4000)]
    assert notes == [f"{job} stops before 16000 vertices: killed by signal 9" for job in ("sphere", "codec")]
    assert len(sheet.figures["steps"]) == 4
