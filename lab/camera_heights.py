"""How well is the height of a camera estimated whose nominal height is wrong?

    python -m lab.camera_heights [CLIPS] [--seed 0]

simulates CLIPS clips (100 if not given) of 13 s as for the alarms; in a third of them people only
sit. The nominal height of the camera is wrong by 30 %, up or down. The prior of camera and body is
estimated from each clip as it is, without all detections below the knees, and from its longest
stay of at least two seconds alone, without these detections. The output is a Markdown table of
errors of the height, in three minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.load import window
from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import Settings
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.detections import own_detections
from imapper_prob.solver.solver import METHODS
from lab.alarms import shortened, simulated
from lab.spoiled.spoilings import with_legs_cut_off

WRONG: Final = 0.3
"""Error of the log of the nominal height."""
SHORTEST: Final = 2.0
"""Seconds of the shortest stay that is estimated from alone."""
SEATED_EVERY: Final = 3
CASES: Final = ("as it is", "legs cut off", "a stay alone, legs cut off")
HEAD: Final = (
    "clip", "estimates", "rms error, m", "mean error, m", "rms error over its stated deviation",
    "in 90 % intervals",
)  # fmt: skip
_LEVEL: Final = 1.645
"""Half the width of a 90 % interval in standard deviations."""


def camera_of(clip: Clip) -> CameraPrior:
    """The prior of camera and body that the program estimates."""
    settings = Settings()
    path, _ = METHODS["default"].examine(clip, settings=settings.path, detector=settings.detector)
    return estimate_camera(
        own_detections(clip, settings.detector),
        path,
        settings=settings.camera,
        detector=settings.detector,
    )


def longest_stay(clip: Clip) -> tuple[int, int] | None:
    """First and last frame of the longest stretch in which the simulated person sits."""
    truth = clip.truth
    assert truth is not None
    sits = np.array([action.startswith("sit") for action in truth.actions])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], sits, [0]]))).reshape(-1, 2)
    first, end = max(edges.tolist(), key=lambda edge: edge[1] - edge[0], default=(0, 0))
    long = end - first >= SHORTEST * clip.fps
    return (int(clip.frame_ids[first]), int(clip.frame_ids[end - 1])) if long else None


def errors(seed: int, library: Library) -> NDArray[np.float64]:
    """(3, 2) error of the height in metres and its deviation, by case; NaN without a stay."""
    rng = np.random.default_rng(seed)
    clip = simulated(rng, library, only=("sit",) if seed % SEATED_EVERY == 0 else ())
    stay, truth = longest_stay(clip), clip.truth
    assert truth is not None
    factor = np.exp(WRONG * rng.choice([-1.0, 1.0]))
    nominal = replace(clip.camera, elevation=truth.camera.elevation * factor)
    clip = replace(clip, camera=nominal)
    cut = with_legs_cut_off(clip, rng).clip
    found = np.full((len(CASES), 2), np.nan)
    for row, seen in zip(found, (clip, cut, stay and window(cut, *stay)), strict=True):
        if seen is not None:
            camera = camera_of(seen)
            row[:] = camera.mean[1] - truth.camera.elevation, np.sqrt(camera.covariance[1, 1])
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, estimate, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    library = shortened(load_library())
    seeds = range(options.seed, options.seed + options.clips)
    found = np.stack([errors(seed, library) for seed in seeds])
    rows: list[tuple[str, ...]] = [HEAD]
    for name, case in zip(CASES, found.transpose(1, 0, 2), strict=True):
        error, deviation = case[np.isfinite(case[:, 0])].T
        z = np.abs(error / deviation)
        rows.append(
            (
                name,
                str(len(error)),
                f"{np.sqrt(np.mean(error**2)):.2f}",
                f"{error.mean():+.2f}",
                f"{np.sqrt(np.mean(z**2)):.2f}",
                f"{np.mean(z < _LEVEL):.2f}",
            )
        )
    sys.stdout.write(markdown_table(rows) + "\n")


if __name__ == "__main__":
    main()
