"""Problem and memory as one object, which compiled code is handed by its address.

A problem and a memory are some ninety arrays. To look at each of them at every call takes
longer than all the arithmetic of a small move; so this is done once, when a session is opened.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.experimental import structref

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.memory import Memory, new_memory
from imapper_prob.models.problem import Problem

__all__ = ["Session", "open_session"]

_structref: Any = structref
"""numba's records by reference, published without types."""


class _SessionType(types.StructRef):
    """What the compiler calls a session."""


class Session(structref.StructRefProxy):
    """A problem and the memory of its evaluation."""

    problem: Problem
    memory: Memory


_structref.register(_SessionType)
_structref.define_boxing(_SessionType, Session)
_structref.define_constructor(Session, _SessionType, ["problem", "memory"])


@compiled
def open_session(problem: Problem, capacity: int) -> Session:
    """A session of ``problem``, whose arrays it keeps, with memory for ``capacity`` scenelets."""
    return Session(problem, new_memory(problem, max(capacity, 1)))  # type: ignore[no-untyped-call]
