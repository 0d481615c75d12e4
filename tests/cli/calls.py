"""Calls of the command line: in this process for speed, in one of its own where that is the point."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from morphlet.cli import main


@dataclass(frozen=True)
class Answer:
    """What a call gave back."""

    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        """The one JSON object on stdout; strict: no NaN, nothing beside it."""
        found = json.loads(self.out, parse_constant=_refused)
        assert isinstance(found, dict)
        assert self.out.count("\n") == 1
        return found


def call(capsys: Any, *arguments: object) -> Answer:
    """The command line in this process."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return Answer(code, out, err)


def start(*arguments: object, cwd: Path | None = None, prefix: tuple[str, ...] = ("-m", "morphlet.cli")) -> subprocess.Popen[str]:
    """The command line as a process."""
    words = [sys.executable, *prefix, *map(str, arguments)]
    pipe = subprocess.PIPE
    return subprocess.Popen(words, cwd=cwd, stdout=pipe, stderr=pipe, text=True, encoding="utf-8", env={**os.environ, "PYTHONUTF8": "1"})


def finished(process: subprocess.Popen[str], seconds: float = 120) -> Answer:
    """Its answer, once it has ended."""
    out, err = process.communicate(timeout=seconds)
    return Answer(process.returncode, out, err)


def _refused(word: str) -> None:
    raise ValueError(f"{word} is no JSON")
