"""Short texts of large objects, for who types their name.

A clip or a posterior holds hundreds of arrays, and the text that dataclasses make of themselves is
all of their numbers. Here arrays are said by kind and shape, and sequences by length.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

import numpy as np

__all__ = ["brief"]

_SHORT: Final = 60
"""Characters up to which a value is written out."""
_FEW: Final = 6
"""Numbers up to which an array is written out."""


def brief(value: object) -> str:
    """The name of a type and what its fields hold, in a line; to be used as ``__repr__``.

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
    """A text, mapping or sequence: as it is if that is short, else how many of what."""
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
