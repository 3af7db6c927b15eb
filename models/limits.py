"""Where the model stops: bounds and tolerances that every executor shares."""

from __future__ import annotations

from typing import Final

__all__ = ["LEVEL", "LOWEST_CAMERA", "NEAREST", "NEAR_SIGHT", "STEEPEST_CAMERA"]

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
