"""Several people: one camera for all, furniture that is shared found once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, Settings
from imapper_prob.models.skeleton import PELV
from imapper_prob.solver.actors import (
    Part,
    Solved,
    _mutual_cost,
    share_camera,
    shared_furniture,
    solve_actors,
    solved,
)
from imapper_prob.uncertainty.summary import distances_to_truth
from lab.couple import CAMERA, N_FRAMES, at_one_table, chairs_and_tables
from tests.models.worlds import couch, deviations

FOCAL_SPREAD = 0.05


@cache
def library() -> Library:
    return chairs_and_tables(12)


def measured() -> Settings:
    """The camera's height is known to 2 %: nobody's feet are seen, and nobody walks."""
    return Settings(camera=CameraSettings(log_elevation=0.02))


@cache
def couple() -> Solved:
    clip = at_one_table(1)
    return solved(clip, solve_actors(clip, library(), settings=measured()))


def prior(settings: CameraSettings) -> CameraPrior:
    """What is known of a camera and a body before anybody's feet were seen."""
    spread = [
        settings.pitch, settings.log_elevation * CAMERA.elevation, FOCAL_SPREAD,
        settings.log_body, settings.roll,
    ]  # fmt: skip
    mean = np.array([CAMERA.pitch, CAMERA.elevation, 0.0, 0.0, CAMERA.roll])
    return CameraPrior(mean, np.diag(spread) ** 2)


def told(seed: int, settings: CameraSettings) -> tuple[CameraPrior, np.ndarray, np.ndarray]:
    """A camera prior after one linear observation, with its precision and pull beyond the prior.

    In log elevation, where all of it is Gaussian.
    """
    rng = np.random.default_rng(seed)
    before = prior(settings)
    to_log = np.diag([1.0, 1.0 / CAMERA.elevation, 1.0, 1.0, 1.0])
    centre = np.array([CAMERA.pitch, np.log(CAMERA.elevation), 0.0, 0.0, CAMERA.roll])
    start = np.linalg.inv(to_log @ before.covariance @ to_log)
    slope = rng.normal(size=(3, 5))
    seen = slope.T @ slope * 50
    target = centre + rng.normal(scale=0.05, size=5)
    covariance = np.linalg.inv(start + seen)
    mean = covariance @ (start @ centre + seen @ target)
    elevation = np.exp(mean[1])
    back = np.diag([1.0, elevation, 1.0, 1.0, 1.0])
    mean[1] = elevation
    return CameraPrior(mean, back @ covariance @ back), seen, seen @ target


def test_one_actor_keeps_the_camera() -> None:
    settings = CameraSettings()
    own, _, _ = told(1, settings)
    (same,) = share_camera([own], nominal=CAMERA, focal_spread=FOCAL_SPREAD)
    np.testing.assert_allclose(same.mean, own.mean, atol=1e-9)
    np.testing.assert_allclose(same.covariance, own.covariance, atol=1e-12)


def test_precisions_add_up_and_the_prior_counts_once() -> None:
    """Against the Gaussian of seven numbers: the camera's four and three bodies."""
    settings = CameraSettings()
    actors = [told(seed, settings) for seed in (1, 2, 3)]
    shared = [0, 1, 2, 4]
    camera = np.array([settings.pitch, settings.log_elevation, FOCAL_SPREAD, settings.roll])
    centre = np.array([CAMERA.pitch, np.log(CAMERA.elevation), 0.0, CAMERA.roll, 0.0, 0.0, 0.0])
    information = np.diag(np.concatenate([camera, np.full(3, settings.log_body)]) ** -2.0)
    pull = information @ centre
    for k, (_, seen, push) in enumerate(actors):
        at = np.array([0, 1, 2, 4 + k, 3])  # of pitch, elevation, focal, body, roll
        information[np.ix_(at, at)] += seen
        pull[at] += push
    covariance = np.linalg.inv(information)
    mean = covariance @ pull
    everybody = [own for own, _, _ in actors]
    found = share_camera(everybody, nominal=CAMERA, focal_spread=FOCAL_SPREAD)
    for k, actor in enumerate(found):
        np.testing.assert_allclose(actor.mean[shared][[0, 2, 3]], mean[[0, 2, 3]], atol=1e-9)
        assert np.log(actor.mean[1]) == pytest.approx(mean[1])
        np.testing.assert_array_equal(actor.mean[shared], found[0].mean[shared])
        assert deviations(actor)[0] == pytest.approx(np.sqrt(covariance[0, 0]))
        # The body is known from one's own feet and from what others say of the camera; what
        # they say is passed on through the camera's four numbers.
        assert actor.mean[3] == pytest.approx(mean[4 + k])
        assert deviations(actor)[3] == pytest.approx(np.sqrt(covariance[4 + k, 4 + k]))


