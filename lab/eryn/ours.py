"""The project's own sampler on both targets.

``python -m lab.eryn.ours TARGET OUT RUNS BURN_IN SECONDS FIRST_SEED``
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.samplers.ladder import power_ladder
from imapper_prob.samplers.reversible_jump import Mixture, Proposal, sample
from imapper_prob.samplers.tempering import start, temper
from imapper_prob.sampling.chain import Setup, TemperedProblem, tempered
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.sample import setup_of
from imapper_prob.sampling.steps import MOVES
from imapper_prob.sampling.visits import Visits
from lab.eryn import gaussian
from lab.eryn.exchange import during, save_runs
from lab.eryn.leaves import to_leaves
from lab.eryn.scene import solve_scene

Array = NDArray[np.float64]

EVERY = 20
"""Steps between two draws that are kept; indicators are correlated over thousands of steps."""
RUNGS, STEPS_PER_SWAP = 6, 5
"""Number of temperatures. With one alone, three of four chains never find the two adjacent
scenelets that are the most probable scene."""
LEARNT_AFTER = (200, 400, 800)
"""Rounds after each of which the reference is learnt from the states visited in them. Their draws
belong to the burn-in."""


@dataclass(frozen=True)
class Birth:
    """Add a signal drawn from the prior at a random position among the others."""

    name: str = "birth"
    reverse: str = "death"

    def propose(self, rng: np.random.Generator, signals: Array) -> Proposal[Array] | None:
        """Impossible if the number of signals is greatest."""
        if len(signals) == gaussian.MOST:
            return None
        new = rng.standard_normal(gaussian.DIMENSION)
        at = int(rng.integers(len(signals) + 1))
        return Proposal(np.insert(signals, at, new, axis=0), -float(gaussian.log_prior(new)))


@dataclass(frozen=True)
class Death:
    """Remove a random signal."""

    name: str = "death"
    reverse: str = "birth"

    def propose(self, rng: np.random.Generator, signals: Array) -> Proposal[Array] | None:
        """Impossible if there is no signal."""
        if len(signals) == 0:
            return None
        at = int(rng.integers(len(signals)))
        log_ratio = float(gaussian.log_prior(signals[at]))
        return Proposal(np.delete(signals, at, axis=0), log_ratio)


@dataclass(frozen=True)
class Walk:
    """Move a random signal by a normal step."""

    scale: float = 0.5
    name: str = "walk"
    reverse: str = "walk"

    def propose(self, rng: np.random.Generator, signals: Array) -> Proposal[Array] | None:
        """Propose a symmetric step."""
        if len(signals) == 0:
            return None
        walked = signals.copy()
        step = self.scale * rng.standard_normal(gaussian.DIMENSION)
        walked[int(rng.integers(len(signals)))] += step
        return Proposal(walked, 0.0)


def gaussian_chain(seed: int) -> Iterator[Array]:
    """Signals after each step."""
    chain = sample(
        np.random.default_rng(seed),
        np.empty((0, gaussian.DIMENSION)),
        log_density_fn=lambda signals: float(
            gaussian.log_prior(signals).sum() + gaussian.log_likelihood(signals.sum(0))
        ),
        mixture=Mixture((Birth(), Death(), Walk()), (0.3, 0.3, 0.4)),
    )
    return (at.state for at, _ in chain)


def scene_chain(setup: Setup, first: State, seed: int) -> Iterator[State]:
    """Every twentieth state, with the project's moves except that of the path."""
    rngs, betas = np.random.default_rng(seed).spawn(RUNGS + 1), power_ladder(RUNGS)
    states, visits = [first] * RUNGS, Visits()
    for state in setup.staged:
        visits.note(state)
    for rounds in (*LEARNT_AFTER, None):
        learnt = _without_path(tempered(setup, visits))
        chain = temper(
            rngs,
            start(states, target=learnt.target, betas=betas),
            chain_at=learnt.chain_at,
            steps_per_swap=STEPS_PER_SWAP,
            adapt=rounds is not None,
            crossover=TimeCrossover(setup.problem),
            independent=partial(_still_scene, learnt),
        )
        visits = Visits()
        for number, at in enumerate(islice(chain, rounds)):
            if rounds is not None:
                for beta, rung in zip(at.state.betas, at.state.chains, strict=True):
                    visits.note(rung.state, beta)
            if number % (EVERY // STEPS_PER_SWAP) == 0:
                yield at.state.chains[-1].state
        states, betas = [rung.state for rung in at.state.chains], at.state.betas


def _without_path(learnt: TemperedProblem) -> TemperedProblem:
    """The moves without those of the path; redraws of intervals replace those of scenes."""
    still = [name not in ("path", "scene-redraw") for name in MOVES]
    moves = learnt.moves._replace(weights=learnt.moves.weights * still)
    return replace(learnt, moves=moves)


def _still_scene(learnt: TemperedProblem, rng: np.random.Generator) -> State:
    """A scene of the reference with the mean path, which is constant here."""
    drawn = learnt.independent(rng)
    return replace(drawn, latent=np.zeros_like(drawn.latent))


def padded(states: list[State], most: int) -> dict[str, Array]:
    """States in Eryn's form: up to ``most`` leaves, one walker."""
    leaves = [to_leaves(state) for state in states]
    filled = np.array([np.pad(own, ((0, most - len(own)), (0, 0))) for own in leaves])
    alive = np.arange(most) < np.array([len(own) for own in leaves])[:, None]
    cameras = np.array([state.camera for state in states])
    return {"leaves": filled[:, None], "alive": alive[:, None], "cameras": cameras[:, None]}


def main(target: str, path: str, runs: int, burn_in: float, seconds: float, first: int) -> None:
    """Run a target ``runs`` times with different seeds and store the draws."""
    results: list[dict[str, Array]] = []
    if target == "gaussian":
        for seed in range(first, first + runs):
            kept = during(gaussian_chain(seed), burn_in, seconds)
            results.append({"count": np.array([len(signals) for signals in kept])[:, None]})
    else:
        solution = solve_scene()
        problem = solution.problem
        most = problem.n_frames // int(problem.lengths.min())
        setup = setup_of(solution, SampleSettings())
        still = np.zeros_like(solution.states[0].latent)
        starts = [replace(solution.states[0], latent=still), empty_state(problem)]
        for seed in range(first, first + runs):
            chain = scene_chain(setup, starts[seed % 2], seed)
            results.append(padded(list(during(chain, burn_in, seconds)), most))
    save_runs(Path(path), results)


if __name__ == "__main__":
    target, path, runs, burn_in, seconds, first = sys.argv[1:]
    main(target, path, int(runs), float(burn_in), float(seconds), int(first))
