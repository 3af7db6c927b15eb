"""Whether the samples in a file are samples of its problem, before anything is made of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.problem import Problem
from imapper_prob.models.valid import check_state
from imapper_prob.samplers.diagnostics import LayoutProbabilities
from imapper_prob.sampling.placements import PlacementDraws
from imapper_prob.sampling.sample import Samples

__all__ = ["check_origins", "check_samples", "require"]

_LARGEST = 1e12
"""Of any log-posterior, in nats."""


def require(holds: bool | np.bool_, what: str) -> None:
    """Raise an `InputError` that says what is wrong unless it ``holds``."""
    if not holds:
        raise InputError(what)


def check_origins(origins: NDArray[np.int64], slots: int, counts: NDArray[np.int64]) -> None:
    """Whether objects (n, 2) are of slots that a draw has, whose scenelets have ``counts``."""
    slot, number = origins.T
    require(((slot >= 0) & (slot < slots)).all(), "an object of a draw is of no scenelet of it")
    inside = (number >= 0) & (number < counts[slot])
    require(inside.all(), "an object of a draw is none of its scenelet")


def check_samples(problem: Problem, samples: Samples) -> None:
    """Refuse samples that contradict each other or their problem.

    Raises
    ------
    InputError
        With what is wrong.
    """
    chains, draws = samples.shape
    count = chains * draws
    require(count > 0 and len(samples.states) == count, "draws and their log-posterior differ")
    require(_finite(samples.log_posterior, most=_LARGEST), "log_posterior is not finite")
    traces = samples.traces
    require(traces.ndim == 2 and len(traces) == chains, "traces are not those of the chains")
    require(traces.shape[1] > 0 and not np.isinf(traces).any(), "traces are not finite")
    for state in samples.states:
        check_state(problem, state)
    layouts = samples.layouts
    number = len(layouts.leaders)
    require(layouts.indicator.shape == (count,), "layouts are not those of the draws")
    seen = np.unique(layouts.indicator)
    require(np.array_equal(seen, np.arange(number)), "layouts and their leaders differ")
    require(all(0 <= leader < count for leader in layouts.leaders), "a leader is no draw")
    _check_probabilities(samples.probabilities, chains, number)
    pair = samples.verdict.disagreement or ()
    require(all(1 <= layout <= number for layout in pair), "the verdict speaks of no layout")
    for placements in samples.placements:
        _check_placements(problem, placements)
    require(len(samples.ladders) == chains, "ladders are not those of the chains")
    table = samples.acceptance
    rates = zip(table.proposed.values(), table.accepted.values(), strict=True)
    require(all(0 <= a <= p for p, a in rates), "more moves were accepted than proposed")


def _check_probabilities(found: LayoutProbabilities, chains: int, number: int) -> None:
    numbers = np.sort(found.layouts)
    require(np.array_equal(numbers, 1 + np.arange(number)), "layouts have other numbers")
    require(found.probability.shape == (number,), "a layout has no probability")
    require(found.standard_error.shape == (number,), "a layout has no error")
    require(found.by_chain.shape == (chains, number), "layouts are not by chain")
    require(found.by_half.shape == (chains, 2, number), "layouts are not by half")
    for values in (found.probability, found.by_chain, found.by_half):
        require(_finite(values, most=1 + 1e-9) and (values >= 0).all(), "a probability is none")


def _check_placements(problem: Problem, draws: PlacementDraws) -> None:
    shape, slots = draws.camera.shape[:3], len(draws.items)
    require(draws.camera.ndim == 4 and draws.camera.shape[3] == 5, "ensembles lack cameras")
    require(min(shape) > 0, "ensembles have no draws")
    require(draws.placements.shape == (*shape, slots, 3), "ensembles lack placements")
    require(draws.sizes.shape == (*shape, slots), "ensembles lack sizes")
    scenelets = draws.items[:, 0]
    inside = (scenelets >= 0) & (scenelets < len(problem.log_rate))
    require(inside.all(), "ensembles have a scenelet that is not there")
    for values in (draws.camera, draws.placements, draws.sizes):
        require(_finite(values, most=_LARGEST), "ensembles are not finite")


def _finite(values: NDArray[np.float64], *, most: float) -> bool:
    return bool((np.abs(values) <= most).all())
