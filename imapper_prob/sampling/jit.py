"""Compile the kernels of chains; they are cached like those of the model.

A compiled kernel contains the kernels that it calls. So it is compiled again when the text of any
module listed below changes, or a kernel of the model.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from imapper_prob.models import jit

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

__all__ = ["compiled", "inner", "inner_inlined"]

Function = TypeVar("Function", bound=Callable[..., Any])

_FOLDER: Final = Path(__file__).parent
_KERNELS: Final = tuple(
    _FOLDER / f"{name}.py"
    for name in (
        "camera_moves",
        "crossover",
        "gains",
        "image_pelvis",
        "moves",
        "redraws",
        "reference",
        "reference_density",
        "reference_placement",
        "scene",
        "steps",
    )
)
"""Modules whose kernels call each other."""


def compiled(function: Function) -> Dispatcher[Function]:
    """Like :func:`imapper_prob.models.jit.compiled`, for kernels of this package.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return jit.compiled(function, beside=_KERNELS)


def inner(function: Function) -> Dispatcher[Function]:
    """Like :func:`imapper_prob.models.jit.inner`, for kernels of this package.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Raises `TypeError` when called from Python.
    """
    return jit.inner(function, beside=_KERNELS)


def inner_inlined(function: Function) -> Dispatcher[Function]:
    """Like :func:`imapper_prob.models.jit.inner_inlined`, for kernels of this package.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Raises `TypeError` when called from Python.
    """
    return jit.inner_inlined(function, beside=_KERNELS)
