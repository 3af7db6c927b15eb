"""Constants that are not what was measured, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

__all__ = ["KEPT"]

KEPT: Final[Mapping[str, tuple[float, str]]] = {
    "swaps.length": (
        1.0,
        "three single frames are no measure of runs; of MediaPipe on somebody turning they "
        "lasted seconds",
    ),
    "camera.pitch": (
        round(float(np.deg2rad(3.0)), 4),
        "four cameras say nothing sure: without Scene10 they would all but agree; 3 degrees are "
        "what the four say, rounded up",
    ),
    "walk.bone": (
        0.06,
        "steps of bones are far from normal: with the measured value the path's pelvis is off "
        "by 35 cm instead of 31 in the mean of the four",
    ),
    "camera.log_elevation": (
        0.5,
        "the four heights are those of one team's tripod; from a camera on a table to one "
        "above a door",
    ),
    "furniture.aside": (
        0.2,
        "the measurement holds the truth's own error, and pieces mistaken for their neighbours; "
        "about the middle of the seat that one is on, pelvises of the same clips spread by .19 m",
    ),
    "furniture.ahead": (
        0.2,
        "the measurement holds the truth's own error, and pieces mistaken for their neighbours; "
        "about the middle of the seat that one is on, pelvises of the same clips spread by .15 m",
    ),
    "scenelet.log_size": (
        0.0766,
        "what the hundred best fits of a window say: the benchmark was measured with it, and it is "
        "a sixth of a standard error away",
    ),
    "body.log_scale": (
        0.05,
        "four clips hold too few people; adults of both sexes spread by .05 to .06",
    ),
}
"""Values that are used in place of the estimate, and why."""
