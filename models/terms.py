"""The summands of the log-posterior, by name and by number (``docs/model.md``, 3)."""

from __future__ import annotations

from typing import Final

__all__ = [
    "CAMERA", "COLLISION", "DETECTIONS", "FREE_POSE", "GROUND", "LAYOUT", "MOTION", "PATH",
    "PLACEMENT", "SMOOTHNESS", "SUPPORT", "TERMS",
]  # fmt: skip

TERMS: Final = (
    "camera", "layout", "placement", "path", "detections", "free_pose", "smoothness", "collision",
    "motion", "ground", "support",
)  # fmt: skip
"""In the order in which they are evaluated."""

(
    CAMERA, LAYOUT, PLACEMENT, PATH, DETECTIONS, FREE_POSE, SMOOTHNESS, COLLISION, MOTION, GROUND,
    SUPPORT,
) = range(len(TERMS))  # fmt: skip
