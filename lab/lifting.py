"""How good are poses lifted from 2D joints alone, beside those of a trained lifter?

    python -m lab.lifting I3DB_FOLDER

prints for each scene the root mean square error of the 14 scored joints about the middle of the
hips, for the benchmark's own lifter and for this program's. It then prints the error of the pelvis
in top view that the static path has with either. It takes some twenty seconds for the four scenes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.evaluate.score import scenes_with_truth
from imapper_prob.lifting import lift_clip
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import LHIP, PELV, RHIP, SCORED
from imapper_prob.solver.static_path import estimate_static_path

Array = NDArray[np.float64]


def pose_error(poses: Array, truth: Array) -> float:
    """Root mean square error of scored joints relative to the middle of the hips, cm."""
    one, other = (p - (p[:, RHIP, None] + p[:, LHIP, None]) / 2 for p in (poses, truth))
    squared = ((one - other)[:, list(SCORED)] ** 2).sum(-1)
    return float(100 * np.sqrt(np.nanmean(squared)))


def path_error(clip: Clip, truth: Array) -> float:
    """Root mean square error of the static path's pelvis in top view, cm."""
    gap = estimate_static_path(clip).pelvis - truth[:, PELV]
    return float(100 * np.sqrt(np.nanmean((gap[:, :2] ** 2).sum(-1))))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one line for each scene, and the means."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of i3DB scenes with their truth")
    options = parser.parse_args(arguments)
    rows = []
    for scene in scenes_with_truth(options.scenes):
        clip = read_i3db(scene)
        known = read_i3db_truth(scene, clip)
        truth = known.camera.to_camera(known.joints)
        track = clip.tracks[0]
        flat = replace(clip, tracks=(replace(track, poses=np.full_like(track.poses, np.nan)),))
        lifted = lift_clip(flat)
        rows.append(
            [
                pose_error(track.poses, truth),
                pose_error(lifted.tracks[0].poses, truth),
                path_error(clip, truth),
                path_error(lifted, truth),
            ]
        )
        sys.stdout.write(f"{scene.name}: " + _line(rows[-1]))
    sys.stdout.write("mean: " + _line(list(np.mean(rows, axis=0))))


def _line(row: list[float]) -> str:
    return (
        f"poses {row[0]:.1f} and {row[1]:.1f} cm, pelvis of the static path {row[2]:.1f} and "
        f"{row[3]:.1f} cm (trained lifter, ours)\n"
    )


if __name__ == "__main__":
    main()
