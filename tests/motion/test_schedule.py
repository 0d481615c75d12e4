"""Schedules: shares by hand, monotone and mirrored, presets, files and what they refuse."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.errors import FileError, InputError
from morphlet.motion.schedule import Schedule

TIMES = np.linspace(0, 1, 101)
easings = st.sampled_from(["linear", "smoothstep", "smootherstep"])
spans = st.tuples(st.floats(0, 0.9), st.floats(0.01, 1), easings).map(lambda s: (s[0], min(s[1], 1 - s[0]), s[2]))
schedules = st.lists(spans, min_size=1, max_size=6).map(lambda rows: Schedule(*(tuple(column) for column in zip(*rows, strict=True))))


@pytest.mark.parametrize(("easing", "quarter"), [("linear", 0.25), ("smoothstep", 0.15625), ("smootherstep", 0.103515625)])
def test_easings_by_hand(easing, quarter):
    schedule = Schedule([0.2], [0.4], (easing,))
    np.testing.assert_allclose([schedule(t)[0] for t in (0, 0.2, 0.3, 0.4, 0.6, 1)], [0, 0, quarter, 0.5, 1, 1], atol=1e-12)


@settings(max_examples=40)
@given(schedules)
def test_bands_never_turn_back_and_arrive(schedule):
    shares = np.array([schedule(t) for t in TIMES])
    assert (np.diff(shares, axis=0) >= -1e-15).all()
    np.testing.assert_array_equal(shares[0], 0)
    np.testing.assert_allclose(shares[-1], 1, atol=1e-7)


@settings(max_examples=40)
@given(schedules, st.floats(0, 1))
def test_the_mirrored_schedule_is_the_same_backwards(schedule, t):
    np.testing.assert_allclose(schedule.mirrored()(1 - t), 1 - schedule(t), atol=1e-7)


def test_presets():
    assert [Schedule.together(3)(t).tolist() for t in (0.3,)] == [[0.3, 0.3, 0.3]]
    coarse, fine = Schedule.coarse_first(4, 0.4), Schedule.fine_first(4, 0.4)
    assert coarse.start.tolist() == pytest.approx([0, 0.2, 0.4, 0.6])
    np.testing.assert_array_equal(fine.start, coarse.start[::-1])
    for t in TIMES:
        assert (np.diff(coarse(t)) <= 1e-15).all()
        assert (np.diff(fine(t)) >= -1e-15).all()
    assert Schedule.coarse_first(1).duration.tolist() == [1.0]
    assert Schedule.fine_first(1).duration.tolist() == [1.0]


def test_other_numbers_of_bands():
    given = Schedule([0.0, 0.6], [0.2, 0.4], ("linear", "smootherstep"))
    np.testing.assert_allclose(given.over(5).start, [0, 0.15, 0.3, 0.45, 0.6])
    np.testing.assert_allclose(given.over(5).duration, [0.2, 0.25, 0.3, 0.35, 0.4])
    assert given.over(5).easing == ("linear", "linear", "linear", "smootherstep", "smootherstep")
    assert given.over(1).duration.tolist() == [0.2]
    np.testing.assert_array_equal(given.over(2).start, given.start)
    assert Schedule.together(1).over(3).easing == ("linear",) * 3
    with pytest.raises(InputError, match="at least one band"):
        given.over(0)


@pytest.mark.parametrize(
    ("start", "duration", "easing", "message"),
    [
        ([-0.1], [0.5], ("linear",), "0 <= start"),
        ([0.6], [0.5], ("linear",), "start 0.6 with duration 0.5"),
        ([0.0, 0.5], [0.5, 0.0], ("linear", "linear"), "found 1 bands that are not"),
        ([0.0], [np.nan], ("linear",), "finite numbers in duration"),
        ([0.0], [0.5, 0.5], ("linear",), "duration of shape"),
        ([0.0], [0.5], (), "found 0 for 1 bands"),
        ([], [], (), "one band or more"),
        ([0.0], [0.5], ("bounce",), "easings out of linear, smoothstep, smootherstep; found 'bounce'"),
    ],
)
def test_bad_schedules_are_refused(start, duration, easing, message):
    with pytest.raises(InputError, match=message):
        Schedule(start, duration, easing)


@settings(max_examples=20)
@given(schedules)
def test_files_and_pickles_bring_schedules_back(tmp_path_factory, schedule):
    path = tmp_path_factory.mktemp("schedule") / "schedule.toml"
    schedule.write(path)
    for copy in (Schedule.read(path), pickle.loads(pickle.dumps(schedule))):
        np.testing.assert_array_equal(copy.start, schedule.start)
        np.testing.assert_array_equal(copy.duration, schedule.duration)
        assert copy.easing == schedule.easing


def test_files_as_people_write_them(tmp_path):
    path = tmp_path / "schedule.toml"
    path.write_bytes(
        b'\xef\xbb\xbf# coarse\r\n[[band]]\r\nstart = 0\r\nduration = 1\r\n[[band]]\nduration = 0.5\nstart = 0.5\neasing = "linear"'
    )
    schedule = Schedule.read(path)
    assert schedule.easing == ("smoothstep", "linear")
    assert schedule.start.tolist() == [0, 0.5]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[band]", "a TOML file of a schedule"),
        ("", "tables .*; found nothing"),
        ("band = 3", "tables"),
        ("band = [1, 2]", "tables"),
        ("band = []", "one band or more"),
        ("title = 1\n[[band]]\nstart = 0\nduration = 1", "tables .* found title, band"),
        ("[[band]]\nstart = 0\nduration = 1\nspeed = 2", "in band 0 .* found .*speed = 2"),
        ("[[band]]\nstart = 0\nduration = 1\neasing = 2", "in band 0"),
        ("[[band]]\nstart = 0", "a number as duration of band 0 .* found None"),
        ('[[band]]\nstart = "0"\nduration = 1', "a number as start of band 0"),
        ("[[band]]\nstart = true\nduration = 1", "a number as start"),
        ("[[band]]\nstart = inf\nduration = 1", "a number as start"),
        ("[[band]]\nstart = 0.5\nduration = 0.6", "start [+] duration <= 1 in .*schedule.toml"),
        ('[[band]]\nstart = 0\nduration = 1\neasing = "bounce"', "easings out of"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, message):
    path = tmp_path / "schedule.toml"
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        Schedule.read(path)


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        Schedule.read(tmp_path / "nothing.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileError, match="a TOML file"):
        Schedule.read(tmp_path / "binary.toml")
    with pytest.raises(FileError, match="a writable folder"):
        Schedule.together(1).write(tmp_path / "nowhere" / "schedule.toml")
