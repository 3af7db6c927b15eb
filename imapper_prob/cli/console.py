"""All that is printed: names in it are of others, who may have put anything in them."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from imapper_prob.models.text import readable

__all__ = ["console", "printable", "told"]


def printable(text: str) -> str:
    """Text line by line without anything that a terminal takes for an order."""
    return "\n".join(map(readable, text.split("\n")))


def console(*, stderr: bool = False) -> Any:
    """A `rich.console.Console` that takes no word of a text for markup, emoji or an order."""
    from rich.console import Console

    class Plain(Console):
        def render_str(self, text: str, **options: Any) -> Any:
            options.update(markup=False, emoji=False)
            return super().render_str(printable(text), **options)

    return Plain(stderr=stderr, markup=False, emoji=False, highlight=False)


@contextmanager
def told() -> Iterator[None]:
    """Warnings of the program as lines on standard error, and no character that stops a line."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    handler = logging.StreamHandler()
    handler.setFormatter(_Plain())
    handler.setLevel(logging.WARNING)
    program = logging.getLogger("imapper_prob")
    program.addHandler(handler)
    try:
        yield
    finally:
        program.removeHandler(handler)


class _Plain(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))
