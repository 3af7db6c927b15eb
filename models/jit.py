"""Compilation of the kernels, cached on disk by what all of them say.

numba's own cache notices a change in a function's file but not in the files of the
functions it calls, and would go on running an old kernel inside a new one. Keeping the
cache under a digest of all kernel sources makes that impossible.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numba

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

__all__ = ["compiled", "inlined"]

Function = TypeVar("Function", bound=Callable[..., Any])

_HERE = Path(__file__).resolve().parent
_NUMBA: Any = numba.config
"""numba's settings, which it names only at run time."""


def _digest() -> str:
    state = hashlib.sha256()
    for path in (*sorted(_HERE.rglob("*.py")), _HERE / "calibrated.toml"):
        state.update(path.read_bytes())
    return state.hexdigest()[:16]


def _cache_folder() -> str:
    """Beside the sources, or where the user keeps numba's cache."""
    base = _NUMBA.CACHE_DIR or str(_HERE / "__pycache__")
    if not os.access(base if os.path.isdir(base) else _HERE, os.W_OK):
        return ""
    return os.path.join(base, f"kernels-{_digest()}")


_CACHE = _cache_folder()

_LIBERTIES = {"contract", "nsz"}
"""What the compiler may do to arithmetic: round once where it multiplies and adds, and take
-0 for 0. Sums keep their order, and what is not finite stays so. Nor does it look out for
divisions by zero, as Python would; they give infinities."""


def compiled(function: Function, *, inline: bool = False) -> Dispatcher[Function]:
    """``function`` compiled by numba on its first call, and remembered for the next process."""
    before = _NUMBA.CACHE_DIR
    try:
        _NUMBA.CACHE_DIR = _CACHE or before
        return numba.njit(cache=True, error_model="numpy", fastmath=_LIBERTIES, forceinline=inline)(
            function
        )
    finally:
        _NUMBA.CACHE_DIR = before


def inlined(function: Function) -> Dispatcher[Function]:
    """As :func:`compiled`, and made part of whatever compiled function calls it.

    For what is called once a frame or a box: to hand over a few arrays, of ten numbers each,
    takes longer than the arithmetic on a row of joints.
    """
    return compiled(function, inline=True)
