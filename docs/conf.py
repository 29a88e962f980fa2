"""Sphinx configuration: `make docs` builds with warnings as errors and without a network."""

import importlib
import re
from importlib.metadata import version as installed
from typing import Any, Generic, NewType, TypeVar

import numpy.typing
from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from sphinx.application import Sphinx


class NDArray(Generic[TypeVar("T")]):
    """Stands in for numpy.typing.NDArray, so that pages show its name and not what it stands for."""


NDArray.__module__ = "numpy.typing"
numpy.typing.NDArray = NDArray  # graindamp is imported later, by autodoc and the tables
numpy.typing.ArrayLike = NewType("ArrayLike", object)

project = "graindamp"
author = "The graindamp developers"
copyright = author
release = version = installed("graindamp")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}
nitpick_ignore_regex = [("py:.*", r"(?!graindamp\.).*")]

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 3

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "pydata_sphinx_theme"
html_title = "graindamp"
html_show_sourcelink = False
html_theme_options = {"show_prev_next": False, "secondary_sidebar_items": ["page-toc"], "navigation_with_keys": False}


def _list_table(directive: Directive, rows: list[tuple[str, str, str]]) -> list[nodes.Node]:
    lines = ["```{list-table}", ":header-rows: 1", ":widths: 20 20 60", ""]
    for first, second, third in rows:
        lines += [f"* - {first}", f"  - {second}", f"  - {third}"]
    box = nodes.container()
    directive.state.nested_parse(StringList([*lines, "```"], source=directive.name), directive.content_offset, box)
    return list(box.children)


class SpecTable(Directive):
    """Keys of a description, from the texts under its fields; the argument is the path of its class."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Key, default, meaning with unit and range."""
        module, _, name = self.arguments[0].rpartition(".")
        fields = getattr(importlib.import_module(module), name).model_fields.items()
        rows = [(f"`{key}`", _default(field), " ".join((field.description or "").split())) for key, field in fields]
        return _list_table(self, [("key", "default", "meaning"), *rows])


class FieldTable(Directive):
    """Variables of an effective field, from its schema."""

    def run(self) -> list[nodes.Node]:
        """Name, unit, meaning."""
        from graindamp.field.schema import TABLE

        rows = [(f"`{name}`", row.units.replace("1", "–"), row.long_name) for name, row in TABLE.items()]
        return _list_table(self, [("variable", "unit", "meaning"), *rows])


def _default(field: Any) -> str:
    value = field.default
    if field.is_required():
        return "needed"
    if value is PydanticUndefined or value is None or value == ():
        return "–"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, BaseModel):
        return "its defaults"
    if isinstance(value, tuple):
        return "[" + ", ".join(f'"{entry}"' if isinstance(entry, str) else f"{entry:g}" for entry in value) + "]"
    if isinstance(value, str):
        return f'"{value}"' if value else "–"
    return f"{value:g}" if isinstance(value, (int, float)) else "–"


def _plain_text(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: lines indented after a colon and a blank line are a formula, a bar is a modulus,
    an underscore at the end of a word an index."""
    in_formula = False
    for i, line in enumerate(lines):
        starts = i > 1 and lines[i - 2].endswith(":") and not lines[i - 1].strip() and line.startswith(" " * 4)
        in_formula = (in_formula or starts) and (not line.strip() or line.startswith(" " * 4))
        if starts and in_formula:
            lines[i - 2] += ":"
        if not in_formula:
            lines[i] = re.sub(r"(?<=\w)_(?=[^\w`]|$)", r"\\_", line.replace("|", r"\|"))
    if what == "attribute":
        _ATTRIBUTES[name] = [line for line in lines if not re.fullmatch(r"Alias for field number \d+", line)]


_ATTRIBUTES: dict[str, list[str]] = {}


def _attribute(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Napoleon takes what precedes a colon in the text of an attribute for its type; put the text back."""
    if what == "attribute":
        lines[:] = _ATTRIBUTES[name]


def setup(app: Sphinx) -> None:
    """Register the tables, and what turns docstrings into pages."""
    app.connect("autodoc-process-docstring", _plain_text, priority=400)  # before napoleon, at 500
    app.connect("autodoc-process-docstring", _attribute, priority=600)
    app.add_directive("spec-table", SpecTable)
    app.add_directive("field-table", FieldTable)
