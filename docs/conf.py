"""Sphinx: the pages of this folder, docstrings, notebooks with stored outputs; ``make docs``."""

from __future__ import annotations

import os
import re
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from pygments.lexers.special import TextLexer

import imapper_prob
from imapper_prob.cli.main import command_parser
from imapper_prob.cli.parser import commands_of

os.environ["COLUMNS"] = "96"

project = "imapper-prob"
author = "The imapper-prob authors"
version = release = imapper_prob.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
# Links from pages to sources leave the site, and source files are no pages.
suppress_warnings: list[str] = []
html_theme = "pydata_sphinx_theme"
html_title = f"imapper-prob {release}"
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False}
html_show_sourcelink = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False


class Help(Directive):
    """The help of every command, as it is printed."""

    def run(self) -> list[nodes.Node]:
        found: list[nodes.Node] = []
        for name, parser in commands_of(command_parser()):
            title = " ".join(name)
            section = nodes.section(ids=[nodes.make_id(title)])
            section += nodes.title(text=title)
            text = parser.format_help()
            section += nodes.literal_block(text, text, language="text")
            found.append(section)
        return found


def link_notebooks(_app: Any, _name: str, source: list[str]) -> None:
    """Have links to notebooks lead to their pages: Sphinx knows them by the link in this folder."""
    source[0] = re.sub(
        r"\[([^\]]+)\]\(([\w./]*notebooks/\w+)\.ipynb\)", r"{doc}`\1 <\2>`", source[0]
    )


def setup(app: Any) -> None:
    """Add the directive, link notebooks, and show diagrams of Mermaid as their text."""
    app.connect("source-read", link_notebooks)
    app.add_lexer("mermaid", TextLexer)
    app.add_directive("help", Help)
