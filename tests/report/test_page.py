"""The page: valid, self-contained, escaped. Curves: drawn where they belong."""

import base64
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import FileError, InputError
from morphlet.report.curves import Axis, curve_picture
from morphlet.report.page import PNG, Plate, Section, page, shown, write_page

PAGE_TAGS = {"html", "head", "meta", "title", "style", "body", "h1", "h2", "section", "p"}
TABLE_TAGS = {"div", "table", "tbody", "tr", "th", "td"}
VOID = {"meta", "img", "br", "link"}


class Reader(HTMLParser):
    """Checks that what opens closes, and gathers text and attributes."""

    def __init__(self):
        super().__init__()
        self.open, self.text, self.attributes, self.tags = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def read(text):
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open
    return reader


PLATE = Plate(PNG + b"rest", 'a "horse" & <cat>')
SECTIONS = [
    Section("Found & <kept>", ("One <b>paragraph</b>.",), (("energy", 1.23456789, "per m²"), ("folds", 0, "faces"), ("known", None, ""))),
    Section("Pictures", plates=(PLATE,)),
]


def test_the_page_reads_back_what_was_written():
    reader = read(page("Cat & <lion>", SECTIONS))
    text = "".join(reader.text)
    for part in ("Cat & <lion>", "Found & <kept>", "One <b>paragraph</b>.", "1.23457", "per m²", 'a "horse" & <cat>'):
        assert part in text
    assert "b" not in reader.tags
    assert reader.tags.count("section") == 2
    assert ("alt", PLATE.alt) in reader.attributes


def test_the_page_needs_nothing_else():
    text = page("Report", SECTIONS)
    assert "http" not in text
    assert "<script" not in text
    assert "<link" not in text
    sources = [value for name, value in read(text).attributes if name == "src"]
    assert [base64.b64decode(value.removeprefix("data:image/png;base64,")) for value in sources] == [PLATE.png]
    assert text.startswith("<!DOCTYPE html>\n<html lang=")


@given(st.text(st.characters(exclude_categories=["Cs", "Cc"])), st.text(st.characters(exclude_categories=["Cs", "Cc"])))
def test_no_text_breaks_out(title, name):
    reader = read(page(title, [Section(name, (name,), ((name, name, name),))]))
    assert set(reader.tags) <= PAGE_TAGS | TABLE_TAGS
    assert "".join(reader.text).count(title) >= 2


def test_the_page_is_written_beside_and_renamed(tmp_path):
    for title in ("first", "second"):
        write_page(tmp_path / "report.html", title, SECTIONS)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page("second", SECTIONS)
    with pytest.raises(FileError, match="writable folder"):
        write_page(tmp_path / "missing" / "report.html", "third", SECTIONS)


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (True, "yes"), (False, "no"), (3, "3"), (1234567, "1234567"), (0.1 + 0.2, "0.3"), (1e-9, "1e-09"), ("a", "a")],
)
def test_values_are_shown_as_people_read_them(value, text):
    assert shown(value) == text


def test_a_plate_is_a_png():
    with pytest.raises(InputError, match="content of a PNG file"):
        Plate(b"GIF89a", "a picture")


def test_curves_are_drawn_within_the_axes_and_told_apart():
    points = np.array([[1.0, 10.0], [2.0, 1.0], [3.0, 0.1]])
    one = curve_picture({"a": points}, Axis("x"), Axis("y", "log"))
    two = curve_picture({"a": points, "b": 2 * points}, Axis("x"), Axis("y", "log"))
    blue = np.array([0x00, 0x72, 0xB2])
    assert (np.abs(one.pixels.astype(int) - blue).max(axis=2) < 10).sum() > 200
    orange = np.array([0xD5, 0x5E, 0x00])
    near = [(np.abs(picture.pixels.astype(int) - orange).max(axis=2) < 10).sum() for picture in (one, two)]
    assert near[0] == 0
    assert near[1] > 200
    assert Plate(one.png, "a curve").png.startswith(PNG)
    np.testing.assert_array_equal(one.pixels, curve_picture({"a": points}, Axis("x"), Axis("y", "log")).pixels)


def test_powers_need_positive_numbers():
    with pytest.raises(InputError, match="logarithmic axis 'error'; found 1 that are not"):
        curve_picture({"a": np.array([[1.0, 0.0], [2.0, 1.0]])}, Axis("bits"), Axis("error", "log"))
    with pytest.raises(InputError, match="finite numbers in curve 'a'"):
        curve_picture({"a": np.array([[1.0, np.inf]])}, Axis("bits"), Axis("error"))
