"""Compilation of the kernels by numba, cached on disk under a digest of what they are made of.

numba's own cache notices a change in a function's file but not in the files of the functions it
calls, and would go on running an old kernel inside a new one. The digest
(:mod:`imapper_prob.models.kernel_sources`) changes with any of them.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numba
from numba.core.registry import CPUDispatcher

from imapper_prob.models.kernel_sources import digest

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

__all__ = ["compiled", "inlined", "inner", "inner_inlined", "remove_unused"]

Function = TypeVar("Function", bound=Callable[..., Any])

_HERE = Path(__file__).resolve().parent
_NUMBA: Any = numba.config
"""numba's settings, which it names only at run time."""

_UNUSED_AFTER = 24 * 3600.0
"""Seconds after which a cache of other kernels is taken for one that nobody needs."""


@cache
def _model_digest() -> str:
    return digest(_HERE)


@cache
def _cache_folder(beside: tuple[Path, ...] = ()) -> str:
    """Beside the sources, or where the user keeps numba's cache; its time is that of last use."""
    made_of = _model_digest()
    if beside:
        texts = [made_of, *(path.read_text(encoding="utf-8") for path in beside)]
        made_of = hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
    base = _NUMBA.CACHE_DIR or str(_HERE / "__pycache__")
    if not os.access(base if os.path.isdir(base) else _HERE, os.W_OK):
        return ""
    folder = os.path.join(base, f"kernels-{made_of}")
    if os.path.isdir(folder):
        with suppress(OSError):  # of another user, who says so himself
            os.utime(folder)
    elif os.path.isdir(base):
        remove_unused(Path(base))
    return folder


def remove_unused(base: Path) -> None:
    """Remove the caches in ``base`` that no process has opened for a day.

    Parameters
    ----------
    base : Path
        Folder that caches are in.
    """
    for folder in base.iterdir():
        if re.fullmatch("kernels-[0-9a-f]{16}", folder.name):
            with suppress(OSError):  # somebody else removes it, too
                if folder.stat().st_mtime < time.time() - _UNUSED_AFTER:
                    shutil.rmtree(folder, ignore_errors=True)


_LIBERTIES = {"nsz"}
"""What the compiler may do to arithmetic: take -0 for 0. Sums keep their order, products are
rounded before they are added, and what is not finite stays so. With fused products the last bits
would depend on what is inlined, which is more in a process that compiles than in one that loads
compiled kernels, and with the bits the draws of a seed. Nor does it look out for divisions by zero,
as Python would; they give infinities."""


class _Inner(CPUDispatcher):
    """A kernel that only kernels can call: there is nothing that would take Python's objects."""

    def __call__(self, *_: object, **__: object) -> None:
        name = self.py_func.__name__
        raise TypeError(f"{name} is for other kernels; to call it from Python, use compiled")


def compiled(function: Function, *, beside: tuple[Path, ...] = ()) -> Dispatcher[Function]:
    """Compile a function by numba on its first call, and cache it for the next process.

    Parameters
    ----------
    function : callable
    beside : tuple of Path
        Modules outside of the model whose kernels it calls.

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return _compiled(function, beside=beside)


def inlined(function: Function) -> Dispatcher[Function]:
    """As :func:`compiled`, and made part of whatever compiled function calls it.

    For what is called once a frame or a box: to hand over a few arrays, of ten numbers each,
    takes longer than the arithmetic on a row of joints.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return _compiled(function, inline=True)


def inner(function: Function) -> Dispatcher[Function]:
    """As :func:`compiled`, for kernels alone.

    To take the seventy arrays of a problem from Python is more work for the compiler than most
    kernels are.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Refuses calls from Python.
    """
    return _compiled(function, alone=True)


def inner_inlined(function: Function) -> Dispatcher[Function]:
    """As :func:`inlined`, for kernels alone; see :func:`inner`.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Refuses calls from Python.
    """
    return _compiled(function, inline=True, alone=True)


def _compiled(
    function: Function,
    *,
    inline: bool = False,
    alone: bool = False,
    beside: tuple[Path, ...] = (),
) -> Dispatcher[Function]:
    before = _NUMBA.CACHE_DIR
    # Nobody calls kernels by their address; to make that possible is a fourth of the work. The
    # published types leave the options out.
    njit: Any = numba.njit
    try:
        _NUMBA.CACHE_DIR = _cache_folder(beside) or before
        dispatcher: Dispatcher[Function] = njit(
            cache=True,
            error_model="numpy",
            fastmath=_LIBERTIES,
            forceinline=inline,
            no_cfunc_wrapper=True,
            no_cpython_wrapper=alone,
        )(function)
    finally:
        _NUMBA.CACHE_DIR = before
    if alone:
        # A call from Python would go to an address where there is nothing.
        dispatcher.__class__ = _Inner  # type: ignore[assignment]
    return dispatcher
