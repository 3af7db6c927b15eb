"""What became of every frame before any scenelet, and where its pose comes from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

__all__ = ["FrameTable", "PoseSource"]

Array = NDArray[np.float64]


class PoseSource(StrEnum):
    """Where the pose of a frame comes from; all but the first were filled in."""

    OWN = "its own"
    MISSING = "no 3D pose"
    INTERPOLATED = "filled in by the input"
    IMPLAUSIBLE = "implausible pose"
    CONTRADICTED = "bad pose"
    ELSEWHERE = "detector elsewhere"
    FAST = "joints too fast"


@dataclass(frozen=True)
class FrameTable:
    """The static path frame by frame.

    Parameters
    ----------
    pose : (T,) tuple of PoseSource
        Whose pose a frame has, or why it is not its own.
    detected : (T,) int
        Joints with a detection.
    miss : (T,) float
        Median distance in pixels from the confident detections to the fitted person; NaN
        where no joint is confident.
    outlier : (T,) bool
        Frames most of whose confident detections are so far off that the path leaves them.
    """

    pose: tuple[PoseSource, ...]
    detected: NDArray[np.int64]
    miss: Array
    outlier: NDArray[np.bool_]

    @classmethod
    def unexamined(cls, detected: NDArray[np.int64]) -> FrameTable:
        """Of a path that was given: all poses their own, nothing known of how well they fit."""
        n = len(detected)
        return cls((PoseSource.OWN,) * n, detected, np.full(n, np.nan), np.zeros(n, dtype=bool))

    @property
    def filled(self) -> NDArray[np.bool_]:
        """(T,) frames whose pose is made from those around them."""
        return np.array([p is not PoseSource.OWN for p in self.pose], dtype=bool)

    @property
    def elsewhere(self) -> NDArray[np.bool_]:
        """(T,) frames in which the detector was not on the person."""
        return np.array([p is PoseSource.ELSEWHERE for p in self.pose], dtype=bool)

    def counts(self) -> dict[str, int]:
        """How many frames, outliers included, by what became of them."""
        found = {str(source): self.pose.count(source) for source in PoseSource}
        found["outlier"] = int(self.outlier.sum())
        found["nothing detected"] = int((self.detected == 0).sum())
        return found
