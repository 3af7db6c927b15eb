"""Every stage keeps what it saw, and the tables add up."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from imapper_prob.models.log_posterior import empty_state, log_posterior
from imapper_prob.solver.candidates import Fate, MaximaSettings, charness_curve
from imapper_prob.solver.combinations import groups_of, search, state_of
from imapper_prob.solver.fits import Fits
from imapper_prob.solver.poses import PoseSource
from imapper_prob.solver.static_path import examine_frames
from tests.runs import solution
from tests.solver.walkers import walk, with_track


def test_every_frame_says_where_its_pose_is_from() -> None:
    truth = walk(np.random.default_rng(5))
    track = truth.clip.tracks[0]
    poses, interpolated = track.poses.copy(), track.interpolated.copy()
    poses[10:13] = np.nan
    interpolated[20:24] = True
    poses[40:44] = poses[40:44][..., [2, 1, 0]]  # lying on the side
    keypoints, confidences = track.keypoints.copy(), track.confidences.copy()
    keypoints[60:65] += (-700.0, 200.0)
    keypoints[70:73] += (170.0, 0.0)
    confidences[80:82] = 0.0
    clip = with_track(
        truth.clip, poses=poses, interpolated=interpolated, keypoints=keypoints,
        confidences=confidences,
    )  # fmt: skip
    path, frames = examine_frames(clip)
    where = {source: [t for t, p in enumerate(frames.pose) if p is source] for source in PoseSource}
    assert where[PoseSource.MISSING] == [10, 11, 12]
    assert where[PoseSource.INTERPOLATED] == [20, 21, 22, 23]
    assert set(where[PoseSource.CONTRADICTED]) >= {40, 41, 42, 43}
    np.testing.assert_array_equal(frames.filled, ~path.posed)
    assert where[PoseSource.ELSEWHERE] == [60, 61, 62, 63, 64]
    outliers = set(np.flatnonzero(frames.outlier).tolist())
    assert outliers
    assert outliers <= {70, 71, 72}
    assert np.isnan(frames.miss[80:82]).all()
    assert frames.counts()["outlier"] == len(outliers)
    assert frames.counts()["nothing detected"] == 7
    assert sum(frames.counts()[str(source)] for source in PoseSource) == clip.n_frames


def test_what_suppression_drops_says_why() -> None:
    centres = np.arange(0, 200, 4)
    cost = np.tile([0.0, 1.0], (50, 1))
    cost[20:23] = cost[26:28] = cost[40] = [1.0, 0.0]
    cost[33] = np.inf
    curve = charness_curve(
        Fits(centres, np.zeros((50, 2, 3)), cost), np.array([0.0, 0.9]), fps=10.0,
        settings=MaximaSettings(smoothing=0.6, apart=2.8, minimum=0.6),
    )  # fmt: skip
    assert np.isnan(curve.raw[33])
    assert np.isfinite(curve.values).all()
    reasons = {p.window: p.dropped for p in curve.peaks}
    assert reasons[21] == ""
    assert reasons[26] == "within 2.8 s of the maximum at frame 84"
    assert reasons[40] == "charness below 0.6"
    assert [p.window for p in curve.peaks if not p.dropped] == sorted(curve.maxima.tolist())


def test_no_maximum_is_where_nothing_could_be_fitted() -> None:
    """At the ends of a clip it is the nearest window that has candidates."""
    centres = np.arange(0, 80, 4)
    cost = np.tile([1.0, 0.0], (20, 1))
    cost[2:9, 0] = np.linspace(2.0, 0.0, 7)
    cost[:2] = np.inf
    fits = Fits(centres, np.zeros((20, 2, 3)), cost)
    curve = charness_curve(fits, np.array([0.0, 0.9]), fps=10.0)
    assert curve.values[0] >= curve.values[2]
    assert 2 in curve.maxima
    assert curve.maxima.min() == 2


def test_shortlists_take_the_gain_apart() -> None:
    solved = solution()
    problem, empty = solved.problem, empty_state(solved.problem)
    base = log_posterior(problem, empty)
    assert [t.window for t in solved.shortlists] == sorted(solved.curve.maxima.tolist())
    for table in solved.shortlists:
        for row in table.rows:
            assert row.fit + row.motion + row.occlusion == pytest.approx(row.candidate.gain)
            assert row.motion <= 0
            c = row.candidate
            state = empty.with_item(c.scenelet, c.start, c.placement, c.size)
            assert log_posterior(problem, state) - base == pytest.approx(c.gain)
        counts = list(table.counts().values())
        assert counts == sorted(counts, reverse=True)
        assert counts[-1] == sum(row.fate is Fate.KEPT for row in table.rows) <= 3
    kept = [r.candidate for t in solved.shortlists for r in t.rows if r.fate is Fate.KEPT]
    assert {(c.window, c.scenelet) for c in kept} == {
        (c.window, c.scenelet) for c in solved.combinations.pool
    }


def test_fates_are_counterfactual() -> None:
    """Without the part it fell by, a candidate would have been as good as the last one kept."""
    fates = set()
    for table in solution().shortlists:
        kept = [r.candidate for r in table.rows if r.fate is Fate.KEPT]
        last = min((c.gain for c in kept), default=np.inf)
        kinds = {c.kind for c in kept}
        for row in table.rows:
            fates.add(row.fate)
            assert (row.fate in (Fate.KIND, Fate.KEPT)) == (row.candidate.kind in kinds)
            spared_motion = row.candidate.gain - row.motion
            spared_occlusion = row.candidate.gain - row.occlusion
            if row.fate is Fate.MOTION:
                assert spared_motion >= last
            elif row.fate is Fate.OCCLUSION:
                assert spared_occlusion >= last > spared_motion
            elif row.fate is Fate.FIT:
                assert max(spared_motion, spared_occlusion) < last
    assert {Fate.KEPT, Fate.KIND, Fate.FIT} <= fates


def test_a_small_search_is_complete_and_a_short_one_says_what_it_left() -> None:
    solved = solution()
    problem, found = solved.problem, solved.combinations
    assert found.complete
    groups = groups_of(solved.candidates, solved.curve)
    base = log_posterior(problem, empty_state(problem))
    # Brute force: one member or none of every group.
    everything: list[list[int]] = [[]]
    first = 0
    for group in groups:
        own = range(first, first + len(group))
        everything = [[*m, *pick] for m in everything for pick in ([], *([k] for k in own))]
        first += len(group)
    gains = [
        log_posterior(problem, state_of(problem, [found.pool[k] for k in m])) - base
        for m in everything
    ]
    possible = [g for g in gains if np.isfinite(g)]
    assert len(found.tried) == len(possible)
    assert found.tried[0].gain == pytest.approx(max(possible))
    assert all(a.gain >= b.gain for a, b in itertools.pairwise(found.tried))
    short, left = search(problem, groups, tried=5)
    assert len(short) == 5
    assert left <= min(t.score for t in short) + 1e-9
    assert short[0].gain == pytest.approx(max(possible))
