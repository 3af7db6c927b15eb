"""From layouts to scenes that differ enough to be looked at one by one.

Layouts are fine: a chair where another has a stool makes a layout of its own, and dozens of them
share the probability. A scene is all layouts within a stated distance of its most probable one,
and has the sum of their probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.results.scene_distance import pair_objects

__all__ = ["APART", "group_scenes"]

APART: Final = 0.9
"""Metres, see :mod:`imapper_prob.results.scene_distance`: an object more or less (1) is another
scene; two seats of other labels (0.7) are not."""


def group_scenes(layouts: Sequence[Sequence[SceneObject]]) -> NDArray[np.int64]:
    """Sort layouts into scenes.

    Parameters
    ----------
    layouts : sequence of K object sets
        The most probable first. Each joins the nearest of the scenes founded before it, and
        founds one itself where none is nearer than :data:`APART`.

    Returns
    -------
    (K,) int
        Scene of each layout, numbered as they are founded.
    """
    founders: list[int] = []
    scene = np.empty(len(layouts), np.int64)
    for k, objects in enumerate(layouts):
        distances = [pair_objects(layouts[f], objects).distance for f in founders]
        nearest = int(np.argmin(distances)) if distances else -1
        if not distances or distances[nearest] >= APART:
            nearest = len(founders)
            founders.append(k)
        scene[k] = nearest
    return scene
