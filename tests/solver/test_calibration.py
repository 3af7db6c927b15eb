from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.placement import in_support
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.scene import MEASURED_FOCAL, Clip, Track
from imapper_prob.models.settings import CameraSettings
from imapper_prob.models.skeleton import LANK, PELV, RANK
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver import camera_prior
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.static_path import estimate_static_path
from tests.models.worlds import deviations
from tests.solver.walkers import CAMERA

CORPUS = Path(__file__).parents[3] / "shared" / "i3db"
N_FRAMES = 240
CONSTANTS = CameraSettings()
FOCAL_SPREAD = 0.05
"""What a clip's focal length is given where nothing else is said."""


def feet(
    rng: np.random.Generator,
    *,
    pitch: float,
    elevation: float,
    log_focal: float = 0.0,
    log_body: float = 0.0,
    offset: float = 0.0,
    roll: float = 0.0,
    nominal_roll: float | None = None,
    spread: float = CONSTANTS.ankle_spread,
) -> tuple[Clip, StaticPath]:
    """A static path that a camera of this pose would have given of somebody who walks about.

    One error of the ankle's height is drawn per correlation time of 12 frames.
    """
    world = np.zeros((N_FRAMES, 3))
    t = np.arange(N_FRAMES)
    world[:, 0] = 1.5 * np.sin(t / 31)
    world[:, 1] = 4.5 + 1.5 * np.sin(t / 23)
    errors = spread * rng.standard_t(CONSTANTS.ankle_dof, N_FRAMES // 12)
    world[:, 2] = CONSTANTS.ankle + offset + np.repeat(errors, 12)
    camera = replace(CAMERA, pitch=pitch, elevation=elevation, roll=roll)
    # What the true person looks like to someone who takes focal length and body as nominal.
    seen = camera.to_camera(world)
    level = replace(CAMERA, pitch=0.0, elevation=0.0, roll=roll)
    x, depth, z = level.to_world(seen).T
    seen = level.to_camera(np.stack([x, depth * np.exp(-log_focal), z], -1) * np.exp(-log_body))
    pelvis = seen + np.array([0.0, 0.0, 0.8])
    poses = np.zeros((N_FRAMES, 16, 3))
    poses[:, RANK, 2] = poses[:, LANK, 2] = -0.8
    poses[:, LANK] += 0.3 * CAMERA.rotation[2]  # the other foot is in the air
    place = np.stack([pelvis[:, 0] / pelvis[:, 1], np.log(pelvis[:, 1])], -1)
    path = StaticPath(
        place, pelvis[:, 2] / pelvis[:, 1], np.ones_like(place), poses,
        np.ones(N_FRAMES, bool),
    )  # fmt: skip
    track = Track(
        "walker", np.zeros((N_FRAMES, 16, 2)), np.ones((N_FRAMES, 16)), poses,
        np.zeros(N_FRAMES, bool),
    )  # fmt: skip
    nominal = replace(CAMERA, roll=roll if nominal_roll is None else nominal_roll)
    return Clip("feet", nominal, 10.0, np.arange(N_FRAMES), (track,)), path


def distance(prior: CameraPrior, truth: np.ndarray) -> float:
    """Squared Mahalanobis distance; chi-squared with five degrees of freedom if honest."""
    error = truth - prior.mean
    return float(error @ np.linalg.solve(prior.covariance, error))


@pytest.mark.slow
def test_is_calibrated_over_cameras_drawn_from_the_prior() -> None:
    """300 worlds: the mean distance is known to sqrt(10 / 300) = .18, coverage to .017."""
    rng, constants = np.random.default_rng(0), CONSTANTS
    distances, z = [], []
    for _ in range(300):
        truth = np.array(
            [
                CAMERA.pitch + constants.pitch * rng.standard_normal(),
                CAMERA.elevation * np.exp(constants.log_elevation * rng.standard_normal()),
                FOCAL_SPREAD * rng.standard_normal(),
                constants.log_body * rng.standard_normal(),
                CAMERA.roll + constants.roll * rng.standard_normal(),
            ]
        )
        clip, path = feet(
            rng, pitch=truth[0], elevation=truth[1], log_focal=truth[2], log_body=truth[3],
            roll=truth[4], nominal_roll=CAMERA.roll,
            offset=constants.ankle_offset * rng.standard_normal(),
        )  # fmt: skip
        prior = estimate_camera(clip, path)
        distances.append(distance(prior, truth))
        z.append((truth - prior.mean) / deviations(prior))
    assert abs(np.mean(distances) - 5) < 4 * 0.18
    coverage = (np.abs(z) < 1.645).mean(0)
    assert np.all(np.abs(coverage - 0.9) < 4 * 0.017)


@pytest.mark.parametrize(("pitch", "elevation"), [(-1.0, 3.0), (1.0, 1.5), (-0.1, 0.2)])
def test_a_camera_at_the_border_of_what_is_possible_is_inside(
    pitch: float, elevation: float
) -> None:
    clip, path = feet(np.random.default_rng(1), pitch=-0.05, elevation=1.5)
    clip = replace(clip, camera=replace(clip.camera, pitch=pitch, elevation=elevation))
    seen = clip.tracks[0]
    nobody = replace(
        seen,
        keypoints=np.full_like(seen.keypoints, np.nan),
        confidences=np.zeros_like(seen.confidences),
    )
    for track in (seen, nobody):
        found = estimate_camera(replace(clip, tracks=(track,)), path)
        assert in_support(np.array(found.mean))


def test_height_is_calibrated_where_only_the_feet_spread() -> None:
    """With all else held, z of 300 worlds has a root mean square known to 1 / sqrt(600)."""
    rng = np.random.default_rng(10)
    held = CameraSettings(pitch=1e-5, log_body=1e-5, ankle_offset=1e-5)
    z = []
    for _ in range(300):
        clip, path = feet(rng, pitch=CAMERA.pitch, elevation=1.3)
        prior = estimate_camera(replace(clip, focal_spread=1e-5), path, settings=held)
        z.append((1.3 - prior.mean[1]) / deviations(prior)[1])
    assert abs(np.sqrt(np.mean(np.square(z))) - 1) < 3 / np.sqrt(600)


def test_feet_tell_height_better_than_the_prior_and_tie_it_to_pitch() -> None:
    clip, path = feet(np.random.default_rng(1), pitch=np.deg2rad(-6.0), elevation=2.2)
    prior = estimate_camera(clip, path)
    spread = deviations(prior)
    assert abs(prior.mean[1] - 2.2) < 3 * spread[1]
    assert spread[1] < 0.3
    assert spread[0] < CONSTANTS.pitch
    assert prior.covariance[0, 1] < -0.2 * spread[0] * spread[1]


def test_a_rolled_camera_is_levelled() -> None:
    shape = {"pitch": np.deg2rad(-6.0), "elevation": 2.2}
    level = estimate_camera(*feet(np.random.default_rng(2), **shape))
    rolled = estimate_camera(*feet(np.random.default_rng(2), roll=0.2, **shape))
    np.testing.assert_allclose(rolled.mean[:2], level.mean[:2], atol=0.05)


def test_without_feet_the_prior_comes_back() -> None:
    clip, path = feet(np.random.default_rng(3), pitch=0.0, elevation=1.0)
    track = replace(clip.tracks[0], confidences=np.zeros((N_FRAMES, 16)))
    prior = estimate_camera(replace(clip, tracks=(track,)), path)
    np.testing.assert_allclose(prior.mean, [CAMERA.pitch, CAMERA.elevation, 0, 0, 0], atol=1e-12)
    expected = [
        CONSTANTS.pitch, CONSTANTS.log_elevation * CAMERA.elevation,
        clip.focal_spread, CONSTANTS.log_body, CONSTANTS.roll,
    ]  # fmt: skip
    np.testing.assert_allclose(deviations(prior), expected)


def test_a_measured_focal_length_is_kept() -> None:
    clip, path = feet(np.random.default_rng(4), pitch=-0.1, elevation=1.3)
    known = estimate_camera(replace(clip, focal_spread=MEASURED_FOCAL), path)
    assert deviations(known)[2] <= 0.005
    assert deviations(estimate_camera(clip, path))[2] > 0.04


@pytest.mark.parametrize("elevation", [0.15, 0.5, 3.0])
def test_elevation_is_positive(elevation: float) -> None:
    clip, path = feet(np.random.default_rng(5), pitch=np.deg2rad(5.0), elevation=elevation)
    assert estimate_camera(clip, path).mean[1] > 0


def test_an_assumed_focal_length_is_as_doubtful_as_the_clip_says() -> None:
    clip, path = feet(np.random.default_rng(4), pitch=-0.1, elevation=1.3)
    wide = estimate_camera(replace(clip, focal_spread=0.2), path)
    assert deviations(wide)[2] == pytest.approx(0.2, rel=0.1)
    near = estimate_camera(clip, path)
    assert deviations(wide)[1] >= deviations(near)[1]


def test_a_hidden_foot_that_was_made_up_does_not_lower_the_floor() -> None:
    clip, path = feet(np.random.default_rng(8), pitch=CAMERA.pitch, elevation=1.4, spread=0.02)
    right = estimate_camera(clip, path)
    poses = path.poses.copy()
    poses[:, LANK] = poses[:, RANK] - 0.4 * CAMERA.rotation[2]
    confidences = clip.tracks[0].confidences.copy()
    confidences[:, LANK] = 0.5
    hidden = replace(clip, tracks=(replace(clip.tracks[0], confidences=confidences),))
    made_up = replace(path, poses=poses)
    assert estimate_camera(hidden, made_up).mean[1] == pytest.approx(right.mean[1])
    # Where neither is seen the lower guess is all there is, unless the person walks, as here.
    confidences[:, RANK] = 0.5
    neither = replace(clip, tracks=(replace(clip.tracks[0], confidences=confidences),))
    walker = estimate_camera(neither, made_up)
    assert abs(walker.mean[1] - right.mean[1]) < deviations(right)[1]
    slow = replace(neither, fps=neither.fps / 4)
    assert estimate_camera(slow, made_up).mean[1] > right.mean[1] + 0.2


def unseen_legs(clip: Clip, *, elevation: float) -> Clip:
    """The clip with no detection of ankles, at another nominal height of the camera."""
    confidences = clip.tracks[0].confidences.copy()
    confidences[:, [RANK, LANK]] = 0.0
    track = replace(clip.tracks[0], confidences=confidences)
    camera = replace(clip.camera, elevation=elevation)
    return replace(clip, camera=camera, tracks=(track,))


@pytest.mark.parametrize("nominal", [1.0, 2.0])
def test_who_walks_tells_the_height_without_feet(nominal: float) -> None:
    clip, path = feet(np.random.default_rng(11), pitch=CAMERA.pitch, elevation=1.4, spread=0.02)
    seen = estimate_camera(clip, path)
    poses = np.zeros_like(path.poses)  # no lifted foot is where it belongs
    found = estimate_camera(unseen_legs(clip, elevation=nominal), replace(path, poses=poses))
    assert abs(found.mean[1] - 1.4) < 3 * deviations(found)[1]
    assert deviations(found)[1] < 2 * deviations(seen)[1]


@pytest.mark.parametrize("nominal", [1.0, 2.0])
def test_a_pelvis_is_at_its_usual_height_where_no_foot_is_seen(nominal: float) -> None:
    """A pelvis .89 m above the floor of a person who hardly moves; the library's are .69 ± .19."""
    clip, path = feet(np.random.default_rng(12), pitch=CAMERA.pitch, elevation=1.4, spread=0.02)
    still = replace(path, estimate=np.broadcast_to(path.estimate[:1], path.estimate.shape).copy(),
                    lift=np.broadcast_to(path.lift[:1], path.lift.shape).copy())  # fmt: skip
    blind = unseen_legs(clip, elevation=nominal)
    found = estimate_camera(blind, still)
    prior = CONSTANTS.log_elevation * nominal
    assert deviations(found)[1] < prior / 1.4
    assert abs(found.mean[1] - 1.2) < abs(nominal - 1.2)
    assert abs(found.mean[1] - 1.4) < 2 * deviations(found)[1]


def test_constants_of_the_pelvis_are_those_of_the_library() -> None:
    across, drop, median = [], [], []
    for scenelet in load_library():
        joints = scenelet.joints
        pelvis = joints[:, PELV]
        width = min(2 * round(scenelet.fps / 2) + 1, len(pelvis))
        speed = uniform_filter1d(np.gradient(pelvis[:, :2], axis=0), width, axis=0, mode="nearest")
        across.append(scenelet.fps * np.linalg.norm(speed, axis=1))
        drop.append(pelvis[:, 2] - joints[:, [RANK, LANK], 2].min(1))
        median.append(np.median(pelvis[:, 2]))
    fast = np.concatenate(across) > camera_prior._WALKING
    upright = np.concatenate(drop)[fast]
    assert np.mean(upright < 0.6) < 0.02
    assert np.median(upright) == pytest.approx(camera_prior._UPRIGHT, abs=0.01)
    assert (np.mean(median), np.std(median)) == pytest.approx(camera_prior._PELVIS, abs=0.005)


def test_frames_on_chairs_and_wrong_feet_do_not_lift_the_floor() -> None:
    clip, path = feet(np.random.default_rng(6), pitch=CAMERA.pitch, elevation=1.4, spread=0.05)
    poses = path.poses.copy()
    poses[:36, [RANK, LANK], 2] += 1.5
    wrong = estimate_camera(clip, replace(path, poses=poses))
    right = estimate_camera(clip, path)
    assert abs(wrong.mean[1] - right.mean[1]) < deviations(right)[1] / 2


def test_feet_on_a_bed_for_most_of_a_clip_are_not_taken_for_the_floor() -> None:
    """Three quarters of the frames: both feet .45 m up and level with the pelvis.

    The pelvis stays where it is; ankles come up to it from .8 m beneath.
    """
    clip, path = feet(np.random.default_rng(7), pitch=CAMERA.pitch, elevation=1.4, spread=0.02)
    right = estimate_camera(clip, path)
    lying = np.arange(N_FRAMES) >= N_FRAMES // 4
    up = clip.camera.rotation[2]
    poses = path.poses.copy()
    poses[lying, RANK] = poses[lying, LANK] = 0.0
    pelvis = path.pelvis
    pelvis[lying] -= 0.35 * up  # ankles from .09 to .54 m above the floor
    place = np.stack([pelvis[:, 0] / pelvis[:, 1], np.log(pelvis[:, 1])], -1)
    moved = replace(path, estimate=place, lift=pelvis[:, 2] / pelvis[:, 1], poses=poses)
    bed = estimate_camera(clip, moved)
    assert abs(bed.mean[1] - right.mean[1]) < deviations(right)[1]


def test_a_path_of_another_clip_is_an_error() -> None:
    clip, path = feet(np.random.default_rng(7), pitch=0.0, elevation=1.0)
    half = replace(
        path, estimate=path.estimate[:9], lift=path.lift[:9], deviation=path.deviation[:9],
        poses=path.poses[:9], posed=path.posed[:9],
    )  # fmt: skip
    with pytest.raises(InputError, match="clip feet has 240 frames, the static path 9"):
        estimate_camera(clip, half)


def test_a_camera_under_the_floor_is_an_error() -> None:
    clip, _ = feet(np.random.default_rng(8), pitch=0.0, elevation=1.0)
    with pytest.raises(InputError, match="a camera -1 m above the floor"):
        replace(clip, camera=replace(clip.camera, elevation=-1.0))


@pytest.mark.corpus
@pytest.mark.skipif(not CORPUS.is_dir(), reason="i3DB scenes are not beside the repository")
@pytest.mark.slow
def test_covers_the_cameras_of_the_benchmark() -> None:
    from imapper_prob.clips.i3db import read_i3db, read_i3db_truth

    for scene in ("Scene04", "Scene10", "Scene13", "Scene14"):
        clip = read_i3db(CORPUS / scene)
        prior = estimate_camera(clip, estimate_static_path(clip))
        camera = read_i3db_truth(CORPUS / scene, clip).camera
        error = np.array([camera.pitch, camera.elevation]) - prior.mean[:2]
        # 99.9 % of a chi-squared with two degrees of freedom.
        assert error @ np.linalg.solve(prior.covariance[:2, :2], error) < 13.8, scene
