"""The site: `make docs` builds it from the pages here and from the docstrings."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from cnnum import __version__

project, version, release = "cnnum", __version__, __version__
copyright = "the cnnum authors, MIT licence"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
html_theme = "furo"
html_title = "cnnum"
html_extra_path = ["skin.html"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
napoleon_numpy_docstring, napoleon_google_docstring = True, False
napoleon_use_ivar, napoleon_use_param, napoleon_use_rtype = True, False, False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
html_copy_source = False
# types of parameters are prose: "x" in them is no link
suppress_warnings = ["ref.python"]
default_role = "literal"


def _escape_bars(
    _app: object, _what: str, _name: str, _obj: object, _opts: object, lines: list[str]
) -> None:
    """Take |x| as a magnitude, not as a substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def setup(app: object) -> None:
    """Connect the hooks."""
    app.connect("autodoc-process-docstring", _escape_bars)  # type: ignore[attr-defined]
