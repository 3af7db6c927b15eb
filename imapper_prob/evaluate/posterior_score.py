"""A posterior against one truth: its best answers, its errors on average, its honesty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.evaluate.claims import claims_of
from imapper_prob.evaluate.draws import draws_of
from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.evaluate.proper import (
    count_scores,
    energy_score,
    joint_energy_score,
    presence_scores,
    scene_distance,
)
from imapper_prob.evaluate.spread import distance_ranks, joint_ranks, object_ranks
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.posterior import Posterior

__all__ = [
    "LIKELY", "MOST_PROBABLE", "PosteriorScore", "posterior_predictions", "score_posterior",
]  # fmt: skip

Array = NDArray[np.float64]

MOST_PROBABLE: Final = "posterior, most probable scene"
LIKELY: Final = "posterior, least expected loss"
_SHOWN: Final = 5
"""Scenes that a user is shown, of which the best is looked for."""


@dataclass(frozen=True, eq=False)
class PosteriorScore:
    """How honest a posterior is on one clip. Distances in cm.

    Parameters
    ----------
    name, clip : str
        Of the run and its clip.
    draws : int
        That were looked at.
    first, best : float
        Distance to the true furniture of the most probable scene, and of the best of the
        five that are shown (:func:`imapper_prob.evaluate.proper.scene_distance`).
    expected, energy : float
        The same distance expected over draws, and its energy score.
    joint_expected, joint_energy : float
        Of scored joints in annotated frames.
    found : float
        Share of the true objects that have a partner within a metre, mean over draws.
    claimed, true : int
        True objects that are paired with one of more than even odds, and how many there are.
    counts, presence : (float, float)
        Brier score, and logarithmic score in nats: of how many seats, tables and shelves
        there are, and of each object's probability.
    object_ranks, pelvis_ranks, joint_ranks, hidden_ranks : (n,) float
        Of centres, of the pelvis, of all scored joints and of the hidden ones; see
        :mod:`imapper_prob.evaluate.spread`.
    distance_ranks : (n,) float
        Of the pelvis' distance from the camera.
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
    object_ranks: Array
    pelvis_ranks: Array
    joint_ranks: Array
    hidden_ranks: Array
    distance_ranks: Array


def posterior_predictions(posterior: Posterior) -> tuple[Prediction, ...]:
    """The most probable scene, and the scene of least expected loss."""
    return (*_shown(posterior, 1), prediction_of_scene(posterior.estimate, name=LIKELY))


def score_posterior(posterior: Posterior, truth: TruthInView, *, name: str) -> PosteriorScore:
    """All that is judged of a posterior beyond its single answers.

    Raises
    ------
    InputError
        If it is of another clip or of several people.
    """
    if len(posterior.clip.tracks) > 1:
        raise InputError(f"the run of {posterior.clip.name} is of several people, its truth of one")
    if posterior.clip.name != truth.name or posterior.clip.n_frames != len(truth.joints):
        raise InputError(
            f"the run is of {posterior.clip.name} with {posterior.clip.n_frames} frames, the "
            f"truth of {truth.name} with {len(truth.joints)}; name the truth of its clip"
        )
    claims, draws, true = claims_of(posterior), draws_of(posterior), truth.used_objects
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
        object_ranks=ranks,
        pelvis_ranks=joint_ranks(draws, truth, joints=(PELV,)),
        joint_ranks=joint_ranks(draws, truth),
        hidden_ranks=joint_ranks(draws, truth, hidden=True),
        distance_ranks=distance_ranks(draws, truth),
    )


def _shown(posterior: Posterior, count: int) -> Sequence[Prediction]:
    return [prediction_of_scene(w.scene, name=MOST_PROBABLE) for w in posterior.scenes(count)]
