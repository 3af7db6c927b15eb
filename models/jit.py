"""Compile kernels by numba, and cache them on disk under a digest of their sources.

The cache of numba notices a change in a function's own file, but not in the files of the functions
that it calls; it would then reuse an outdated kernel. The digest of
:mod:`imapper_prob.models.kernel_sources` covers all of them.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numba
from numba import types
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher

from imapper_prob.models.kernel_sources import digest

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

__all__ = ["compiled", "inlined", "inner", "inner_inlined", "remove_unused"]

Function = TypeVar("Function", bound=Callable[..., Any])

_HERE = Path(__file__).resolve().parent
_NUMBA: Any = numba.config
"""Settings of numba, typed as Any because their attributes are created at run time."""

_UNUSED_AFTER = 24 * 3600.0
"""Age in seconds after which a cache with another digest is removed as unused."""


@cache
def _model_digest() -> str:
    return digest(_HERE)


@cache
def _cache_folder(beside: tuple[Path, ...] = ()) -> str:
    """Folder of the cache, in numba's cache folder or beside the sources; touched on every use."""
    made_of = _model_digest()
    if beside:
        texts = [made_of, *(path.read_text(encoding="utf-8") for path in beside)]
        made_of = hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
    base = _NUMBA.CACHE_DIR or str(_HERE / "__pycache__")
    if not os.access(base if os.path.isdir(base) else _HERE, os.W_OK):
        return ""
    folder = os.path.join(base, f"kernels-{made_of}")
    if os.path.isdir(folder):
        with suppress(OSError):  # the folder belongs to another user
            os.utime(folder)
    elif os.path.isdir(base):
        remove_unused(Path(base))
    return folder


def remove_unused(base: Path) -> None:
    """Remove the kernel caches in ``base`` that no process has used for a day.

    Parameters
    ----------
    base : Path
        Folder that contains caches.
    """
    for folder in base.iterdir():
        if re.fullmatch("kernels-[0-9a-f]{16}", folder.name):
            with suppress(OSError):  # another process may remove it at the same time
                if folder.stat().st_mtime < time.time() - _UNUSED_AFTER:
                    shutil.rmtree(folder, ignore_errors=True)


_LIBERTIES = {"nsz"}
"""Floating-point liberties of the compiler: it may treat -0 as 0. Sums keep their order, products
are rounded before they are added (no fused multiply-add), and non-finite values are preserved.
Fused products would make the last bits depend on inlining, which differs between a process that
compiles and one that loads compiled kernels; then the same seed would give other draws. Division by
zero gives infinity instead of Python's exception (``error_model="numpy"``)."""


class _Cache(FunctionCache):
    """The compiled forms of a function on disk, which one process at a time adds to.

    numba reads the list of files, adds one and writes the list. Two processes that do so at once
    could give one name to the code for different types of arguments.
    """

    def save_overload(self, sig: Any, data: Any) -> None:
        with _held(Path(self.cache_path)):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which the system releases when this process ends in any way."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        if fcntl is not None:
            with suppress(OSError):  # a network disk without locks
                fcntl.flock(file, fcntl.LOCK_EX)
        yield


class _Kernel(CPUDispatcher):
    """A function that LLVM optimises at a lower level than numba's 3.

    At level 1 compiling all kernels takes a fifth less time and memory. Chains take the same time,
    and their draws are equal to the last bit.
    """

    def compile(self, sig: Any) -> Any:
        before = _NUMBA.OPT
        _NUMBA.OPT = type(before)(1)
        try:
            return super().compile(sig)
        finally:
            _NUMBA.OPT = before


class _Uncounted(_Kernel):
    """A kernel without reference counts: it can neither allocate arrays nor return any.

    numba counts an array of a problem or a cache whenever it is looked up, once per frame or box.
    """

    def compile(self, sig: Any) -> Any:
        made = super().compile(sig)
        overloads: list[Any] = list(self.overloads.values())
        for overload in overloads:
            if not _of_numbers(overload.signature.return_type):
                raise TypeError(f"{self.py_func.__name__} is inlined; it cannot return arrays")
        return made


def _of_numbers(kind: Any) -> bool:
    """Whether a numba type consists of numbers and None only."""
    if isinstance(kind, types.Tuple | types.UniTuple | types.NamedTuple):
        return all(_of_numbers(part) for part in kind.types)
    return isinstance(kind, types.Number | types.Boolean | types.NoneType)


class _Inner(_Kernel):
    """A kernel that only other kernels can call; it has no wrapper for Python objects."""

    def __call__(self, *_: object, **__: object) -> None:
        name = self.py_func.__name__
        raise TypeError(f"{name} is for other kernels; to call it from Python, use compiled")


class _InnerUncounted(_Inner, _Uncounted):
    """Both of these."""


def compiled(function: Function, *, beside: tuple[Path, ...] = ()) -> Dispatcher[Function]:
    """Compile a function by numba on its first call, and cache it on disk.

    Parameters
    ----------
    function : callable
    beside : tuple of Path
        Modules outside of the model whose kernels it calls; their text enters the digest.

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return _compiled(function, beside=beside)


def inlined(function: Function) -> Dispatcher[Function]:
    """Like :func:`compiled`, but inlined into the compiled functions that call it.

    For kernels that are called once per frame or box: passing a few arrays (about ten numbers each)
    takes longer than the arithmetic on one row of joints. They are compiled without reference
    counts, so they read and write the arrays that they are given; they neither allocate nor return
    any.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return _compiled(function, inline=True)


def inner(function: Function, *, beside: tuple[Path, ...] = ()) -> Dispatcher[Function]:
    """Like :func:`compiled`, but callable from other kernels only.

    Compiling the conversion of a problem's seventy arrays from Python takes longer than compiling
    most kernels.

    Parameters
    ----------
    function : callable
    beside : tuple of Path
        See :func:`compiled`.

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Raises `TypeError` when called from Python.
    """
    return _compiled(function, alone=True, beside=beside)


def inner_inlined(function: Function, *, beside: tuple[Path, ...] = ()) -> Dispatcher[Function]:
    """Like :func:`inlined`, but callable from other kernels only; see :func:`inner`.

    Parameters
    ----------
    function : callable
    beside : tuple of Path
        See :func:`compiled`.

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Raises `TypeError` when called from Python.
    """
    return _compiled(function, inline=True, alone=True, beside=beside)


def _compiled(
    function: Function,
    *,
    inline: bool = False,
    alone: bool = False,
    beside: tuple[Path, ...] = (),
) -> Dispatcher[Function]:
    before = _NUMBA.CACHE_DIR
    # Nobody calls kernels by C address; leaving out that wrapper saves a fourth of the compilation.
    # `Any`, because numba's published types lack these options.
    njit: Any = numba.njit
    try:
        _NUMBA.CACHE_DIR = _cache_folder(beside) or before
        dispatcher: Dispatcher[Function] = njit(
            cache=True,
            error_model="numpy",
            fastmath=_LIBERTIES,
            forceinline=inline,
            _nrt=not inline,
            no_cfunc_wrapper=True,
            no_cpython_wrapper=alone,
        )(function)
        dispatcher._cache = _Cache(function)  # type: ignore[attr-defined, no-untyped-call]
    finally:
        _NUMBA.CACHE_DIR = before
    # Without a Python wrapper, a call from Python would jump to an invalid address.
    if inline:
        dispatcher.__class__ = _InnerUncounted if alone else _Uncounted  # type: ignore[assignment]
    else:
        dispatcher.__class__ = _Inner if alone else _Kernel  # type: ignore[assignment]
    return dispatcher
