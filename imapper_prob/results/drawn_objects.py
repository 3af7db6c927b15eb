"""The furniture of one draw, as it may stand about the person.

A scenelet says where such furniture stands about somebody who moves like this, not where this
piece does: people sit at any place of a couch, and farther from a shelf or nearer to it. The
detections hardly tell (``docs/preference.md``), so that what the posterior knows of a place is
the scenelet's word, and how far such words are off is measured on scenes whose truth is known
(``docs/calibration.md``). What is drawn of the scenelets alone leaves that out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.settings import ModelSettings

__all__ = ["drawn_objects"]

Array = NDArray[np.float64]


def drawn_objects(
    rng: np.random.Generator, objects: Sequence[SceneObject], settings: ModelSettings
) -> tuple[SceneObject, ...]:
    """The same objects, each moved along its own axes by what its scenelet cannot know."""
    return tuple(_moved(o, rng.standard_normal(2), settings) for o in objects)


def _moved(o: SceneObject, errors: Array, settings: ModelSettings) -> SceneObject:
    low, high = o.bounds
    scale = (settings.furniture_aside * (high[0] - low[0]), settings.furniture_ahead)
    x, y = o.placement.rotation @ (scale * errors)
    place = replace(o.placement, x=o.placement.x + float(x), y=o.placement.y + float(y))
    return SceneObject(o.label, place, o.cuboids)
