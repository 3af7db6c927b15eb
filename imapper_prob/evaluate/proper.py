"""Scores that reward honest probabilities: none can be improved by stating others than one has.

Gneiting and Raftery (2007), *Strictly proper scoring rules, prediction, and estimation*.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from imapper_prob.evaluate.claims import Claim
from imapper_prob.evaluate.draws import Draws
from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.outline import Outline
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.models.skeleton import SCORED

__all__ = [
    "brier",
    "count_scores",
    "energy_score",
    "joint_energy_score",
    "presence_scores",
    "scene_distance",
]

Array = NDArray[np.float64]

_MISSED: Final = 0.5
"""Cost in metres of an object that is missed, and of one too many: together the metre from
which an object is not found."""


def scene_distance(one: Sequence[Outline], other: Sequence[Outline]) -> float:
    """Metres between two sets of furniture.

    Distances of partners within a metre, and half a metre for each object without one: the
    generalised optimal sub-pattern assignment metric (Rahmathullah, García-Fernández and
    Svensson 2017) of order 1, cut off at a metre. Being a metric, it makes
    :func:`energy_score` proper.
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
    """Expected distance to the truth, and the same less half of that between draws; metres.

    The second is the energy score; draws are held against those half the chain away.
    """
    expected = float(np.mean([scene_distance(d, truth) for d in draws]))
    half = len(draws) // 2
    between = [scene_distance(draws[k], draws[k + half]) for k in range(half)]
    return expected, expected - 0.5 * float(np.mean(between)) if between else expected


def joint_energy_score(draws: Draws, truth: TruthInView) -> tuple[float, float]:
    """Mean over scored joints and annotated frames of expected error and energy score, metres."""
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
    """Brier and logarithmic score (nats) of how many seats, tables and shelves there are.

    What is judged is the probability of the whole triple. A triple that no draw has counts as
    half a draw: that it is impossible nobody can know from so many.
    """
    counted = Counter(_counts(d) for d in draws)
    right = _counts(truth)
    shares = {triple: n / len(draws) for triple, n in counted.items()}
    own = shares.get(right, 0.0)
    spread = sum(p**2 for triple, p in shares.items() if triple != right)
    return spread + (1 - own) ** 2, -float(np.log(max(own, 0.5 / len(draws))))


def presence_scores(claims: Sequence[Claim], truth: TruthInView) -> tuple[float, float]:
    """Brier and logarithmic score (nats) of each object's probability to be there.

    An object that some draw has is there if it finds a true one within a metre; true objects
    that no draw has count as claimed with probability 0. Means over both.
    """
    shown = [c.representative for c in claims]
    near = {id(p.found) for p in pair_up(truth.used_objects, shown) if p.near}
    stated = [(c.probability, id(o) in near) for c, o in zip(claims, shown, strict=True)]
    stated += [(0.0, True)] * (len(truth.used) - len(near))
    if not stated:
        return float("nan"), float("nan")
    probability = np.array([p for p, _ in stated])
    there = np.array([t for _, t in stated], dtype=float)
    return brier(probability, there)


def brier(probability: Array, happened: Array, *, least: float = 0.0025) -> tuple[float, float]:
    """Brier and logarithmic score (nats) of stated probabilities of yes-or-no events.

    ``least`` bounds probabilities for the logarithm: half a draw in 200.
    """
    square = float(((probability - happened) ** 2).mean())
    of_what_happened = np.where(happened > 0, probability, 1 - probability)
    return square, float(-np.log(np.maximum(of_what_happened, least)).mean())


def _counts(objects: Sequence[Outline]) -> tuple[int, ...]:
    return tuple(sum(o.group == group for o in objects) for group in ("seat", "table", "shelf"))
