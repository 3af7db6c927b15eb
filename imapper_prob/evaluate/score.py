"""Scores of one prediction against one truth: joints, objects, baselines, paired differences.

:func:`score` computes all scores of a prediction on a clip, :func:`summarise` a table row over
several clips, and :func:`paired_difference` compares two methods object by object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.i3db import DETECTIONS
from imapper_prob.clips.load import load_clip
from imapper_prob.evaluate.i3db import read_authors, read_input_path, read_truth_in_view
from imapper_prob.evaluate.objects import ObjectScore, object_scores
from imapper_prob.evaluate.prediction import Prediction, of_people
from imapper_prob.evaluate.truth import Outline, TruthInView, box_corners, segments, truth_in_view
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import Settings
from imapper_prob.models.skeleton import LHIP, PELV, RHIP, SCORED
from imapper_prob.scenelets.captures import i3db_folders
from imapper_prob.solver.static_path import estimate_static_path

__all__ = [
    "SUBSETS",
    "Difference",
    "KnownScene",
    "Score",
    "Summary",
    "known_clip",
    "known_scene",
    "paired_difference",
    "pose_scores",
    "scenes_with_truth",
    "score",
    "static_path",
    "summarise",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
SUBSETS: Final = ("all frames", "occluded joints", "occ3")
"""All annotated frames; only joints hidden by furniture; all joints of frames in which at least
three of the sixteen are hidden, which the paper's table 2 scores."""
_MANY_HIDDEN: Final = 3
"""Least number of hidden joints in a frame of the third subset, as in the paper's table 2."""


@dataclass(frozen=True)
class PoseScore:
    """Root mean square errors over joints and frames.

    Parameters
    ----------
    world : float
        In camera axes, cm.
    local : float
        Relative to the pelvis, cm.
    pixels : float
        In the image, pixels.
    joints : int
        Number of scored joints over all frames. If it is 0, the errors are NaN.
    left_out : int
        Number of annotated joints that the prediction lacks.
    """

    world: float
    local: float
    pixels: float
    joints: int
    left_out: int


def pose_scores(prediction: Prediction, truth: TruthInView) -> dict[str, PoseScore]:
    """Errors of the fourteen scored joints of all people in the truth, by :data:`SUBSETS`.

    Parameters
    ----------
    prediction : Prediction
    truth : TruthInView

    Returns
    -------
    dict of str to PoseScore

    Raises
    ------
    InputError
        The rows of the prediction are not the frames of the clip for each person.
    """
    frames = len(truth.frame_ids)
    people = len(truth.joints) // frames
    prediction = of_people(prediction, people, frames=frames, clip=truth.name)
    scored = list(SCORED)
    known = np.repeat(truth.known[:, None], len(scored), 1)
    hidden = truth.hidden[:, scored]
    many = (truth.hidden.sum(1) >= _MANY_HIDDEN)[:, None]
    squares = [
        ((a - b) ** 2).sum(-1)[:, scored]
        for a, b in (
            (prediction.joints, truth.joints),
            (_about_pelvis(prediction.joints), _about_pelvis(truth.joints)),
            (prediction.pixels, truth.pixels),
        )
    ]
    subsets = (known, known & hidden, known & many)
    return {name: _score(squares, s) for name, s in zip(SUBSETS, subsets, strict=True)}


def _about_pelvis(joints: Array) -> Array:
    """Joints relative to the pelvis, or to the middle of the hips if the pelvis is missing."""
    pelvis = joints[:, PELV]
    middle = joints[:, (RHIP, LHIP)].mean(1)
    return joints - np.where(np.isfinite(pelvis), pelvis, middle)[:, None]


def _score(squares: list[Array], wanted: Flags) -> PoseScore:
    there = wanted & np.isfinite(squares[0])
    world, local, pixels = (_root_mean(s[wanted & np.isfinite(s)]) for s in squares)
    count = int(there.sum())
    return PoseScore(100 * world, 100 * local, pixels, count, int(wanted.sum()) - count)


def _root_mean(squares: Array) -> float:
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")


# ------------------------------------------------------------------------------------------------
# Paired differences.

_RESAMPLES: Final = 4000
"""Bootstraps of a difference; its 5 % quantile has a level of 5 ± .3 %."""
_INTERVAL: Final = (0.05, 0.95)
"""Quantiles of the bootstrap that bound the 90 % interval."""


@dataclass(frozen=True)
class Difference:
    """Difference of one method minus another, over the same true objects.

    Parameters
    ----------
    name, other : str
        Names of the methods.
    mean : float
        Mean difference of losses, cm; negative if the first method is better.
    low, high : float
        Bootstrap interval of 90 % over objects.
    objects : int
        Number of true objects.
    """

    name: str
    other: str
    mean: float
    low: float
    high: float
    objects: int


