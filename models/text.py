"""Text that others wrote: names of clips, people, furniture, files."""

from __future__ import annotations

import unicodedata
from typing import Final

__all__ = ["readable"]

_UNKNOWN: Final = "\N{REPLACEMENT CHARACTER}"
_BLANKS: Final = frozenset("\t\n\v\f\r\x85\u2028\u2029")
_UNDECODED: Final = range(0xDC80, 0xDD00)
"""Code points by which Python stands for bytes of file names that are no UTF-8."""
_ORDERS: Final = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that turn the direction of what follows, so that it reads as something else."""


def readable(text: str) -> str:
    """The text on one line, with nothing in it that a terminal or a file would trip over.

    Line breaks and tabs become blanks, other control characters and halves of characters a
    replacement character. A byte that is no UTF-8 is taken for Latin-1, as old file systems
    meant it.
    """
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    if ord(character) in _UNDECODED:
        character = chr(ord(character) - 0xDC00)
    if character in _BLANKS:
        return " "
    category = unicodedata.category(character)
    return _UNKNOWN if category in ("Cc", "Cs") or character in _ORDERS else character
