"""Calibration of probabilities: proper scores, ranks of the truth, coverage of regions.

Scores are proper: their expectation is best when the stated probabilities are the true ones
(Gneiting and Raftery 2007, *Strictly proper scoring rules, prediction, and estimation*).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import binom
from shapely.affinity import translate

from imapper_prob.evaluate.objects import pair_up
from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.evaluate.truth import Outline, TruthInView, outline_of
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import state_camera
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.results.posterior import Posterior
from imapper_prob.uncertainty.motion import drawn_motion

__all__ = [
    "LIKELY",
    "MOST_PROBABLE",
    "Claim",
    "Coverage",
    "Draws",
    "PosteriorScore",
    "at_true_size",
    "brier",
    "claims_of",
    "count_scores",
    "coverage",
    "distance_ranks",
    "draws_inside",
    "draws_of",
    "elliptic_rank",
    "energy_score",
    "joint_energy_score",
    "joint_ranks",
    "object_ranks",
    "posterior_predictions",
    "presence_scores",
    "scene_distance",
    "score_posterior",
]

Array = NDArray[np.float64]
_MOST: Final = 200
"""Most draws used. Ranks among 200 are accurate to .035, and neighbouring draws are similar."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of all chains at even spacing.

    Parameters
    ----------
    joints : (N, R, 16, 3) float
        Camera axes, metres.
    pixels : (N, R, 16, 2) float
        Projections by each draw's own camera.
    objects : tuple of N tuples of Outline
    """

    joints: Array
    pixels: Array
    objects: tuple[tuple[Outline, ...], ...]

    def __len__(self) -> int:
        return len(self.objects)


def draws_of(posterior: Posterior, *, rows: int | None = None) -> Draws:
    """At most 200 draws of a posterior, evenly spaced over its chains.

    Parameters
    ----------
    posterior : Posterior
    rows : int, optional
        Frames times people, for the first people only; all people if not given.

    Returns
    -------
    Draws
    """
    samples, source = posterior.samples, posterior.solution
    count = len(samples.states)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(int))
    joints, pixels, objects = [], [], []
    rng = np.random.default_rng(posterior.config.seed)
    for k in chosen.tolist():
        state = samples.states[k]
        camera = state_camera(posterior.clip.camera, state)
        world = drawn_motion(rng, source.problem, state, camera)[:rows]
        joints.append(camera.to_camera(world))
        pixels.append(camera.project(world))
        objects.append(tuple(outline_of(o, camera) for o in posterior.furniture[k]))
    return Draws(np.array(joints), np.array(pixels), tuple(objects))


# ------------------------------------------------------------------------------------------------
# Claims: object clusters in camera axes.

_LEAST: Final = 0.005
"""Least probability of a cluster that is scored; two draws of 400."""


@dataclass(frozen=True, eq=False)
class Claim:
    """A cluster of objects over the draws.

    Parameters
    ----------
    probability : float
        Probability that the object exists.
    label : str
        Its most probable label.
    members : tuple of Outline
        The object in each draw that has it.
    """

    probability: float
    label: str
    members: tuple[Outline, ...]

    @property
    def centres(self) -> Array:
        """(n, 2) centres in top view, metres."""
        return np.array([m.centre for m in self.members])

    @cached_property
    def representative(self) -> Outline:
        """The member with the cluster's label that is nearest to the mean, moved to the mean.

        The mean is over bearing and log distance, because uncertainty is relative and along the
        ray.
        """
        away = np.linalg.norm(self.centres, axis=1)
        bearing = np.arctan2(self.centres[:, 0], self.centres[:, 1]).mean()
        middle = np.exp(np.log(away).mean()) * np.array([np.sin(bearing), np.cos(bearing)])
        alike = [m for m in self.members if m.label == self.label]
        best = min(alike, key=lambda m: float(np.linalg.norm(m.centre - middle)))
        x, y = middle - best.centre
        moved = translate(best.hull, float(x), float(y))
        corners = best.corners + np.array([x, y, 0.0])
        return Outline(best.label, middle, best.yaw, best.has_front, moved, corners)


def claims_of(posterior: Posterior) -> tuple[Claim, ...]:
    """The object clusters that a run reports, the most probable first.

    They come from :mod:`imapper_prob.uncertainty.clusters`, without use of the truth.

    Parameters
    ----------
    posterior : Posterior

    Returns
    -------
    tuple of Claim
    """
    samples = posterior.samples
    cameras = [state_camera(posterior.clip.camera, state) for state in samples.states]
    return tuple(
        Claim(
            cluster.presence,
            cluster.label,
            tuple(outline_of(posterior.furniture[n][k], cameras[n]) for n, k in cluster.members),
        )
        for cluster in posterior.clusters(least=_LEAST)
    )


# ------------------------------------------------------------------------------------------------
# Proper scores.

_MISSED: Final = 0.5
"""Cost in metres of a missed object and of a spurious one; together one metre, the distance from
which an object does not count as found."""


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
        The logarithmic score is in nats. A cluster counts as present if it is paired with a true
        object within a metre; true objects in no draw have probability 0. Means over both kinds.
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
    """Brier and logarithmic score of probabilities of binary events.

    Parameters
    ----------
    probability : (n,) float
    happened : (n,) bool
    least : float
        Lower bound of probabilities in the logarithm: half a draw in 200.

    Returns
    -------
    brier, logarithmic : float
        The logarithmic score is in nats.
    """
    square = float(((probability - happened) ** 2).mean())
    of_what_happened = np.where(happened > 0, probability, 1 - probability)
    return square, float(-np.log(np.maximum(of_what_happened, least)).mean())


def _counts(objects: Sequence[Outline]) -> tuple[int, ...]:
    return tuple(sum(o.group == group for o in objects) for group in ("seat", "table", "shelf"))


# ------------------------------------------------------------------------------------------------
# Ranks and coverage.
#
# The rank of a point is the fraction of the draws that are nearer to the mean of all than it, in
# Mahalanobis distance. If probabilities are correct and draws independent, ranks are uniform for
# any number of draws (conformal prediction; Vovk, Gammerman and Shafer 2005, section 2.2).

_REGIONS: Final = (0.5, 0.9)
"""Probabilities of the regions whose coverage is reported."""
_EXPECTED: Final = (0.05, 0.95)
"""Quantiles of the expected share, a range of 90 %."""
_PAIRINGS: Final = 4000
_PAIRING_SEED: Final = 20190708
"""Combinations of draws of independent clips, for an error of .003 in the quantiles' levels."""
_FEWEST: Final = 20
"""Least number of draws of an object for which an ellipse is fitted."""
_NUGGET: Final = 1e-6
"""Square metres added to variances, one square millimetre, for draws at a single point."""


