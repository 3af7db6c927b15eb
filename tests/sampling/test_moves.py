"""The prior comes back, whatever moves are made, and moves do what they are for."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from emcee.autocorr import integrated_time

from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.reversible_jump import Mixture, sample
from imapper_prob.samplers.tempering import POSTERIOR
from imapper_prob.sampling.learning import learn
from imapper_prob.sampling.steps import SceneChain
from imapper_prob.sampling.visits import Visits
from lab.prior import draw_state
from tests.models import worlds
from tests.sampling.scenes import SceneMove, in_order, moves_of, random_gains, similarity

N_FRAMES = 20
PROBLEM = worlds.problem(N_FRAMES)


def exact_counts(problem: Problem) -> np.ndarray:
    """P(k) under the prior, by counting non-overlapping arrangements."""
    rates, lengths = np.exp(problem.log_rate), problem.lengths
    n = problem.n_frames
    weight = np.zeros((n + 1, n + 1))  # frames used, scenelets
    weight[0, 0] = 1.0
    for t in range(1, n + 1):
        weight[t] = weight[t - 1]
        for rate, length in zip(rates, lengths, strict=True):
            if t >= length:
                weight[t, 1:] += rate * weight[t - length, :-1]
    return weight[n] / weight[n].sum()


def chain_error(values: np.ndarray) -> float:
    """Standard error of a chain's mean, by its integrated autocorrelation time."""
    time = float(integrated_time(values, tol=20)[0])
    return float(values.std() * np.sqrt(time / len(values)))


def prior_problem() -> Problem:
    return worlds.problem(N_FRAMES, settings=ModelSettings(likelihood=0.0, scenelet_rate=0.3))


