"""Make text from the input safe to print, count names, and describe large objects in one line.

A clip or a posterior holds hundreds of arrays, and the default text of a dataclass would print all
their numbers. :func:`brief` describes arrays by type and shape, and sequences by length.
"""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final, TypeVar

import numpy as np

__all__ = [
    "Listed",
    "as_probability",
    "brief",
    "counted",
    "in_markdown",
    "plural",
    "readable",
    "shortened",
    "with_error",
]

T = TypeVar("T")
_UNKNOWN: Final = "\N{REPLACEMENT CHARACTER}"
_BLANKS: Final = frozenset("\t\n\v\f\r\x85\u2028\u2029")
_UNDECODED: Final = range(0xDC80, 0xDD00)
"""Code points that Python uses for undecodable bytes of file names."""
_ORDERS: Final = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that change the writing direction, so that text is displayed in another order."""


def readable(text: str) -> str:
    """The text on one line, without characters that terminals or files cannot show.

    Line breaks and tabs become blanks; other control characters and lone surrogates become a
    replacement character. An undecodable byte is read as Latin-1.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    if ord(character) in _UNDECODED:
        character = chr(ord(character) - 0xDC00)
    if character in _BLANKS:
        return " "
    category = unicodedata.category(character)
    return _UNKNOWN if category in ("Cc", "Cs") or character in _ORDERS else character


_DIGITS: Final = range(2, 7)
"""Digits after the point of a number with an error; smaller errors are those of arithmetic."""


def with_error(value: float, error: float) -> str:
    """A number with its error, to two digits after the point, or to the first one of the error.

    Parameters
    ----------
    value : float
    error : float
        NaN if no error can be given; 0 if there is none.

    Returns
    -------
    str
        Such as ``0.25 ± 0.03``, ``0.998 ± 0.001``, ``0.25 ± unknown``, or ``0.25`` without an
        error.
    """
    if math.isnan(error):
        return f"{value:.2f} ± unknown"
    digits = next((d for d in _DIGITS if round(error, d) > 0), None)
    return f"{value:.2f}" if digits is None else f"{value:.{digits}f} ± {error:.{digits}f}"


def as_probability(value: float) -> str:
    """A probability of which no error is shown, so that it never looks certain.

    Parameters
    ----------
    value : float

    Returns
    -------
    str
        Such as ``0.25``, ``> 0.99`` or ``< 0.01``.

    Examples
    --------
    >>> as_probability(0.25), as_probability(0.998), as_probability(0.0)
    ('0.25', '> 0.99', '< 0.01')
    """
    shown = f"{value:.2f}"
    return {"1.00": "> 0.99", "0.00": "< 0.01"}.get(shown, shown)


_MARKS: Final = "\\`*<|["
"""Characters that Markdown takes for code, emphasis, HTML, the end of a table's cell and a link."""


def plural(name: str) -> str:
    """The plural of a piece of furniture.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Examples
    --------
    >>> plural("shelf"), plural("bench"), plural("seat")
    ('shelves', 'benches', 'seats')
    """
    if name.endswith("f"):
        return f"{name[:-1]}ves"
    return f"{name}es" if name.endswith(("ch", "sh", "s", "x")) else f"{name}s"


def counted(names: Iterable[str]) -> str:
    """Names with their numbers, the most frequent first; ``none`` if there are none.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    str

    Examples
    --------
    >>> counted(["table", "seat", "seat"])
    '2 seats, 1 table'
    """
    found = Counter(sorted(names)).most_common()
    return ", ".join(f"{n} {plural(name) if n > 1 else name}" for name, n in found) or "none"


def shortened(items: Iterable[object], *, most: int) -> str:
    """The first items, separated by commas, and the number of further ones.

    Parameters
    ----------
    items : iterable
    most : int
        Number of items that are listed.

    Returns
    -------
    str

    Examples
    --------
    >>> from imapper_prob.models.text import shortened
    >>> shortened(["a", "b", "c"], most=2)
    'a, b and 1 more'
    """
    items = list(items)
    text = ", ".join(map(str, items[:most]))
    more = len(items) - most
    return f"{text} and {more} more" if more > 0 else text


def in_markdown(text: str) -> str:
    """The text on one line, as Markdown that shows it as it is, in a table's cell as well.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return "".join(f"\\{c}" if c in _MARKS else c for c in readable(text))


_SHORT: Final = 60
"""Longest text of a value that is printed in full, characters."""
_FEW: Final = 6
"""Largest array or sequence that is printed in full, elements."""
_PAGE: Final = 600
"""Longest text of a tuple that is printed in full, characters."""


class Listed(tuple[T, ...]):
    """A tuple whose text gives the number and type of its elements if it is long.

    Parameters
    ----------
    iterable : iterable
        Its elements.
    """

    def __repr__(self) -> str:
        """The full text if it is short, else the number and type of the elements."""
        whole = super().__repr__() if len(self) <= _FEW else ""
        return whole if 0 < len(whole) <= _PAGE else f"({_sequence(self)})"


def brief(value: object) -> str:
    """One-line description of a type and its fields, for use as ``__repr__``.

    Parameters
    ----------
    value : dataclass or named tuple

    Returns
    -------
    str
        Such as ``Track(name='A', keypoints=float64 (130, 16, 2), ...)``.
    """
    if is_dataclass(value):
        names = [f.name for f in fields(value) if f.repr]
    else:
        names = list(getattr(value, "_fields", ()))
    told = ", ".join(f"{name}={_told(getattr(value, name))}" for name in names)
    return f"{type(value).__name__}({told})"


def _told(value: Any) -> str:
    if isinstance(value, np.ndarray):
        few = value.size <= _FEW and value.dtype.kind not in "OUS"
        return str(value.tolist()) if few else f"{value.dtype.name} {value.shape}"
    if isinstance(value, str | bytes | Mapping | set | frozenset | tuple | list):
        return _sequence(value)
    if is_dataclass(value) or hasattr(value, "_fields"):
        return type(value).__name__
    text = repr(value)
    return text if len(text) <= _SHORT else type(value).__name__


def _sequence(value: Any) -> str:
    """Describe a text, mapping or sequence: in full if short, else by length and type."""
    text = isinstance(value, str | bytes)
    inside = [value] if text else list(value.values() if isinstance(value, Mapping) else value)
    plain = str | bytes | int | float | bool | None
    if len(inside) <= _FEW and all(isinstance(v, plain) for v in inside):
        whole = repr(value)
        if len(whole) <= _SHORT:
            return whole
    if text:
        return f"{value[:_SHORT]!r}..."
    kinds = sorted({type(v).__name__ for v in inside})
    return f"{len(inside)} x {kinds[0] if len(kinds) == 1 else 'values'}"
