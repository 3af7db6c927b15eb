"""Compilation of the kernels that draw stretches anew: they call one another from file to file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from imapper_prob.models import jit
from imapper_prob.samplers import pools

__all__ = ["compiled"]

Function = TypeVar("Function", bound=Callable[..., Any])

_HERE: Final = Path(__file__).resolve().parent
_BESIDE: Final = (
    Path(pools.__file__).resolve(),
    _HERE / "join_kernels.py",
    _HERE / "pool_kernels.py",
)


def compiled(function: Function) -> Function:
    """As :func:`imapper_prob.models.jit.compiled`, cached by what these files say as well."""
    result: Any = jit.compiled(function, beside=_BESIDE)
    kernel: Function = result
    return kernel
