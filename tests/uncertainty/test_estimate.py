"""One answer: what is there with more than even odds, at its mean place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.models.log_posterior import motion, state_camera
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.solver.limbs import limbs_of
from imapper_prob.uncertainty.clusters import object_clusters
from imapper_prob.uncertainty.estimate import expected_scene
from imapper_prob.uncertainty.motion import drawn_motion, height_deviation
from tests.models import worlds
from tests.runs import posterior


def chair(
    x: float, y: float, label: str = "chair", *, yaw: float = 0.3, ahead: float = 0.0
) -> SceneObject:
    seat = Cuboid("seat", np.array([0, ahead, 0.2]), np.full(3, 0.4))
    return SceneObject(label, Placement(x, y, yaw), (seat,))


def test_what_has_more_than_even_odds_stands_at_its_mean_on_the_ray() -> None:
    objects = [(chair(0.0, 3.8),), (chair(0.0, 4.2), chair(2.0, 5.0, "bed")), (chair(0.0, 4.0),)]
    clusters = object_clusters(objects, np.zeros((1, 3)), radius=0.5)
    joints = worlds.walk(5)
    motions = [(worlds.CAMERA, joints)] * 3
    scene = expected_scene(worlds.CAMERA, clusters, objects, motions)
    (only,) = scene.objects
    assert only.label == "chair"
    np.testing.assert_allclose(only.centre[:2], [0.0, (3.8 * 4.2 * 4.0) ** (1 / 3)], atol=1e-9)
    np.testing.assert_allclose(scene.joints, joints, atol=1e-9)


def test_it_is_turned_as_those_of_its_label_are_in_the_mean() -> None:
    turns = (np.pi - 0.1, -np.pi + 0.3, np.pi + 0.1)
    own = [(chair(0.0, 4.0, yaw=yaw, ahead=0.1),) for yaw in turns]
    objects = [*own, (chair(0.1, 4.0, "stool", yaw=1.0),)]
    clusters = object_clusters(objects, np.zeros((1, 4)), radius=0.5)
    (only,) = expected_scene(
        worlds.CAMERA, clusters, objects, [(worlds.CAMERA, worlds.walk(5))] * 4
    ).objects
    (cluster,) = clusters
    # 0.1 beyond straight back, whichever way round; its middle stays in the middle.
    assert np.cos(only.placement.yaw - np.pi - 0.1) == pytest.approx(1.0, abs=1e-3)
    x, y = cluster.positions.T
    assert np.arctan2(*only.centre[:2]) == pytest.approx(np.arctan2(x, y).mean())


def made(width: float, depth: float, label: str, y: float = 4.0) -> SceneObject:
    seat = Cuboid("seat", np.array([0, 0, 0.2]), np.array([width, depth, 0.4]))
    back = Cuboid("back", np.array([0, -0.1, 0.5]), np.array([width, 0.1, 0.2]))
    return SceneObject(label, Placement(0.0, y, 0.5), (seat, back))


@pytest.mark.parametrize(("apart", "piece"), [(0.0, "chair"), (0.4, "couch")])
def test_it_is_the_piece_that_overlaps_most_with_what_it_may_be(apart: float, piece: str) -> None:
    """A chair, if it is sure where it stands; otherwise the couch meets more of the chairs."""
    objects = [(made(0.4, 0.5, "chair", 4.0 + apart * side),) for side in (-1, -0.5, 0, 0.5, 1)]
    objects += [(made(1.6, 0.8, "couch"),), (made(1.6, 0.8, "couch"),)]
    clusters = object_clusters(objects, np.zeros((1, 7)), radius=0.9)
    motions = [(worlds.CAMERA, worlds.walk(5))] * 7
    (only,) = expected_scene(worlds.CAMERA, clusters, objects, motions).objects
    assert only.label == piece
    size = only.bounds[1] - only.bounds[0]
    assert size[:2] == pytest.approx((0.4, 0.5) if piece == "chair" else (1.6, 0.8))
    np.testing.assert_allclose(only.centre[:2], [0.0, 4.0], atol=0.03)
    assert [c.part for c in only.cuboids] == ["seat", "back"]


@pytest.mark.parametrize(
    ("drawn", "kind"),
    [
        (("shelf", "shelf", "couch", "couch", "couch", "shelf", "shelf"), {"shelf"}),
        (
            ("chair", "stool", "shelf", "shelf", "shelf", "bench", "chair"),
            {"chair", "stool", "bench"},
        ),
    ],
)
def test_it_is_of_the_most_probable_kind(drawn: tuple[str, ...], kind: set[str]) -> None:
    """What overlaps most with all is of the other kind here, and stands in their middle."""
    places = 4.0 + np.linspace(-0.6, 0.6, len(drawn))
    sizes = {"couch": (1.6, 0.9), "shelf": (0.9, 0.3)}
    objects = [
        (made(*sizes.get(label, (0.4, 0.5)), label, float(y)),)
        for label, y in zip(drawn, places, strict=True)
    ]
    clusters = object_clusters(objects, np.zeros((1, len(drawn))), radius=1.5)
    motions = [(worlds.CAMERA, worlds.walk(5))] * len(drawn)
    assert len(clusters) == 1
    (only,) = expected_scene(worlds.CAMERA, clusters, objects, motions).objects
    assert only.label in kind


def test_motion_seen_by_other_cameras_is_averaged_as_it_is_seen() -> None:
    joints = worlds.walk(5)
    low = replace(worlds.CAMERA, elevation=worlds.CAMERA.elevation - 0.2)
    # Seen from lower down the same picture is a lower world.
    lower = low.to_world(worlds.CAMERA.to_camera(joints))
    scene = expected_scene(worlds.CAMERA, (), (), [(worlds.CAMERA, joints), (low, lower)])
    np.testing.assert_allclose(scene.joints, joints, atol=1e-9)


def test_limbs_differ_by_the_pose_tolerance_and_the_pelvis_in_height() -> None:
    source, states = posterior().solution, posterior().samples.states
    rng, problem = np.random.default_rng(0), source.problem
    numbers, off = [], []
    for state in states[:40]:
        camera = state_camera(source.clip.camera, state)
        expected = limbs_of(problem, state, camera)
        apart = drawn_motion(rng, problem, state, camera, fps=source.clip.fps) - expected.joints
        off.append(apart)
        limbs = np.delete(apart - apart[:, [PELV]], PELV, axis=1)
        ray, known = (np.delete(a, PELV, axis=1) for a in (expected.rays, expected.known))
        along = (limbs * ray).sum(-1, keepdims=True) * ray
        own = np.delete(problem.pose_tolerance, PELV)[:, None]
        numbers.append((along + (limbs - along) / np.sqrt(1.0 - known[..., None])) / own)
    off, numbers = np.concatenate(off), np.concatenate(numbers)
    assert not off[:, PELV, :2].any()
    # Some 40 clips of ten correlation times, 45 numbers each.
    assert np.sqrt((numbers**2).mean()) == pytest.approx(1.0, rel=0.05)
    expected = np.concatenate(
        [height_deviation(problem, motion(problem, state)) for state in states[:40]]
    )
    # About 800 that are independent: known to 2.5 %.
    assert np.std(off[:, PELV, 2] / expected) == pytest.approx(1.0, abs=4 * 0.025)
    summary = posterior().joints()
    # Along the ray, here nearly along y, detections say nothing of a joint.
    assert np.all(summary.standard_deviation[:, 0, 1] >= 0.9 * problem.pose_tolerance[0])


def test_deviations_of_joints_last_as_long_as_errors_of_frames_do() -> None:
    source, states = posterior().solution, posterior().samples.states
    problem, fps = source.problem, 5.0
    camera, rng = state_camera(source.clip.camera, states[0]), np.random.default_rng(0)
    expected = limbs_of(problem, states[0], camera).joints
    off = [drawn_motion(rng, problem, states[0], camera, fps=fps) - expected for _ in range(40)]
    # Along the ray, nearly y, where detections say nothing.
    limbs = np.delete(np.array(off) - np.array(off)[:, :, [PELV]], PELV, axis=2)[..., 1]
    one, next_one = limbs[:, :-1], limbs[:, 1:]
    repeated = 1.2 * fps
    memory = np.sum(one * next_one) / np.sqrt(np.sum(one**2) * np.sum(next_one**2))
    # Some thousand deviations that are independent.
    assert memory == pytest.approx((repeated - 1) / (repeated + 1), abs=0.03)


def test_the_estimate_of_a_run_is_one_scene() -> None:
    scene = posterior().estimate
    assert scene.joints.shape == (posterior().clip.n_frames, 16, 3)
    likely = [c for c in posterior().clusters() if c.presence > 0.5]
    assert len(scene.objects) == len(likely)
    for o, cluster in zip(scene.objects, likely, strict=True):
        assert o.label in cluster.labels