@dataclass(frozen=True)
class Coverage:
    """Observed coverage of regions of a stated probability.

    Parameters
    ----------
    region : float
        Stated probability.
    share : float
        Fraction of the truths inside the region; NaN if there are none.
    low, high : float
        Range that contains ``share`` with probability .9 if probabilities are correct; NaN if there
        are no truths.
    count : int
        Number of truths.
    """

    region: float
    share: float
    low: float
    high: float
    count: int


def elliptic_rank(draws: ArrayLike, point: ArrayLike) -> float:
    """Rank of a point among draws, by Mahalanobis distance with the covariance of all N + 1.

    The covariance includes the point. Without it the ellipse would be too small for the point: with
    100 draws in three dimensions, coverage of a region of .9 would be .03 too low.

    Parameters
    ----------
    draws : (N, d) float
    point : (d,) float

    Returns
    -------
    float
        In [0, 1].
    """
    everything = np.concatenate([np.asarray(draws, float), np.asarray(point, float)[None]])
    distances = _squared_distances(everything)
    # The middle of the point's step among N + 1.
    return float(((distances[:-1] < distances[-1]).sum() + 0.5) / len(distances))


def _squared_distances(points: Array) -> Array:
    """(N,) squared Mahalanobis distances of (N, d) points from their mean."""
    off = points - points.mean(0)
    covariance = np.cov(points.T) + _NUGGET * np.eye(off.shape[1])
    found: Array = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    return found


def object_ranks(claims: Sequence[Claim], truth: TruthInView) -> Array:
    """Ranks of true centres in the clusters that they are paired with.

    Parameters
    ----------
    claims : sequence of Claim
    truth : TruthInView

    Returns
    -------
    (n,) float
        Clusters more probable than one half are paired as the objects of a scene are; a true object
        without a partner has no rank.
    """
    likely = [c for c in claims if c.probability > 0.5 and len(c.members) >= _FEWEST]
    claim_of = {id(c.representative): c for c in likely}
    pairs = pair_up(truth.used_objects, [c.representative for c in likely])
    return np.array([elliptic_rank(claim_of[id(p.found)].centres, p.truth.centre) for p in pairs])


