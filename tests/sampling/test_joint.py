"""Scenes and data stay what they were, whatever moves are made (after Geweke 2004).

A scene drawn from the prior is, given data drawn of it, a draw of the posterior: moves that
leave the posterior as it is may be made from there, and scene and data are jointly distributed
as before. Every pair is drawn anew, so that nothing has to mix and errors are those of
independent numbers. Errors made on purpose show what this sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.log_posterior import State, log_posterior, motion, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV
from imapper_prob.samplers.reversible_jump import Mixture, Proposal, init, step
from imapper_prob.samplers.tempering import LogDensityParts, start, temper
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.redraws import draw_scene
from imapper_prob.sampling.reference import Reference
from imapper_prob.sampling.scene import state_of
from imapper_prob.sampling.steps import Moves, parts_of, scene_moves
from imapper_prob.sampling.visits import Visits
from lab.prior import Experiment, draw_state
from tests.models import worlds
from tests.samplers.kernel_chain import KernelChain
from tests.sampling.scenes import SceneMove, mixture_of, random_gains

N_FRAMES = 20
LIMIT = 4.2
"""Standard errors; the largest of twenty is beyond once in 1,900 times."""
Change = Callable[[Mixture[State]], Mixture[State]]


def poor_data(rate: float = 0.12, depth: float = 0.1) -> Experiment:
    """A joint every fourth frame, and that not well, so that much is left open."""
    settings = ModelSettings(scenelet_rate=rate, start_bearing=0.02, start_log_depth=depth)
    given = worlds.experiment(
        N_FRAMES, joints_a_frame=1, doubt=(0.02, depth), settings=settings,
        scenelets=worlds.mixed_library(),
    )  # fmt: skip
    (track,), model = given.clip.tracks, DetectionModel()
    confidences = track.confidences.copy()
    confidences[np.arange(N_FRAMES) % 4 != 0] = 0.0
    return replace(
        given,
        clip=replace(given.clip, tracks=(replace(track, confidences=confidences),)),
        # Feet may go below the floor, or else the floor would say how far away somebody is.
        settings=replace(given.settings, motion_cost=0.2),
        detections=replace(model, error_scale=6 * model.error_scale),
    )


def similarity(problem: Problem) -> np.ndarray:
    """All alike."""
    n = len(problem.lengths)
    return (np.ones((n, n)) - np.eye(n)) / (n - 1)


def reference_of(problem: Problem) -> Reference:
    """Learnt from scenes of the prior, with gains that know nothing of the data either."""
    rng, visits = np.random.default_rng(0), Visits()
    for _ in range(200):
        visits.note(draw_state(rng, problem))
    return learn(problem, random_gains(problem), similarity(problem), visits)


def moves_of(problem: Problem, reference: Reference) -> Moves:
    shape = 0.5 * np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    return scene_moves(problem, reference, shape)


def asked(problem: Problem, state: State) -> dict[str, float]:
    """Quantities, their squares where these say something else, and how they go with the data."""
    nats = terms(problem, state)
    pelvis = motion(problem, state)[:, PELV]
    where, ends = state.placements[:, 1], state.items[:, 1] + problem.lengths[state.items[:, 0]]
    values = {
        "log-likelihood": nats["detections"],
        "costs": nats["collision"] + nats["motion"] + nats["ground"],
        "scenelets": state.n_scenelets,
        "covered": int(problem.lengths[state.items[:, 0]].sum()),
        "starts": float(state.items[:, 1].sum()),
        "without a gap": int((ends[:-1] == state.items[1:, 1]).sum()),
        "which": float((state.items[:, 0] % 3).sum()),
        "log depth": float(np.log(np.maximum(pelvis[10, 1], 0.1))),
        "bearing": float(pelvis[10, 0] / pelvis[10, 1]),
        "sizes": float(state.sizes.sum()),
        "depths": float(np.log(np.maximum(where / 4.0, 0.1)).sum()),
        "yaws": float(np.cos(state.placements[:, 2] - 1.0).sum()),
        "latent": float(state.latent[5, 1]),
    }
    values |= {f"camera {i}": value for i, value in enumerate(state.camera.tolist())}
    squares = ("log depth", "bearing", "sizes", "latent", "yaws")
    return values | {f"{name} squared": values[name] ** 2 for name in squares}


def scores(
    n_pairs: int,
    *,
    steps: int = 60,
    change: Change = lambda mixture: mixture,
    drawn_with: DetectionModel | None = None,
    sampled: Callable[[Problem], Problem] = lambda problem: problem,
    given: Experiment | None = None,
    seed: int = 0,
) -> dict[str, float]:
    """How many standard errors each quantity has changed by, on average over pairs."""
    given = given or poor_data()
    source = given if drawn_with is None else replace(given, detections=drawn_with)
    # Moves know nothing of the data.
    mixture = change(mixture_of(moves_of(given.problem, reference_of(given.problem))))
    differences: dict[str, list[float]] = {}
    for rng in np.random.default_rng(seed).spawn(n_pairs):
        state = draw_state(rng, given.problem)
        seen = replace(source.observed(rng, state), detections=given.detections)
        problem = sampled(seen.problem)
        density = partial(log_posterior, problem)
        at = init(density, state)
        for _ in range(steps):
            at, _ = step(rng, at, log_density_fn=density, mixture=mixture)
        before, after = asked(problem, state), asked(problem, at.state)
        for name, value in after.items():
            differences.setdefault(name, []).append(value - before[name])
    return in_standard_errors(differences)


def in_standard_errors(differences: dict[str, list[float]]) -> dict[str, float]:
    """Means over pairs of what has changed at all."""
    return {
        name: float(np.mean(d) / (np.std(d) / np.sqrt(len(d))))
        for name, d in differences.items()
        if np.std(d) > 0
    }


def largest(found: dict[str, float]) -> float:
    return max(abs(score) for score in found.values())


def test_scene_and_data_stay_what_they_were() -> None:
    found = scores(500)
    assert len(found) > 15
    assert largest(found) < LIMIT, found


@pytest.mark.slow
def test_scene_and_data_stay_what_they_were_to_a_few_per_cent() -> None:
    assert largest(found := scores(6000, seed=1)) < LIMIT, found


def only(
    name: str, changed: Callable[[Proposal[State]], Proposal[State]] = lambda proposal: proposal
) -> Change:
    """A move by itself, its proposals changed."""

    class Wrong(SceneMove):
        def propose(self, rng: np.random.Generator, state: State) -> Proposal[State] | None:
            proposal = super().propose(rng, state)
            return None if proposal is None else changed(proposal)

    def change(mixture: Mixture[State]) -> Mixture[State]:
        right = mixture.moves[0]
        assert isinstance(right, SceneMove)
        return Mixture([Wrong(right.moves, name)], [1.0])

    return change


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["camera-adapted", "shift", "replace", "camera-compensated"],
)
def test_a_move_by_itself_leaves_scene_and_data(name: str) -> None:
    """With so many scenelets that some have no gap to the next."""
    found = scores(400, change=only(name), given=poor_data(rate=0.3))
    assert largest(found) < LIMIT, found


def two_rungs(n_pairs: int, *, off: float = 0.0) -> dict[str, float]:
    """As :func:`scores`, of the colder of two rungs after a few rounds of exchanges.

    The hotter one is at the reference itself, from which every state of it is drawn, so that both
    are where they should be from the beginning.
    """
    given = poor_data(rate=0.3)
    reference = reference_of(given.problem)
    walk = partial(step, mixture=mixture_of(moves_of(given.problem, reference), ["placement"]))
    differences: dict[str, list[float]] = {}
    for rng in np.random.default_rng(0).spawn(n_pairs):
        state = draw_state(rng, given.problem)
        problem = replace(given.observed(rng, state), detections=given.detections).problem

        def target(state: State, problem: Problem = problem) -> LogDensityParts:
            parts = parts_of(problem, reference, state)
            wrong = off * state.n_scenelets
            return LogDensityParts(parts.log_prior + wrong, parts.log_likelihood - wrong)

        def independent(rng: np.random.Generator) -> State:
            return state_of(draw_scene(reference, rng))

        hot = independent(rng)
        while not np.isfinite(log_posterior(problem, hot)):
            hot = independent(rng)
        position = start((hot, state), target=target, betas=(0.0, 1.0))
        rounds = temper(
            rng.spawn(3), position, chain_at=partial(KernelChain, target, walk), steps_per_swap=1,
            independent=independent, crossover=TimeCrossover(problem),
        )  # fmt: skip
        *_, last = islice(rounds, 12)
        before, after = asked(problem, state), asked(problem, last.state.chains[-1].state)
        for name, value in after.items():
            differences.setdefault(name, []).append(value - before[name])
    return in_standard_errors(differences)


@pytest.mark.parametrize("off", [0.0, pytest.param(4.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["scene-redraw", pytest.param("redraw", marks=pytest.mark.slow)])
def test_draws_of_the_reference_leave_scene_and_data(name: str, off: float) -> None:
    """Unless what is drawn is not as dense as is said, here by a factor a scenelet."""
    given = poor_data(rate=0.3)

    def wrong(proposal: Proposal[State]) -> Proposal[State]:
        return proposal._replace(
            log_ratio=proposal.log_ratio + off * proposal.state.n_scenelets
        )  # fmt: skip

    found = scores(400, steps=20, change=only(name, wrong), given=given)
    assert (largest(found) > LIMIT) == (off > 0), found


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.0, 2.0])
def test_exchanges_with_the_reference_leave_scene_and_data(off: float) -> None:
    """Unless its density is not that of its draws: here by a factor a scenelet."""
    found = two_rungs(500, off=off)
    assert (largest(found) > LIMIT) == (off > 0), found


@pytest.mark.slow
def test_a_look_the_wrong_way_is_seen() -> None:
    change = only("camera-compensated", lambda p: p._replace(log_ratio=-p.log_ratio))
    found = scores(900, change=change, given=poor_data(rate=0.3, depth=0.4))
    assert largest(found) > LIMIT, found


@pytest.mark.parametrize("wrong", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_jacobian_the_wrong_way_is_seen(wrong: bool) -> None:
    change = only("placement", lambda p: p._replace(log_ratio=-p.log_ratio) if wrong else p)
    found = scores(300, change=change, given=poor_data(rate=0.3, depth=0.4))
    assert (largest(found) > LIMIT) == wrong, found


@pytest.mark.slow
def test_hidden_and_seen_exchanged_is_seen() -> None:
    model = poor_data().detections
    exchanged = replace(
        model,
        confidence=model.confidence[::-1],
        error_scale=model.error_scale[::-1],
        error_dof=model.error_dof[::-1],
    )
    found = scores(300, drawn_with=exchanged)
    assert abs(found["log-likelihood"]) > LIMIT, found


@pytest.mark.slow
def test_a_rate_that_is_too_high_is_seen() -> None:
    def wrong(problem: Problem) -> Problem:
        return problem._replace(log_rate=problem.log_rate + np.log(len(problem.lengths)))

    found = scores(300, sampled=wrong)
    assert abs(found["scenelets"]) > LIMIT, found
