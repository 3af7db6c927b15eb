"""Faults of motions, each made by hand in a motion that had none."""

from __future__ import annotations

import re
from collections.abc import Callable

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import (
    BONES,
    HEAD,
    JOINTS,
    LANK,
    LELB,
    LKNE,
    LSHO,
    LWRI,
    NECK,
    RANK,
    RELB,
    RHIP,
    RKNE,
    RSHO,
    RWRI,
    THRX,
    turned,
)
from imapper_prob.scenelets.plausibility import (
    depth_inside,
    faults,
    floor_faults,
    furniture_faults,
    motion_faults,
    posture_faults,
)
from imapper_prob.scenelets.procedural.body import ANKLE_HEIGHT, Trunk, pose_body
from imapper_prob.scenelets.procedural.gait import Gait, Walk, arc, steady, walk_along

Array = NDArray[np.float64]
FPS = 10.0
BOX = SceneObject("chest", Placement(0.0, 0.0, 0.0), (Cuboid("body", [0, 0, 0.5], [1, 1, 1]),))


def standing(*, n_frames: int = 12, **angles: float) -> Array:
    """Somebody who stands still, knees and elbows slightly bent."""
    trunk = Trunk.of(np.broadcast_to([0.0, 0.0, 0.88], (n_frames, 3)), 0.0, **angles)
    ankles = np.array([[0.1, 0.02, ANKLE_HEIGHT], [-0.1, 0.02, ANKLE_HEIGHT]])
    wrists = trunk.shoulders + np.array([[0.05, 0.1, -0.45], [-0.05, 0.1, -0.45]])
    return pose_body(trunk, ankles=np.broadcast_to(ankles, wrists.shape), wrists=wrists)


def turn(joints: Array, pivot: int, moved: list[int], axis: int, degrees: float) -> Array:
    """Joints turned about a pivot in all frames, around x, y or z."""
    a, b = [k for k in range(3) if k != axis]
    if axis == 1:
        a, b = b, a
    offset = joints[:, moved] - joints[:, [pivot]]
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotated = offset.copy()
    rotated[..., a] = c * offset[..., a] - s * offset[..., b]
    rotated[..., b] = s * offset[..., a] + c * offset[..., b]
    changed = joints.copy()
    changed[:, moved] = joints[:, [pivot]] + rotated
    return changed


@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-5, 5))
def test_standing_and_walking_have_no_fault_anywhere(yaw: float, x: float) -> None:
    times = np.arange(18) / FPS
    walk: Walk = walk_along(arc(steady(1.0), 0.4), times, Gait(step_time=0.5, phase=0.2, lean=0.05))
    for joints in (standing(), pose_body(walk.trunk, ankles=walk.ankles, wrists=walk.wrists)):
        assert faults(Placement(x, 1.0, yaw).apply(joints), (), fps=FPS) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda j: turn(j, RKNE, [RANK], 0, -165), "right knee bends by 1.. degrees"),
        (lambda j: turn(j, RKNE, [RANK], 0, 55), "right knee bends backward by"),
        (lambda j: turn(j, LELB, [LWRI], 0, 140), "left elbow bends by"),
        (lambda j: turn(j, RHIP, [RKNE, RANK], 0, -70), "right hip bends by -"),
        (lambda j: turn(j, RHIP, [RKNE, RANK], 0, 178), "right hip bends by 1"),
        (lambda j: turn(j, RHIP, [RKNE, RANK], 1, -65), "right thigh goes outward by 6"),
        (lambda j: turn(j, RHIP, [RKNE, RANK], 1, 45), "right thigh goes outward by -4"),
        (lambda j: turn(j, RSHO, [RELB, RWRI], 0, -80), "right upper arm goes backward"),
        (lambda j: turn(j, LSHO, [LELB, LWRI], 1, -95), "left upper arm goes inward"),
        (lambda j: turn(j, THRX, [HEAD, NECK], 1, 60), "neck bends by"),
        (lambda j: turn(j, THRX, [HEAD, NECK], 0, -65), "neck bends by"),
        (lambda j: turn(j, THRX, [RSHO, LSHO, RELB, LELB, RWRI, LWRI], 2, 60), "trunk twists by"),
        (lambda j: standing(tilt=0.85), "trunk bends sideways by"),
    ],
)
def test_joints_bent_too_far_are_named(change: Callable[[Array], Array], message: str) -> None:
    assert posture_faults(standing()) == []
    found = "; ".join(posture_faults(change(standing())))
    assert re.search(message, found), found


def test_the_worst_frame_is_named() -> None:
    joints = standing()
    bent = turn(joints, LKNE, [LANK], 0, -165)
    joints[7] = bent[7]
    (found,) = (f for f in posture_faults(joints) if "knee bends by" in f)
    assert found.startswith("left knee")
    assert found.endswith("in frame 7")


@pytest.mark.parametrize(("sunk", "faulty"), [(0.028, False), (0.032, True)])
def test_feet_below_the_floor_are_named(sunk: float, faulty: bool) -> None:
    joints = standing()
    joints[3:, LANK, 2] -= sunk
    assert any("LANK is" in f and "too low" in f for f in floor_faults(joints)) == faulty


