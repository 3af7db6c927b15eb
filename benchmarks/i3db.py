"""Static path and found furniture of i3DB scenes against their truth.

``python benchmarks/i3db.py I3DB_FOLDER [RUNS_FOLDER]``: for each scene the root mean square
error of the static path over annotated frames, in camera axes; with RUNS_FOLDER, which holds a
run folder of the scene's name, also the distances of the most probable layout's objects.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from imapper_prob.inputs.i3db import read_i3db, read_i3db_truth
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.results.export import read_scenes
from imapper_prob.results.summary import distances_to_truth
from imapper_prob.staged.static_path import estimate_static_path


def main() -> None:
    """Print two lines a scene at most, and the mean of the path errors."""
    scenes = sorted(p for p in Path(sys.argv[1]).iterdir() if (p / "gt").is_dir())
    errors = []
    for scene in scenes:
        clip = read_i3db(scene)
        truth = read_i3db_truth(scene, clip)
        known = np.isfinite(truth.joints).all((1, 2))
        gap = truth.camera.to_camera(truth.joints[known])
        gap = 100 * (gap - estimate_static_path(clip).joints[known])
        pelvis = np.sqrt((gap[:, PELV, :2] ** 2).sum(-1).mean())
        joints = np.sqrt((gap[:, list(SCORED)] ** 2).sum(-1).mean())
        errors.append((pelvis, joints))
        sys.stdout.write(f"{scene.name}: pelvis {pelvis:.1f} cm, joints {joints:.1f} cm\n")
        if len(sys.argv) > 2:
            best = read_scenes(Path(sys.argv[2]) / scene.name / "scenes.json")[0]
            found = best.scene.objects
            distances = 100 * distances_to_truth(found, truth.objects)
            told = (f"{o.label} {d:.0f} cm" for o, d in zip(found, distances, strict=True))
            sys.stdout.write(f"  p = {best.probability:.2f}: {', '.join(told)}\n")
    pelvis, joints = np.mean(errors, axis=0)
    sys.stdout.write(f"mean: pelvis {pelvis:.1f} cm, joints {joints:.1f} cm\n")


if __name__ == "__main__":
    main()
