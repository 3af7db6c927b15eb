"""Scores of stated probabilities: proper scores, and all scores of a posterior.

Scores are proper: their expectation is best when the stated probabilities are the true ones
(Gneiting and Raftery 2007, *Strictly proper scoring rules, prediction, and estimation*). Those of
presence are only nearly so, because of their divisor.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from imapper_prob.evaluate.claims import Claim, Draws, claimed_pairs, claims_of, draws_of
from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.evaluate.regions import (
    at_true_size,
    distance_ranks,
    draws_inside,
    joint_ranks,
    object_ranks,
)
from imapper_prob.evaluate.truth import Outline, TruthInView
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.results.posterior import Posterior

__all__ = [
    "LIKELY", "MOST_PROBABLE", "PosteriorScore", "brier", "count_scores", "energy_score",
    "joint_energy_score", "label_scores", "posterior_predictions", "presence_scores",
    "scene_distance", "score_posterior",
]  # fmt: skip

Array = NDArray[np.float64]

# ------------------------------------------------------------------------------------------------
# Proper scores.

_MISSED: Final = 0.5
"""Cost in metres of a missed object and of a spurious one; together one metre, the distance from
which an object does not count as found."""

_RAREST: Final = 0.0025
"""Lower bound of probabilities in logarithmic scores: half a draw in 200."""


def scene_distance(one: Sequence[Outline], other: Sequence[Outline]) -> float:
    """Distance in metres between two sets of furniture.

    It sums the distances of partners within a metre, and half a metre for each object without a
    partner: the generalised optimal sub-pattern assignment metric (Rahmathullah, García-Fernández
    and Svensson 2017) of order 1 with cut-off one metre. Because it is a metric,
    :func:`energy_score` is proper.

    Parameters
    ----------
    one, other : sequence of Outline

    Returns
    -------
    float
    """
    alone = _MISSED * (len(one) + len(other))
    if not one or not other:
        return alone
    gap = np.array([o.centre for o in one])[:, None] - [o.centre for o in other]
    distance = np.linalg.norm(gap, axis=-1)
    other_group = np.array([[a.group != b.group for b in other] for a in one])
    saved = np.where(other_group, 0.0, np.minimum(distance - 2 * _MISSED, 0.0))
    return float(alone + saved[linear_sum_assignment(saved)].sum())


def energy_score(
    draws: Sequence[Sequence[Outline]], truth: Sequence[Outline]
) -> tuple[float, float]:
    """Expected distance of the draws to the truth, and energy score.

    Parameters
    ----------
    draws : sequence of sequence of Outline
    truth : sequence of Outline

    Returns
    -------
    error, score : float
        Metres. The score is the error minus half the mean distance between draws; each draw is
        compared with the one half the sequence later.
    """
    expected = float(np.mean([scene_distance(d, truth) for d in draws]))
    half = len(draws) // 2
    between = [scene_distance(draws[k], draws[k + half]) for k in range(half)]
    return expected, expected - 0.5 * float(np.mean(between)) if between else expected


def joint_energy_score(draws: Draws, truth: TruthInView) -> tuple[float, float]:
    """Expected error and energy score of joints, averaged over scored joints and annotated frames.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView

    Returns
    -------
    error, score : float
        Metres.
    """
    known, scored = truth.known, list(SCORED)
    found = draws.joints[:, known][:, :, scored]
    expected = np.linalg.norm(found - truth.joints[known][:, scored], axis=-1).mean()
    half = len(draws) // 2
    if not half:
        return float(expected), float(expected)
    between = np.linalg.norm(found[:half] - found[half : 2 * half], axis=-1).mean()
    return float(expected), float(expected - 0.5 * between)


def count_scores(
    draws: Sequence[Sequence[Outline]], truth: Sequence[Outline]
) -> tuple[float, float]:
    """Scores of the predicted numbers of seats, tables and shelves.

    Parameters
    ----------
    draws : sequence of sequence of Outline
    truth : sequence of Outline

    Returns
    -------
    brier, logarithmic : float
        The logarithmic score is in nats. The event is the whole triple of counts; a triple that
        occurs in no draw has the probability of half a draw.
    """
    counted = Counter(_counts(d) for d in draws)
    right = _counts(truth)
    shares = {triple: n / len(draws) for triple, n in counted.items()}
    own = shares.get(right, 0.0)
    spread = sum(p**2 for triple, p in shares.items() if triple != right)
    return spread + (1 - own) ** 2, -float(np.log(max(own, 0.5 / len(draws))))


def presence_scores(claims: Sequence[Claim], truth: TruthInView) -> tuple[float, float]:
    """Scores of the presence probabilities of objects.

    Parameters
    ----------
    claims : sequence of Claim
    truth : TruthInView

    Returns
    -------
    brier, logarithmic : float
        The logarithmic score is in nats. Clusters and true objects of one group within a metre are
        matched one to one, so that the probability of the matched ones is greatest. Matched
        clusters count as present; true objects without one have probability 0. Sums over both
        kinds, divided by the number of true objects (1 if nothing is true): improbable clusters,
        however many, change little. NaN if nothing is stated.
    """
    true = truth.used_objects
    probability = np.array([claim.probability for claim in claims])
    near = np.zeros((len(true), len(claims)))
    for i, k in np.ndindex(near.shape):
        near[i, k] = any(p.near for p in pair_up([true[i]], [claims[k].representative]))
    rows, columns = linear_sum_assignment(near * probability, maximize=True)
    there = np.zeros(len(claims))
    there[columns] = near[rows, columns]
    missed = len(true) - int(there.sum())
    probability = np.append(probability, np.zeros(missed))
    there = np.append(there, np.ones(missed))
    if not len(there):
        return float("nan"), float("nan")
    square, logarithmic = brier(probability, there)
    weight = len(there) / max(len(true), 1)
    return square * weight, logarithmic * weight


@dataclass(frozen=True)
class LabelScores:
    """Scores of the labels of claimed objects.

    Parameters
    ----------
    count : int
        Number of clusters that are more probable than one half and paired with a true object within
        a metre.
    right : int
        Number of those whose most probable label is the true one.
    expected : float
        Expectation of ``right`` if the stated probabilities are correct.
    logarithmic : float
        Logarithmic score of the probability of the true label, mean in nats.
    """

    count: int
    right: int
    expected: float
    logarithmic: float


def label_scores(claims: Sequence[Claim], truth: TruthInView) -> LabelScores:
    """Score the label probabilities of claimed objects.

    Parameters
    ----------
    claims : sequence of Claim
    truth : TruthInView

    Returns
    -------
    LabelScores
    """
    right, stated, of_true = 0, [], []
    for claim, pair in claimed_pairs(claims, truth):
        if pair.near:
            right += claim.label == pair.truth.label
            stated.append(claim.labels[claim.label])
            of_true.append(claim.labels.get(pair.truth.label, 0.0))
    logarithmic = -np.log(np.maximum(of_true, _RAREST)).mean() if of_true else np.nan
    return LabelScores(len(stated), right, float(sum(stated)), float(logarithmic))


def brier(probability: Array, happened: Array) -> tuple[float, float]:
    """Brier and logarithmic score of probabilities of binary events.

    Parameters
    ----------
    probability : (n,) float
    happened : (n,) bool

    Returns
    -------
    brier, logarithmic : float
        The logarithmic score is in nats.
    """
    square = float(((probability - happened) ** 2).mean())
    of_what_happened = np.where(happened > 0, probability, 1 - probability)
    return square, float(-np.log(np.maximum(of_what_happened, _RAREST)).mean())


def _counts(objects: Sequence[Outline]) -> tuple[int, ...]:
    return tuple(sum(o.group == group for o in objects) for group in ("seat", "table", "shelf"))


# ------------------------------------------------------------------------------------------------
# All scores of a posterior.

MOST_PROBABLE: Final = "posterior, most probable scene"
LIKELY: Final = "posterior, least expected loss"
_SHOWN: Final = 5
"""Number of scenes shown to a user, among which the best is scored."""


@dataclass(frozen=True, eq=False)
class PosteriorScore:
    """Scores of one posterior on one clip; distances are in cm.

    Parameters
    ----------
    name, clip : str
        Names of the run and of its clip.
    draws : int
        Number of draws used.
    first, best : float
        Distance to the true furniture (:func:`imapper_prob.evaluate.probability.scene_distance`) of
        the most probable scene, and of the best of the five scenes that are shown.
    expected, energy : float
        Expectation of the same distance over draws, and its energy score.
    joint_expected, joint_energy : float
        Expected error and energy score of scored joints in annotated frames.
    found : float
        Fraction of the true objects that have a partner within a metre, mean over draws.
    claimed, true : int
        Number of true objects paired with a cluster more probable than one half, and of all.
    counts, presence : (float, float)
        Brier score, and logarithmic score in nats: of the numbers of seats, tables and shelves, and
        of each object's presence.
    labels : LabelScores
        Scores of the labels of claimed objects.
    object_ranks, pelvis_ranks, joint_ranks, hidden_ranks : (n,) float
        Ranks of object centres, the pelvis, all scored joints and the hidden ones.
    sized_ranks : (n,) float
        Ranks of all scored joints, given the clip's true size (:func:`at_true_size`).
    distance_ranks : (n,) float
        Ranks of the pelvis' distance from the camera.
    inside : dict of str to (N, 2) int
        Results of :func:`draws_inside` for each kind of ranks but the first and the last.
    """

    name: str
    clip: str
    draws: int
    first: float
    best: float
    expected: float
    energy: float
    joint_expected: float
    joint_energy: float
    found: float
    claimed: int
    true: int
    counts: tuple[float, float]
    presence: tuple[float, float]
    labels: LabelScores
    object_ranks: Array
    pelvis_ranks: Array
    joint_ranks: Array
    hidden_ranks: Array
    sized_ranks: Array
    distance_ranks: Array
    inside: dict[str, NDArray[np.int64]]


def posterior_predictions(posterior: Posterior) -> tuple[Prediction, ...]:
    """The predictions of a posterior: most probable scene, and scene of least expected loss.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    tuple of Prediction
    """
    people = len(posterior.clip.tracks)
    likely = prediction_of_scene(posterior.estimate, name=LIKELY, people=people)
    return (*_shown(posterior, 1), likely)


def score_posterior(posterior: Posterior, truth: TruthInView, *, name: str) -> PosteriorScore:
    """Score a posterior, except for its single predictions.

    Parameters
    ----------
    posterior : Posterior
    truth : TruthInView
    name : str
        Name of the method.

    Returns
    -------
    PosteriorScore

    Raises
    ------
    InputError
        The posterior is of another clip.
    """
    if posterior.clip.name != truth.name or posterior.clip.n_frames != len(truth.frame_ids):
        raise InputError(
            f"the run is of {posterior.clip.name} with {posterior.clip.n_frames} frames, the "
            f"truth of {truth.name} with {len(truth.frame_ids)}; name the truth of its clip"
        )
    claims, true = claims_of(posterior), truth.used_objects
    draws = draws_of(posterior, rows=len(truth.joints))
    sized = at_true_size(draws, truth)
    shown = [scene_distance(p.objects, true) for p in _shown(posterior, _SHOWN)]
    expected, energy = energy_score(draws.objects, true)
    joints = joint_energy_score(draws, truth)
    ranks = object_ranks(claims, truth)
    near = [sum(p.near for p in pair_up(true, objects)) for objects in draws.objects]
    return PosteriorScore(
        name=name,
        clip=truth.name,
        draws=len(draws),
        first=100 * shown[0],
        best=100 * min(shown),
        expected=100 * expected,
        energy=100 * energy,
        joint_expected=100 * joints[0],
        joint_energy=100 * joints[1],
        found=float(np.mean(near)) / len(true) if true else float("nan"),
        claimed=len(ranks),
        true=len(true),
        counts=count_scores(draws.objects, true),
        presence=presence_scores(claims, truth),
        labels=label_scores(claims, truth),
        object_ranks=ranks,
        pelvis_ranks=joint_ranks(draws, truth, joints=(PELV,)),
        joint_ranks=joint_ranks(draws, truth),
        hidden_ranks=joint_ranks(draws, truth, hidden=True),
        sized_ranks=joint_ranks(sized, truth),
        distance_ranks=distance_ranks(draws, truth),
        inside={
            "pelvis_ranks": draws_inside(draws, truth, joints=(PELV,)),
            "joint_ranks": draws_inside(draws, truth),
            "hidden_ranks": draws_inside(draws, truth, hidden=True),
            "sized_ranks": draws_inside(sized, truth),
        },
    )


def _shown(posterior: Posterior, count: int) -> Sequence[Prediction]:
    people = len(posterior.clip.tracks)
    return [
        prediction_of_scene(w.scene, name=MOST_PROBABLE, people=people)
        for w in posterior.scenes(count)
    ]
