"""The stages after the static path: fits, charness, candidates, combinations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import empty_state, log_posterior, motion
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.candidates import charness_curve, refine, screen
from imapper_prob.solver.combinations import combine
from imapper_prob.solver.fits import Fits, fit_windows, free_pose_cost
from tests.models import worlds
from tests.runs import solution

_HERE = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
PLACE = np.array([0.4, 3.6, 0.9])


def performed(scenelet: int = 0, *, start: int = 6) -> tuple[Problem, StaticPath, Library]:
    """A clip in which a scenelet is performed at ``PLACE``, the person standing still around it."""
    few = [s for action in ("sit", "walk") for s in load_library() if s.action == action][::9]
    library = Library("few", tuple(few))
    blank = worlds.problem(30, scenelets=library)
    state = empty_state(blank).with_item(scenelet, start, PLACE)
    joints = motion(blank, state)
    n = library[scenelet].n_frames
    joints[:start], joints[start + n :] = joints[start], joints[start + n - 1]
    clip, path = worlds.clip_of(joints, np.random.default_rng(4)), worlds.path_of(joints)
    return pack_problem(clip, path, worlds.camera_prior(), library), path, library


def test_a_fit_finds_where_the_scenelet_was_performed() -> None:
    problem, path, library = performed()
    fits = fit_windows(problem, path, fps=10.0)
    centre = 6 + library[0].n_frames // 2
    w = int(np.abs(fits.centres - centre).argmin())
    assert fits.centres[w] == pytest.approx(centre, abs=2)
    assert fits.cost[w].argmin() == 0
    x, y, yaw = fits.placements[w, 0]
    assert np.hypot(x - PLACE[0], y - PLACE[1]) < 0.1
    assert abs((yaw - PLACE[2] + np.pi) % (2 * np.pi) - np.pi) < 0.1


def test_a_device_that_is_not_there_is_refused_by_name() -> None:
    problem, path, _ = performed()
    with pytest.raises(InputError, match="device 'cuda:99': not here"):
        fit_windows(problem, path, fps=10.0, device="cuda:99")
    here = [fit_windows(problem, path, fps=10.0, device=d) for d in _HERE]
    for other in here[1:]:
        np.testing.assert_allclose(here[0].placements, other.placements, atol=0.02)


def test_refinement_does_not_lower_the_posterior() -> None:
    problem, path, _ = performed()
    gains = []
    for candidate in screen(problem, fit_windows(problem, path, fps=10.0))[::7]:
        state = empty_state(problem).with_item(
            candidate.scenelet, candidate.start, candidate.placement
        )
        better = refine(problem, state)
        gains.append(log_posterior(problem, better) - log_posterior(problem, state))
    assert min(gains) >= 0
    assert max(gains) > 0.1


def test_a_free_frame_pays_where_nobody_walking_poses_so() -> None:
    problem, path, library = performed()
    assert library[0].objects, "the scenelet performed has furniture"
    cost = free_pose_cost(problem, fit_windows(problem, path, fps=10.0))
    assert np.all(cost >= 0)
    assert cost[12:18].mean() > 3.0
    bare = replace(library[0], name="bare", objects=())
    other = worlds.problem(30, scenelets=Library("bare", (bare, *library.scenelets)))
    problem = other._replace(
        keypoints=problem.keypoints, static_density=problem.static_density, poses=problem.poses
    )
    same = free_pose_cost(problem, fit_windows(problem, path, fps=10.0))
    # Only who is upright stands for a free frame: the same motion without furniture is a scenelet
    # to be chosen, and no less evidence that something is done there.
    assert same[12:18].mean() > 0.7 * cost[12:18].mean()


def test_frames_at_the_ends_of_a_clip_are_judged_too() -> None:
    """Nothing fits into the windows nearest to them, but scenelets further in reach them."""
    problem, path, _ = performed()
    fits = fit_windows(problem, path, fps=10.0)
    nowhere = ~np.isfinite(fits.cost).any(1)
    assert nowhere[0]
    assert nowhere[-1]
    far = problem._replace(keypoints=problem.keypoints + 80.0)
    cost = free_pose_cost(far._replace(static_density=problem.static_density), fits)
    assert (cost > 1.0).sum() > 0.8 * problem.n_frames


def test_scenelets_that_reach_the_ends_judge_the_frames_there() -> None:
    """The best of a window may leave out frames that others reach."""
    lengths = (5, 8, 9)
    motions = [replace(worlds.library(n, objects=False)[0], name=f"bare-{n}") for n in lengths]
    problem = worlds.problem(31, scenelets=Library("bare", tuple(motions)))
    path = worlds.path_of(worlds.walk(31))
    fits = fit_windows(problem, path, fps=10.0)
    far = problem._replace(keypoints=problem.keypoints + 80.0)
    far = far._replace(static_density=problem.static_density)
    # The shortest one fits best everywhere.
    cost = fits.cost + np.array([0.0, 1e3, 2e3])
    reached = np.zeros(31, bool)
    for start, length in zip(
        (fits.centres[:, None] - problem.lengths // 2)[np.isfinite(cost)],
        np.broadcast_to(problem.lengths, cost.shape)[np.isfinite(cost)],
        strict=True,
    ):
        reached[start : start + length] = True
    paid = free_pose_cost(far, replace(fits, cost=cost)) > 1.0
    assert not paid[~reached].any()
    assert paid[0]
    assert paid[reached].all()


def test_a_library_without_bare_motions_is_refused() -> None:
    problem = worlds.problem(20)
    fits = Fits(np.arange(0, 20, 4), np.zeros((5, 3, 3)), np.full((5, 3), np.inf))
    with pytest.raises(InputError, match="without objects"):
        free_pose_cost(problem, fits)


def test_maxima_are_apart_and_above_the_minimum() -> None:
    centres = np.arange(0, 200, 4)
    cost = np.tile([0.0, 1.0], (50, 1))
    cost[20:30] = [1.0, 0.0]
    curve = charness_curve(
        Fits(centres, np.zeros((50, 2, 3)), cost), np.array([0.0, 0.9]), fps=10.0
    )
    assert np.all((curve.values >= 0) & (curve.values <= 0.9))
    chosen = np.sort(centres[curve.maxima])
    assert np.all(np.diff(chosen) >= 16)
    assert chosen.min() >= 76
    assert chosen.max() <= 124


def test_the_combination_is_at_least_as_good_as_its_parts() -> None:
    solved = solution()
    best = log_posterior(solved.problem, solved.states[0])
    empty = empty_state(solved.problem)
    base = log_posterior(solved.problem, empty)
    at_maxima = [c for c in solved.candidates if c.window in solved.curve.maxima and c.kind]
    assert best >= base + max(c.gain for c in at_maxima)
    values = [log_posterior(solved.problem, s) for s in solved.states]
    assert values == sorted(values, reverse=True)
    kinds = furniture_kinds(solved.problem)
    stories = {tuple(kinds[s] for s in state.items[:, 0]) for state in solved.states}
    assert len(stories) == len(solved.states)
    again = combine(solved.problem, solved.candidates, solved.curve)
    np.testing.assert_array_equal(again.states[0].placements, solved.states[0].placements)
