"""Frames in which the detector is on something else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Track
from imapper_prob.models.skeleton import LELB, LSHO, LWRI, MIRROR, N_JOINTS
from imapper_prob.solver.detections import own_detections
from imapper_prob.solver.elsewhere import frames_elsewhere
from tests.solver.walkers import walk

CLIP = walk(np.random.default_rng(0), pixel_error=5.0).clip
TRACK = CLIP.tracks[0]
T = CLIP.n_frames


def found(track: Track) -> list[int]:
    """Frames that are found to be elsewhere."""
    flags = frames_elsewhere(track, camera=CLIP.camera, fps=CLIP.fps, detections=DetectionModel())
    return np.flatnonzero(flags).tolist()


def on_clutter(first: int, end: int, *, aside: float, seed: int = 0) -> Track:
    """The track with scattered detections, ``aside`` pixels from where the person is before."""
    rng = np.random.default_rng(seed)
    points = np.array(TRACK.keypoints)
    middle = np.nanmean(points[first - 1], axis=0)
    place = middle + np.array([aside, 0.0]) + rng.normal(0.0, 120.0, (N_JOINTS, 2))
    points[first:end] = place + rng.normal(0.0, 5.0, (end - first, N_JOINTS, 2))
    return replace(TRACK, keypoints=points)


def test_nobody_who_walks_is_elsewhere() -> None:
    assert found(TRACK) == []


@pytest.mark.parametrize("seed", range(4))
def test_clutter_at_an_end_of_the_clip_is_told_from_the_person_by_its_shape(seed: int) -> None:
    """It is half a body away; what comes after it is too short to say who is who by itself."""
    track = on_clutter(T - 18, T - 2, aside=240.0, seed=seed)
    assert found(track) == list(range(T - 18, T - 2))


def test_a_person_in_a_mirror_is_elsewhere_too() -> None:
    points = np.array(TRACK.keypoints)
    points[20:32] += (-700.0, 0.0)
    assert found(replace(TRACK, keypoints=points)) == list(range(20, 32))


def test_sides_exchanged_and_an_arm_that_jumps_are_the_persons_own() -> None:
    points = np.array(TRACK.keypoints)
    points[20:30] = points[20:30, list(MIRROR)]
    points[40:48, [LSHO, LELB, LWRI]] += (250.0, 100.0)
    assert found(replace(TRACK, keypoints=points)) == []


def test_frames_elsewhere_count_as_undetected() -> None:
    track = on_clutter(20, 32, aside=600.0)
    (own,) = own_detections(replace(CLIP, tracks=(track,))).tracks
    assert (own.confidences[20:32] == 0).all()
    assert np.isnan(own.poses[20:32]).all()
    assert np.array_equal(own.keypoints[:20], TRACK.keypoints[:20], equal_nan=True)


def test_a_track_of_nobody_is_refused() -> None:
    rng = np.random.default_rng(1)
    points = np.tile(
        rng.uniform(0, (CLIP.camera.width, CLIP.camera.height), (T, 1, 2)), (1, N_JOINTS, 1)
    )
    points += rng.normal(0.0, 60.0, points.shape)
    with pytest.raises(InputError, match="nobody does"):
        own_detections(replace(CLIP, tracks=(replace(TRACK, keypoints=points),)))
