"""Compilation of the kernels of chains, which are cached as those of the model are.

A kernel that is compiled has in it the kernels it calls. It is compiled anew when one of the
modules below changes, or a kernel of the model.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from imapper_prob.models import jit

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher

__all__ = ["compiled"]

Function = TypeVar("Function", bound=Callable[..., Any])

_FOLDER: Final = Path(__file__).parent
_KERNELS: Final = tuple(
    _FOLDER / f"{name}.py"
    for name in (
        "camera_moves",
        "crossover",
        "looks",
        "moves",
        "redraws",
        "reference",
        "scene",
        "steps",
    )
)
"""Modules with kernels that kernels of other modules call, or are called by."""


def compiled(function: Function) -> Dispatcher[Function]:
    """As :func:`imapper_prob.models.jit.compiled`.

    Parameters
    ----------
    function : callable

    Returns
    -------
    numba.core.dispatcher.Dispatcher
    """
    return jit.compiled(function, beside=_KERNELS)
