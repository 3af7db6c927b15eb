"""Colours, class numbers and drawable text of a recording.

Objects have the colours of :mod:`imapper_prob.plotting`; people have light tones that differ from
those.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.skeleton import BONES, JOINTS
from imapper_prob.plotting import Colour, category_colour

__all__ = [
    "ALTERNATIVE",
    "BACKGROUND",
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
    "digest",
    "drawable",
]

_LENGTH = 32
"""Hexadecimal digits of a digest: 128 bits, enough to make names unique."""


def digest(*contents: Any) -> str:
    """A name that depends only on contents: arrays, dataclasses, collections, scalars.

    Parameters
    ----------
    *contents : object

    Returns
    -------
    str
        Hexadecimal.
    """
    state = hashlib.sha256()
    for part in _parts(contents):
        state.update(part)
    return state.hexdigest()[:_LENGTH]


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield repr((value.shape, value.dtype.str)).encode()
        yield np.ascontiguousarray(value).tobytes()
    elif is_dataclass(value) and not isinstance(value, type):
        yield type(value).__name__.encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _parts(key)
            yield from _parts(item)
    elif isinstance(value, list | tuple):
        yield f"{len(value)} items".encode()
        for item in value:
            yield from _parts(item)
    else:
        yield repr(value).encode()


# ------------------------------------------------------------------------------------------------
# Text. The viewer's only font has Latin, Greek and Cyrillic letters. On any other character the
# viewer crashes.

_RANGES = (
    (0x20, 0x7E),
    (0xA0, 0x148),
    (0x14A, 0x1C3),
    (0x1C5, 0x24F),
    (0x386, 0x3E1),
    (0x400, 0x45F),
)
"""Ranges of drawable code points, tested one by one in the viewer of rerun 0.41."""
_SIGNS = frozenset("\n–—‘’“”…→×≈≤≥•−√∞€")


def drawable(text: str) -> str:
    """The text with a question mark for every character that the viewer cannot draw.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return "".join(c if c in _SIGNS or _has(ord(c)) else "?" for c in text)


def _has(code: int) -> bool:
    return any(first <= code <= last for first, last in _RANGES)


# ------------------------------------------------------------------------------------------------
# Classes.

ESTIMATE: Final = 1
"""Class of the person in the most probable scene."""
ALTERNATIVE: Final = 2
"""Class of the person in every other scene."""
TRUTH: Final = 3
"""Class of everything in the ground truth."""
REPROJECTION: Final = 4
"""Class of the most probable scene's joints in the image."""
_FIRST_CATEGORY: Final = 10
"""Class of the first furniture label; smaller ones are those above."""
BACKGROUND: Final = (18, 20, 25)
"""Behind every view: nearly black, sRGB."""
FLOOR: Final = (30, 33, 40)
FLOOR_LINE: Final = (58, 63, 74)
TRUE_COLOUR: Final = (190, 190, 190)
UNCLAIMED: Final = (150, 155, 165)
"""Colour of joints that no particular object hides."""
SCENE_COLOURS: Final[tuple[Colour, ...]] = (
    (255, 214, 102),
    (134, 188, 240),
    (240, 150, 170),
    (150, 215, 170),
    (200, 170, 235),
)
"""Colours of the curves of scenes 1, 2, …; the first is also the person's colour."""
GHOSTS: Final[dict[int, Colour]] = {
    ESTIMATE: (128, 108, 56),
    ALTERNATIVE: (70, 97, 124),
}
"""The person's colour at half brightness. Rerun draws opaque lines, and other draws must not be
brighter than the person they surround."""
_PEOPLE: Final[dict[int, tuple[str, Colour]]] = {
    ESTIMATE: ("estimate", SCENE_COLOURS[0]),
    ALTERNATIVE: ("alternative", SCENE_COLOURS[1]),
    TRUTH: ("truth", TRUE_COLOUR),
    REPROJECTION: ("reprojection", SCENE_COLOURS[0]),
}
_UNSURE: Final = np.array([225.0, 70.0, 70.0])
_HALF_SURE: Final = np.array([245.0, 190.0, 70.0])
_SURE: Final = np.array([90.0, 210.0, 120.0])
"""Colours of certainties 0, 1/2 and 1, sRGB; those in between are interpolated."""


def category_ids(labels: Iterable[str]) -> dict[str, int]:
    """A class number for each category, in alphabetical order.

    Parameters
    ----------
    labels : iterable of str

    Returns
    -------
    dict of str to int
    """
    return {label: _FIRST_CATEGORY + i for i, label in enumerate(sorted(set(labels)))}


def annotation_context(categories: dict[str, int]) -> rr.AnnotationContext:
    """Names, colours and bones of every class in a recording.

    Parameters
    ----------
    categories : dict of str to int
        Class numbers.

    Returns
    -------
    rerun.AnnotationContext
    """
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
    """Map confidences to colours: red at 0, amber at one half, green at 1.

    Parameters
    ----------
    confidences : (...) float
        In [0, 1].

    Returns
    -------
    (..., 3) uint8
    """
    c = np.clip(np.asarray(confidences, float), 0, 1)[..., None]
    below = _UNSURE + (_HALF_SURE - _UNSURE) * (2 * c)
    above = _HALF_SURE + (_SURE - _HALF_SURE) * (2 * c - 1)
    colours: NDArray[np.uint8] = np.where(c < 0.5, below, above).round().astype(np.uint8)
    return colours
