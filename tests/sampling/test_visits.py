"""What chains note while they burn in."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.sampling.visits import Visits, camera_shape
from tests.models import worlds

PROBLEM = worlds.problem(20)
SPREAD = np.array([0.03, 0.2, 0.01, 0.05, 0.02])


def seen_by(camera: np.ndarray) -> State:
    """Two scenelets, seen by a camera."""
    state = empty_state(PROBLEM)
    for scenelet, start in ((0, 0), (2, 8)):
        state = state.with_item(scenelet, start, np.array([0.1, 4.0, 0.0]))
    return State(camera, state.items, state.placements, state.sizes, state.latent)


def noted(count: int, *, beta: float = 1.0, wider: float = 1.0, repeat: int = 1) -> Visits:
    """So many cameras, pitch and height tied to one another, each met some times in a row."""
    rng, visits = np.random.default_rng(0), Visits()
    for _ in range(count):
        z = rng.standard_normal(5)
        z[1] = -0.9 * z[0] + np.sqrt(1 - 0.9**2) * z[1]
        for _ in range(repeat):
            visits.note(seen_by(np.array(PROBLEM.camera_mean) + wider * SPREAD * z), beta)
    return visits


def test_the_shape_of_the_camera_is_that_of_cold_visits() -> None:
    visits = Visits.together([noted(400), noted(400, beta=0.3, wider=5.0)])
    shape = camera_shape(visits)
    assert shape is not None
    covariance = shape @ shape.T
    # Standard deviations are known to 1 / sqrt(2 n), a correlation to (1 - r^2) / sqrt n.
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), SPREAD, rtol=5 / np.sqrt(800))
    tied = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert abs(tied + 0.9) < 5 * (1 - 0.9**2) / np.sqrt(400)


def test_a_camera_counts_once_however_often_it_is_met() -> None:
    np.testing.assert_allclose(camera_shape(noted(60)), camera_shape(noted(60, repeat=3)))


def test_states_without_scenelets_are_noted_and_those_behind_the_camera_are_not() -> None:
    visits = Visits()
    visits.note(empty_state(PROBLEM))
    visits.note(seen_by(np.array(PROBLEM.camera_mean)))
    visits.note(empty_state(PROBLEM).with_item(0, 2, np.array([0.0, -1.0, 0.0])))
    assert visits.arrays()["counts"].tolist() == [0, 2]
    visits.check(PROBLEM)
    again = Visits.of(visits.arrays())
    for name, array in visits.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


@pytest.mark.parametrize("wrong", ["counts", "cameras", "items", "where"])
def test_visits_of_no_chain_are_refused(wrong: str) -> None:
    arrays = noted(3).arrays()
    arrays[wrong] = arrays[wrong] + 10**7
    with pytest.raises(InputError, match="visits are of no chain of this run"):
        Visits.of(arrays).check(PROBLEM)


def test_few_cameras_or_one_have_no_shape() -> None:
    assert camera_shape(noted(20, repeat=5)) is None
    assert camera_shape(Visits()) is None
    still = Visits()
    for n in range(60):
        camera = np.array(PROBLEM.camera_mean)
        camera[0] += 1e-3 * n
        still.note(seen_by(camera))
    assert camera_shape(still) is None