def paired_difference(
    ours: Sequence[Score], theirs: Sequence[Score], rng: np.random.Generator
) -> Difference:
    """Mean difference of losses between two methods on the same clips.

    Losses are those of :attr:`imapper_prob.evaluate.objects.ObjectScore.losses`.

    The bootstrap draws whole objects with replacement. It ignores that objects of one clip share a
    camera, so the intervals tend to be too short.

    Parameters
    ----------
    ours, theirs : sequence of Score
        Scores on the same clips.
    rng : numpy.random.Generator

    Returns
    -------
    Difference
    """
    both = {s.clip: s for s in theirs}
    pairs = [(s, both[s.clip]) for s in ours if s.clip in both]
    gaps = [a.objects.losses - b.objects.losses for a, b in pairs]
    gap = 100 * np.concatenate([np.empty(0), *gaps])
    if not len(gap):
        nothing = float("nan")
        return Difference(ours[0].name, theirs[0].name, nothing, nothing, nothing, 0)
    means = rng.choice(gap, (_RESAMPLES, len(gap))).mean(1)
    low, high = np.quantile(means, _INTERVAL)
    return Difference(
        ours[0].name, theirs[0].name, float(gap.mean()), float(low), float(high), len(gap)
    )


# ------------------------------------------------------------------------------------------------
# Baselines.

_COUCH: Final = (2.4, 0.8, 0.45)
"""Width, depth and height in metres of a typical couch in i3DB."""


def _couch_where_sat(path: Prediction, truth: TruthInView) -> Prediction:
    """A baseline that puts a couch around the median pelvis of each sitting, facing as the hips do.

    Parameters
    ----------
    path : Prediction
        Its joints are used and kept; its furniture is not.
    truth : TruthInView
        Gives the intervals of sitting, which the other methods do not get.
    """
    couches = []
    for action, frames in segments(truth.actions, len(truth.frame_ids)):
        body = path.joints[frames]
        body = body[np.isfinite(body).all((1, 2))]
        if action == "sitting" and len(body):
            sideways = np.median(body[:, RHIP] - body[:, LHIP], axis=0) * (1, 1, 0)
            couches.append(_couch(np.median(body[:, PELV], axis=0), sideways))
    return replace(path, name=f"couch on {path.name}", objects=tuple(couches))


def static_path(clip: Clip) -> Prediction:
    """Baseline: the smooth paths through the detections that the solver starts from, no furniture.

    The constants are estimated without the scene of that name.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Prediction
    """
    settings = Settings().without(clip.name).path
    people = [replace(clip, tracks=(track,)) for track in clip.tracks]
    joints = np.concatenate(
        [estimate_static_path(person, settings=settings).joints for person in people]
    )
    pixels = clip.camera.project_camera(joints)
    return Prediction("static path", joints, pixels, (), people=len(people))


def _couch(centre: Array, sideways: Array) -> Outline:
    right = sideways / np.linalg.norm(sideways)
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([right, np.cross(up, right), up], 1)
    return Outline.of_corners("couch", box_corners(centre, axes, _COUCH), right, has_front=True)


# ------------------------------------------------------------------------------------------------
# Scores.

_CHANCE_SEED = 20190708
"""Seed of the chance levels, the same for every table."""


@dataclass(frozen=True)
class Score:
    """Scores of a prediction on one clip.

    Parameters
    ----------
    name : str
        Name of the method.
    clip : str
    objects : ObjectScore
    pose : dict of str to PoseScore
        By :data:`imapper_prob.evaluate.score.SUBSETS`.
    """

    name: str
    clip: str
    objects: ObjectScore
    pose: dict[str, PoseScore]


@dataclass(frozen=True)
class Summary:
    """A row of a table; NaN where there is nothing to average.

    Parameters
    ----------
    name : str
    clips : tuple of str
    error, spread : float
        Mean and standard deviation of the distances of paired objects, cm.
    seat_error : float
        Mean distance over seats only, cm.
    loss : float
        Mean loss over all true objects, with one metre for a missed object, cm.
    paired, true, found, spurious : int
    chance : float
        Fraction of the true objects found by chance.
    yaw, seat_yaw : float
        Median angles over the objects found, degrees: ``yaw`` uses axes of objects without a front;
        ``seat_yaw`` is over seats only, modulo a full turn.
    overlap : float
        Intersection over union of footprints.
    pose : dict of str to (float, float, float)
        World cm, local cm, pixels: means over clips.
    left_out : int
        Number of joints in annotated frames that were not predicted.
    """

    name: str
    clips: tuple[str, ...]
    error: float
    spread: float
    seat_error: float
    loss: float
    paired: int
    true: int
    found: int
    spurious: int
    chance: float
    yaw: float
    seat_yaw: float
    overlap: float
    pose: dict[str, tuple[float, float, float]]
    left_out: int


