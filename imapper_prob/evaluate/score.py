"""One prediction against one truth, and several clips together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imapper_prob.evaluate.objects import ObjectScore, object_scores
from imapper_prob.evaluate.pose import SUBSETS, PoseScore, pose_scores
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import TruthInView

__all__ = ["Score", "Summary", "score", "summarise"]

_CHANCE_SEED = 20190708
"""Chance levels are thrown with the same numbers in every table."""


@dataclass(frozen=True)
class Score:
    """A prediction on one clip.

    Parameters
    ----------
    name : str
        Of the method.
    clip : str
    objects : ObjectScore
    pose : dict of str to PoseScore
        By :data:`imapper_prob.evaluate.pose.SUBSETS`.
    """

    name: str
    clip: str
    objects: ObjectScore
    pose: dict[str, PoseScore]


@dataclass(frozen=True)
class Summary:
    """What a row of a table says; NaN where there is nothing to average.

    Parameters
    ----------
    name : str
    clips : tuple of str
    error, spread : float
        Mean and standard deviation of the distances of paired objects, cm.
    seat_error : float
        The mean over seats alone, cm.
    loss : float
        Mean over all true objects, a miss counting as a metre, cm.
    paired, true, found, spurious : int
    chance : float
        Share of the true objects found by chance.
    yaw, seat_yaw : float
        Medians over the objects found, degrees: axes where there is no front, and seats alone
        by the full turn.
    overlap : float
        Footprints, intersection over union.
    pose : dict of str to (float, float, float)
        World cm, local cm, pixels: the mean over clips.
    left_out : int
        Joints in annotated frames that were not predicted.
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
    """All scores of a prediction.

    Raises
    ------
    InputError
        If its frames are not those of the truth.
    """
    rng = np.random.default_rng(_CHANCE_SEED)
    return Score(
        name=prediction.name,
        clip=truth.name,
        objects=object_scores(prediction.objects, truth, rng),
        pose=pose_scores(prediction, truth),
    )


def summarise(scores: Sequence[Score]) -> Summary:
    """One method over its clips: objects are pooled, pose errors averaged over clips."""
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
