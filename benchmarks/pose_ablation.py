"""What each part of the static path brings to where its joints are.

``python benchmarks/pose_ablation.py I3DB_FOLDER`` fits the static path of every scene as the
solver does, then with one part at a time switched off, and prints a markdown table: root mean
square errors in camera axes over annotated frames, the mean over scenes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from imapper_prob.evaluate.pose import SUBSETS, pose_scores
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.scenes import known_scene, scenes_with_truth
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.path import StaticPath
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import CameraSettings, StaticPathSettings
from imapper_prob.models.skeleton import BONE_LENGTHS, PELV
from imapper_prob.staged.calibration import estimate_camera
from imapper_prob.staged.static_path import estimate_static_path

Variant = Callable[[Clip], Prediction]

_NOTHING = 1e3
"""Times its unit: the deviation of what is no longer held."""
_EXACTLY = 1e-3
"""Radians, or log metres: the deviation of what is taken for known."""


def reference_body(
    clip: Clip, *, settings: StaticPathSettings | None = None, scale: float = 1.0
) -> Prediction:
    """The static path of a body of 1.70 m, or of ``scale`` times that; feet are not asked."""
    return _prediction(clip, estimate_static_path(clip, settings=settings), scale, 1.0)


def with_feet(clip: Clip, *, settings: CameraSettings | None = None) -> Prediction:
    """The static path at the body scale and focal length that its feet ask for."""
    path = estimate_static_path(clip)
    _, _, log_focal, log_body, _ = estimate_camera(clip, path, settings=settings).mean
    return _prediction(clip, path, float(np.exp(log_body)), float(np.exp(log_focal)))


def lifters_body(clip: Clip) -> Prediction:
    """The static path of a body as large as the lifter has it."""
    person = clip.tracks[0]
    poses = person.poses[person.has_pose]
    legs = [(p, c) for p, c in BONE_LENGTHS if PELV not in (p, c)][:4]
    lifted = sum(np.median(np.linalg.norm(poses[:, p] - poses[:, c], axis=-1)) for p, c in legs)
    return reference_body(clip, scale=float(lifted / sum(BONE_LENGTHS[bone] for bone in legs)))


def _prediction(clip: Clip, path: StaticPath, scale: float, focal: float) -> Prediction:
    """A path carried along to another body and focal length: pixels stay as they are."""
    joints = scale * path.joints * (1.0, focal, 1.0)
    return Prediction("static path", joints, clip.camera.project_camera(path.joints), ())


def variants() -> dict[str, Variant]:
    """The static path as the solver uses it, then with one part at a time switched off."""
    path, camera = StaticPathSettings(), CameraSettings()

    def changed(**values: float) -> Variant:
        return partial(reference_body, settings=replace(path, **values))

    return {
        "static path": reference_body,
        "body scale: the lifter's": lifters_body,
        "no prior on bone lengths": changed(length_tolerance=_NOTHING),
        "no smoothing of log depth": changed(walk_log_depth=_NOTHING),
        "no smoothing at all": changed(
            walk_log_depth=_NOTHING, walk_bearing=_NOTHING, walk_bone=_NOTHING
        ),
        "squared pixel errors": changed(dof=_NOTHING),
        "frames independent": changed(correlation_time=0.1),
        "with the floor under the feet": with_feet,
        "the same, pitch known": partial(with_feet, settings=replace(camera, pitch=_EXACTLY)),
        "the same, pitch unknown": partial(with_feet, settings=replace(camera, pitch=_NOTHING)),
    }


def errors(prediction: Prediction, truth: TruthInView) -> tuple[float, ...]:
    """Centimetres: pelvis in top view, joints in the world by subset, joints about the pelvis."""
    gap = prediction.joints[truth.known, PELV, :2] - truth.joints[truth.known, PELV, :2]
    pelvis = 100 * float(np.sqrt((gap**2).sum(-1).mean()))
    scores = pose_scores(prediction, truth)
    return (pelvis, *(scores[name].world for name in SUBSETS), scores[SUBSETS[0]].local)


def main() -> None:
    """Print a row a variant."""
    known = [known_scene(scene) for scene in scenes_with_truth(sys.argv[1])]
    out = sys.stdout.write
    out("| | pelvis, top view | joints, all frames | occluded joints | occ3 | about the pelvis |\n")
    out("|---|---:|---:|---:|---:|---:|\n")
    for name, variant in variants().items():
        found = np.array([errors(variant(scene.clip), scene.truth) for scene in known])
        cells = " | ".join(f"{value:.1f}" for value in found.mean(0))
        out(f"| {name} | {cells} |\n")


if __name__ == "__main__":
    main()
