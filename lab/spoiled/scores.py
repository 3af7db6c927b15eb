"""One i3DB scene, spoiled in one way: its errors and coverage, for `lab.spoiled`.

The constants are those estimated without the scene.

Results for a spoiled clip are interpolated linearly to the times of the annotated frames, and
compared with the truth of the original clip.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from imapper_prob.api import sample
from imapper_prob.clips.load import load_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.claims import Draws, draws_of
from imapper_prob.evaluate.i3db import read_truth_in_view
from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.evaluate.regions import coverage, joint_ranks
from imapper_prob.evaluate.score import SUBSETS, pose_scores, score, static_path, summarise
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.files import written_whole
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.actors import solve_actors
from lab.spoiled.spoilings import SPOILINGS, Spoiled
from lab.stored import with_steps

__all__ = ["UNSPOILED", "Task", "at_times", "score_task", "spoil"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

UNSPOILED: Final = "unspoiled"
"""Name of the unspoiled case."""
_RATE: Final = 10.0
"""Frames a second of i3DB's clips and annotations."""


@dataclass(frozen=True)
class Task:
    """What is to be scored, and the file of the result.

    Parameters
    ----------
    scene : Path
        Folder of an i3DB scene with its ``gt/``.
    spoiling : str
        Name of the spoiling, or :data:`UNSPOILED`.
    steps : int, optional
        Steps of each chain; if not given, only the static path is scored.
    seed : int
        Seed of the spoilings.
    path : Path
        File of the result.
    """

    scene: Path
    spoiling: str
    steps: int | None
    seed: int
    path: Path


def spoil(clip: Clip, name: str, seed: int) -> Spoiled:
    """Apply the named spoiling to a clip; random numbers depend on both names and the seed."""
    if name == UNSPOILED:
        return Spoiled(clip, np.zeros(clip.n_frames, bool))
    found = next(s for s in SPOILINGS if s.name == name)
    words = (clip.name, name)
    return found.apply(clip, np.random.default_rng([seed, *(crc32(w.encode()) for w in words)]))


def score_task(task: Task) -> None:
    """Score one spoiling of one scene and write the result atomically."""
    clip = load_clip(task.scene)
    truth = read_truth_in_view(task.scene, clip)
    spoiled = spoil(clip, task.spoiling, task.seed)
    affected = _nearest(spoiled, clip)
    begun = time.perf_counter()
    document: dict[str, Any] = {
        "scene": task.scene.name,
        "spoiling": task.spoiling,
        "affected": affected[truth.known].tolist(),
    }
    if task.steps is None:
        document["static"] = errors(static_path(spoiled.clip), spoiled.clip, truth)
    else:
        document |= _sampled(spoiled.clip, truth, affected, task.steps)
    document["seconds"] = round(time.perf_counter() - begun, 1)
    with written_whole(task.path) as beside:
        beside.write_text(json.dumps(document), encoding="utf-8")


def _sampled(clip: Clip, truth: TruthInView, affected: Flags, steps: int) -> dict[str, Any]:
    """Scores of static path and scene of least expected loss, its furniture, and coverage."""
    config = Config(sample=settings(steps)).without(clip.name)
    library = load_library(config.library)
    (solution,) = solve_actors(clip, library, settings=config.settings)
    posterior = sample(clip, library, start=solution, config=config)
    joints = solution.path.joints
    path = Prediction("static path", joints, clip.camera.project_camera(joints), ())
    answer = prediction_of_scene(posterior.estimate, name="answer")
    draws = draws_of(posterior)
    draws = replace(
        draws,
        joints=at_times(len(truth.joints), clip, draws.joints, axis=1),
        pixels=at_times(len(truth.joints), clip, draws.pixels, axis=1),
    )
    furniture = summarise([score(_brought_back(answer, clip, truth), truth)])
    return {
        "static": errors(path, clip, truth),
        "answer": errors(answer, clip, truth),
        "regions": {
            "all": _shares(draws, truth),
            "hidden": _shares(draws, truth, hidden=True),
            "affected": _shares(draws, _only(truth, affected)),
        },
        "objects": {
            "error": furniture.error,
            "loss": furniture.loss,
            "found": furniture.found,
            "true": furniture.true,
            "spurious": furniture.spurious,
        },
    }


def settings(steps: int) -> SampleSettings:
    """The default settings with fewer steps, and without ensembles, which are not scored."""
    return replace(with_steps(steps).sample, ensemble_steps=0)


def errors(prediction: Prediction, clip: Clip, truth: TruthInView) -> dict[str, Any]:
    """World cm, local cm and pixels by subset, each frame's mean squared world error in cm², depth.

    The depth is that of the pelvis: mean and standard deviation of the log of estimated over true.
    """
    prediction = _brought_back(prediction, clip, truth)
    scores = pose_scores(prediction, truth)
    depth = np.log(prediction.joints[:, PELV, 1] / truth.joints[:, PELV, 1])[truth.known]
    gap = 100 * (prediction.joints - truth.joints)[truth.known][:, list(SCORED)]
    return {
        **{n: [scores[n].world, scores[n].local, scores[n].pixels] for n in SUBSETS},
        "squares": np.round((gap**2).sum(-1).mean(-1), 2).tolist(),
        "depth": [float(depth.mean()), float(depth.std())],
    }


def at_times(count: int, clip: Clip, values: Array, *, axis: int = 0) -> Array:
    """Interpolate values at a clip's frames to the times of the annotated frames.

    Parameters
    ----------
    count : int
        Number of frames of the truth, the first of which is the clip's first; after the clip's last
        frame its last values are used.
    clip : Clip
        Its frame rate may differ.
    values : array
        Has the clip's frames along ``axis``.
    """
    where = _where(clip, count)
    first = np.floor(where).astype(int)
    second = np.minimum(first + 1, clip.n_frames - 1)
    shape = [1] * values.ndim
    shape[axis] = len(where)
    weight = (where - first).reshape(shape)
    result: Array = (1 - weight) * values.take(first, axis) + weight * values.take(second, axis)
    return result


def _where(clip: Clip, count: int) -> Array:
    """(count,) fractional frames of the clip at the times of as many frames of the truth."""
    return np.minimum(np.round(np.arange(count) * clip.fps / _RATE, 9), clip.n_frames - 1)


def _brought_back(prediction: Prediction, clip: Clip, truth: TruthInView) -> Prediction:
    return replace(
        prediction,
        joints=at_times(len(truth.joints), clip, prediction.joints),
        pixels=at_times(len(truth.joints), clip, prediction.pixels),
    )


def _nearest(spoiled: Spoiled, clip: Clip) -> Flags:
    """(T,) whether the nearest frame of the spoiled clip is affected, by frame of the clip."""
    nearest = np.round(_where(spoiled.clip, clip.n_frames)).astype(int)
    flags: Flags = spoiled.affected[nearest]
    return flags


def _only(truth: TruthInView, frames: Flags) -> TruthInView:
    """The truth restricted to some frames."""
    return replace(truth, joints=np.where(frames[:, None, None], truth.joints, np.nan))


def _shares(draws: Draws, truth: TruthInView, *, hidden: bool = False) -> list[float]:
    """Coverage of scored joints by regions of 50 and 90 %."""
    return [c.share for c in coverage([joint_ranks(draws, truth, hidden=hidden)])]
