"""How many skeletons of two people who walk past each other are given to the right one?

    python -m lab.crossings [CROSSINGS]

simulates so many crossings for each share of missing skeletons and each frame rate, 50 if not
given, as a detector that misses some would see them, and prints a line for each.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.tracking import associate
from imapper_prob.models.camera import Camera
from imapper_prob.models.skeleton import N_JOINTS, PELV
from imapper_prob.scenelets.library import built_in_library

__all__ = ["simulate_crossing"]


Array = NDArray[np.float64]

CAMERA = Camera(1280, 720, 1280, 1280, 640, 360, pitch=-0.1, elevation=1.5)
_SPEED = 1.2  # metres a second
_PIXELS = 6.0  # standard deviation of a detection


@dataclass(frozen=True)
class Crossing:
    """Skeletons in random order, and their true identities."""

    frames: NDArray[np.int64]
    keypoints: Array
    confidences: Array
    truth: NDArray[np.int64]


def simulate_crossing(
    rng: np.random.Generator, *, missing: float, fps: float, n_frames: int = 120
) -> Crossing:
    """Simulate two walkers who cross in the middle of the image, .3 to 1 m apart in depth.

    Parameters
    ----------
    rng : Generator
    missing : float
        Fraction of the skeletons that the detector misses.
    fps : float
    n_frames : int
    """
    depth = rng.uniform(3, 5)
    way = min(_SPEED * n_frames / fps, 4.0) / 2
    walkers = [
        _walker(rng, n_frames, fps, depth, -way, way),
        _walker(rng, n_frames, fps, depth + rng.uniform(0.3, 1.0), way, -way),
    ]
    rows = []
    for t in range(n_frames):
        for who in rng.permutation(2):
            if rng.random() >= missing:
                pixels = CAMERA.project(walkers[who][t]) + rng.normal(0, _PIXELS, (N_JOINTS, 2))
                confidences = rng.uniform(0.5, 1, N_JOINTS) * (rng.random(N_JOINTS) > 0.1)
                rows.append((t, pixels, confidences, who))
    return Crossing(*(np.array(column) for column in zip(*rows, strict=True)))


def _walker(
    rng: np.random.Generator, n_frames: int, fps: float, y: float, start: float, end: float
) -> Array:
    """(T, 16, 3) a stride of the library, forwards and backwards, moved along a line."""
    strides = [s.joints for s in built_in_library() if s.action == "walk"]
    stride = strides[rng.integers(len(strides))]
    stride = stride - stride[:, PELV, None] * (1, 1, 0)
    last = len(stride) - 1
    at = np.abs(np.arange(n_frames) * 10 / fps % (2 * last) - last)
    low = np.clip(at.astype(int), 0, last - 1)
    part = (at - low)[:, None, None]
    joints: Array = (1 - part) * stride[low] + part * stride[low + 1]
    if end > start:
        joints = joints[..., [1, 0, 2]] * (1, -1, 1)
    else:
        joints = joints[..., [1, 0, 2]] * (-1, 1, 1)
    joints += np.stack(
        [np.linspace(start, end, n_frames), np.full(n_frames, y), np.zeros(n_frames)], -1
    )[:, None]
    return joints


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each share of missing skeletons and each frame rate."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("crossings", type=int, nargs="?", default=50, help="of each kind")
    crossings = parser.parse_args(arguments).crossings
    for missing in (0.0, 0.2, 0.4):
        for fps in (10.0, 30.0):
            right = total = swapped = 0
            start = time.process_time()
            for seed in range(crossings):
                crossing = simulate_crossing(np.random.default_rng(seed), missing=missing, fps=fps)
                rows = associate(
                    crossing.frames, crossing.keypoints, crossing.confidences, people=2
                )
                found = np.full(len(crossing.frames), -1)
                for actor, own in enumerate(rows):
                    found[own] = actor
                best = max((found == crossing.truth).sum(), (found == 1 - crossing.truth).sum())
                right, total = right + best, total + len(found)
                swapped += bool(best < 0.9 * len(found))
            seconds = (time.process_time() - start) / crossings
            sys.stdout.write(
                f"{missing:.0%} missing, {fps:.0f} a second: {right / total:.2%} of {total} "
                f"skeletons right, {swapped} of {crossings} exchanged, {seconds:.2f} s each\n"
            )


if __name__ == "__main__":
    main()
