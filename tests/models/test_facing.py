"""Where somebody faces in a scenelet, given the lifted poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.kernels.placement import expected_facing, log_yaw_density
from imapper_prob.models.path_prior import StaticPath
from imapper_prob.models.problem import Problem, pack_problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import turned
from tests.models import worlds

TURN = 0.7
"""Radians by which the person on the path is turned to the left of straight ahead."""


def turned_walk(*, pitch: float = 0.0, roll: float = 0.0, **settings: float) -> Problem:
    """Somebody walks turned by ``TURN``, as a camera of this pitch and roll sees it."""
    joints = worlds.walk(20)
    rng = np.random.default_rng(0)
    clip = worlds.clip_of(joints, rng)
    pelvis = joints[:, [6]]
    joints = pelvis + turned(joints - pelvis, np.full(len(joints), TURN))
    camera = replace(worlds.CAMERA, pitch=pitch, roll=roll)
    seen = camera.to_camera(joints)
    path = worlds.path_of(worlds.walk(20))
    path = StaticPath(path.estimate, path.lift, path.deviation, seen - seen[:, [6]], path.posed)
    prior = worlds.camera_prior()
    prior = replace(prior, mean=np.array([pitch, 1.5, 0.0, 0.0, roll]))
    return pack_problem(clip, path, prior, worlds.library(), settings=ModelSettings(**settings))


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (-0.4, 0.0), (-0.3, 0.25)])
def test_a_scenelet_is_expected_to_face_as_the_path_does(pitch: float, roll: float) -> None:
    """In the world, whatever the tilt of the camera in whose axes poses are given."""
    problem = turned_walk(pitch=pitch, roll=roll)
    expected = expected_facing(problem, 0, 5)
    assert expected == pytest.approx((np.cos(TURN), np.sin(TURN)), abs=1e-6)
    off = np.radians([0.0, 10.0, 40.0, 90.0, 180.0])
    density = [log_yaw_density(problem, 0, 5, TURN + angle) for angle in off]
    assert density == sorted(density, reverse=True)
    mirrored = [log_yaw_density(problem, 0, 5, TURN - angle) for angle in off]
    assert mirrored == pytest.approx(density, abs=1e-5)


@pytest.mark.parametrize("spread", [0.05, 0.3, 2.0])
def test_the_density_is_one_and_periodic(spread: float) -> None:
    problem = worlds.facing_about(turned_walk(facing_spread=spread))
    yaws = np.linspace(-np.pi, np.pi, 4000, endpoint=False)
    density = np.exp([log_yaw_density(problem, 1, 3, yaw) for yaw in yaws])
    assert density.mean() * 2 * np.pi == pytest.approx(1.0, abs=1e-9)
    again = log_yaw_density(problem, 1, 3, yaws[17] + 4 * np.pi)
    assert again == pytest.approx(np.log(density[17]))
    # Half of it is within one spread, as long as it does not wrap.
    near = np.array(expected_facing(problem, 1, 3)) @ [np.cos(yaws), np.sin(yaws)]
    if spread < 0.1:
        within = density[np.arccos(np.clip(near, -1, 1)) < spread].sum() * 2 * np.pi / 4000
        assert within == pytest.approx(0.5, abs=0.02)


def test_only_frames_of_the_scenelet_are_asked() -> None:
    problem = turned_walk()
    n = int(problem.lengths[0])
    elsewhere = problem.path_facing.copy()
    elsewhere[:5], elsewhere[5 + n :] = (0.0, 1.0), (-1.0, 0.0)
    other = problem._replace(path_facing=elsewhere)
    assert expected_facing(other, 0, 5) == expected_facing(problem, 0, 5)
    assert expected_facing(other, 0, 4) != expected_facing(problem, 0, 4)
    assert expected_facing(other, 0, 6) != expected_facing(problem, 0, 6)


def test_nobody_has_looked_or_all_directions_are_alike() -> None:
    unseen = turned_walk(likelihood=0.0)
    assert not unseen.path_facing.any()
    n = int(unseen.lengths[0])
    around = 2 * np.pi * np.arange(n) / n
    facings = np.zeros_like(unseen.path_facing)
    facings[5 : 5 + n] = np.stack([np.cos(around), np.sin(around)], -1)
    for problem in (unseen, unseen._replace(path_facing=facings)):
        assert expected_facing(problem, 0, 5) == (0.0, 0.0)
        for yaw in (-2.0, 0.0, 1.0):
            assert log_yaw_density(problem, 0, 5, yaw) == pytest.approx(-np.log(2 * np.pi))
