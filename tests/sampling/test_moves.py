"""Every move's ratio is what its two directions say, and the prior comes back."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from emcee.autocorr import integrated_time
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from imapper_prob.config import SampleSettings
from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.camera import Camera
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.samplers.reversible_jump import Mixture, sample
from imapper_prob.sampling.camera_moves import CameraFrame, FocalScale
from imapper_prob.sampling.chain import Setup, scene_moves
from imapper_prob.sampling.moves import Birth, Death, PlacementWalk, ReplaceNearby, Shift
from imapper_prob.sampling.proposals import Candidates, Proposals, log_wrapped_normal
from imapper_prob.sampling.replace_moves import (
    Refurnish,
    Replace,
    ReplaceAndShift,
    log_choice,
    window_of,
)
from tests.models import worlds

N_FRAMES = 20


def candidates(seed: int = 0) -> Candidates:
    """Three scenelets in five windows, the last of which has not fitted everywhere."""
    rng = np.random.default_rng(seed)
    shape = (5, 3)
    places = np.stack(
        [rng.normal(0, 0.5, shape), rng.uniform(3, 5, shape), rng.uniform(-3, 3, shape)], -1
    )
    weights = rng.uniform(0.2, 1, shape)
    weights[1, 2] = 0.0
    return Candidates(np.array([3, 6, 9, 13, 16]), places, rng.normal(0, 0.03, shape), weights)


def even_candidates() -> Candidates:
    """All scenelets alike, everywhere."""
    return Candidates(
        np.array([3, 6, 9, 13, 16]),
        np.tile([0.0, 4.0, 0.0], (5, 3, 1)),
        np.zeros((5, 3)),
        np.ones((5, 3)),
    )


def similarity() -> np.ndarray:
    """The second is more like the first than the third is."""
    return np.array([[0.0, 0.7, 0.3], [0.6, 0.0, 0.4], [0.5, 0.5, 0.0]])


def setup(problem: Problem) -> Setup:
    return Setup(problem, candidates(), similarity(), SampleSettings(), (empty_state(problem),))


def random_state(problem: Problem, seed: int) -> State:
    """A state with as many scenelets as a few random births manage to fit in."""
    rng = np.random.default_rng(seed)
    state = empty_state(problem)
    birth = Birth(Proposals(problem, candidates()))
    for _ in range(int(rng.integers(0, 5))):
        proposal = birth.propose(rng, state)
        state = state if proposal is None else proposal.state
    return state


PROBLEM = worlds.problem(N_FRAMES)


@hypothesis_settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_ratios_of_jumps_are_explained_by_both_directions(seed: int) -> None:
    proposals = Proposals(PROBLEM, candidates())
    birth, death, swap = Birth(proposals), Death(proposals), ReplaceNearby(proposals)
    replacing = Replace(proposals)
    state = random_state(PROBLEM, seed)
    rng = np.random.default_rng(seed)
    same = ((move, move) for move in (swap, replacing))
    pairs = ((birth, death), (death, birth), *same)
    for move, reverse in pairs:
        proposal = move.propose(rng, state)
        if proposal is None:
            continue
        forward = move.explain(state, proposal.state)
        backward = reverse.explain(proposal.state, state)
        assert proposal.log_ratio == pytest.approx(backward - forward, abs=1e-8)


@pytest.mark.parametrize("around", [None, 6])
@pytest.mark.parametrize("where", ["candidate", "anywhere"])
@pytest.mark.parametrize("crowded", [False, True])
@pytest.mark.parametrize("count", [7000, pytest.param(12000, marks=pytest.mark.slow)])
def test_proposals_are_a_density(where: str, around: int | None, crowded: bool, count: int) -> None:
    """The mean of h / q over draws of q is the integral of h, here of a density: one."""
    proposals = Proposals(PROBLEM, candidates())
    rng = np.random.default_rng(1)
    others = np.array([[0, 11]]) if crowded else np.empty((0, 2), np.int64)
    window, scenelet_of_h = 1, 0
    # A body 3 % larger, a shorter lens, and another pitch, roll and elevation than was fitted with.
    camera = PROBLEM.camera_mean + np.array([0.01, 0.05, -0.02, 0.03, 0.02])
    if where == "candidate":
        found = proposals.carried(CameraFrame(camera), window, scenelet_of_h)
        assert found is not None
        stand, usual, deviation = found
        yaw = proposals.candidates.placements[window, scenelet_of_h, 2]
        centre = np.array([stand.x / stand.y, np.log(stand.y) - 0.9 * stand.size + 0.01])
        spread = np.array([0.004, 0.03])
    else:
        usual, deviation = 0.0, PROBLEM.size_spread
        yaw, centre, spread = 0.0, PROBLEM.start_mean, np.sqrt(PROBLEM.start_variance) / 2
    n_starts = 15 if around is None else 7

    def log_h(scenelet: int, start: int, placement: np.ndarray, size: float) -> float:
        x, y, turn = placement
        # Of the sizes tried the smaller, further away than they look.
        of_size = norm.logpdf(size, usual - 0.01, 0.8 * deviation)
        offset = (np.array([x / y, np.log(y) - 0.9 * size]) - centre) / spread
        value = of_size - 0.5 * offset @ offset - np.log(2 * np.pi * spread.prod()) - 2 * np.log(y)
        if where == "anywhere":
            return float(value - np.log(2 * np.pi) - np.log(3 * n_starts))
        if (scenelet, start) != (scenelet_of_h, 3):
            return -np.inf
        return float(value + log_wrapped_normal(turn - yaw, 0.12))

    weights = []
    for _ in range(count):
        drawn = proposals.draw(rng, camera, others, around=around, window=3)
        assert drawn is not None
        density = proposals.log_density(*drawn, camera, others, around=around, window=3)
        weights.append(np.exp(log_h(*drawn) - density))
    error = np.std(weights) / np.sqrt(len(weights))
    assert error < 0.2
    assert abs(np.mean(weights) - 1) < 4.5 * error


def test_windows_under_a_scenelet_that_stays_are_not_tried() -> None:
    proposals = Proposals(PROBLEM, candidates())
    rng = np.random.default_rng(0)
    others = np.array([[0, 6]])
    middles = [
        proposals.middle(scenelet, start)
        for scenelet, start, *_ in (
            proposals.draw(rng, PROBLEM.camera_mean, others) for _ in range(300)
        )
    ]
    inside = np.mean([7 <= m <= 10 for m in middles])
    assert inside < 0.05


def test_a_replacement_stands_to_its_fit_as_the_old_one_did() -> None:
    proposals = Proposals(PROBLEM, candidates())
    placements = proposals.candidates.placements
    x, y, yaw = placements[0, 0]
    moved = np.array([1.1 * (x + 0.1 * y), 1.1 * y, yaw + 0.2])
    state = empty_state(PROBLEM).with_item(0, 0, moved)
    rng = np.random.default_rng(0)
    proposal = next(iter(lambda: Replace(proposals).propose(rng, state), None))
    new, start = proposal.state.items[0].tolist()
    assert proposals.middle(new, start) == proposals.middle(0, 0)
    fx, fy, fyaw = placements[0, new]
    ox, oy, oyaw = proposal.state.placements[0]
    assert ox / oy - fx / fy == pytest.approx(0.1)
    assert oy / fy == pytest.approx(1.1)
    assert oyaw - fyaw == pytest.approx(0.2)


def test_wrapped_normal_integrates_to_one() -> None:
    for spread in (0.15, 2.0):
        total, _ = quad(lambda a, s=spread: np.exp(log_wrapped_normal(a, s)), 1, 1 + 2 * np.pi)
        assert total == pytest.approx(1.0, abs=1e-3)


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


def draw_prior(mixture: Mixture[State], problem: Problem, *, seed: int, steps: int) -> list[State]:
    chain = sample(
        np.random.default_rng(seed),
        empty_state(problem),
        log_density_fn=lambda s: log_posterior(problem, s),
        mixture=mixture,
    )
    return [at.state for at, _ in islice(chain, 1000, steps, 5)]


def prior_problem() -> Problem:
    return worlds.problem(N_FRAMES, settings=ModelSettings(likelihood=0.0, scenelet_rate=0.3))


@pytest.fixture(scope="module", params=[120_000, pytest.param(300_000, marks=pytest.mark.slow)])
def prior_draws(request: pytest.FixtureRequest) -> list[State]:
    problem = prior_problem()
    shape = 0.5 * np.linalg.cholesky(np.linalg.inv(problem.camera_precision))
    moves = scene_moves(setup(problem), shape=shape)
    # Under the prior most births are refused: candidates are far too narrow for it.
    often = [
        20 * weight if move.name in ("birth", "death") else weight
        for move, weight in zip(moves.moves, moves.weights, strict=True)
    ]
    return draw_prior(Mixture(moves.moves, often), problem, seed=2, steps=request.param)


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
    rng = np.random.default_rng(2)
    for _ in range(20):
        proposal = FocalScale(0.2).propose(rng, state)
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


def test_refurnishing_changes_all_that_share_a_couch_and_nothing_else() -> None:
    proposals = Proposals(PROBLEM, even_candidates())
    move = Refurnish(proposals, furniture_kinds(PROBLEM))
    near, far = np.array([0.0, 4.0, 0.0]), np.array([2.0, 4.0, 0.0])
    state = empty_state(PROBLEM).with_item(0, 0, near).with_item(1, 6, near + 0.1)
    state = state.with_item(0, 12, far)
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(20):
        proposal = move.propose(rng, state)
        assert proposal is not None
        seen.add(tuple(proposal.state.items[:, 0].tolist()))
        np.testing.assert_allclose(proposal.state.placements, state.placements)
    assert seen == {(2, 2, 0), (0, 1, 2)}
    # Two couches are as likely for each of two chairs: the way back is 1/4 of the way there.
    both = next(p for p in iter(lambda: move.propose(rng, state), None) if p.state.items[0, 0] == 2)
    assert both.log_ratio == pytest.approx(np.log(1 / 4))


def test_refurnishing_a_group_has_the_ratio_of_its_replacements() -> None:
    """One scenelet alone: the ratio is that of a replacement restricted to the other kind."""
    proposals = Proposals(PROBLEM, candidates())
    move = Refurnish(proposals, furniture_kinds(PROBLEM))
    state = empty_state(PROBLEM).with_item(1, 5, np.array([0.2, 4.0, 0.3]))
    rng = np.random.default_rng(0)
    proposal = next(iter(lambda: move.propose(rng, state), None))
    assert proposal.state.items[0, 0] == 2
    weights = proposals.candidates.weights[1 if proposals.nearest_window(8) == 1 else 2]
    before, after = state.placements[0, 1], proposal.state.placements[0, 1]
    expected = np.log(weights[1] / weights[:2].sum()) + 2 * np.log(after / before)
    assert proposal.log_ratio == pytest.approx(expected)


def test_refurnishing_leaves_no_gap_where_there_was_none() -> None:
    """Chairs of seven frames for couches of six, and back to just the same state."""
    chair = worlds.library(7)[2]
    problem = worlds.problem(26, scenelets=Library("two", (*list(worlds.library(6))[:2], chair)))
    proposals = Proposals(problem, even_candidates())
    move = Refurnish(proposals, furniture_kinds(problem))
    state = empty_state(problem)
    for scenelet, at in ((0, 0), (1, 6), (1, 15)):
        state = state.with_item(scenelet, at, np.array([0.1, 4.0, 0.2]))
    rng = np.random.default_rng(0)
    there = next(iter(lambda: move.propose(rng, state), None))
    items = there.state.items
    # The first keeps its middle, the second begins where it ends, the third is apart.
    assert items.tolist() == [[2, 0], [2, 7], [2, 15]]
    for _ in range(200):
        back = move.propose(rng, there.state)
        if back is not None and np.array_equal(back.state.items, state.items):
            break
    np.testing.assert_allclose(back.state.placements, state.placements, atol=1e-12)
    assert back.log_ratio == pytest.approx(-there.log_ratio)


def test_a_forgotten_jacobian_is_noticed() -> None:
    """Mutation: a placement walk without (y' / y)^2 must fail the prior test's statistic."""

    class Forgetful(PlacementWalk):
        def propose(self, rng, state):  # type: ignore[no-untyped-def]
            proposal = super().propose(rng, state)
            return None if proposal is None else proposal._replace(log_ratio=0.0)

    problem = prior_problem()
    start = empty_state(problem).with_item(0, 0, np.array([0.0, 4.0, 0.0]))

    def depth_score(walk: PlacementWalk) -> float:
        chain = sample(
            np.random.default_rng(3),
            start,
            log_density_fn=lambda s: log_posterior(problem, s),
            mixture=Mixture([walk], [1.0]),
        )
        # Seen first under a scenelet, log depth has its prior: mean log 4, s.d. .4.
        depth = np.log([at.state.placements[0, 1] for at, _ in islice(chain, 500, 30_000)])
        return float((depth.mean() - np.log(4.0)) / chain_error(depth))

    scales = (4.0, 12.0)
    assert abs(depth_score(PlacementWalk(scales))) < 4.5
    assert abs(depth_score(Forgetful(scales))) > 8


def test_what_is_flush_is_shifted_together_or_alone() -> None:
    """Scenelets of six frames: the first two follow without a gap, the third after one."""
    state = empty_state(PROBLEM)
    for start in (0, 6, 13):
        state = state.with_item(0, start, np.array([0.0, 4.0, 0.0]))
    state = replace(state, items=state.items + np.array([0, 1]))
    rng = np.random.default_rng(0)
    proposals = [Shift(PROBLEM, reach=1).propose(rng, state) for _ in range(200)]
    seen = {tuple(p.state.items[:, 1].tolist()) for p in proposals if p is not None}
    # The first two a frame later would be flush with the third, and all three would go back.
    assert seen == {(0, 6, 14), (0, 7, 14), (1, 8, 14), (1, 7, 13)}
    assert all(p.log_ratio == 0.0 for p in proposals if p is not None)


def test_what_is_flush_stays_so_when_one_of_it_comes_at_another_time() -> None:
    proposals = Proposals(PROBLEM, candidates())
    state = empty_state(PROBLEM)
    for scenelet, at in ((0, 2), (1, 8)):
        state = state.with_item(scenelet, at, np.array([0.1, 4.0, 0.2]))
    rng = np.random.default_rng(1)
    tried = (ReplaceAndShift(proposals, reach=1).propose(rng, state) for _ in range(400))
    found = [p for p in tried if p is not None]
    assert len({tuple(p.state.items.ravel().tolist()) for p in found}) > 3
    for log_ratio, after in ((p.log_ratio, p.state) for p in found):
        first, second = after.items.tolist()
        assert first[1] + PROBLEM.lengths[first[0]] == second[1]
        # One of them is another scenelet at another place, and what comes with it stands still.
        (k,) = np.flatnonzero((after.placements != state.placements).any(1)).tolist() or (None,)
        if k is None:
            continue
        chosen = [
            log_choice(proposals, window_of(proposals, s, k), s.items[k, 0]) for s in (state, after)
        ]
        grown = 2 * np.log(after.placements[k, 1] / state.placements[k, 1])
        assert log_ratio == pytest.approx(chosen[0] - chosen[1] + grown)


def test_starts_without_a_gap_are_tried_more_often() -> None:
    """And as often as the density of births says."""
    proposals = Proposals(PROBLEM, candidates())
    others = np.array([[0, 12]])
    rng, window, scenelet = np.random.default_rng(0), 2, 1
    drawn = [proposals.draw_shift(rng, window, scenelet, others) for _ in range(4000)]
    shifts = np.arange(-proposals.blur - 1, proposals.blur + 2)
    expected = [proposals.shift_probability(window, scenelet, int(s), others) for s in shifts]
    assert sum(expected) == pytest.approx(1.0)
    # The middle of the window is frame 9: from 6 to 12 there is no gap.
    assert shifts[int(np.argmax(expected))] == 0
    assert max(expected) > 0.5
    shares = np.array([np.mean(np.array(drawn) == s) for s in shifts])
    np.testing.assert_allclose(shares, expected, atol=4.5 * 0.5 / np.sqrt(4000))
