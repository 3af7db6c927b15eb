"""Text that the viewer can draw.

Its one font has Latin, Greek and Cyrillic letters. At any other sign, of a clip's name or an
object's label, the viewer does not draw a box but ends, and takes all other views with it.
"""

from __future__ import annotations

__all__ = ["drawable"]

_RANGES = (
    (0x20, 0x7E),
    (0xA0, 0x148),
    (0x14A, 0x1C3),
    (0x1C5, 0x24F),
    (0x386, 0x3E1),
    (0x400, 0x45F),
)
"""Tried one by one in the viewer of rerun 0.41."""
_SIGNS = frozenset("\n–—‘’“”…→×≈≤≥•−√∞€")


def drawable(text: str) -> str:
    """The same text with a question mark for every sign that the viewer has no picture of."""
    return "".join(c if c in _SIGNS or _has(ord(c)) else "?" for c in text)


def _has(code: int) -> bool:
    return any(first <= code <= last for first, last in _RANGES)