def joint_ranks(
    draws: Draws, truth: TruthInView, *, joints: Sequence[int] = SCORED, hidden: bool = False
) -> Array:
    """Ranks of joints in annotated frames, of all or only of hidden ones.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView
    joints : sequence of int
    hidden : bool
        Whether only hidden joints are used.

    Returns
    -------
    (n,) float
    """
    return np.array(
        [
            elliptic_rank(draws.joints[:, t, joint], truth.joints[t, joint])
            for t, joint in _ranked(truth, joints, hidden)
        ]
    )


def draws_inside(
    draws: Draws, truth: TruthInView, *, joints: Sequence[int] = SCORED, hidden: bool = False
) -> NDArray[np.int64]:
    """How many joints regions would contain if a draw were the truth, draw by draw.

    Joints of a clip share the doubt of its size, so the share of them that a region contains varies
    far more from clip to clip than that of independent points.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView
        For the choice of joints and frames.
    joints : sequence of int
    hidden : bool
        See `joint_ranks`.

    Returns
    -------
    (N, 2) int
        For regions of 50 and 90 %.
    """
    inside = np.zeros((len(draws), len(_REGIONS)), int)
    for t, joint in _ranked(truth, joints, hidden):
        distances = _squared_distances(draws.joints[:, t, joint])
        ranks = (distances.argsort().argsort() + 0.5) / len(draws)
        inside += ranks[:, None] < _REGIONS
    return inside


def at_true_size(draws: Draws, truth: TruthInView) -> Draws:
    """Draws scaled about the camera so that the mean log distance of the pelvis is the true one.

    What remains is the doubt of poses and of the path's shape, without that of the clip's size,
    which is one unknown number a clip: one camera does not measure it.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView

    Returns
    -------
    Draws
        The scaled joints; pixels and objects are unchanged.
    """
    known = truth.known

    def size(joints: Array) -> Array:
        away: Array = np.log(np.linalg.norm(joints[..., known, PELV, :], axis=-1)).mean(-1)
        return away

    factor = np.exp(size(truth.joints) - size(draws.joints))
    return replace(draws, joints=draws.joints * factor[:, None, None, None])


def _ranked(truth: TruthInView, joints: Sequence[int], hidden: bool) -> list[tuple[int, int]]:
    """Frames and joints that have ranks."""
    frames = np.flatnonzero(truth.known).tolist()
    return [(t, joint) for t in frames for joint in joints if truth.hidden[t, joint] or not hidden]


def distance_ranks(draws: Draws, truth: TruthInView) -> Array:
    """Fraction of draws whose pelvis is nearer to the camera than the true one, by frame.

    Fractions are uniform if distances are calibrated. They concentrate at 1 if draws are too near,
    and at 0 if they are too far.

    Parameters
    ----------
    draws : Draws
    truth : TruthInView

    Returns
    -------
    (n,) float
    """
    known = truth.known
    drawn = np.linalg.norm(draws.joints[:, known, PELV], axis=-1)
    true = np.linalg.norm(truth.joints[known, PELV], axis=-1)
    shares: Array = (drawn < true).mean(0)
    return shares


def coverage(ranks: Sequence[Array], inside: Sequence[ArrayLike] = ()) -> tuple[Coverage, ...]:
    """Observed coverage of regions of stated probabilities.

    Parameters
    ----------
    ranks : sequence of (n,) float
        Ranks of each clip.
    inside : sequence of (N, 2) int
        Results of `draws_inside` of each clip. If empty, truths are independent and the expected
        range is that of a binomial distribution.

    Returns
    -------
    tuple of Coverage
    """
    everything = np.concatenate([np.empty(0), *ranks])
    count = len(everything)
    rng = np.random.default_rng(_PAIRING_SEED)
    sums = np.zeros((_PAIRINGS, len(_REGIONS)))
    for each in map(np.asarray, inside):
        sums += each[rng.integers(len(each), size=_PAIRINGS)]
    result = []
    for k, region in enumerate(_REGIONS):
        share = low = high = float("nan")
        if count:
            share = float((everything < region).mean())
            low, high = (
                np.quantile(sums[:, k], _EXPECTED)
                if inside
                else binom.ppf(_EXPECTED, count, region)
            ) / count
        result.append(Coverage(region, share, float(low), float(high), count))
    return tuple(result)


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
