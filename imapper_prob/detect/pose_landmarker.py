"""MediaPipe's pose detector, with the weights that lie in its wheel; one person a frame."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from imapper_prob.detect.video import needs
from imapper_prob.inputs.mediapipe_landmarks import Landmarks

__all__ = ["Detector", "pose_landmarker"]


class Detector(Protocol):
    """Whatever finds somebody in an image."""

    def __call__(self, frame: int, image: NDArray[np.uint8]) -> Landmarks | None:
        """The person in an (H, W, 3) RGB image, if there is one."""


@contextmanager
def pose_landmarker() -> Iterator[Detector]:
    """A detector that follows the person from frame to frame.

    Raises
    ------
    InputError
        MediaPipe is not installed.
    """
    os.environ.setdefault("GLOG_minloglevel", "2")  # its own reports on threads and delegates
    solution = needs("mediapipe").solutions.pose.Pose(
        static_image_mode=False,
        model_complexity=1,  # the one whose weights are in the wheel
        smooth_landmarks=True,
    )

    def detect(frame: int, image: NDArray[np.uint8]) -> Landmarks | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its messages to protobuf are old-fashioned
            found = solution.process(image)
        if found.pose_landmarks is None:
            return None
        image_points = found.pose_landmarks.landmark
        return Landmarks(
            frame=frame,
            image=np.array([[p.x, p.y] for p in image_points]),
            visibility=np.array([p.visibility for p in image_points]),
            world=_world(found.pose_world_landmarks),
        )

    with solution:
        yield detect


def _world(found: Any) -> NDArray[np.float64] | None:
    return None if found is None else np.array([[p.x, p.y, p.z] for p in found.landmark])
