"""The house rules: floors, public names, docstrings, sizes of functions, what no source file may hold."""

import ast
import inspect
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import morphlet

SOURCE = Path(morphlet.__file__).parent
ROOT = Path(__file__).parents[1]
FILES = sorted(SOURCE.rglob("*.py"))
TREES = {file.relative_to(SOURCE).as_posix(): ast.parse(file.read_text("utf-8")) for file in FILES}
LONGEST, MOST_PARAMETERS = 40, 6
FEEDERS = {"sphere/energy.py": {"value", "derivatives"}}
"""Functions that hand their arguments on to kernels, piece by piece, and so have as many."""
PRINTS = {"console.py"}
"""Where the command line talks to people."""
VERBS = {name for name in TREES if name.startswith("cli/")} - {"cli/steps.py", "cli/pictures.py"}
"""Modules of verbs, whose options are keywords."""
TEXTS = {".py", ".md", ".toml", ".cff", ".yml", ".yaml", ".cfg", ".txt", ".html", ".js", ".css"}
FOLDERS = ("src", "tests", "docs", "examples", "benchmarks")

Function = ast.FunctionDef | ast.AsyncFunctionDef
each_module = pytest.mark.parametrize("name", TREES)


def functions(name: str) -> Iterator[Function]:
    """All functions of a module, those within others too."""
    return (node for node in ast.walk(TREES[name]) if isinstance(node, Function))


def decorators(node: Function) -> set[str]:
    """Last words of a function's decorators: njit, kernel, property, ..."""
    calls = (d.func if isinstance(d, ast.Call) else d for d in node.decorator_list)
    return {d.attr if isinstance(d, ast.Attribute) else getattr(d, "id", "") for d in calls}


def is_kernel(node: Function) -> bool:
    return any(word.endswith("jit") or "kernel" in word for word in decorators(node))


def length(node: Function) -> int:
    """Lines of a body without its docstring and without functions defined in it."""
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    if not body:
        return 0
    inner = [n for statement in body for n in ast.walk(statement) if isinstance(n, Function)]
    return body[-1].end_lineno - body[0].lineno + 1 - sum(n.end_lineno - n.lineno + 1 for n in inner)


def imported(name: str) -> Iterator[str]:
    """The package's modules that a module imports, late ones and those for type checkers too."""
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def floors() -> list[list[str]]:
    """From the top to the bottom; neighbours on one floor."""
    config = ROOT / "pyproject.toml"
    if not config.exists():
        pytest.skip("the floors are told in pyproject.toml, which is not here")
    contract = tomllib.loads(config.read_text("utf-8"))["tool"]["importlinter"]["contracts"][0]
    return [[part.strip() for part in re.split(r"[|:]", layer)] for layer in contract["layers"]]


def test_files_import_only_from_floors_below():
    height = {part: -number for number, floor in enumerate(floors()) for part in floor}
    parts = {name: name.split("/")[0].removesuffix(".py") for name in TREES if name != "__init__.py"}
    assert set(parts.values()) == set(height)
    wrong = [
        f"{name} imports {target}"
        for name, part in parts.items()
        for target in imported(name)
        if target.startswith("morphlet.") and (other := target.split(".")[1]) in height and other != part and height[other] >= height[part]
    ]
    assert not wrong


