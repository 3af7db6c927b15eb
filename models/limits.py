"""Where the model stops: bounds and tolerances that every executor shares."""

from __future__ import annotations

from typing import Final

__all__ = [
    "FARTHEST_KEYPOINT", "HIGHEST_CAMERA", "LARGEST_IMAGE", "LEVEL", "LONGEST_CLIP",
    "LONGEST_FOCAL", "LOWEST_CAMERA", "MOST_PEOPLE", "NEAREST", "NEAR_SIGHT", "QUICKEST_FILM",
    "SHORTEST_FOCAL", "SLOWEST_FILM", "STEEPEST_CAMERA",
]  # fmt: skip

NEAREST: Final = 0.1
"""Metres; depth at which a point counts that is nearer to the camera or behind it."""

NEAR_SIGHT: Final = 0.05
"""Metres; nearer to the camera than this, bearing and slope of a line of sight say nothing."""

LEVEL: Final = 0.02
"""Metres two things may overlap in height before they count as being level."""

LOWEST_CAMERA: Final = 0.2
"""Metres above the floor: the support of the camera's elevation begins here."""

STEEPEST_CAMERA: Final = 1.0
"""Radians of pitch or roll either way: the support of the camera's pose ends here."""

HIGHEST_CAMERA: Final = 100.0
"""Metres above the floor: people are a few pixels high from there."""

LARGEST_IMAGE: Final = 65_536
"""Pixels a side: sixteen times that of the largest films."""

SHORTEST_FOCAL: Final = 0.005
LONGEST_FOCAL: Final = 100.0
"""Longer sides of the image: fields of view of 179 degrees, and of half a degree."""

FARTHEST_KEYPOINT: Final = 1e4
"""Longer sides of the image from its corner: detectors place joints a little outside of it, and
draws of the detection model, whose tails have two degrees of freedom, some hundred of them away."""

SLOWEST_FILM: Final = 0.1
QUICKEST_FILM: Final = 1_000.0
"""Frames a second: one in ten seconds, and what laboratories film people with."""

LONGEST_CLIP: Final = 36_000
"""Frames: an hour at ten a second. A longer clip is a damaged frame number."""

MOST_PEOPLE: Final = 64
"""In one clip: a crowd."""