def test_windows_belong_to_one_actor() -> None:
    for actor, track in zip(couple().actors, couple().clip.tracks, strict=True):
        assert actor.clip.tracks == (track,)
        assert actor.problem.n_frames == N_FRAMES
        np.testing.assert_array_equal(
            actor.problem.used, (track.confidences > 0) & actor.problem.used
        )
    first, second = couple().actors
    np.testing.assert_array_equal(
        first.problem.camera_mean[[0, 1, 2, 4]], second.problem.camera_mean[[0, 1, 2, 4]]
    )


def test_both_people_and_their_table_are_found_once() -> None:
    result = couple()
    truth = result.clip.truth
    assert truth is not None
    for scene in result.scenes:
        # Nobody changes sides.
        left, right = (m[:, PELV, 0].mean() for m in scene.motions)
        assert left < -0.4
        assert right > 0.4
    best = result.scenes[0]
    assert sorted(o.label for o in best.objects) == ["chair", "chair", "table"]
    # Whether both bring it, or one of them has a scenelet with a chair alone, is .8 nats.
    brought_by = [
        dict(zip((o.label for o in s.objects), s.users, strict=True)) for s in result.scenes
    ]
    assert (0, 1) in [users.get("table") for users in brought_by]
    assert np.all(distances_to_truth(best.objects, truth.objects) < 0.4)
    values = [scene.log_posterior for scene in result.scenes]
    assert values == sorted(values, reverse=True)


def part(*objects: object, depth: float) -> Part:
    joints = np.zeros((4, 16, 3))
    joints[..., 1] = depth
    return Part(tuple(objects), joints, np.ones(4, bool))  # type: ignore[arg-type]


def test_what_two_found_is_one_and_the_nearer_one_is_believed() -> None:
    near = part(couch(0.0, 3.0), couch(3.0, 3.0, label="table"), depth=3.0)
    far = part(couch(0.2, 3.1, 0.1), couch(-4.0, 3.0), depth=5.0)
    objects, users = shared_furniture([far, near])
    assert [(o.label, o.placement.x) for o in objects] == [
        ("couch", 0.0), ("table", 3.0), ("couch", -4.0),
    ]  # fmt: skip
    assert users == ((0, 1), (1,), (0,))


def test_nobody_walks_through_furniture_where_nobody_is_detected() -> None:
    """Paths go on where a person is out of sight, through whatever others use there."""
    actor = couple().actors[0]
    walker = replace(part(depth=3.0), joints=np.tile([0.0, 3.0, 0.4], (4, 16, 1)))
    beside = part(couch(0.0, 3.0), depth=6.0)
    assert _mutual_cost(actor, walker, beside) > 0.1
    gone = replace(walker, detected=np.zeros(4, bool))
    assert _mutual_cost(actor, gone, beside) == 0


def test_other_labels_and_other_places_stay_two() -> None:
    one = part(couch(0.0, 3.0), depth=3.0)
    for other in (couch(0.0, 3.0, label="bed"), couch(1.5, 3.0)):
        objects, users = shared_furniture([one, part(other, depth=4.0)])
        assert len(objects) == 2
        assert users == ((0,), (1,))


def test_furniture_of_one_actor_is_not_merged_again() -> None:
    twice = part(couch(0.0, 3.0), couch(0.3, 3.0), depth=3.0)
    objects, _ = shared_furniture([twice, part(depth=4.0)])
    assert len(objects) == 2


def test_order_of_the_tracks_does_not_matter() -> None:
    clip = couple().clip
    turned = replace(clip, tracks=clip.tracks[::-1])
    other = solved(turned, solve_actors(turned, library(), settings=measured()))
    assert other.scenes[0].log_posterior == pytest.approx(couple().scenes[0].log_posterior)
    for one, two in zip(couple().scenes[0].motions, other.scenes[0].motions[::-1], strict=True):
        np.testing.assert_allclose(one, two, atol=1e-6)