def test_a_hand_below_the_floor_is_named() -> None:
    joints = standing()
    joints[4, RWRI, 2] = -0.06
    assert floor_faults(joints) == ["RWRI is 6 cm too low in frame 4"]


def test_nobody_stands_on_nothing() -> None:
    joints = standing()
    joints[5] += (0.0, 0.0, 0.06)
    assert floor_faults(joints) == ["stands on nothing in frame 5"]
    # On a high bed one may lie.
    lying = joints[..., [0, 2, 1]] + (0.0, 0.0, 0.9)
    assert floor_faults(lying) == []


@pytest.mark.parametrize(("slide", "faulty"), [(0.028, False), (0.032, True)])
def test_a_foot_that_slides_while_it_stands_is_named(slide: float, faulty: bool) -> None:
    joints = standing()
    joints[:, RANK, 1] += np.linspace(0.0, slide, len(joints))
    assert any(f.startswith("right foot slides") for f in floor_faults(joints)) == faulty


def test_a_foot_may_be_lifted_and_put_elsewhere() -> None:
    joints = standing()
    joints[4:6, RANK, 2] += 0.05
    joints[6:, RANK, 1] += 0.2
    assert floor_faults(joints) == []


def test_speeds_are_named() -> None:
    joints = standing()
    joints[5:] += (0.25, 0.0, 0.0)
    assert motion_faults(joints, fps=FPS) == ["PELV moves at 2.5 m/s in frame 4"]
    assert len(motion_faults(joints, fps=3 * FPS)) == len(JOINTS)
    assert motion_faults(joints, fps=FPS / 2) == []


def test_bones_that_stretch_are_named() -> None:
    joints = standing()
    joints[4, HEAD, 2] += 0.041
    assert motion_faults(joints, fps=FPS) == ["HEAD-NECK changes its length by 4 cm"]
    assert motion_faults(standing() * 1.2, fps=FPS) == []


def test_bones_in_furniture_are_named() -> None:
    joints = np.add(standing(), (0.0, 0.6, 0.0))  # knees and wrists are ahead of the hips
    assert furniture_faults(joints, [BOX]) == []
    inside = furniture_faults(joints - (0.0, 0.2, 0.0), [BOX])
    assert "RANK-RKNE is" in inside[0]
    assert all("inside the body of the chest" in f for f in inside)
    # The piece may stand anywhere, and so may the person with it.
    elsewhere = Placement(2.0, -1.0, 2.2)
    assert len(inside) == len(
        furniture_faults(elsewhere.apply(joints - (0.0, 0.2, 0.0)), [BOX.moved(elsewhere)])
    )


def test_an_arm_through_a_board_is_as_deep_as_its_hand_is_beyond() -> None:
    board = SceneObject(
        "shelf", Placement(0.0, 0.0, 0.0), (Cuboid("board", [0, 0, 1.0], [4, 4, 0.02]),)
    )
    joints = standing()
    bone = BONES.index((RWRI, RELB))
    joints[:, RELB], joints[:, RWRI] = (0.0, 0.0, 1.25), (0.0, 0.0, 0.95)
    depth = depth_inside(joints, board)[:, bone, 0]
    np.testing.assert_allclose(depth, 0.06)  # the hand is .04 below a board .02 thick


lengths = st.floats(0.05, 1.5)
ends = arrays(float, (2, 3), elements=st.floats(-1, 1))


@given(ends=ends, size=st.tuples(lengths, lengths, lengths), yaw=st.floats(-3, 3))
def test_depth_is_the_least_way_out(
    ends: Array, size: tuple[float, float, float], yaw: float
) -> None:
    at = Placement(0.3, -0.2, yaw)
    piece = SceneObject("chest", at, (Cuboid("body", [0.1, 0, 0], size),))

    def depth(shift: Array) -> Array:
        """Of one bone, moved by (m, 3) shifts in the frame of the piece."""
        joints = np.zeros((len(shift), 16, 3))
        joints[:, BONES[0][0]], joints[:, BONES[0][1]] = (at.apply(e + shift) for e in ends)
        return depth_inside(joints, piece)[:, 0, 0]

    here = float(depth(np.zeros((1, 3)))[0])
    points = ends[0] + np.linspace(0, 1, 801)[:, None] * (ends[1] - ends[0]) - (0.1, 0.0, 0.0)
    point_depth = (np.array(size) / 2 - np.abs(points)).min(-1).max()
    assert max(here, 0.0) >= point_depth - 1e-9
    assert (here > 0.005) <= (point_depth > 0)
    if here > 0.005:
        k = np.arange(4000) + 0.5  # directions evenly over the sphere
        z, turn = 1 - k / 2000, np.pi * (1 + 5**0.5) * k
        level = np.sqrt(1 - z**2)
        every = np.stack([level * np.cos(turn), level * np.sin(turn), z], -1)
        assert depth(0.99 * here * every).min() > 0
        assert depth(1.01 * here * every).min() < 0


@given(yaw=st.floats(-3.1, 3.1))
def test_postures_do_not_depend_on_where_one_faces(yaw: float) -> None:
    joints = turn(standing(), RKNE, [RANK], 0, -165)
    assert posture_faults(turned(joints, yaw)) == posture_faults(joints)
