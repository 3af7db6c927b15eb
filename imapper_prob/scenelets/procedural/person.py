"""Who performs a recipe: a stature, and furniture as seen from it.

Segment lengths are fixed parts of stature (Drillis and Contini 1966), so a person of any
stature is the reference body in a room that has shrunk or grown. Recipes therefore pose the
reference body only, among furniture that :meth:`Person.sees`; the catalogue undoes the
scaling of the furniture afterwards. Motions of the library are thus all of the reference
body, while how high a seat is for whoever sits there varies as it does among people.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import REFERENCE_STATURE
from imapper_prob.scenelets.frames import resized

__all__ = ["Person", "draw_person"]

STATURE: Final = (1.70, 0.07)
"""Mean and standard deviation in metres over adults of both sexes (Pheasant and Haslegrave,
*Bodyspace*, 2005)."""

STATURE_RANGE: Final = (1.55, 1.85)
"""Shortest and tallest performer, metres; beyond, furniture of usual sizes no longer fits."""


@dataclass(frozen=True)
class Person:
    """Somebody of a stature in metres."""

    stature: float

    def sees(self, piece: SceneObject) -> SceneObject:
        """Furniture in units in which this person is of the reference stature."""
        return resized(piece, REFERENCE_STATURE / self.stature)

    def returns(self, piece: SceneObject) -> SceneObject:
        """Furniture in metres again."""
        return resized(piece, self.stature / REFERENCE_STATURE)


def draw_person(rng: np.random.Generator) -> Person:
    """An adult."""
    return Person(float(np.clip(rng.normal(*STATURE), *STATURE_RANGE)))
