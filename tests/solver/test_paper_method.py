"""The stages as the paper has them: occluded frames, T', 200 to 3, combinations, selection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_terms import paper_energy
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings, PaperWeights, Settings
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording.stages import stage_views
from imapper_prob.results.solution import stage_table
from imapper_prob.solver.actors import solved
from imapper_prob.solver.candidates import Fate, MaximaSettings, MaximumTable, charness_curve
from imapper_prob.solver.fits import Fits, fit_windows
from imapper_prob.solver.poses import FrameTable, PoseSource
from imapper_prob.solver.published import (
    PublishedSettings,
    combine_published,
    fast_frames,
    filter_published,
    interpolated,
)
from imapper_prob.solver.selection import published_objects
from imapper_prob.solver.solver import METHODS, Fitted, method_of, solve_fitted
from imapper_prob.solver.static_path import examine_published
from tests.models import worlds
from tests.solver.walkers import walk, with_track

PAPER = ModelSettings(energy="paper")
AHEAD = np.array([0.0, 4.0, 0.0])


# --- Occluded frames


def test_velocities_beyond_the_95th_percentile_are_clipped() -> None:
    keypoints = np.zeros((41, 3, 2))
    keypoints[1:, :, 0] = np.cumsum(np.arange(1, 41))[:, None]  # 1, 2, ... 40 pixels a frame
    fast = fast_frames(keypoints, np.ones((41, 3)))
    # Of forty velocities two are above the 95th percentile, the 38th.
    assert np.flatnonzero(fast).tolist() == [39, 40]
    # A joint that is not detected in both frames says nothing of velocity.
    keypoints[10, 2] = 9e3
    confidences = np.ones((41, 3))
    confidences[10, 2] = 0.0
    assert np.flatnonzero(fast_frames(keypoints, confidences)).tolist() == [39, 40]


def test_a_person_at_one_velocity_has_no_fast_frame() -> None:
    still = np.tile(np.arange(20.0)[:, None, None], (1, 3, 2))
    assert not fast_frames(still, np.ones((20, 3))).any()
    assert not fast_frames(still, np.zeros((20, 3))).any()


def test_filling_is_linear_between_known_frames() -> None:
    values = np.array([9.0, 1.0, 9.0, 9.0, 4.0, 9.0])[:, None, None] * np.ones((6, 2, 3))
    known = np.array([False, True, False, False, True, False])
    filled = interpolated(values, known)
    np.testing.assert_allclose(filled[:, 0, 0], [1, 1, 2, 3, 4, 4])


def test_skeletons_are_rigid_and_occluded_frames_straight() -> None:
    truth = walk(np.random.default_rng(5))
    keypoints, poses = truth.clip.tracks[0].keypoints.copy(), truth.clip.tracks[0].poses.copy()
    keypoints[30] += 150.0
    poses[50:60] = np.nan
    clip = with_track(truth.clip, keypoints=keypoints, poses=poses)
    path, frames = examine_published(clip)
    assert frames.pose[30] is PoseSource.FAST
    assert frames.pose[55] is PoseSource.MISSING
    assert not path.posed[[30, 31, *range(50, 60)]].any()
    # One frame's jump moves no other: it has no say.
    plain, _ = examine_published(with_track(truth.clip, poses=poses))
    np.testing.assert_allclose(path.estimate[:28], plain.estimate[:28], atol=5e-3)
    joints = path.joints[48:62]
    np.testing.assert_allclose(joints[2:12], joints[1:2] + np.arange(1, 11)[:, None, None]
                               * (joints[12] - joints[1]) / 11, atol=1e-9)  # fmt: skip
    # The skeleton keeps its bones; the default path bends them to the detections.
    own = np.flatnonzero(~frames.filled)
    thigh = np.linalg.norm(path.poses[own][:, 1] - path.poses[own][:, 2], axis=-1)
    np.testing.assert_allclose(thigh, thigh[0])


def test_the_static_path_is_where_the_squares_are_least() -> None:
    """Any other place or turn of a frame's skeleton costs more: L_r + .05 L_s."""
    truth = walk(np.random.default_rng(3))
    path, frames = examine_published(truth.clip)
    t = int(np.flatnonzero(~frames.filled)[20])
    track, camera = truth.clip.tracks[0], truth.clip.camera

    def energy(joints: np.ndarray) -> float:
        detected = [k for k in range(16) if k not in (6, 8)]
        apart = camera.project_camera(joints[:, detected]) - track.keypoints[:, detected]
        normalised = (apart / (camera.fx, camera.fy)) ** 2
        posed = path.posed[:, None] * track.confidences[:, detected]
        return float((posed * normalised.sum(-1)).sum()) + 0.05 * float(
            (np.diff(joints[:, PELV], axis=0) ** 2).sum()
        )

    best = energy(path.joints)
    for axis in range(3):
        for step in (-0.02, 0.02):
            moved = path.joints.copy()
            moved[t, :, axis] += step
            assert energy(moved) > best


