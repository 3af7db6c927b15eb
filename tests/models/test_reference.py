"""The compiled log-posterior is that of ``docs/explanation/model.md``, term by term."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from imapper_prob.models.kernels.intersection import DISPLACED
from imapper_prob.models.log_posterior import State, motion, terms
from imapper_prob.models.problem import TERMS, Problem
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import OPAQUE
from imapper_prob.models.skeleton import DETECTED, MIRROR
from tests.models import worlds
from tests.models.reference import items_by_frame, reference, scene_of

N_FRAMES, N_ITEMS = 18, 3
NEAR = 1e-9
"""Of terms in double precision, relative; and of those that are 0 but for rounding, nats."""


def problem(rng: np.random.Generator, *, people: tuple[int, ...], furnished: bool) -> Problem:
    """A walk, partly undetected, with sides exchanged for a while, and free frames at a price.

    One scenelet of the library has two objects, which stand in each other.
    """
    library = worlds.library(5)
    first, *others = (library if furnished else worlds.library(5, objects=False)).scenelets
    if furnished:
        first = replace(first, objects=(*first.objects, worlds.couch(0.5, -0.7, 1.0, "table")))
    whole = worlds.problem(
        N_FRAMES, seed=int(rng.integers(99)), scenelets=Library("test", (first, *others)),
        starts=np.isin(np.arange(N_FRAMES), people),
    )  # fmt: skip
    whole = worlds.facing_about(whole, seed=int(rng.integers(99)))
    used = np.zeros_like(whole.used)
    used[:, list(DETECTED)] = rng.random((N_FRAMES, len(DETECTED))) < 0.9
    used[rng.integers(N_FRAMES)] = False
    keypoints, turned = whole.keypoints.copy(), slice(*np.sort(rng.integers(0, N_FRAMES, 2)))
    keypoints[turned] = keypoints[turned][:, list(MIRROR)]
    jumps = (rng.random(used.shape) < 0.05)[..., None] * rng.normal(0, 200, keypoints.shape)
    begin = rng.integers(0, N_FRAMES - 2, 6)
    stays = np.stack([begin, begin + rng.integers(1, 6, 6), rng.random(6)], -1)
    lowered = np.zeros_like(whole.lowered)
    lowered[::2] = 1, 4
    return whole._replace(
        used=used, keypoints=keypoints + jumps, free_cost=rng.random(N_FRAMES), lowered=lowered,
        stays=stays.astype(float),
        path_stay=np.where(rng.random(N_FRAMES) < 0.1, -1, np.arange(N_FRAMES) // 9),
        stay_steps=int(rng.integers(1, 4)),
        sight_width=float(rng.uniform(0.03, 0.2)),
        merge_angle=float(rng.uniform(0.3, 1.5)),
        label_front=rng.random(len(whole.label_front)) < 0.5,
        flip_begins=float(rng.uniform(0.001, 0.2)), flip_ends=float(rng.uniform(0.05, 0.4)),
    )  # fmt: skip


def state(rng: np.random.Generator, whole: Problem, *, wild: bool) -> State:
    """0 to 3 scenelets about the walk, or ``wild``, anywhere.

    Of wild states some are outside the support, some have boxes and joints behind the camera, and
    in some scenelets share a placement.
    """
    camera = whole.camera_mean + rng.normal(size=5) * [0.03, 0.05, 0.05, 0.05, 0.03]
    start = 5 * np.arange(N_ITEMS) + rng.integers(0, 2)
    start[1:] += rng.integers(0, 2)
    held = rng.random(N_ITEMS) < 0.7
    placements = worlds.walk(N_FRAMES)[start + 2, 6] + rng.normal(size=(N_ITEMS, 3)) * [0.4, 0.4, 3]
    sizes = 0.1 * rng.normal(size=N_ITEMS)
    if wild:
        camera += rng.normal(size=5) * [0.3, 0.6, 0.1, 0.1, 0.3]
        start[-1] += rng.integers(-2, 4)
        placements[:, 1] += rng.choice([-5.0, -3.0, 0.0], N_ITEMS)
        placements[2] = placements[rng.integers(1, 3)]
    items = np.stack([rng.integers(0, 3, N_ITEMS), start], -1)[held]
    latent = rng.normal(size=(N_FRAMES, 2))
    return State(camera, items, placements[held], sizes[held], latent)


def rounding(whole: Problem, joints: np.ndarray) -> float:
    """Nats by which the detections may be off, for misfits and lines of sight are single precision.

    A joint's log-density changes by no more than 1 / w for a metre of clearance: (11) is a mean of
    two densities whose odds are those of a logistic function of clearance over w. Clearance comes
    of a dozen roundings of lengths up to the distance of the farthest joint (boxes that hide are
    nearer), enlarged where a box is thin. Exponents of the misfit come to 60 at most for what is a
    picture away, after a dozen roundings too.
    """
    roundings, exponent = 12 * np.finfo(np.float32).eps / 2, 60.0
    thin = max([1.0, *(OPAQUE / whole.boxes[:, 3:6].min(1))]) if len(whole.boxes) else 1.0
    farthest = np.abs(joints).max()
    each = roundings * (thin * farthest / whole.sight_width + exponent)
    return float(whole.frame_weight * whole.used.sum() * each)


def compare(whole: Problem, scene: State) -> bool:
    """Hold every term of a state against the reference; returns whether the state is possible."""
    found, expected = terms(whole, scene), reference(whole, scene)
    assert tuple(found) == tuple(expected) == TERMS
    item_of = items_by_frame(whole, scene)
    if item_of is None:
        assert found["camera"] == -np.inf
        assert found == expected
        return False
    joints = scene_of(whole, scene, item_of)[0].joints
    np.testing.assert_allclose(motion(whole, scene), joints, rtol=NEAR, atol=NEAR)
    for name, value in expected.items():
        near = NEAR + (rounding(whole, joints) if name == "detections" else 0.0)
        assert found[name] == pytest.approx(value, rel=NEAR, abs=near), name
    return True


@settings(max_examples=120)
@given(
    seed=st.integers(0, 10**6),
    wild=st.booleans(),
    furnished=st.booleans(),
    people=st.sampled_from([(0,), (0, 5, 11)]),
    likelihood=st.sampled_from([1.0, 1.0, 0.0]),
)
def test_every_term_is_that_of_the_reference(
    seed: int, wild: bool, furnished: bool, people: tuple[int, ...], likelihood: float
) -> None:
    rng = np.random.default_rng(seed)
    whole = problem(rng, people=people, furnished=furnished)._replace(likelihood=likelihood)
    compare(whole, state(rng, whole, wild=wild))


def test_the_random_states_go_everywhere() -> None:
    """Otherwise agreement would say little: every term is felt, and detections in both senses."""
    rng = np.random.default_rng(0)
    whole = problem(rng, people=(0,), furnished=True)
    wild = np.array([list(terms(whole, state(rng, whole, wild=True)).values()) for _ in range(300)])
    outside = np.isinf(wild[:, 0])
    assert 0.1 < outside.mean() < 0.7
    felt = (wild[~outside] != 0).mean(0)[:-1]  # statements have tests of their own
    assert (felt > 0.2).all(), felt
    tame = [compare(whole, state(rng, whole, wild=False)) for _ in range(20)]
    assert all(tame)


def test_one_frame_and_a_clip_covered_from_end_to_end() -> None:
    whole = worlds.problem(6, scenelets=worlds.library(6))
    bare = State(
        whole.camera_mean.copy(), np.empty((0, 2), np.int64), np.empty((0, 3)), np.empty(0),
        np.ones((6, 2)),
    )  # fmt: skip
    assert compare(whole, bare.with_item(0, 0, np.array([0.1, 4.0, 0.3])))
    per_frame = (
        "keypoints", "used", "confidences", "confidence_density", "error_scale", "error_dof",
        "path_centre", "path_scale", "path_starts", "path_stay", "path_facing", "lift", "poses",
        "free_cost",
    )  # fmt: skip
    one = whole._replace(
        static_density=whole.static_density[:, :1].copy(),
        **{name: getattr(whole, name)[:1].copy() for name in per_frame},
    )
    assert compare(one, replace(bare, latent=bare.latent[:1].copy()))


def test_nobody_is_detected() -> None:
    rng = np.random.default_rng(1)
    whole = problem(rng, people=(0,), furnished=True)
    blind = whole._replace(used=np.zeros_like(whole.used))
    assert compare(blind, state(rng, blind, wild=False))


def test_where_furniture_may_stand_is_in_the_middle_of_equal_quarters() -> None:
    np.testing.assert_allclose(
        DISPLACED[1:], norm.ppf([9 / 16, 11 / 16, 13 / 16, 15 / 16]), atol=5e-5
    )
