"""A name for contents: equal contents have equal names, on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["digest"]

_LENGTH = 32
"""Hexadecimal digits: 128 bits, no two recordings will ever share a name."""


def digest(*contents: Any) -> str:
    """A name that depends on nothing but contents: arrays, dataclasses, collections, scalars."""
    state = hashlib.sha256()
    for part in _parts(contents):
        state.update(part)
    return state.hexdigest()[:_LENGTH]


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield repr((value.shape, value.dtype.str)).encode()
        yield np.ascontiguousarray(value).tobytes()
    elif is_dataclass(value) and not isinstance(value, type):
        yield type(value).__name__.encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _parts(key)
            yield from _parts(item)
    elif isinstance(value, list | tuple):
        yield f"{len(value)} items".encode()
        for item in value:
            yield from _parts(item)
    else:
        yield repr(value).encode()
