"""What a page may say: checked field by field."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.studio.frames import ALL, HEADER, WITH_DISTORTION, Frame, Kind, Slot
from morphlet.studio.messages import MESSAGES, Refusal, number_of, parse
from morphlet.studio.methods import WAYS, chosen


def told(**fields: object) -> str:
    return json.dumps(fields)


def test_defaults_are_filled_in():
    found = parse(told(type="roi", radius=None))
    assert dict(found.values) == {"radius": None, "metric": "geodesic", "live": False}
    assert found.id is None


def test_vertices_are_sorted_and_said_once():
    assert parse(told(type="paint", role="handle", mode="add", vertices=[5, 1, 5]))["vertices"].tolist() == [1, 5]


def test_a_transform_has_defaults_and_a_unit_quaternion():
    found = parse(told(type="transform", transform={"rotate": [0, 0, 0.60003, 0.80004]}))["transform"]
    assert found["scale"] == (1.0, 1.0, 1.0)
    assert np.linalg.norm(found["rotate"]) == pytest.approx(1, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "code", "match"),
    [
        ("", "json", "JSON object"),
        ("[1]", "json", "found list"),
        ("{" * 5000, "json", "JSON object"),
        ('{"type": ["undo"]}', "type", "as type"),
        ('{"type": "undo", "id": -1}', "field", "integer from 0"),
        ('{"type": "undo", "id": true}', "field", "integer from 0"),
        ('{"type": "undo", "path": "/etc/passwd"}', "field", "found path"),
        ('{"type": "roi"}', "field", "needed radius in roi"),
        ('{"type": "roi", "radius": NaN}', "field", "number from 0"),
        ('{"type": "roi", "radius": 0}', "field", "number above 0"),
        ('{"type": "roi", "radius": "5%"}', "field", "number"),
        ('{"type": "roi", "radius": 1e999}', "field", "number"),
        ('{"type": "paint", "role": "handle", "mode": "set", "vertices": [1.0]}', "field", "list of vertex numbers"),
        ('{"type": "paint", "role": "handle", "mode": "set", "vertices": [true]}', "field", "list of vertex numbers"),
        ('{"type": "paint", "role": "handle", "mode": "set", "vertices": [-1]}', "field", "from 0"),
        ('{"type": "transform", "transform": {"rotate": [0, 0, 0, 0.5]}}', "field", "quaternion of length 1"),
        ('{"type": "transform", "transform": {"scale": [1, 0, 1]}}', "field", "0.001"),
        ('{"type": "transform", "transform": {"translate": [1, 2]}}', "field", "list of 3"),
        ('{"type": "symmetry", "plane": {"normal": [0, 0, 0], "point": [0, 0, 0]}}', "field", "direction"),
        ('{"type": "symmetry", "plane": {"axis": "w"}}', "field", "x, y, z"),
        ('{"type": "pose.keep", "name": "a\\u0000b"}', "field", "printable"),
        ('{"type": "morph.schedule", "bands": [{"start": 0, "duration": 0}]}', "field", "above 0"),
    ],
)
def test_nonsense_is_refused(text, code, match):
    with pytest.raises(Refusal, match=match) as caught:
        parse(text)
    assert caught.value.code == code


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@given(
    st.sampled_from(sorted(MESSAGES)),
    st.dictionaries(st.sampled_from(["vertices", "transform", "radius", "plane", "slot", "name"]), values),
)
def test_any_content_is_a_message_or_a_refusal(kind, fields):
    try:
        found = parse(json.dumps({"type": kind} | fields))
    except Refusal:
        return
    assert set(found.values) == set(MESSAGES[kind])


def test_the_number_of_a_refused_message_is_found():
    assert number_of('{"type": "nonsense", "id": 7}') == 7
    assert number_of("garbage") is None
    assert number_of('{"id": true}') is None


@pytest.mark.parametrize("name", WAYS)
def test_every_method_can_be_chosen_with_what_a_page_is_told(name):
    way = WAYS[name].told()
    options = json.loads(json.dumps({option["name"]: option["default"] for option in way["options"]}))
    assert repr(chosen(name, options, None).method()) == repr(chosen(name, {}, None).method())


@pytest.mark.parametrize(
    ("name", "options", "weight", "match"),
    [
        ("nonsense", {}, None, "as method"),
        ("arap", {"iterations": 3}, None, "found iterations"),
        ("arap", {"smoothing": 0.1, "volume": True}, None, "smoothing alone"),
        ("arap", {"volume": 1}, None, "true or false"),
        ("mls", {}, 3.0, "weight null"),
        ("ffd", {"lattice": [8, 8]}, None, "list of 3 integers"),
        ("ffd", {"lattice": [8, 8, 99]}, None, "from 2 to 12"),
        ("dual", {"iterations": 1.5}, None, "integer from 0 to 20"),
        ("direct", {"falloff": "steep"}, None, "gaussian"),
    ],
)
def test_impossible_methods_are_refused(name, options, weight, match):
    with pytest.raises(Refusal, match=match):
        chosen(name, options, weight)


def test_a_frame_has_the_layout_of_the_protocol():
    rows = np.arange(6, dtype=np.float32).reshape(2, 3)
    data = Frame(Kind.FRAME, Slot.MORPH, 5, (rows, -rows), 2, subset=3, flags=WITH_DISTORTION, seq=11).data(9)
    assert struct.unpack_from("<4sHHHHIIIIIII", data) == (b"MLST", 1, 3, 2, 1, 9, 5, 3, 2, 0, 11, 0)
    assert np.frombuffer(data, np.float32, 12, HEADER.size).tolist() == [*range(6), *(-float(k) for k in range(6))]
    assert len(data) == 40 + 48
    assert Frame(Kind.ROLES, Slot.SOURCE, 1, (np.ones(5, np.uint8),), 5).data(1)[40:] == b"\1\1\1\1\1\0\0\0"


def test_newer_frames_make_older_ones_stale():
    def frame(kind: Kind, subset: int = ALL, slot: Slot = Slot.SOURCE) -> Frame:
        return Frame(kind, slot, 1, (), 0, subset=subset)

    partial, subset, whole, mesh = frame(Kind.FRAME, 2), frame(Kind.SUBSET, 2), frame(Kind.FRAME), frame(Kind.MESH)
    assert partial.replaces(partial.key)
    assert not partial.replaces(whole.key)
    assert not partial.replaces(subset.key)
    assert subset.replaces(partial.key)
    assert not subset.replaces(whole.key)
    assert whole.replaces(partial.key)
    assert not whole.replaces(subset.key)
    assert not whole.replaces(mesh.key)
    assert all(mesh.replaces(one.key) for one in (partial, subset, whole, mesh, frame(Kind.ROLES)))
    assert not mesh.replaces(frame(Kind.FRAME, slot=Slot.TARGET).key)
