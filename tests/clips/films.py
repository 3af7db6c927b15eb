"""Short films of a made-up room: textured walls, a dark figure that walks, and the camera."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from imapper_prob.clips.keypoints import KEYPOINT_SETS
from imapper_prob.clips.mediapipe import Landmarks
from tests.clips.bodies import body

Image = NDArray[np.uint8]
SIZE = (320, 240)
NAMES = KEYPOINT_SETS["mediapipe_33"]


def dark_figure(frame: int, image: NDArray[np.uint8]) -> Landmarks | None:
    """All landmarks about the middle of what is dark."""
    dark = np.argwhere(image.mean(-1) < 45)
    if len(dark) < 200 or frame == 3:
        return None
    y, x = dark.mean(0)
    height, width = image.shape[:2]
    points = (body(NAMES, at=(0, 0)) * 0.4 + (x, y)) / (width, height)
    return Landmarks(frame, points, np.full(33, 0.95), body(NAMES, at=(0, 0))[:, [0, 1, 1]] / 200)


def room(seed: int = 0) -> Image:
    """(240, 640, 3) a wall with more of it than a camera sees at once."""
    rng = np.random.default_rng(seed)
    rough = gaussian_filter(rng.normal(size=(SIZE[1], 2 * SIZE[0])), 3)
    grey = np.clip(128 + 300 * rough, 0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def film(
    n_frames: int = 40, *, left: Callable[[int], int] = lambda t: 60, seed: int = 0
) -> list[Image]:
    """Frames of a camera whose left edge is at column ``left(t)`` of the room."""
    wall = room(seed)
    frames = []
    for t in range(n_frames):
        image = wall[:, left(t) : left(t) + SIZE[0]].copy()
        x = 40 + 200 * t // n_frames
        image[60:230, x : x + 50] = 20
        frames.append(image)
    return frames


def write_film(
    path: Path, frames: list[Image], *, fps: int = 20, metadata: dict[str, str] | None = None
) -> Path:
    """Encode with PyAV; the test is skipped where that is not installed."""
    av = pytest.importorskip("av", reason="the extra `video` is not installed")
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream("mpeg4", rate=fps)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.bit_rate = 4_000_000
        for image in frames:
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
