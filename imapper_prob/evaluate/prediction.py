"""An answer to a clip, in the axes of its camera, whoever gave it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.evaluate.outline import Outline, outline_of
from imapper_prob.models.posterior import State, state_camera
from imapper_prob.models.scene import Scene
from imapper_prob.results.limbs import limbs_of
from imapper_prob.results.selected import selected_objects
from imapper_prob.results.solved import Solved
from imapper_prob.results.stored_input import Source

__all__ = [
    "Prediction", "between_frames", "prediction_of_scene", "prediction_of_solved",
    "prediction_of_state",
]  # fmt: skip

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Motion and furniture that somebody claims.

    Parameters
    ----------
    name : str
        Heads its row.
    joints : (T, 16, 3) float
        In the axes of the camera (x right, y forward, z up), metres; NaN for joints and frames
        about which nothing is claimed.
    pixels : (T, 16, 2) float
        Where its own camera sees them.
    objects : tuple of Outline
    """

    name: str
    joints: Array
    pixels: Array
    objects: tuple[Outline, ...]


def between_frames(joints: ArrayLike) -> Array:
    """Frames between the first and the last that have joints, on straight lines.

    Parameters
    ----------
    joints : (T, J, 3) float
        NaN where there is nothing; each joint is taken by itself.

    Returns
    -------
    (T, J, 3) float
        Still NaN before the first and after the last frame of a joint.
    """
    filled = np.array(joints, dtype=np.float64)
    frames = np.arange(len(filled))
    for joint in range(filled.shape[1]):
        there = np.isfinite(filled[:, joint]).all(-1)
        if not there.any():
            continue
        first, last = frames[there][[0, -1]]
        gap = frames[first : last + 1]
        for axis in range(3):
            filled[gap, joint, axis] = np.interp(gap, frames[there], filled[there, joint, axis])
    return filled


def prediction_of_scene(scene: Scene, *, name: str) -> Prediction:
    """A scene turned by its own camera, which may be tilted otherwise than the true one."""
    return Prediction(
        name=name,
        joints=scene.camera.to_camera(scene.joints),
        pixels=scene.camera.project(scene.joints),
        objects=tuple(outline_of(o, scene.camera) for o in scene.objects),
    )


def prediction_of_state(source: Source, state: State, *, name: str) -> Prediction:
    """A state, with the furniture of it that is worth naming."""
    camera = state_camera(source.clip.camera, state)
    joints = limbs_of(source.problem, state, camera).joints
    objects = selected_objects(source.problem, source.library, state)
    return prediction_of_scene(Scene(camera, objects, joints, (), 0.0), name=name)


def prediction_of_solved(solved: Solved, *, name: str) -> Prediction:
    """The staged solver's best scene: everybody's furniture, and the motion of the first actor.

    Of several people in a clip the truth knows one, the first.
    """
    best = solved.scenes[0]
    scene = Scene(best.camera, best.objects, best.motions[0], (), best.log_posterior)
    return prediction_of_scene(scene, name=name)
