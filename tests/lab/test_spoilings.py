"""Clips spoiled on purpose: what is changed is changed by what is said, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import BONES, DETECTED, LANK, LKNE, N_JOINTS, NECK, PELV, RKNE
from lab.spoiled.spoilings import (
    HIPS,
    LEGS,
    LIMBS,
    SPOILINGS,
    TRUNK,
    Spoiling,
    at_rate,
    with_confidences,
    with_focal_length,
    with_ghosts,
    with_jumping_limbs,
    with_legs_cut_off,
    with_lost_joints,
    with_scaled_bones,
)

FRAMES, LOST = 300, 40
CAMERA = Camera(1920, 1080, 1955.0, 1953.0, 960.0, 540.0)
SPEED = np.array([4.0, -0.5])
"""Pixels a frame."""


@pytest.fixture
def clip() -> Clip:
    """Somebody who goes through the picture evenly, and is lost in one frame."""
    rng = np.random.default_rng(1)
    body = np.array([500.0, 500.0]) + rng.uniform(-150, 150, (N_JOINTS, 2))
    keypoints = body + SPEED * np.arange(FRAMES)[:, None, None]
    confidences = rng.uniform(0.05, 1.0, (FRAMES, N_JOINTS))
    confidences[:, [j for j in range(N_JOINTS) if j not in DETECTED]] = 0.0
    keypoints[LOST], confidences[LOST] = np.nan, 0.0
    poses = np.tile(rng.normal(size=(N_JOINTS, 3)), (FRAMES, 1, 1))
    poses -= poses[:, PELV, None]
    poses[LOST + 1] = np.nan
    track = Track("somebody", keypoints, confidences, poses, np.arange(FRAMES) == 7)
    return Clip("clip", CAMERA, 10.0, np.arange(1, FRAMES + 1), (track,))


def generator() -> np.random.Generator:
    return np.random.default_rng(5)


def copied(clip: Clip) -> list[np.ndarray]:
    track = clip.tracks[0]
    arrays = (track.keypoints, track.confidences, track.poses, track.interpolated, clip.frame_ids)
    return [a.copy() for a in arrays]


@pytest.mark.parametrize("spoiling", SPOILINGS, ids=lambda s: s.name)
def test_the_same_seed_spoils_alike_and_leaves_the_clip_alone(
    spoiling: Spoiling, clip: Clip
) -> None:
    before, camera = copied(clip), clip.camera
    one, other = (spoiling.apply(clip, generator()) for _ in range(2))
    for now, then in zip(copied(clip), before, strict=True):
        np.testing.assert_array_equal(now, then)
    assert clip.camera == camera
    for a, b in zip(copied(one.clip), copied(other.clip), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.affected, other.affected)
    assert one.affected.shape == (one.clip.n_frames,)
    assert one.affected.any()


@pytest.mark.parametrize("spoiling", SPOILINGS, ids=lambda s: s.name)
def test_frames_that_are_not_affected_are_as_they_were(spoiling: Spoiling, clip: Clip) -> None:
    spoiled, affected = spoiling.apply(clip, generator())
    if spoiled.fps != clip.fps:
        return
    old, new = clip.tracks[0], spoiled.tracks[0]
    for name in ("keypoints", "confidences", "poses", "interpolated"):
        np.testing.assert_array_equal(getattr(new, name)[~affected], getattr(old, name)[~affected])
    np.testing.assert_array_equal(spoiled.frame_ids, clip.frame_ids)


def test_names_are_different_and_can_be_files() -> None:
    names = [s.name for s in SPOILINGS]
    assert len(set(names)) == len(names)
    assert all(c.isalnum() or c in ".-" for name in names for c in name)


@pytest.mark.parametrize("factor", [0.6, 1.4])
@pytest.mark.parametrize("bones", [TRUNK, HIPS, LEGS, LIMBS])
def test_bones_are_scaled_and_carry_what_hangs_on_them(
    bones: frozenset[tuple[int, int]], factor: float, clip: Clip
) -> None:
    old = clip.tracks[0].poses
    new = with_scaled_bones(clip, generator(), bones=bones, factor=factor).clip.tracks[0].poses
    for far, near in BONES:
        wanted = factor if (far, near) in bones else 1.0
        np.testing.assert_allclose(
            new[:, far] - new[:, near], wanted * (old[:, far] - old[:, near]), atol=1e-12
        )
    np.testing.assert_array_equal(new[:, PELV], old[:, PELV])


@pytest.mark.parametrize("low", [True, False])
def test_ghosts_are_far_away_inside_of_the_picture(low: bool, clip: Clip) -> None:
    spoiled, affected = with_ghosts(clip, generator(), low=low)
    old, new = clip.tracks[0], spoiled.tracks[0]
    begins = np.flatnonzero(np.diff(affected.astype(int)) == 1) + 1
    ends = np.flatnonzero(np.diff(affected.astype(int)) == -1) + 1
    assert len(begins) == len(ends) == 2
    np.testing.assert_array_equal(new.poses, old.poses)
    rows = {row.tobytes() for row in old.confidences}
    for begin, end in zip(begins, ends, strict=True):
        assert 5 <= end - begin <= 20
        ghost = new.keypoints[begin:end].mean(1)
        away = np.linalg.norm(ghost - np.nanmean(old.keypoints[begin:end], 1), axis=-1)
        assert away.min() > 250
        assert np.linalg.norm(ghost - ghost[0], axis=-1).max() < 40  # at one place
        assert all(row.tobytes() in rows for row in new.confidences[begin:end])
        inside = (new.keypoints[begin:end] > -60) & (new.keypoints[begin:end] < [1980, 1140])
        assert low or inside.all()


def test_a_ghost_keeps_the_shape_and_clutter_does_not(clip: Clip) -> None:
    def distortion(low: bool) -> float:
        spoiled, affected = with_ghosts(clip, generator(), low=low)
        new, old = (c.tracks[0].keypoints[affected] for c in (spoiled, clip))
        new, old = (k - k.mean(1, keepdims=True) for k in (new, old))
        return float(np.nanstd(new - old))

    assert distortion(low=False) < 5
    assert distortion(low=True) > 50


def test_ghosts_on_clutter_have_the_least_confidences(clip: Clip) -> None:
    spoiled, affected = with_ghosts(clip, generator(), low=True)
    sums = clip.tracks[0].confidences.sum(1)
    limit = np.quantile(sums[sums > 0], 0.06)
    assert spoiled.tracks[0].confidences[affected].sum(1).max() <= limit


def test_a_limb_jumps_as_a_whole(clip: Clip) -> None:
    spoiled, affected = with_jumping_limbs(clip, generator())
    old, new = clip.tracks[0], spoiled.tracks[0]
    known = affected & (np.arange(FRAMES) != LOST)
    step = np.linalg.norm((new.keypoints - old.keypoints)[known], axis=-1)
    assert ((step > 0).sum(1) == 2).all()
    moved = step[step > 0]
    assert moved.min() > 130
    assert moved.max() < 420
    assert (new.confidences[affected] > 0)[:, list(DETECTED)].any(1).all()


def test_nothing_is_seen_below_the_knees(clip: Clip) -> None:
    track = clip.tracks[0]
    line = np.nanmedian(track.keypoints[:, (RKNE, LKNE), 1])
    spoiled, affected = with_legs_cut_off(clip, generator())
    new = spoiled.tracks[0]
    below = track.keypoints[..., 1] > line
    assert not new.confidences[below].any()
    assert np.isnan(new.keypoints[below]).all()
    np.testing.assert_array_equal(new.confidences[~below], track.confidences[~below])
    np.testing.assert_array_equal(affected, (below & (track.confidences > 0)).any(1))


def test_joints_are_lost_throughout_or_half_of_the_time(clip: Clip) -> None:
    for throughout, share in ((True, 1.0), (False, 0.5)):
        spoiled, affected = with_lost_joints(
            clip, generator(), joints=(LKNE, LANK), throughout=throughout
        )
        lost = spoiled.tracks[0].confidences[:, (LKNE, LANK)] == 0
        assert lost[affected].all()
        assert affected.mean() == pytest.approx(share, abs=0.01)


def test_confidences_on_another_scale(clip: Clip) -> None:
    spoiled, _ = with_confidences(clip, generator(), curve=np.sqrt)
    old, new = clip.tracks[0], spoiled.tracks[0]
    np.testing.assert_array_equal(new.confidences, np.sqrt(old.confidences))
    np.testing.assert_array_equal(new.keypoints, old.keypoints)


def test_another_focal_length(clip: Clip) -> None:
    spoiled, _ = with_focal_length(clip, generator(), factor=1.05)
    assert spoiled.camera == replace(CAMERA, fx=1.05 * CAMERA.fx, fy=1.05 * CAMERA.fy)
    assert spoiled.tracks == clip.tracks


@pytest.mark.parametrize("fps", [15.0, 25.0, 5.0])
def test_even_motion_stays_even_at_another_rate(fps: float, clip: Clip) -> None:
    spoiled, _ = at_rate(clip, generator(), fps=fps)
    old, new = clip.tracks[0], spoiled.tracks[0]
    assert spoiled.n_frames == int((FRAMES - 1) * fps / 10) + 1
    assert spoiled.fps == fps
    where = np.arange(spoiled.n_frames) * 10 / fps
    sure = np.abs(where - LOST) >= 1
    wanted = old.keypoints[0] + SPEED * where[:, None, None]
    np.testing.assert_allclose(new.keypoints[sure], wanted[sure], atol=1e-6)
    posed = np.abs(where - (LOST + 1)) >= 0.5
    np.testing.assert_allclose(
        new.poses[posed], np.broadcast_to(old.poses[0], new.poses[posed].shape), atol=1e-9
    )
    assert np.isnan(new.poses[np.abs(where - (LOST + 1)) < 0.5]).all()
    assert not new.confidences[:, [PELV, NECK]].any()


def test_a_frame_of_both_rates_is_that_frame(clip: Clip) -> None:
    spoiled, _ = at_rate(clip, generator(), fps=25.0)
    old, new = clip.tracks[0], spoiled.tracks[0]
    for name in ("keypoints", "confidences", "interpolated"):
        np.testing.assert_array_equal(getattr(new, name)[::5], getattr(old, name)[::2])


def test_turning_bones_keep_their_length_at_another_rate(clip: Clip) -> None:
    old = clip.tracks[0]
    turn = np.linspace(0, 2 * np.pi, FRAMES)
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y, z = np.moveaxis(np.broadcast_to(old.poses[0], old.poses.shape), -1, 0)
    poses = np.stack([c * x - s * y, s * x + c * y, z], -1)
    turning = replace(clip, tracks=(replace(old, poses=poses),))
    new = at_rate(turning, generator(), fps=15.0).clip.tracks[0].poses
    for far, near in BONES:
        length = np.linalg.norm(poses[0, far] - poses[0, near])
        lengths = np.linalg.norm(new[:, far] - new[:, near], axis=-1)
        np.testing.assert_allclose(lengths, length, rtol=1e-9)


def test_clips_too_short_for_a_stretch_are_left_alone(clip: Clip) -> None:
    track = clip.tracks[0]
    few = slice(0, 4)
    short = Track(
        "short", track.keypoints[few], track.confidences[few], track.poses[few],
        track.interpolated[few],
    )  # fmt: skip
    short_clip = Clip("short", CAMERA, 10.0, np.arange(4), (short,))
    for change in (partial(with_ghosts, low=True), with_jumping_limbs):
        spoiled, affected = change(short_clip, generator())
        assert not affected.any()
        np.testing.assert_array_equal(spoiled.tracks[0].keypoints, short.keypoints)
