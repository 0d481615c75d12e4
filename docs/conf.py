"""How the documentation becomes a site: `make docs`, into out/docs."""

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
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
autosummary_generate = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
nitpicky = False
suppress_warnings = ["config.cache"]

sphinx.ext.autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.", "Eqs.", "Fig.", "Figs.", "Sect.", "Sects.")  # no ends of sentences

REFERENCE = Path(__file__).parent / "reference"
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


def write_reference() -> list[str]:
    """A page per package of the public names it is home to, in the order of the floors; what is there already and the same stays."""
    REFERENCE.mkdir(exist_ok=True)
    homes = defaultdict(list)
    for name in sorted(morphlet._HOME):
        homes[morphlet._HOME[name].split(".")[1]].append(name)
    for package, names in homes.items():
        listed = "\n".join(f"   {name}" for name in names)
        text = PAGE.format(package=package, text=(import_module(f"morphlet.{package}").__doc__ or "").strip(), names=listed)
        page = REFERENCE / f"{package}.md"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
    return sorted(homes)


write_reference()
