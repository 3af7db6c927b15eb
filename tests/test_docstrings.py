"""Docstrings of public names are complete: summary, parameters, what is returned and raised."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from enum import Enum
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from numpydoc.validate import validate

import imapper_prob

ROOT = Path(__file__).parents[1]
DONE = (
    "api", "clips", "cli", "config", "evaluate", "files", "layouts", "lifting", "memory", "models",
    "people", "plotting", "progress", "recording", "results", "samplers", "sampling", "scenelets",
    "simulate", "solver", "uncertainty",
)  # fmt: skip
"""Packages and modules in which all names of ``__all__`` are held to it."""
CHECKS = {
    "GL08",  # there is a docstring
    "SS01",  # with a summary
    "PR01",  # all parameters are documented
    "PR02",  # and none that is not there
    "PR03",  # in their order
    "GL07",  # and so are sections
}
"""Of `numpydoc.validate`."""


def public_names(package: str) -> Iterator[tuple[str, Any]]:
    """Functions and classes in ``__all__`` of a package's modules, and public methods of these."""
    top = ROOT / "imapper_prob" / package
    paths = sorted(top.rglob("*.py")) if top.is_dir() else [top.with_suffix(".py")]
    for path in paths:
        module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
        for name in getattr(module, "__all__", ()):
            entry = getattr(module, name)
            if callable(entry) and getattr(entry, "__module__", "") == module.__name__:
                yield from with_methods(f"{module.__name__}.{name}", entry)


def top_level_names() -> Iterator[tuple[str, Any]]:
    """What `imapper_prob` exports, with methods that are inherited, by where it is defined."""
    for name in imapper_prob.__all__:
        entry = getattr(imapper_prob, name)
        bases = entry.__mro__[1:] if inspect.isclass(entry) else ()
        for base in bases:
            if base.__module__.startswith("imapper_prob."):
                yield from methods(f"{base.__module__}.{base.__name__}", base)
        yield from with_methods(f"{entry.__module__}.{name}", entry)


def with_methods(name: str, entry: Any) -> Iterator[tuple[str, Any]]:
    """A function; or a class, and its public methods and properties."""
    yield name, entry
    if inspect.isclass(entry):
        yield from methods(name, entry)


def methods(name: str, entry: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that a class defines itself."""
    for method, value in vars(entry).items():
        plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if not method.startswith("_") and (
            inspect.isfunction(plain) or isinstance(plain, property | cached_property)
        ):
            yield f"{name}.{method}", plain


def lacking(name: str, entry: Any) -> list[str]:
    """What the docstring of a name lacks."""
    checks = {"GL08", "SS01"} if is_enumeration(entry) else CHECKS
    found = [f"{code}: {text}" for code, text in validate(name)["errors"] if code in checks]
    function, text = getattr(entry, "py_func", entry), inspect.getdoc(entry) or ""
    if inspect.isfunction(function):
        returned = function.__annotations__.get("return", "None")
        if returned not in ("None", None, "NoReturn") and not has(text, "Returns", "Yields"):
            found.append(f"{returned} is returned without a section Returns")
        if raises_input_error(function) and not has(text, "Raises"):
            found.append("InputError is raised without a section Raises")
    return found


def is_enumeration(entry: Any) -> bool:
    return inspect.isclass(entry) and issubclass(entry, Enum)


def has(text: str, *sections: str) -> bool:
    return any(f"{section}\n{'-' * len(section)}" in text for section in sections)


def raises_input_error(function: Any) -> bool:
    """Whether the function's own body does."""
    body = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return any(
        isinstance(node, ast.Raise) and "InputError" in ast.unparse(node) for node in ast.walk(body)
    )


@pytest.mark.parametrize("package", DONE)
def test_public_names_are_documented(package: str) -> None:
    assert {n: found for n, entry in public_names(package) if (found := lacking(n, entry))} == {}


def test_what_the_program_exports_is_documented() -> None:
    assert {n: found for n, entry in top_level_names() if (found := lacking(n, entry))} == {}