# --- T'


def test_frames_without_a_skeleton_are_added_to_the_maxima() -> None:
    centres = np.arange(0, 200, 4)
    cost = np.tile([0.0, 1.0], (50, 1))
    cost[20:23] = [1.0, 0.0]
    cost[35:40] = np.inf
    bare = np.zeros(200, bool)
    bare[[84, *range(140, 160), 190]] = True
    placements = np.ones((50, 2, 3))
    fits, charness = Fits(centres, placements, cost), np.array([0.0, 0.9])
    settings = MaximaSettings(smoothing=0.6, apart=1.6, minimum=0.6, most=5)
    plain = charness_curve(fits, charness, fps=10.0, settings=settings)
    assert centres[plain.maxima].tolist() == [84]
    curve = charness_curve(fits, charness, fps=10.0, settings=settings, bare=bare)
    # 84 is a maximum anyway; 190 is in no window's middle; of 140 to 156 those 16 frames apart.
    added = sorted(centres[curve.maxima].tolist())
    assert added[0] == 84
    assert all(140 <= f < 160 for f in added[1:])
    assert len(added) == 3
    assert (np.diff(added) >= 16).all()
    fewer = charness_curve(fits, charness, fps=10.0, settings=replace(settings, most=2), bare=bare)
    assert len(fewer.maxima) == 2


# --- 200, 3


def seated(problem: Problem, settings: PublishedSettings) -> tuple[MaximumTable, ...]:
    fits = fit_windows(
        problem, worlds.path_of(worlds.walk(problem.n_frames)), fps=10.0, squared=True
    )
    curve = charness_curve(
        fits, np.ones(len(problem.lengths)), fps=10.0, settings=MaximaSettings(most=1)
    )
    return filter_published(problem, fits, curve, settings=settings)


def test_the_filter_keeps_few_by_path_then_few_by_all() -> None:
    """Two are kept by L_r and L_s, one of them once L_m and L_o have spoken."""
    problem = worlds.problem(30, settings=PAPER)
    (table,) = seated(problem, PublishedSettings(fitted=2, kept=1))
    assert table.fitted == 3
    assert len(table.rows) == 2
    assert table.rows[0].fate is Fate.KEPT
    assert table.rows[1].fate is not Fate.KEPT
    assert table.counts()["judged"] == 2
    assert list(table.counts().values())[-1] == 1
    for row in table.rows:
        candidate = row.candidate
        assert candidate.gain == pytest.approx(row.fit + row.motion + row.occlusion)
        state = empty_state(problem).with_item(
            candidate.scenelet, candidate.start, candidate.placement
        )
        weights = PaperWeights(*(problem.paper_nats * (1, 1, 1, 0, 1)).tolist())
        bare = paper_energy(problem, empty_state(problem), weights=weights).total
        there = paper_energy(problem, state, weights=weights).total
        assert candidate.gain == pytest.approx(bare - there)