@pytest.fixture(scope="module", params=[120_000, pytest.param(500_000, marks=pytest.mark.slow)])
def prior_draws(request: pytest.FixtureRequest) -> list[State]:
    """Every fifth state of a chain, whose reference is learnt from the prior."""
    problem, rng, visits = prior_problem(), np.random.default_rng(2), Visits()
    for _ in range(200):
        visits.note(draw_state(rng, problem))
    moves = moves_of(problem)._replace(
        reference=learn(problem, random_gains(problem), similarity(), visits)
    )
    chain = SceneChain(problem, moves, empty_state(problem))
    chain.advance(rng, POSTERIOR, 1000)
    return [chain.advance(rng, POSTERIOR, 5)[0].state for _ in range(request.param // 5)]


def test_prior_of_the_number_of_scenelets_comes_back(prior_draws: list[State]) -> None:
    exact = exact_counts(prior_problem())
    counts = np.array([s.n_scenelets for s in prior_draws])
    assert exact[:3].min() > 0.05
    for k in range(3):
        hit = (counts == k).astype(float)
        assert abs(hit.mean() - exact[k]) < 4.5 * chain_error(hit), (k, hit.mean(), exact[k])


def test_prior_of_starts_yaw_camera_and_position_comes_back(prior_draws: list[State]) -> None:
    problem = prior_problem()
    first = [s for s in prior_draws if s.n_scenelets == 1]
    yaw = np.array([s.placements[0, 2] for s in first])
    for m in (1, 2):
        for part in (np.cos(m * yaw), np.sin(m * yaw)):
            assert abs(part.mean()) < 4.5 * chain_error(part)
    # One scenelet alone: any start is as probable as any other.
    starts = np.array([s.items[0, 1] for s in first])
    early = (starts < 7).astype(float)
    assert abs(early.mean() - 7 / 15) < 4.5 * chain_error(early)
    camera = np.array([s.camera for s in prior_draws])
    spread = np.sqrt(np.diag(np.linalg.inv(problem.camera_precision)))
    for i in range(5):
        scaled = (camera[:, i] - problem.camera_mean[i]) / spread[i]
        assert abs(scaled.mean()) < 4.5 * chain_error(scaled)
        assert abs((scaled**2).mean() - 1) < 4.5 * chain_error(scaled**2)
    size = np.array([s.sizes[0] for s in first]) / problem.size_spread
    assert abs(size.mean()) < 4.5 * chain_error(size)
    assert abs((size**2).mean() - 1) < 4.5 * chain_error(size**2)
    latent = np.array([s.latent[3, 1] for s in prior_draws])
    assert abs((latent**2).mean() - 1) < 4.5 * chain_error(latent**2)


def test_a_longer_lens_from_further_away_sees_the_same() -> None:
    """Much more nearly than if only the focal length or only the depths had changed."""
    problem = worlds.problem(N_FRAMES, seed=4)
    state = empty_state(problem).with_item(1, 5, np.array([0.3, 4.0, 0.5]))
    focal, rng = SceneMove(moves_of(problem), "focal-scale"), np.random.default_rng(2)
    for _ in range(20):
        proposal = focal.propose(rng, state)
        after = proposal.state
        step = after.camera[2] - state.camera[2]
        assert proposal.log_ratio == pytest.approx(0.0)  # of pitch and one depth
        both = np.abs(_pixels(problem, after) - _pixels(problem, state)).max()
        lens = replace(state, camera=after.camera)
        assert both < 0.4 * np.abs(_pixels(problem, lens) - _pixels(problem, state)).max()
        assert after.placements[0, 1] == pytest.approx(4.0 * np.exp(step))


def _pixels(problem: Problem, state: State) -> np.ndarray:
    """Where the joints of the scenelet's frames are seen."""
    pitch, elevation, focal, _, roll = state.camera.tolist()
    camera = Camera(
        1920, 1080, problem.fx, problem.fy, problem.cx, problem.cy,
        pitch=pitch, roll=roll, elevation=elevation,
    )  # fmt: skip
    seen = camera.posed(
        pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(focal))
    )
    start, n = int(state.items[0, 1]), int(problem.lengths[state.items[0, 0]])
    return seen.project(motion(problem, state)[start : start + n])


@pytest.mark.slow
def test_a_forgotten_jacobian_is_noticed() -> None:
    """Mutation: a placement walk without (y' / y)^2 must fail the prior test's statistic."""

    class Forgetful(SceneMove):
        def propose(self, rng, state):  # type: ignore[no-untyped-def]
            proposal = super().propose(rng, state)
            return None if proposal is None else proposal._replace(log_ratio=0.0)

    problem = prior_problem()
    start = empty_state(problem).with_item(0, 0, np.array([0.0, 4.0, 0.0]))

    def depth_score(walk: SceneMove) -> float:
        chain = sample(
            np.random.default_rng(3),
            start,
            log_density_fn=lambda s: log_posterior(problem, s),
            mixture=Mixture([walk], [1.0]),
        )
        # Seen first under a scenelet, log depth has its prior: mean log 4, s.d. .4.
        depth = np.log([at.state.placements[0, 1] for at, _ in islice(chain, 500, 40_000)])
        return float((depth.mean() - np.log(4.0)) / chain_error(depth))

    moves = moves_of(problem)
    assert abs(depth_score(SceneMove(moves, "placement"))) < 4.5
    assert abs(depth_score(Forgetful(moves, "placement"))) > 6


def test_what_is_flush_is_shifted_together_or_alone() -> None:
    """Scenelets of six frames: the first two follow without a gap, the third after one."""
    state = empty_state(PROBLEM)
    for start in (0, 6, 13):
        state = state.with_item(0, start, np.array([0.0, 4.0, 0.0]))
    state = replace(state, items=state.items + np.array([0, 1]))
    move, rng = SceneMove(moves_of(PROBLEM), "shift"), np.random.default_rng(0)
    proposals = [p for p in (move.propose(rng, state) for _ in range(1000)) if p is not None]
    seen = {tuple(p.state.items[:, 1].tolist()) for p in proposals if in_order(PROBLEM, p.state)}
    # The first two a frame later would be flush with the third, and all three would go back.
    assert seen == {(0, 6, 14), (0, 7, 14), (1, 8, 14), (1, 7, 13)}
    assert all(p.log_ratio == 0.0 for p in proposals)
