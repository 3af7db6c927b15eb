"""The benchmark beside Eryn gives both samplers the same target. Eryn itself is not needed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from imapper_prob.models.log_posterior import State, empty_state, log_posterior, terms
from lab.eryn import gaussian
from lab.eryn.leaves import (
    ANYWHERE,
    AllLeaves,
    CameraDensity,
    LeafDensity,
    SceneLikelihood,
    log_posteriors,
    to_leaves,
    to_state,
)
from tests.models import worlds

PROBLEM = worlds.problem(20)


def density() -> LeafDensity:
    items = np.array([[0, 3], [2, 9], [2, 9]])
    placements = np.array([[0.5, 4.0, 0.1], [-1.0, 3.0, 3.1], [0.3, 5.0, -1.0]])
    return LeafDensity.of(PROBLEM, items, placements, np.array([1.0, 2.0, 3.0]))


def state(k: int) -> State:
    result = empty_state(PROBLEM)
    for n in range(k):
        placement = np.array([0.3 * n - 0.5, 4.0 + 0.2 * n, 1.0 + n])
        result = result.with_item(n, 6 * n + 1, placement, 0.02 * (n + 1))
    return result


@pytest.mark.parametrize("k", [0, 1, 3])
def test_states_come_back_from_leaves_in_any_order(k: int) -> None:
    there = state(k)
    leaves = to_leaves(there)[::-1]
    back = to_state(PROBLEM, leaves, there.camera)
    for name in ("camera", "items", "sizes", "latent"):
        np.testing.assert_array_equal(getattr(back, name), getattr(there, name))
    np.testing.assert_allclose(back.placements, there.placements, rtol=1e-15)


@pytest.mark.slow
def test_the_compiled_loop_is_the_log_posterior() -> None:
    states = [state(k) for k in (2, 0, 3, 1)]
    leaves = [to_leaves(s)[::-1] for s in states]
    first = np.concatenate([[0], np.cumsum([len(own) for own in leaves])])
    cameras = np.array([s.camera + 0.01 for s in states])
    found = log_posteriors(PROBLEM, cameras, np.concatenate(leaves), first)
    expected = [
        log_posterior(PROBLEM, to_state(PROBLEM, own, camera))
        for own, camera in zip(leaves, cameras, strict=True)
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.slow
def test_outside_the_support_is_outside_for_both() -> None:
    leaves = to_leaves(state(2))
    leaves[1, -1] = leaves[0, -1] + 1
    camera = PROBLEM.camera_mean[None]
    assert log_posteriors(PROBLEM, camera, leaves, np.array([0, 2]))[0] == -math.inf


@pytest.mark.slow
@pytest.mark.parametrize("leaf", [density(), density().without_candidates()])
def test_what_eryn_is_given_adds_up_to_the_posterior(leaf: LeafDensity) -> None:
    camera = CameraDensity(PROBLEM.camera_mean, PROBLEM.camera_precision)
    states = [state(k) for k in (1, 3, 0, 2)]
    most, walkers = 3, len(states)
    leaves, alive = np.zeros((1, walkers, most, 6)), np.zeros((1, walkers, most), dtype=bool)
    for walker, there in enumerate(states):
        # Not in the first places, nor in order of time.
        alive[0, walker, most - there.n_scenelets :] = True
        leaves[0, walker, alive[0, walker]] = to_leaves(there)[::-1]
    cameras = np.array([s.camera for s in states])[None, :, None]
    prior = AllLeaves({"scenelet": leaf, "camera": camera})
    log_prior = prior.logpdf(
        {"scenelet": leaves, "camera": cameras},
        {"scenelet": alive, "camera": np.ones((1, walkers, 1), dtype=bool)},
    )
    owner = np.nonzero(alive)[1]
    log_likelihood = SceneLikelihood(PROBLEM, leaf, camera)(
        [leaves[alive], cameras[0, :, 0]], [owner, np.arange(walkers)]
    )
    # What births and deaths leave of a set of k leaves: k! orders of it.
    orders = [math.lgamma(s.n_scenelets + 1) for s in states]
    expected = [log_posterior(PROBLEM, s) for s in states]
    np.testing.assert_allclose(log_prior[0] + log_likelihood + orders, expected, rtol=1e-12)


def test_leaves_from_anywhere_have_a_density() -> None:
    leaf = density().without_candidates()
    bearing, log_depth = np.meshgrid(np.linspace(-2, 2, 161), np.linspace(-1, 4, 201))
    depth = np.exp(log_depth).ravel()
    cell = 0.025 * 0.025 * depth**2 * 2 * math.pi
    total = 0.0
    for scenelet, last in enumerate(leaf.last_start):
        rows = np.column_stack([bearing.ravel() * depth, depth, *np.full((4, len(depth)), 0.5)])
        rows[:, 3] = 0.0
        rows[:, 4] += scenelet
        total += (last + 1) * float((np.exp(leaf.logpdf(rows)) * cell).sum())
    total /= norm.pdf(0.0, scale=PROBLEM.size_spread)
    assert total == pytest.approx(1, abs=1e-3)


def test_leaves_are_drawn_from_their_density() -> None:
    np.random.seed(0)  # noqa: NPY002
    leaf, n = density(), 20_000
    drawn = leaf.rvs(n)
    part = np.exp(leaf.without_candidates().logpdf(drawn) - leaf.logpdf(drawn))
    # A ratio of at most 20 whose mean is one has a variance below 20.
    assert part.mean() == pytest.approx(1, abs=4 * math.sqrt(20 / n))
    near = np.exp(leaf.logpdf(drawn)) > 20 * np.exp(leaf.without_candidates().logpdf(drawn))
    assert near.mean() == pytest.approx(1 - ANYWHERE, abs=0.02)


def test_cameras_have_the_density_of_the_model() -> None:
    camera = CameraDensity(PROBLEM.camera_mean, PROBLEM.camera_precision)
    off = PROBLEM.camera_mean + 0.01 * np.arange(len(PROBLEM.camera_mean))
    moved = replace(empty_state(PROBLEM), camera=off)
    assert camera.logpdf(off[None])[0] == pytest.approx(terms(PROBLEM, moved)["camera"], rel=1e-12)


def test_the_gaussian_answer_is_that_of_quadrature() -> None:
    """One signal: the evidence is the integral of prior times likelihood, axis by axis."""
    exact = gaussian.probabilities()
    none = float(np.exp(gaussian.log_likelihood(np.zeros(gaussian.DIMENSION))))
    one = 1.0
    for seen in gaussian.SEEN:
        one *= quad(lambda x, seen=seen: norm.pdf(x) * norm.pdf(seen, x, gaussian.NOISE), -8, 8)[0]
    assert exact[1] / exact[0] == pytest.approx(one / none, rel=1e-8)
    assert exact.sum() == pytest.approx(1)