def test_windows_without_detections_have_candidates_too() -> None:
    """What holds them is the smoothness of the path around them."""
    problem = worlds.problem(30, settings=PAPER)
    used = problem.used.copy()
    used[4:26] = False
    path = worlds.path_of(worlds.walk(30))
    fits = fit_windows(problem._replace(used=used), path, fps=10.0, squared=True)
    blind = int(np.flatnonzero(fits.centres == 16)[0])
    assert np.isinf(fits.cost[blind]).all()
    bare = np.zeros(30, bool)
    bare[16] = True
    curve = charness_curve(fits, np.zeros(3), fps=10.0, bare=bare)
    assert curve.maxima.tolist() == [blind]
    (table,) = filter_published(problem._replace(used=used), fits, curve)
    assert len(table.rows) == 3
    best = table.rows[0].candidate.placement
    # Somebody walks from (-.8, 4) to (.8, 4).
    assert np.hypot(*(best[:2] - (0.1, 4.0))) < 0.5


# --- Combinations


def test_every_combination_is_placed_and_sorted_by_the_energy() -> None:
    problem = worlds.problem(40, settings=PAPER)
    fits = fit_windows(problem, worlds.path_of(worlds.walk(40)), fps=10.0, squared=True)
    curve = charness_curve(fits, np.ones(3), fps=10.0, settings=MaximaSettings(most=2, apart=1.0))
    settings = PublishedSettings(kept=2, scenes=3)
    tables = filter_published(problem, fits, curve, settings=settings)
    found = combine_published(problem, tables, fps=10.0, settings=settings)
    assert len(found.pool) == 4
    assert len(found.tried) == 4
    assert [t.gain for t in found.tried] == sorted((t.gain for t in found.tried), reverse=True)
    assert all(t.gain >= t.score - 1e-9 for t in found.tried)
    assert found.complete
    assert len(found.states) == 3
    best = found.states[0]
    assert best.n_scenelets == 2
    assert (best.sizes == 0).all()
    weights = PaperWeights(*problem.paper_nats.tolist())
    nothing = paper_energy(problem, empty_state(problem), weights=weights).total
    gained = nothing - paper_energy(problem, best, weights=weights).total
    assert gained == pytest.approx(found.tried[0].gain)
    # The next scene has least in common with the best one.
    assert not (set(best.items[:, 0]) & set(found.states[1].items[:, 0]))


def test_of_members_that_overlap_in_time_the_better_one_stays() -> None:
    problem = worlds.problem(20, settings=PAPER)
    fits = fit_windows(problem, worlds.path_of(worlds.walk(20)), fps=10.0, squared=True)
    curve = charness_curve(
        fits, np.ones(3), fps=10.0, settings=MaximaSettings(most=2, apart=0.4, smoothing=0.5)
    )
    tables = filter_published(problem, fits, curve, settings=PublishedSettings(kept=1))
    assert len(tables) == 2
    found = combine_published(problem, tables, fps=10.0)
    best = max((t.rows[0].candidate for t in tables), key=lambda c: c.gain)
    assert found.states[0].items.tolist() == [[best.scenelet, best.start]]


# --- Object selection


def two_couches(apart: float, yaw: float = 0.0) -> tuple[Problem, Library, State]:
    """Two scenelets whose couches are ``apart`` metres and turned by ``yaw``."""
    joints = np.repeat(worlds.POSE[None], 6, 0) + np.array([0.0, 0.0, worlds.PELVIS_HEIGHT])
    away = Scenelet("a", "stand", joints, (worlds.couch(0.0, -1.5),))
    near = Scenelet("b", "stand", joints, (worlds.couch(0.0, -1.5 + apart, yaw),))
    library = Library("two", (away, near))
    problem = worlds.problem(20, settings=PAPER, scenelets=library)
    state = empty_state(problem).with_item(0, 2, AHEAD).with_item(1, 10, AHEAD)
    return problem, library, state


@pytest.mark.parametrize(("apart", "yaw", "left"), [(0.5, 0.0, 1), (1.2, 0.0, 2), (0.5, 1.6, 2)])
def test_of_compatible_objects_in_each_other_one_stays(apart: float, yaw: float, left: int) -> None:
    problem, library, state = two_couches(apart, yaw)
    assert len(published_objects(problem, library, state)) == left


