"""Two roads to one posterior: placements by jump chains and by ensembles of walkers.

The ensembles hold one assignment fixed. Draws of the chains that have the very same
assignment come from the same distribution of placements, by other moves and other code:
where means and spreads differ by much, one of the two has not arrived yet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State
from imapper_prob.models.scenelet import Library
from imapper_prob.sampling.placements import PlacementDraws

__all__ = ["Agreement", "compare", "describe_agreement"]

Array = NDArray[np.float64]

_FEWEST = 20
"""Draws below which a spread is not worth comparing: it is known to 16 % with so many."""
_APART, _FACTOR = 0.5, 1.5
"""Differences that are worth a word: of means in standard deviations, of these as a factor."""


@dataclass(frozen=True)
class Agreement:
    """How well chains and ensembles agree on the objects of one assignment.

    Parameters
    ----------
    labels : tuple of n str
        Objects of its scenelets, unmerged, in order of time.
    difference : (n, 2) float
        Mean of the ensembles minus that of the chains in x and y, over the ensembles'
        standard deviation. NaN with too few draws.
    ratio : (n, 2) float
        Standard deviation of the chains over that of the ensembles.
    draws : int
        Draws of the chains with this assignment.
    """

    labels: tuple[str, ...]
    difference: Array
    ratio: Array
    draws: int


def compare(library: Library, draws: PlacementDraws, states: Sequence[State]) -> Agreement:
    """Hold the ensembles of an assignment against the chains' draws of it."""
    same = [s.placements for s in states if np.array_equal(s.items, draws.items)]
    # An assignment may be empty; how many draws there are is then not to be had from the size.
    shape = draws.placements.shape
    walked = draws.placements.reshape(math.prod(shape[:-2]), *shape[-2:])
    jumped = np.array(same).reshape(len(same), *shape[-2:])
    labels, difference, ratio = [], [], []
    for index, scenelet in enumerate(draws.items[:, 0].tolist()):
        for o in library[scenelet].objects:
            first, second = (_centres(o.centre, p[:, index]) for p in (walked, jumped))
            labels.append(o.label)
            if len(same) < _FEWEST:
                difference.append(np.full(2, np.nan))
                ratio.append(np.full(2, np.nan))
                continue
            difference.append((first.mean(0) - second.mean(0)) / first.std(0))
            ratio.append(second.std(0) / first.std(0))
    by_object = (len(labels), 2)
    return Agreement(
        tuple(labels), np.reshape(difference, by_object), np.reshape(ratio, by_object), len(same)
    )


def describe_agreement(agreements: Sequence[Agreement]) -> str:
    """One line for a person: whether both roads arrive at the same place."""
    known = [a for a in agreements if a.labels and a.draws >= _FEWEST]
    if not known:
        return (
            "Ensembles and chains cannot be compared: no chain stays with one assignment for "
            f"{_FEWEST} draws."
        )
    apart = max(float(np.abs(a.difference).max()) for a in known)
    ratios = np.concatenate([a.ratio.ravel() for a in known])
    alike = apart <= _APART and ratios.min() >= 1 / _FACTOR and ratios.max() <= _FACTOR
    counted = " and ".join(str(a.draws) for a in known)
    return (
        f"Ensembles and chains {'agree' if alike else 'do not agree yet'} on where objects stand: "
        f"means differ by up to {apart:.1f} standard deviations, which are {ratios.min():.1f} to "
        f"{ratios.max():.1f} times as large in the chains ({counted} draws)."
    )


def _centres(local: Array, placements: Array) -> Array:
    """(n, 2) where a point of the scenelet's frame lies in the world."""
    x, y, yaw = placements[:, :3].T
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * local[0] - s * local[1], y + s * local[0] + c * local[1]], -1)
