"""Colours of objects and actions, used in recordings and figures.

Object colours are those of Tableau 10, which can be told apart on dark and light backgrounds and
with most kinds of colour blindness. Action colours go from cool to warm.
"""

from __future__ import annotations

import zlib
from typing import Final

__all__ = ["Colour", "action_colour", "category_colour"]

Colour = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""
# Colours are chosen by eye, so that neighbours in a room differ.
_CATEGORIES: Final[dict[str, Colour]] = {
    "couch": (89, 161, 159),
    "sofa": (89, 161, 159),
    "armchair": (60, 128, 140),
    "chair": (242, 142, 43),
    "stool": (225, 87, 89),
    "bench": (255, 157, 167),
    "table": (176, 122, 161),
    "desk": (140, 110, 190),
    "counter": (196, 120, 90),
    "shelf": (78, 121, 167),
    "bed": (89, 161, 79),
    "monitor": (118, 183, 178),
}
# Colours of actions, chosen likewise.
_ACTIONS: Final[dict[str, Colour]] = {
    "walk": (118, 128, 140),
    "stand": (78, 121, 167),
    "reach": (200, 90, 150),
    "pick-up": (150, 80, 170),
    "put-down": (176, 122, 90),
    "sit": (242, 142, 43),
    "sit-down": (214, 96, 60),
    "stand-up": (237, 201, 72),
    "lie": (89, 161, 79),
    "squat": (60, 128, 140),
    "kneel": (118, 183, 178),
    "bend": (140, 110, 190),
}
# Colours of names that are not listed, chosen by a digest of the name.
_OTHERS: Final[tuple[Colour, ...]] = (
    (156, 117, 95),
    (255, 157, 167),
    (186, 176, 172),
    (140, 192, 222),
)


def category_colour(label: str) -> Colour:
    """The colour of an object category; unknown categories share a few other colours.

    Parameters
    ----------
    label : str

    Returns
    -------
    (int, int, int)
    """
    return _CATEGORIES.get(label, _other(label))


def action_colour(action: str) -> Colour:
    """The colour of an action; unknown actions share a few other colours.

    Parameters
    ----------
    action : str

    Returns
    -------
    (int, int, int)
    """
    return _ACTIONS.get(action, _other(action))


def _other(word: str) -> Colour:
    # A checksum instead of hash(), which changes between runs.
    return _OTHERS[zlib.crc32(word.encode()) % len(_OTHERS)]
