"""Which colour and which class number everything in a recording has.

Objects have the hues of :mod:`imapper_prob.colours`; people and their doubles take the light
tones that are left.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from imapper_prob.colours import Colour, category_colour
from imapper_prob.models.skeleton import BONES, JOINTS
from imapper_prob.recording.glyphs import drawable

__all__ = [
    "ALTERNATIVE",
    "ESTIMATE",
    "FLOOR",
    "FLOOR_LINE",
    "GHOSTS",
    "REPROJECTION",
    "SCENE_COLOURS",
    "TRUE_COLOUR",
    "TRUTH",
    "UNCLAIMED",
    "annotation_context",
    "category_ids",
    "confidence_colours",
]

ESTIMATE: Final = 1
"""Class of the person in the most probable scene."""
ALTERNATIVE: Final = 2
"""Class of the person in every other scene."""
TRUTH: Final = 3
"""Class of everything that really was there."""
REPROJECTION: Final = 4
"""Class of the best scene's joints in the image."""
_FIRST_CATEGORY: Final = 10

FLOOR: Final = (30, 33, 40)
FLOOR_LINE: Final = (58, 63, 74)
TRUE_COLOUR: Final = (190, 190, 190)
UNCLAIMED: Final = (150, 155, 165)
"""Of what is hidden by nothing in particular."""

SCENE_COLOURS: Final[tuple[Colour, ...]] = (
    (255, 214, 102),
    (134, 188, 240),
    (240, 150, 170),
    (150, 215, 170),
    (200, 170, 235),
)
"""Curves of scenes 1, 2, … in plots; the first is also the person's colour."""

GHOSTS: Final[dict[int, Colour]] = {
    ESTIMATE: (128, 108, 56),
    ALTERNATIVE: (70, 97, 124),
}
"""The person's colour at half the light: rerun draws lines opaque, and other draws must not
outshine the one they surround."""

_PEOPLE: Final[dict[int, tuple[str, Colour]]] = {
    ESTIMATE: ("estimate", SCENE_COLOURS[0]),
    ALTERNATIVE: ("alternative", SCENE_COLOURS[1]),
    TRUTH: ("truth", TRUE_COLOUR),
    REPROJECTION: ("reprojection", SCENE_COLOURS[0]),
}
_UNSURE: Final = np.array([225.0, 70.0, 70.0])
_HALF_SURE: Final = np.array([245.0, 190.0, 70.0])
_SURE: Final = np.array([90.0, 210.0, 120.0])


def category_ids(labels: Iterable[str]) -> dict[str, int]:
    """A class number for each category, in alphabetical order."""
    return {label: _FIRST_CATEGORY + i for i, label in enumerate(sorted(set(labels)))}


def annotation_context(categories: dict[str, int]) -> rr.AnnotationContext:
    """Names, colours and bones of every class in a recording."""
    joints = [rr.AnnotationInfo(id=j, label=name) for j, name in enumerate(JOINTS)]
    people = [
        rr.ClassDescription(
            info=rr.AnnotationInfo(id=number, label=label, color=colour),
            keypoint_annotations=[
                rr.AnnotationInfo(id=j.id, label=j.label, color=colour) for j in joints
            ],
            keypoint_connections=list(BONES),
        )
        for number, (label, colour) in _PEOPLE.items()
    ]
    objects = [
        rr.ClassDescription(
            info=rr.AnnotationInfo(id=number, label=drawable(label), color=category_colour(label))
        )
        for label, number in categories.items()
    ]
    return rr.AnnotationContext([*people, *objects])


def confidence_colours(confidences: ArrayLike) -> NDArray[np.uint8]:
    """(...) confidences in [0, 1] to (..., 3) colours: red, amber at one half, green."""
    c = np.clip(np.asarray(confidences, float), 0, 1)[..., None]
    below = _UNSURE + (_HALF_SURE - _UNSURE) * (2 * c)
    above = _HALF_SURE + (_SURE - _HALF_SURE) * (2 * c - 1)
    colours: NDArray[np.uint8] = np.where(c < 0.5, below, above).round().astype(np.uint8)
    return colours
