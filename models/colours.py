"""Colours of objects and actions, used in recordings and figures.

Object colours are those of Tableau 10, which can be told apart on dark and light backgrounds and
with most kinds of colour blindness. Action colours go from cool to warm.
"""

from __future__ import annotations

import zlib
from typing import Final

__all__ = ["Colour", "action_colour", "category_colour", "text_colour"]

Colour = tuple[int, int, int]
"""Red, green and blue from 0 to 255."""
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


_LUMINANCE: Final = 0.05 * (21.0**0.5 - 1.0)
"""Relative luminance whose contrast ratios to white and to black are equal, 4.6 (Web Content
Accessibility Guidelines 2.2: 1.05 / (L + .05) = (L + .05) / .05); 4.5 suffices for text."""
_WEIGHTS: Final = (0.2126, 0.7152, 0.0722)
"""Share of red, green and blue light in the luminance (sRGB, IEC 61966-2-1)."""


def text_colour(label: str) -> Colour:
    """The colour of an object category for text, equally readable on black and on white.

    Colours that are too light are darkened; those that are too dark are mixed with white.

    Parameters
    ----------
    label : str

    Returns
    -------
    (int, int, int)
    """
    light = [_linear(value / 255.0) for value in category_colour(label)]
    luminance = sum(w * value for w, value in zip(_WEIGHTS, light, strict=True))
    if luminance > _LUMINANCE:
        light = [value * _LUMINANCE / luminance for value in light]
    else:
        white = (_LUMINANCE - luminance) / (1.0 - luminance)
        light = [value + white * (1.0 - value) for value in light]
    red, green, blue = (round(255.0 * _encoded(value)) for value in light)
    return red, green, blue


def _linear(value: float) -> float:
    """Light of an sRGB value, both from 0 to 1 (IEC 61966-2-1)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _encoded(light: float) -> float:
    """The inverse of :func:`_linear`."""
    return 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055


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
