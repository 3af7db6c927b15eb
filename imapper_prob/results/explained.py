"""What a scene explains of what was seen: frames, and joints that the detector lost."""

from __future__ import annotations

from typing import Final

import numpy as np

from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.people import everybody
from imapper_prob.results.scenes import Explains

__all__ = ["SURE", "explained_by"]

SURE: Final = 0.5
"""Confidence from which a detector counts as sure of a joint. On i3DB 28 to 84 % of hidden
joints are below it."""


def explained_by(clip: Clip, problem: Problem, scene: Scene, state: State) -> Explains:
    """What the furniture and the scenelets of a scene account for.

    A joint is behind furniture where the line of sight from the camera to it meets a box.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        Its log-posterior, for the length of scenelets.
    scene : Scene
    state : State
        The draw that the scene shows.
    """
    ids, last = np.tile(clip.frame_ids, len(clip.tracks)), problem.n_frames - 1
    lengths = problem.lengths[state.items[:, 0]]
    spans = tuple(
        (int(ids[start]), int(ids[min(start + length - 1, last)]))
        for start, length in zip(state.items[:, 1].tolist(), lengths.tolist(), strict=True)
    )
    detected = list(DETECTED)
    boxes = pack_boxes(scene.objects)
    behind = sight_clearance(scene.camera.centre, scene.joints[:, detected], boxes) < 0
    sure = everybody(clip).confidences[:, detected] >= SURE
    return Explains(
        frames=spans,
        n_frames=problem.n_frames,
        unsure=int(np.sum(~sure)),
        unsure_behind=int(np.sum(~sure & behind)),
        sure_behind=int(np.sum(sure & behind)),
    )
