"""How a map comes about: options, ladder, levels, and the record of it."""

from dataclasses import replace

import numpy as np
import pytest

from morphlet import InputError, Mesh
from morphlet.errors import Cancelled, SolveError
from morphlet.numerics.optimize import Step
from morphlet.sphere import embed as module
from morphlet.sphere.embed import LADDER, Embedding, SphereOptions, embed
from morphlet.sphere.quality import Certificate, Quality, certificate, measure
from support import assert_one_to_one, bipyramid, blob, exact_signs, icosphere, noisy, stacked, tetrahedron


def embedded(mesh: Mesh, options: SphereOptions | None = None) -> Embedding:
    return embed(mesh, np.zeros(mesh.n_faces, bool), options or SphereOptions())


def quality(mesh: Mesh, options: SphereOptions | None = None) -> Quality:
    points = embedded(mesh, options).points
    return measure(mesh, points, certificate(points, mesh.faces))


@pytest.mark.parametrize("mesh", [tetrahedron(), icosphere(0), blob(2), noisy(3, 0.3), bipyramid(40), stacked(120)])
def test_points_are_unit_vectors_and_cover_the_sphere_once(mesh: Mesh) -> None:
    points = embedded(mesh).points
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, rtol=0, atol=4e-16)
    assert_one_to_one(points, mesh.faces)


def test_a_round_sphere_keeps_its_shape() -> None:
    found = quality(icosphere(3))
    assert found.iso_mean < 1.02
    assert found.iso_max < 1.05


def test_mirrored_input_faces_inwards_and_is_mapped_all_the_same() -> None:
    mesh = blob(2)
    inside_out = Mesh(mesh.vertices, mesh.faces[:, [0, 2, 1]])
    assert_one_to_one(embedded(inside_out).points, inside_out.faces)


@pytest.mark.parametrize(("p", "weights"), [(1.0, "uniform"), (0.5, "uniform"), (1.0, "area")])
def test_the_energy_falls_within_every_stage(p: float, weights: str) -> None:
    steps = embedded(noisy(3, 0.35), SphereOptions(p, weights)).trace.steps  # type: ignore[arg-type]
    for stage in dict.fromkeys(step.stage for step in steps):
        values = np.array([step.objective for step in steps if step.stage == stage])
        assert (np.diff(values) <= 1e-9 * values[:-1]).all(), stage
    assert {step.stage.split()[0] for step in steps} == {"sweep", "newton"}
    assert steps[-1].objective >= 1 - 1e-9  # 1 is an isometry


def test_progress_runs_from_little_to_all_and_the_trace_ends_with_a_reason() -> None:
    found = embedded(blob(3))
    progress = [step.progress for step in found.trace.steps]
    assert progress == sorted(progress)
    assert 0 < progress[0] < 0.5 < progress[-1] <= 1
    assert found.trace.reason in ("energy settled", "iteration limit", "no step decreases the energy")
    assert found.trace.attempt == 0
    assert found.trace.iterations > 10


def test_the_objective_of_the_trace_is_the_energy_of_the_result() -> None:
    found = embedded(blob(2))
    s = measure(blob(2), found.points, certificate(found.points, blob(2).faces))
    assert 1 < s.iso_mean < s.iso_p99 < s.iso_max
    assert found.trace.steps[-1].objective == pytest.approx(1.0, abs=2.0)


def test_a_lower_exponent_trades_the_tail_for_the_mean() -> None:
    limbs = blob(3).with_vertices(blob(3).vertices * [1, 1, 4])
    one, other = quality(limbs), quality(limbs, SphereOptions(p=0.5))
    assert other.iso_mean < one.iso_mean
    assert other.iso_max > one.iso_max


def test_area_weights_favour_large_faces() -> None:
    mesh = icosphere(3)
    crowded = mesh.with_vertices(mesh.vertices * (1 + 2 * np.maximum(mesh.vertices[:, 2:], 0) ** 4))
    uniform, area = quality(crowded), quality(crowded, SphereOptions(weights="area"))
    assert area.symmetric_dirichlet < uniform.symmetric_dirichlet  # weighted by area
    assert area.iso_mean > uniform.iso_mean * 0.99  # unweighted


def test_virtual_faces_hardly_count_and_never_fold() -> None:
    mesh = blob(3)
    virtual = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] > 0.5
    free = embed(mesh, virtual, SphereOptions()).points
    bound = embedded(mesh).points
    assert_one_to_one(free, mesh.faces)
    real = Mesh(mesh.vertices, mesh.faces[~virtual])
    found, other = (measure(real, p, certificate(p, mesh.faces)) for p in (free, bound))
    assert found.symmetric_dirichlet < other.symmetric_dirichlet


