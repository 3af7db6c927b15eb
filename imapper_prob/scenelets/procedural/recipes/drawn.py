"""What a recipe makes, and how long it may last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.scenelets.procedural.person import Person

__all__ = ["FACING_BACK", "FRAMES_PER_SECOND", "Drawn", "Recipe", "moments"]

Array = NDArray[np.float64]

FRAMES_PER_SECOND: Final = 10.0
"""Of i3DB, and fast enough for everything people do in a room."""

FACING_BACK: Final = float(np.pi)
"""Yaw in radians of a piece that faces the person who faces it."""


class Drawn(NamedTuple):
    """One motion (n, 16, 3) and its furniture, in a common frame and in the units of a person."""

    joints: Array
    objects: tuple[SceneObject, ...]


Recipe = Callable[[np.random.Generator, Person], Drawn]
"""Draws a motion of the reference body among furniture as the person sees it."""


def moments(rng: np.random.Generator, fewest: int, most: int) -> Array:
    """(n,) times in seconds of a clip of ``fewest`` to ``most`` frames."""
    return np.arange(int(rng.integers(fewest, most + 1))) / FRAMES_PER_SECOND