def score(prediction: Prediction, truth: TruthInView) -> Score:
    """Compute all scores of a prediction.

    Parameters
    ----------
    prediction : Prediction
    truth : TruthInView

    Returns
    -------
    Score

    Raises
    ------
    InputError
        Its frames differ from those of the truth.
    """
    rng = np.random.default_rng(_CHANCE_SEED)
    return Score(
        name=prediction.name,
        clip=truth.name,
        objects=object_scores(prediction.objects, truth, rng),
        pose=pose_scores(prediction, truth),
    )


def summarise(scores: Sequence[Score]) -> Summary:
    """Summarise one method over its clips: objects are pooled, pose errors averaged over clips.

    Parameters
    ----------
    scores : sequence of Score

    Returns
    -------
    Summary
    """
    objects = [s.objects for s in scores]
    pairs = [p for o in objects for p in o.pairs]
    distances = np.array([100 * p.distance for p in pairs])
    seats = np.array([100 * p.distance for p in pairs if p.truth.group == "seat"])
    covered = sum(o.covered for o in objects)
    true = sum(o.true for o in objects)
    return Summary(
        name=scores[0].name,
        clips=tuple(s.clip for s in scores),
        error=_mean(distances),
        spread=float(distances.std()) if len(distances) else float("nan"),
        seat_error=_mean(seats),
        loss=100 * _mean(np.concatenate([o.losses for o in objects])),
        paired=len(pairs),
        true=true,
        found=sum(o.found for o in objects),
        spurious=sum(o.spurious for o in objects),
        chance=sum(o.chance * o.true for o in objects if o.true) / true if true else float("nan"),
        yaw=_median(np.concatenate([o.yaws for o in objects])),
        seat_yaw=_median(np.concatenate([o.seat_yaws for o in objects])),
        overlap=sum(o.shared for o in objects) / covered if covered else float("nan"),
        pose={name: _mean_pose([s.pose[name] for s in scores]) for name in SUBSETS},
        left_out=sum(s.pose[SUBSETS[0]].left_out for s in scores),
    )


def _mean_pose(scores: Sequence[PoseScore]) -> tuple[float, float, float]:
    known = [s for s in scores if s.joints]
    columns = ("world", "local", "pixels")
    world, local, pixels = (_mean(np.array([getattr(s, c) for s in known])) for c in columns)
    return world, local, pixels


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


# ------------------------------------------------------------------------------------------------
# Clips with ground truth.


@dataclass(frozen=True, eq=False)
class KnownScene:
    """A clip with ground truth.

    Parameters
    ----------
    clip : Clip
    truth : TruthInView
    others : tuple of Prediction
        The authors' output if it is public, and simple baselines.
    """

    clip: Clip
    truth: TruthInView
    others: tuple[Prediction, ...]


def known_scene(path: str | Path) -> KnownScene:
    """Read an i3DB scene with its ``gt/``, or a clip file that contains ground truth.

    Parameters
    ----------
    path : path

    Returns
    -------
    KnownScene

    Raises
    ------
    InputError
        There is no ground truth, or a file is damaged.
    """
    path = Path(path)
    clip = load_clip(path)
    if not (path.is_dir() and any(path.glob(DETECTIONS))):
        return known_clip(clip)
    if not (path / "gt").is_dir():
        raise InputError(f"{path}: has no gt/, so nobody knows its truth; name another scene")
    truth = read_truth_in_view(path, clip)
    published = (read_authors(path, clip),) if (path / "iMapper").is_dir() else ()
    lifted = read_input_path(path, clip)
    paths = (lifted, static_path(clip))
    return KnownScene(
        clip, truth, (*published, lifted, *(_couch_where_sat(p, truth) for p in paths))
    )


def known_clip(clip: Clip) -> KnownScene:
    """Add truth and baselines to a clip that contains ground truth, such as a simulated one.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    KnownScene

    Raises
    ------
    InputError
        The clip has no ground truth.
    """
    truth = truth_in_view(clip)
    return KnownScene(clip, truth, (_couch_where_sat(static_path(clip), truth),))


def scenes_with_truth(folder: str | Path) -> list[Path]:
    """The i3DB scenes in a folder that have ground truth.

    Parameters
    ----------
    folder : path

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        There are none.
    """
    found = [path for path in i3db_folders(folder) if (path / "gt").is_dir()]
    if not found:
        raise InputError(f"{folder}: no scene there has a gt/; nothing to hold results to")
    return found