def test_every_public_name_is_there_and_documented():
    assert len(set(morphlet.__all__)) == len(morphlet.__all__)
    for name in morphlet.__all__:
        value = getattr(morphlet, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert inspect.getdoc(value), name
            assert value.__module__.startswith("morphlet."), name
            assert value.__name__ == name


def test_public_names_hide_no_module():
    modules = {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert not modules & set(morphlet.__all__)


def test_public_names_are_the_same_for_type_checkers():
    block = next(node for node in TREES["__init__.py"].body if isinstance(node, ast.If))
    told = {(node.module, alias.name, alias.asname) for node in block.body for alias in node.names}
    assert told == {(module, name, name) for name, module in morphlet._HOME.items()}


def test_importing_the_package_loads_no_library():
    code = "import sys, morphlet; dir(morphlet); print([m for m in ('numpy', 'numba', 'scipy', 'cyclopts') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'morphlet' has no attribute 'nonsense'"):
        morphlet.nonsense  # noqa: B018


def test_every_public_name_is_in_a_doctest_or_an_example():
    lines = [line.strip() for file in FILES for line in file.read_text("utf-8").splitlines()]
    shown = " ".join(line for line in lines if line.startswith((">>>", "...")))
    shown += " ".join(file.read_text("utf-8") for file in (ROOT / "examples").glob("*.py"))
    used = set(re.findall(r"\w+", shown))
    classes = {name for name in morphlet.__all__ if inspect.isclass(getattr(morphlet, name))}
    errors = {name for name in classes if issubclass(getattr(morphlet, name), Exception)}
    assert set(morphlet.__all__) - (classes & words_of_types()) - errors - used - {"__version__"} == set()


def words_of_types() -> set[str]:
    """Types that nobody need construct, since a documented call returns them or another type holds them."""
    nodes = [node for tree in TREES.values() for node in ast.walk(tree)]
    told = [ast.unparse(node.returns) for node in nodes if isinstance(node, Function) and node.returns]
    held = [ast.unparse(node.annotation) for node in nodes if isinstance(node, ast.AnnAssign)]
    return set(re.findall(r"\w+", " ".join(told + held)))


@each_module
def test_modules_say_what_they_are(name):
    text = ast.get_docstring(TREES[name])
    assert text
    first = text.split("\n\n")[0]
    assert first.endswith((".", ":")), first


@each_module
def test_functions_and_classes_without_underscore_are_documented(name):
    """Kernels say what they do in a comment."""
    found = [
        node.name
        for parent in (TREES[name], *(n for n in TREES[name].body if isinstance(n, ast.ClassDef)))
        for node in parent.body
        if isinstance(node, Function | ast.ClassDef) and not node.name.startswith("_") and not ast.get_docstring(node)
        if not (isinstance(node, Function) and is_kernel(node))
    ]
    assert not found


@each_module
def test_functions_are_short(name):
    """Kernels may be long: a call within costs them time."""
    assert not [f"{node.name}: {length(node)} lines" for node in functions(name) if length(node) > LONGEST and not is_kernel(node)]


@each_module
def test_functions_have_few_parameters(name):
    """Kernels take plain arrays, so they may have more; so may verbs."""
    found = []
    for node in functions(name):
        count = len(node.args.posonlyargs) + len(node.args.args) + (0 if name in VERBS else len(node.args.kwonlyargs))
        count -= bool(node.args.args) and node.args.args[0].arg == "self"
        if count > MOST_PARAMETERS and not is_kernel(node) and node.name not in FEEDERS.get(name, ()):
            found.append(f"{node.name}: {count} parameters")
    assert not found


@each_module
def test_no_asserts_prints_or_bare_excepts(name):
    for node in ast.walk(TREES[name]):
        place = f"line {getattr(node, 'lineno', 0)}"
        assert not isinstance(node, ast.Assert), place
        assert not (isinstance(node, ast.ExceptHandler) and node.type is None), place
        called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
        assert called not in ({"eval", "exec"} if name in PRINTS else {"print", "eval", "exec"}), place


@each_module
def test_nothing_copyleft_is_imported(name):
    assert not [target for target in imported(name) if target.startswith(("igl.copyleft", "igl.triangle"))]
    assert not re.search(r"igl\.(copyleft|triangle)\b", (SOURCE / name).read_text("utf-8"))


def test_no_file_names_a_place_on_somebodys_machine():
    places = re.compile("|".join(f"/{top}/[A-Za-z]" for top in ("work", "tmp", "home", "Users", "root")))
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*") if file.suffix in TEXTS and "__pycache__" not in file.parts]
    files += [file for file in ROOT.iterdir() if file.is_file() and file.suffix in TEXTS]
    assert len(files) > len(FILES)
    found = [f"{file.relative_to(ROOT)}: {match.group()}" for file in files for match in places.finditer(file.read_text("utf-8"))]
    assert not found
