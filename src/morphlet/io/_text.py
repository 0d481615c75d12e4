"""Words and numbers of a text file, by line, converted in bulk.

Lines count from 1, as editors show them. A word is a run of bytes above the space; numbers are correctly rounded.
"""

import re
import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from morphlet.errors import FileError

SPACE = 32
"""Bytes up to the space part words."""
NEWLINE = 10
FIRST_BLANK, AFTER_BLANKS = 9, 14
"""Tabs and line ends are the bytes 9 to 13; other control characters are in no text file."""
WORD_SHOWN = 24
"""How much of an unreadable word a message shows, in characters."""
BOM = b"\xef\xbb\xbf"
"""What some systems put before text in UTF-8."""
NUMBER = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Text:
    """A buffer between two newlines; where its words start; the first word of each line, and how many words it has."""

    buffer: UInt8[np.ndarray, "b"]
    starts: Int[np.ndarray, "w"]
    first: Int[np.ndarray, "l"]
    counts: Int[np.ndarray, "l"]


def scan(data: bytes) -> Text:
    """Find the words of each line."""
    buffer = np.frombuffer(b"\n" + data + b"\n", np.uint8)
    if buffer.min() < FIRST_BLANK or np.any(buffer - np.uint8(AFTER_BLANKS) < SPACE - AFTER_BLANKS):
        raise FileError("text", "control characters of a binary file", "check the file and its ending")
    solid = buffer > SPACE
    starts = np.flatnonzero(solid[1:] > solid[:-1]) + 1
    first = np.searchsorted(starts, np.flatnonzero(buffer == NEWLINE))
    return Text(buffer, starts, first[:-1], np.diff(first))


def plain(data: bytes) -> bytes:
    """The same lines, ended by newlines only, without comments."""
    data = ended_by_newlines(data)
    return re.sub(rb"#[^\n]*", b"", data) if b"#" in data else data


def ended_by_newlines(data: bytes) -> bytes:
    """The same lines, whichever system wrote them."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def words(text: Text, lines: Bool[np.ndarray, "l"], skip: int) -> Bool[np.ndarray, "w"]:
    """Which words stand on these lines, after the first `skip` of each (which must be there)."""
    chosen = np.repeat(lines, text.counts)
    for k in range(skip):
        chosen[text.first[lines] + k] = False
    return chosen


def numbers(text: Text, chosen: Bool[np.ndarray, "w"]) -> Float[np.ndarray, "k"]:
    """These words as numbers; a `FileError` names the line of the first that is none."""
    wanted = int(np.count_nonzero(chosen))
    if not wanted:
        return np.zeros(0)
    spans = np.diff(text.starts, append=len(text.buffer))
    body = text.buffer[text.starts[0] :][np.repeat(chosen, spans)].tobytes()
    values = _converted(body)
    if values is None or len(values) != wanted:
        raise _unreadable(text, chosen)
    return values


def word(text: Text, index: int) -> bytes:
    """One word."""
    stop = text.starts[index + 1] if index + 1 < len(text.starts) else len(text.buffer)
    return text.buffer[text.starts[index] : stop].tobytes().strip()


def printable(text: str) -> str:
    """The same letters; those that a terminal obeys are written as escapes."""
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii") for letter in text)


def line_of(text: Text, index: int) -> int:
    """The line of a word."""
    return int(np.searchsorted(text.first, index, side="right"))


def unreadable(text: Text, index: int, wanted: str) -> FileError:
    """The error for a word that is not what it should be."""
    shown = word(text, index).decode("ascii", "backslashreplace")[:WORD_SHOWN]
    return FileError(f"{wanted} on line {line_of(text, index)}", f"'{shown}'", "correct this line")


def lettered(rows: list[list[float]] | list[list[int]], letter: str) -> str:
    """One line per row: the letter, then the row's numbers in the fewest digits that give the same numbers back."""
    return f"{letter}{str(rows)[2:-2].replace('], [', chr(NEWLINE) + letter).replace(',', '')}\n" if rows else ""


def _converted(body: bytes) -> Float[np.ndarray, "k"] | None:
    """The numbers of a text in C speed, None if a word is none (older numpy warns where newer raises)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(body, sep=" ")
    except (ValueError, DeprecationWarning):
        return None


def _unreadable(text: Text, chosen: Bool[np.ndarray, "w"]) -> FileError:
    for index in np.flatnonzero(chosen):
        if not NUMBER.fullmatch(word(text, int(index))):
            return unreadable(text, int(index), "a number")
    return FileError("numbers parted by spaces", "other text between them", "check that this is a text file")
