"""The exchange of a stretch of time between two scenes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from imapper_prob.models.log_posterior import State
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.image_pelvis import middle_heights, project_pelvis
from tests.models import worlds
from tests.sampling.scenes import in_order, random_state

PROBLEM = worlds.problem(20)
CROSS = TimeCrossover(PROBLEM)


def scene(seed: int) -> State:
    rng = np.random.default_rng(seed)
    state = random_state(PROBLEM, seed)
    return replace(
        state,
        camera=state.camera + 0.05 * rng.standard_normal(state.camera.shape),
        latent=rng.standard_normal(state.latent.shape),
    )


@hypothesis_settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_same_exchange_again_gives_both_back(seed: int) -> None:
    hot, cold = scene(seed), scene(seed + 1)
    there = CROSS(np.random.default_rng(seed), hot, cold)
    if there is None:
        assert hot.n_scenelets + cold.n_scenelets == 0
        return
    assert all(in_order(PROBLEM, state) for state in there[:2])
    assert sum(s.n_scenelets for s in there[:2]) == hot.n_scenelets + cold.n_scenelets
    back = CROSS(np.random.default_rng(seed), *there[:2])
    assert back is not None
    assert back[2] == pytest.approx(-there[2])
    for one, other in zip(back[:2], (hot, cold), strict=True):
        for field in fields(State):
            np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name))


def test_the_jacobian_is_that_of_the_placements() -> None:
    place = np.array([0.3, 4.0, 0.2, 0.01])
    empty = replace(
        scene(0), items=np.empty((0, 2), np.int64), placements=np.empty((0, 3)), sizes=np.empty(0)
    )
    cold = replace(empty, camera=empty.camera + 0.1)

    def crossed(where: np.ndarray) -> tuple[State, State, float]:
        hot = empty.with_item(0, 3, where[:3], float(where[3]))
        found = CROSS(np.random.default_rng(0), hot, cold)
        assert found is not None
        return found

    def moved(where: np.ndarray) -> np.ndarray:
        hot, after, _ = crossed(where)
        assert hot.n_scenelets == 0
        return np.array([*after.placements[0], after.sizes[0]])

    step = 1e-5
    columns = [(moved(place + step * e) - moved(place - step * e)) / (2 * step) for e in np.eye(4)]
    log_jacobian = crossed(place)[2]
    assert log_jacobian == pytest.approx(np.log(np.linalg.det(np.array(columns))), abs=1e-6)
    assert abs(log_jacobian) > 0.1


def test_what_is_exchanged_looks_the_same_afterwards() -> None:
    heights = middle_heights(PROBLEM)
    hot, cold = scene(3), scene(5)
    found = CROSS(np.random.default_rng(1), hot, cold)
    assert found is not None

    def images(state: State) -> list[tuple[float, ...]]:
        seen = []
        for (scenelet, _), (x, y, _), size in zip(
            state.items.tolist(), state.placements.tolist(), state.sizes.tolist(), strict=True
        ):
            seen.append(tuple(project_pelvis(state.camera, x, y, size, heights[scenelet])))
        return seen

    before, after = sorted(images(hot) + images(cold)), sorted(images(found[0]) + images(found[1]))
    assert images(found[0]) != images(hot)
    np.testing.assert_allclose(after, before)
