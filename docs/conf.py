"""How `make docs` makes a site of these pages. It loads nothing from a network, and a warning is an error."""

# ruff: noqa: INP001 (Sphinx reads this file by its name)
from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pygments.lexers.special import TextLexer

if TYPE_CHECKING:
    from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parents[1]))
from ge_torchrl.version import __version__  # Of this checkout, whichever is installed.

project = "ge_torchrl"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["foreign/**", "examples/**", "trees/**"]

# Links to a heading are those of GitHub, so that a page reads alike in both places.
myst_heading_anchors = 4
# A block without a language is what a program prints.
highlight_language = "none"
smartquotes_action = "D"
# Docstrings are plain text, where a name in backticks is code, as it is in these pages.
default_role = "code"
add_module_names = False
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "ge_torchrl"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}


def setup(app: Sphinx) -> None:
    """Leave two languages plain that Pygments does not know, and say where folders lie."""
    app.add_lexer("iecst", TextLexer)
    app.add_lexer("mermaid", TextLexer)
    app.connect("source-read", _name_folders)


def _name_folders(_app: Sphinx, _name: str, source: list[str]) -> None:
    """Make names of the links to folders of docs/: GitHub shows folders, a site has none."""
    source[0] = re.sub(r"\[[^\]]+\]\((\w+)/\)", r"`docs/\1`", source[0])
