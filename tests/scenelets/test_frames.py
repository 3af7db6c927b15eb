"""The local frame of scenelets, and mirroring."""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from imapper_prob.models.scene import Placement
from imapper_prob.models.skeleton import BONE_LENGTHS, LWRI, MIRROR, PELV, RWRI, facing
from imapper_prob.scenelets.frames import REACH, localised, mirrored
from imapper_prob.scenelets.library import built_in_library

metres = st.floats(-8, 8)
indices = st.integers(0, len(built_in_library()) - 1)


def test_the_library_is_in_its_local_frame() -> None:
    for scenelet in built_in_library():
        middle = scenelet.joints[scenelet.n_frames // 2]
        np.testing.assert_allclose(middle[PELV, :2], 0.0, atol=1e-9)
        assert facing(middle) == pytest.approx(0.0, abs=1e-9)


@given(index=indices, x=metres, y=metres, yaw=st.floats(-3.1, 3.1))
def test_the_local_frame_forgets_the_world(index: int, x: float, y: float, yaw: float) -> None:
    scenelet = built_in_library()[index]
    world = Placement(x, y, yaw)
    again = localised(
        scenelet.name,
        scenelet.action,
        world.apply(scenelet.joints),
        [o.moved(world) for o in scenelet.objects],
    )
    np.testing.assert_allclose(again.joints, scenelet.joints, atol=1e-9)
    assert again.labels == scenelet.labels
    for one, other in zip(again.objects, scenelet.objects, strict=True):
        np.testing.assert_allclose(one.footprint, other.footprint, atol=1e-9)


def test_far_objects_are_left_out() -> None:
    scenelet = next(s for s in built_in_library() if s.labels == ("stool",))
    reach = np.abs(scenelet.joints[..., :2]).max()
    (stool,) = scenelet.objects
    near, far = (stool.moved(Placement(0.0, d, 0.0)) for d in (REACH, REACH + reach + 0.5))
    kept = localised("kept", "sit", scenelet.joints, [near, far]).objects
    assert len(kept) == 1
    np.testing.assert_allclose(kept[0].centre, near.centre, atol=1e-9)


@given(index=indices)
def test_mirroring_twice_changes_nothing(index: int) -> None:
    scenelet = built_in_library()[index]
    once = mirrored(scenelet, "once")
    twice = mirrored(once, scenelet.name)
    np.testing.assert_array_equal(twice.joints, scenelet.joints)
    for one, other in zip(twice.objects, scenelet.objects, strict=True):
        np.testing.assert_allclose(one.footprint, other.footprint)
    for a, b in BONE_LENGTHS:
        bone = np.linalg.norm(once.joints[:, a] - once.joints[:, b], axis=-1)
        other = scenelet.joints[:, MIRROR[a]] - scenelet.joints[:, MIRROR[b]]
        np.testing.assert_allclose(bone, np.linalg.norm(other, axis=-1), atol=1e-9)
    assert facing(once.joints[once.n_frames // 2]) == pytest.approx(0.0, abs=1e-9)


def test_a_mirror_image_counts_as_much() -> None:
    scenelet = replace(built_in_library()[0], weight=0.2)
    assert mirrored(scenelet, "other").weight == 0.2


@given(index=indices)
def test_the_mirror_swaps_the_hands(index: int) -> None:
    scenelet = built_in_library()[index]
    other = mirrored(scenelet, "other")
    np.testing.assert_array_equal(
        other.joints[:, LWRI], scenelet.joints[:, RWRI] * (-1.0, 1.0, 1.0)
    )
    # A wrist is as far from the middle of every object as the other one was.
    for here, there in zip(other.objects, scenelet.objects, strict=True):
        np.testing.assert_allclose(
            np.linalg.norm(other.joints[:, LWRI] - here.centre, axis=-1),
            np.linalg.norm(scenelet.joints[:, RWRI] - there.centre, axis=-1),
        )
