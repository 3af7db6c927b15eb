"""Moves of ensembles can be undone, with the opposite ratio."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from imapper_prob.samplers.ensemble import CrankNicolson, DifferentialEvolution, Snooker

N_OTHERS = 5
numbers = st.floats(-10, 10).map(lambda x: round(x, 3))


class Scripted:
    """Chooses the walkers it is told to, in this order, and draws no other chances."""

    def __init__(self, chosen, *, jump=False) -> None:
        self.chosen = chosen
        self.jump = jump

    def rand(self, size, n=None):
        if n is None:
            return np.full(size, 0.0 if self.jump else 0.999)
        places = np.ones((size, n))
        places[:, self.chosen] = np.linspace(0, 0.5, len(self.chosen))
        return places

    def randn(self, size):
        return np.zeros(size)


@st.composite
def walkers(draw):
    """One walker, five others that differ from it, and three of these."""
    dimension = draw(st.integers(1, 4))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(N_OTHERS)[:3].tolist()
    return rng.normal(0, 3, (1, dimension)), rng.normal(0, 3, (N_OTHERS, dimension)), chosen


@given(walkers(), st.booleans())
def test_differential_evolution_is_undone_by_the_exchanged_pair(given_walkers, jump):
    theta, others, (first, second, _) = given_walkers
    move = DifferentialEvolution(theta.shape[1], jump_between_modes=0.1)
    moved, ratio = move.move(theta, others, Scripted([first, second], jump=jump))
    back, back_ratio = move.move(moved, others, Scripted([second, first], jump=jump))
    np.testing.assert_allclose(back, theta, atol=1e-12)
    assert ratio == back_ratio == 0
    if jump:
        np.testing.assert_allclose(moved - theta, [others[first] - others[second]])


@given(walkers())
def test_snooker_is_undone_by_the_exchanged_pair(given_walkers):
    theta, others, (anchor, first, second) = given_walkers
    move = Snooker(theta.shape[1])
    moved, ratio = move.move(theta, others, Scripted([anchor, first, second]))
    back, back_ratio = move.move(moved, others, Scripted([anchor, second, first]))
    np.testing.assert_allclose(back, theta, atol=1e-9)
    np.testing.assert_allclose(back_ratio, -ratio, atol=1e-9)


@given(walkers())
def test_the_ratio_of_snooker_is_a_jacobian(given_walkers):
    """Times that of the way along the line, which is one, it is |d theta' / d theta| at a
    given distance moved: the ratio of areas of two spheres about the anchor."""
    theta, others, (anchor, first, second) = given_walkers
    dimension = theta.shape[1]
    moved, ratio = Snooker(dimension).move(theta, others, Scripted([anchor, first, second]))
    shift = np.linalg.norm(moved - others[anchor]) - np.linalg.norm(theta - others[anchor])

    def along(point):
        ray = point - others[anchor]
        return point + shift * ray / np.linalg.norm(ray)

    if np.dot((moved - others[anchor])[0], (theta - others[anchor])[0]) < 0:
        return  # Across the anchor the map has another form and the same areas.
    step = 1e-6
    columns = [
        (along(theta[0] + step * axis) - along(theta[0] - step * axis)) / (2 * step)
        for axis in np.eye(dimension)
    ]
    _, log_volume = np.linalg.slogdet(np.array(columns))
    assert ratio[0] == pytest.approx(log_volume, abs=1e-4)


class Noise:
    """Draws the steps and numbers it is given."""

    def __init__(self, steps, values) -> None:
        self.steps, self.values = steps, values

    def rand(self, *shape):
        assert shape == self.steps.shape
        # A step is the least one, .02, to the power of a uniform number.
        return np.log(self.steps) / np.log(0.02)

    def standard_normal(self, shape):
        assert shape == self.values.shape
        return self.values


@given(
    latent=hnp.arrays(float, (3, 6), elements=numbers),
    noise=hnp.arrays(float, (3, 6), elements=numbers),
    step=hnp.arrays(float, (3, 1), elements=st.floats(0.02, 1.0)),
)
def test_crank_nicolson_turns_numbers_and_noise_into_each_other(latent, noise, step):
    """With the noise of the way back the move is a rotation, which keeps N(z) N(noise)."""
    move = CrankNicolson(1)
    ends = np.ones((3, 1))
    moved, ratio = move.move(np.concatenate([ends, latent, ends], axis=1), Noise(step, noise))
    returning = step * latent - np.sqrt(1 - step**2) * noise
    back, _ = move.move(moved, Noise(step, returning))
    np.testing.assert_allclose(back[:, 1:-1], latent, atol=1e-9)
    before, after = (latent**2 + noise**2), (moved[:, 1:-1] ** 2 + returning**2)
    np.testing.assert_allclose(before, after, atol=1e-9)
    np.testing.assert_array_equal(moved[:, [0, -1]], 1)
    assert not ratio.any()
