"""Usage: help, versions, wrong words, and how each is said."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cli.calls import call, finished, start
from morphlet import __version__

VERBS = (
    *("approximate", "carry", "compare", "correspond", "deform", "demo", "fetch", "image", "info", "match", "morph"),
    *("reconstruct", "regions", "repair", "sample", "sphere", "transfer", "warmup"),
)
COMMON = ("--json", "--quiet", "--force", "--seed", "--picture", "--threads")
OUTPUTS = {
    *("approximate", "carry", "correspond", "deform", "demo", "fetch", "image", "match", "morph"),
    *("reconstruct", "regions", "repair", "sample", "sphere", "transfer"),
}


def test_help_lists_every_verb(capsys):
    answer = call(capsys, "--help")
    assert answer.code == 0
    assert all(f" {verb} " in answer.out for verb in VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_explains_every_option(capsys, verb):
    answer = call(capsys, verb, "--help")
    assert answer.code == 0
    assert answer.err == ""
    for option in (*COMMON, *(["--output -o"] if verb in OUTPUTS else [])):
        assert option in answer.out
    rows = [line.strip("│ ") for line in answer.out.splitlines() if line.startswith("│")]
    unexplained = [row for row in rows if row.startswith("--") and len(row.split()) < 3 and row != "--version"]
    assert not unexplained


def test_version(capsys):
    assert call(capsys, "--version").out.strip() == __version__


def test_help_loads_neither_numpy_nor_numba():
    code = "import sys; from morphlet.cli import main; main(['morph', '--help']); "
    code += "print([m for m in ('numpy', 'numba', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_script_and_the_module_are_the_same():
    script = Path(sys.executable).with_name("morphlet")
    if not script.exists():
        pytest.skip("the package is not installed beside this interpreter")
    answers = [
        finished(start("--help")),
        finished(start("--help", prefix=("-c", "from morphlet.cli import main; raise SystemExit(main())"))),
    ]
    by_script = subprocess.run([script, "--help"], capture_output=True, text=True, check=True)
    assert {answer.out for answer in answers} == {by_script.stdout}


WRONG = [
    (["sphre", "a.obj"], r'Unknown command "sphre"\. Did you mean "sphere"\?.*; try morphlet --help'),
    (["sphere"], "MESH requires an argument; try morphlet sphere --help"),
    (["sphere", "a.obj"], "--output requires an argument"),
    (["info", "a.obj", "b.obj"], r"Unused Tokens: \['b.obj'\]"),
    (["info", "a.obj", "--frames", "3"], "Unknown option: --frames.*info of this version has --json, --quiet"),
    (["morph", "a", "b", "-o", "c", "--path", "crooked"], '"crooked" for --path.*gradient.*linear.*wavelet'),
    (["transfer", "a", "b", "-o", "c"], "--to requires an argument"),
    (["morph", "a", "b", "-o", "c", "--frames", "many"], 'Invalid value for --frames: unable to convert "many" into int'),
    (["repair", "a", "-o", "b.ply", "--fill", "some"], '"some" for --fill.*none.*small.*all'),
]


@pytest.mark.parametrize(("arguments", "match"), WRONG)
def test_wrong_words_are_usage_errors(capsys, arguments, match):
    answer = call(capsys, *arguments)
    assert (answer.code, answer.out) == (2, "")
    assert len(answer.err.splitlines()) == 1
    assert re.search(match, answer.err)


def test_wrong_words_with_json_are_one_object(capsys):
    answer = call(capsys, "morph", "a", "b", "--json")
    assert answer.result["exit_code"] == answer.code == 2
    assert "--output" in answer.result["error"]["message"]


@pytest.mark.parametrize(
    ("option", "value", "match"),
    [("--seed", "-1", "a seed of 0 or more; found -1"), ("--threads", "0", "at least 1 thread; found 0")],
)
def test_common_numbers_out_of_range(capsys, option, value, match):
    answer = call(capsys, "sample", "blob", "-o", "never.ply", option, value)
    assert answer.code == 2
    assert match in answer.err
    assert not Path("never.ply").exists()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["sample", "unicorn", "-o", "{}/a.ply"], "one of the samples grazer"),
        (["sample", "blob", "-o", "{}/a.ply", "--vertices", "0"], "1500 to 100000 vertices; found 0"),
        (["fetch", "hores.obj"], "did you mean horse.obj"),
        (["warmup", "--picture", "{}/a.png"], "no --picture for warmup"),
        (
            ["morph", "a", "b", "-o", "{}/c", "--path", "linear", "--schedule", "s"],
            "--path wavelet or gradient for a --schedule; found --path linear",
        ),
        (["transfer", "a.ply", "-o", "{}/c", "--to", "b.ply"], "at least one pose; found none"),
        (["transfer", "a.ply", "p.ply", "q/p.obj", "-o", "{}/c", "--to", "b.ply"], "poses with different names; found p twice"),
    ],
)
def test_arguments_out_of_range(capsys, tmp_path, arguments, match):
    answer = call(capsys, *(word.format(tmp_path) for word in arguments), "--json")
    assert answer.code == answer.result["exit_code"] == 2
    assert match in answer.err
    assert not list(tmp_path.iterdir())
