"""What a posterior says, in camera axes: its draws, and the objects that it claims.

Truth and predictions are compared in camera axes, because draws have cameras of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely.affinity import translate

from imapper_prob.evaluate.objects import Pair, pair_up
from imapper_prob.evaluate.truth import Outline, TruthInView, outline_of
from imapper_prob.models.log_posterior import state_camera
from imapper_prob.results.posterior import Posterior
from imapper_prob.uncertainty.motion import drawn_motion

__all__ = ["Claim", "Draws", "claimed_pairs", "claims_of", "draws_of"]

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
    fps, rng = posterior.clip.fps, np.random.default_rng(posterior.config.seed)
    for k in chosen.tolist():
        state = samples.states[k]
        camera = state_camera(posterior.clip.camera, state)
        world = drawn_motion(rng, source.problem, state, camera, fps=fps)[:rows]
        joints.append(camera.to_camera(world))
        pixels.append(camera.project(world))
        objects.append(tuple(outline_of(o, camera) for o in posterior.furniture[k]))
    return Draws(np.array(joints), np.array(pixels), tuple(objects))


_LEAST: Final = 0.005
"""Least probability of a cluster that is scored; two draws of 400."""


@dataclass(frozen=True, eq=False)
class Claim:
    """A cluster of objects over the draws.

    Parameters
    ----------
    probability : float
        Probability that the object exists.
    labels : mapping of str to float
        Probability of each label, in descending order.
    members : tuple of Outline
        The object in each draw that has it.
    """

    probability: float
    labels: Mapping[str, float]
    members: tuple[Outline, ...]

    @property
    def label(self) -> str:
        """The most probable label."""
        return next(iter(self.labels))

    @property
    def centres(self) -> Array:
        """(n, 2) centres in top view, metres."""
        return np.array([m.centre for m in self.members])

    @cached_property
    def representative(self) -> Outline:
        """The member nearest to the mean, moved there, among those with the cluster's label if any.

        The mean is over bearing and log distance, because uncertainty is relative and along the
        ray.
        """
        away = np.linalg.norm(self.centres, axis=1)
        bearing = np.arctan2(self.centres[:, 0], self.centres[:, 1]).mean()
        middle = np.exp(np.log(away).mean()) * np.array([np.sin(bearing), np.cos(bearing)])
        off = np.linalg.norm(self.centres - middle, axis=1)
        best = self.members[np.lexsort((off, [m.label != self.label for m in self.members]))[0]]
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
            cluster.labels,
            tuple(outline_of(posterior.furniture[n][k], cameras[n]) for n, k in cluster.members),
        )
        for cluster in posterior.clusters(least=_LEAST)
    )


def claimed_pairs(
    claims: Sequence[Claim], truth: TruthInView, *, fewest: int = 1
) -> list[tuple[Claim, Pair]]:
    """Claims more probable than one half, each with its pair, as the objects of a scene are paired.

    Parameters
    ----------
    claims : sequence of Claim
    truth : TruthInView
    fewest : int
        Claims with fewer members are left out.

    Returns
    -------
    list of (Claim, Pair)
        Claims and true objects without a partner are left out.
    """
    likely = [c for c in claims if c.probability > 0.5 and len(c.members) >= fewest]
    claim_of = {id(c.representative): c for c in likely}
    pairs = pair_up(truth.used_objects, [c.representative for c in likely])
    return [(claim_of[id(pair.found)], pair) for pair in pairs]