def test_the_object_goes_whose_scene_costs_more() -> None:
    """Held against the energies of two scenes that have one of the couches only."""
    problem, library, state = two_couches(0.5)
    unsure = np.full_like(problem.confidences, 0.1)
    weights = PaperWeights(*problem.paper_nats.tolist())
    energies = []
    for gone in (0, 1):
        one = [replace(s, objects=() if k == gone else s.objects) for k, s in enumerate(library)]
        bare = worlds.problem(20, settings=PAPER, scenelets=Library("one", tuple(one)))
        bare = bare._replace(confidences=unsure)
        energies.append(paper_energy(bare, state, weights=weights).total)
    assert abs(energies[0] - energies[1]) > 0.1
    (kept,) = published_objects(problem._replace(confidences=unsure), library, state)
    # Without the first (2.5 m away) the scene costs energies[0].
    assert kept.placement.y == pytest.approx(2.5 if energies[1] < energies[0] else 3.0)
    # Somebody who stands in one of them decides as well, whatever it hides.
    for k, other in ((0, 3.0), (1, 2.5)):
        joints = problem.joints.copy()
        joints[slice(*problem.joint_first[:2]), :, 1] -= 1.6 if k == 0 else 0.7
        held = problem._replace(joints=joints, paper_nats=problem.paper_nats * (0, 0, 0, 0, 1))
        (kept,) = published_objects(held, library, state)
        assert kept.placement.y == pytest.approx(other)


# --- Which method goes with which energy


def test_the_method_goes_with_the_energy_that_a_problem_was_packed_for() -> None:
    for energy in ("default", "paper"):
        problem = worlds.problem(20, settings=ModelSettings(energy=energy))
        assert method_of(problem) is METHODS[energy]
    # Without its likelihood a published energy is no energy at all.
    silent = worlds.problem(20, settings=ModelSettings(energy="paper", likelihood=0.0))
    assert method_of(silent) is METHODS["default"]


def test_fits_say_nothing_of_the_right_motion_under_the_published_energy() -> None:
    problem = worlds.problem(30, settings=PAPER)
    fits = fit_windows(problem, worlds.path_of(worlds.walk(30)), fps=10.0, squared=True)
    assert np.isnan(method_of(problem).best_fits(problem, fits)).all()
    assert np.isfinite(METHODS["default"].best_fits(problem, fits)).any()


def test_only_its_own_stages_run_and_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, path = worlds.problem(30, settings=PAPER), worlds.path_of(worlds.walk(30))
    clip, library = worlds.clip_of(worlds.walk(30), np.random.default_rng(0)), worlds.library()
    fits = fit_windows(problem, path, fps=10.0, squared=True)
    frames = FrameTable(
        (PoseSource.OWN,) * 30, problem.used.sum(1), np.full(30, np.nan), np.zeros(30, bool)
    )
    fitted = Fitted(
        path, frames, worlds.camera_prior(), problem, fits, np.ones(3), np.zeros((3, 3)),
        Settings(PAPER),
    )  # fmt: skip
    stages: list[str] = []
    found = solve_fitted(clip, library, fitted, progress=lambda stage, _: stages.append(stage))
    assert set(stages) == {"filtering candidates", "combining"}
    assert found.candidates == tuple(r.candidate for t in found.shortlists for r in t.rows)
    answer = solved(clip, [found], count=2)
    assert [scene.states for scene in answer.scenes] == [(state,) for state in found.states[:2]]

    # Of several people too, only the scenes of this method are shown, and no other is refined.
    def refined(*_: object) -> State:
        raise AssertionError("a scene is refined that is not shown")

    monkeypatch.setattr("imapper_prob.solver.actors.refine", refined)
    both = replace(clip, tracks=(clip.tracks[0], replace(clip.tracks[0], name="B")))
    pair = solved(both, [found, found], count=2)
    assert [scene.states for scene in pair.scenes] == [(state, state) for state in found.states[:2]]
    _, _, outcome = stage_table(answer, [("filtering candidates", 1.0)]).columns
    assert "maxima of charness" in next(iter(outcome.cells))
    judged = next(v for v in stage_views(answer) if v.name == "Candidates judged")
    assert "judged by the published energy" in judged.text