@pytest.mark.parametrize("p", [0.0, -1.0, 1.5, np.nan])
def test_exponents_outside_the_range_are_refused(p: float) -> None:
    with pytest.raises(InputError, match=r"needed p in \(0, 1\]"):
        SphereOptions(p=p)


def test_unknown_weights_are_refused() -> None:
    with pytest.raises(InputError, match="weights to be one of uniform, area; found 'areas'"):
        SphereOptions(weights="areas")  # type: ignore[arg-type]


def test_the_ladder_climbs_until_the_certificate_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Certificate] = []

    def second_try(points: np.ndarray, faces: np.ndarray) -> Certificate:
        asked.append(certificate(points, faces))
        return asked[-1] if len(asked) > 1 else replace(asked[-1], negative=1)

    monkeypatch.setattr(module, "certificate", second_try)
    assert embedded(blob(2)).trace.attempt == 1
    assert len(asked) == 2


def test_when_no_attempt_holds_the_error_tells_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "certificate", lambda points, faces: Certificate(3, 1, 1, 2.0))
    with pytest.raises(SolveError, match=r"attempt 0: 4 inverted faces, degree 2\.0.*attempt 1: .*attempt 2: ") as caught:
        embedded(icosphere(1))
    assert "repair the mesh" in str(caught.value)


def test_a_lost_kernel_is_retried_and_then_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []

    def failing(high: int, *rest: object) -> int:
        calls.append(high)
        return high - 1

    monkeypatch.setattr(module, "insert", failing)
    with pytest.raises(SolveError, match="attempt 0: needed room for every vertex in its ring; found no kernel at record"):
        embedded(icosphere(1))
    assert len(calls) == sum(attempt.retries + 1 for attempt in LADDER)


def test_a_kernel_lost_once_is_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = []
    insert = module.insert

    def failing_once(high: int, low: int, *rest: object) -> int:
        if high - low > 40 and not lost:
            lost.append(high)
            insert(high, high - 20, *rest)
            return high - 21
        return int(insert(high, low, *rest))

    monkeypatch.setattr(module, "insert", failing_once)
    monkeypatch.setattr(module, "LADDER", LADDER[1:])
    mesh = blob(2)
    found = embedded(mesh)
    assert lost
    assert_one_to_one(found.points, mesh.faces)


@pytest.mark.parametrize("rung", range(3))
def test_every_rung_alone_maps_a_plain_mesh(rung: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LADDER", LADDER[rung : rung + 1])
    mesh = noisy(3, 0.2)
    assert_one_to_one(embedded(mesh).points, mesh.faces)


@pytest.mark.parametrize("after", [0, 5, 15])
def test_whoever_listens_may_stop_it(after: int) -> None:
    seen: list[Step] = []

    def listen(step: Step) -> None:
        seen.append(step)
        if len(seen) > after:
            raise Cancelled

    with pytest.raises(Cancelled):
        embed(blob(2), np.zeros(320, bool), SphereOptions(), listen)
    assert len(seen) == after + 1


def test_no_sweep_folds_a_face() -> None:
    """The map of each level is fold-free before and after its relaxation, also with hubs and slivers."""
    mesh = stacked(300)
    checked = []
    relax = module.Ascent.relax

    def watched(self: module.Ascent, level: module.Level, last: bool, number: int) -> str:
        assert (exact_signs(level.S, level.F) > 0).all()
        before = level.value(level.S)
        reason = relax(self, level, last, number)
        assert (exact_signs(level.S, level.F) > 0).all()
        assert level.value(level.S) <= before * (1 + 1e-12) or self.options.p != 1
        checked.append(len(level.V))
        return reason

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.Ascent, "relax", watched)
        embedded(mesh)
    assert checked == [8, 16, 32, 64, 128, 300]


def test_balance_walks_from_angles_to_areas_and_never_folds() -> None:
    mesh = blob(3)
    found = [embedded(mesh, SphereOptions(balance=balance)) for balance in (0.05, 0.5, 0.95)]
    for one in found:
        assert_one_to_one(one.points, mesh.faces)
    figures = [measure(mesh, one.points, certificate(one.points, mesh.faces)) for one in found]
    angles, areas = [q.angle_mean_deg for q in figures], [q.area_log_std for q in figures]
    assert angles == sorted(angles)
    assert areas == sorted(areas, reverse=True)
    assert areas[2] < areas[0] / 2


@pytest.mark.parametrize("balance", [-0.1, 1.1, float("nan")])
def test_balances_outside_the_range_are_refused(balance: float) -> None:
    with pytest.raises(InputError, match=r"balance in \[0, 1\]"):
        SphereOptions(balance=balance)
