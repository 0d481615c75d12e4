"""How the documentation becomes a site: `make docs`, into out/docs."""

import tomllib
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import sphinx.ext.autosummary

import morphlet

project = "morphlet"
author = "The morphlet developers"
release = version = "0.1.0"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax", "numpydoc", "myst_parser"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
root_doc = "index"
exclude_patterns = ["_build"]
templates_path = ["templates"]
html_theme = "furo"
html_title = "morphlet"
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
autosummary_generate = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
nitpicky = False
suppress_warnings = ["config.cache"]

sphinx.ext.autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.", "Eqs.", "Fig.", "Figs.", "Sect.", "Sects.")  # no ends of sentences

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "reference"
PAGE = """# morphlet.{package}

{text}

```{{eval-rst}}
.. currentmodule:: morphlet

.. autosummary::
   :toctree: names
   :nosignatures:

{names}
```
"""
INDEX = """(reference)=

# Reference

Every public name is imported from `morphlet` itself; here they stand by the floor that is their home, the lowest first.

| floor | what | names |
| --- | --- | --- |
{rows}

```{{toctree}}
:hidden:
:maxdepth: 1

{packages}
```
"""


def public_names() -> dict[str, list[str]]:
    """The public names of each package that is home to one, the lowest floor first."""
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"][0]["layers"]
    floors = [package.strip() for layer in reversed(layers) for package in layer.split("|")]
    homes = defaultdict(list)
    for name in sorted(morphlet._HOME):
        homes[morphlet._HOME[name].split(".")[1]].append(name)
    return {package: homes[package] for package in floors if package in homes}


def about(package: str) -> str:
    """What a package says of itself."""
    return (import_module(f"morphlet.{package}").__doc__ or "").strip()


def written(path: Path, text: str) -> None:
    """Write a page; what is there already and the same stays, so that it is not built again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def write_reference() -> None:
    """A page per package, and one that leads to them; pages of packages that are gone go."""
    REFERENCE.mkdir(exist_ok=True)
    homes = public_names()
    wanted = {f"{package}.md" for package in homes} | {"index.md"} | {f"morphlet.{name}.rst" for name in morphlet._HOME}
    for old in (*REFERENCE.glob("*.md"), *REFERENCE.glob("names/*.rst")):
        if old.name not in wanted:
            old.unlink()
    for package, names in homes.items():
        written(REFERENCE / f"{package}.md", PAGE.format(package=package, text=about(package), names="\n".join(f"   {n}" for n in names)))
    told = {package: about(package).partition("\n")[0] for package in homes}
    rows = "\n".join(f"| [{p}]({p}.md) | {told[p]} | {', '.join(f'[{n}](#morphlet.{n})' for n in names)} |" for p, names in homes.items())
    written(REFERENCE / "index.md", INDEX.format(rows=rows, packages="\n".join(homes)))


write_reference()
