"""States and data drawn from the model are what its density says they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, norm

from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.detection import draw_flips
from imapper_prob.models.log_posterior import State, log_posterior, motion, terms
from imapper_prob.models.path_prior import path_tables
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import PELV
from lab import prior
from lab.prior import Experiment, draw_layout, draw_state, path_in_view
from tests.models import worlds

N_FRAMES = 20
RATES = np.array([[0.9, 0.9], [0.95, 0.3]])
"""Of the errors of bearing and log depth."""


@cache
def bare_prior(starts: tuple[int, ...] = (0,)) -> Problem:
    """The prior of which no scene is refused, its path smoother than somebody astray."""
    settings = ModelSettings(likelihood=0.0, scenelet_rate=0.3)
    problem = worlds.problem(
        N_FRAMES, settings=settings, scenelets=worlds.mixed_library(),
        starts=np.isin(np.arange(N_FRAMES), starts),
    )  # fmt: skip
    mean, draw = path_tables(RATES, N_FRAMES)
    return worlds.facing_about(problem._replace(path_mean=mean, path_draw=draw))


def apart(problem: Problem, state: State, index: int) -> float:
    """Radians that a scenelet is turned from where it faces as the path does, in [-pi, pi]."""
    scenelet, start = state.items[index].tolist()
    own = problem.joint_facing[slice(*problem.joint_first[scenelet : scenelet + 2])]
    seen = problem.path_facing[start : start + len(own)]
    mean = (seen @ (1, 1j) * (own @ (1, -1j))).mean()
    return float(np.angle(np.exp(1j * state.placements[index, 2]) / mean))


@cache
def onwards(axis: int, frames: int) -> tuple[np.ndarray, float]:
    """Weights of the last two errors in one so many frames later, and what it deviates by.

    By powers of the matrix that takes two neighbours one frame on.
    """
    r, s = RATES[axis]
    step, power, variance = np.array([[r + s, -r * s], [1.0, 0.0]]), np.eye(2), 0.0
    shocks = np.convolve(r ** np.arange(2000.0), s ** np.arange(2000.0))[:2000]
    for _ in range(frames):
        variance += power[0, 0] ** 2 / (shocks @ shocks)
        power = power @ step
    return power[0], float(np.sqrt(variance))


@cache
def bare_draws() -> list[State]:
    rng = np.random.default_rng(0)
    return [draw_state(rng, bare_prior()) for _ in range(6000)]


@cache
def experiment() -> Experiment:
    return worlds.experiment(N_FRAMES, joints_a_frame=3, scenelets=worlds.mixed_library())


def is_one(ratios: np.ndarray) -> None:
    """The mean of what should be one on average, within 4.5 standard errors that are small."""
    error = ratios.std() / np.sqrt(len(ratios))
    assert error < 0.1
    assert abs(ratios.mean() - 1) < 4.5 * error, (ratios.mean(), error)


def all_layouts(problem: Problem, first: int = 0) -> dict[tuple[tuple[int, int], ...], float]:
    """Every admissible set of scenelets from a frame on, with the product of its rates."""
    result = {(): 1.0}
    for start in range(first, problem.n_frames):
        for scenelet, length in enumerate(problem.lengths.tolist()):
            if start + length <= problem.n_frames:
                rate = float(np.exp(problem.log_rate[scenelet]))
                for rest, weight in all_layouts(problem, start + length).items():
                    result[((scenelet, start), *rest)] = rate * weight
    return result


@pytest.mark.slow
def test_every_layout_comes_as_often_as_it_should() -> None:
    settings = ModelSettings(likelihood=0.0, scenelet_rate=0.5)
    mixed = worlds.mixed_library()
    few = worlds.Library("few", (mixed[0], mixed[3], mixed[5]))
    shares = np.array([1.0, 2.0, 3.0])
    joints = worlds.walk(16)
    problem = worlds.pack_problem(
        worlds.clip_of(joints, np.random.default_rng(0)), worlds.path_of(joints),
        worlds.camera_prior(), few, settings=settings, weights=shares,
    )  # fmt: skip
    expected = all_layouts(problem)
    assert len(expected) > 100
    assert {len(layout) for layout in expected} == {0, 1, 2}
    rng = np.random.default_rng(2)
    counts = Counter(tuple(map(tuple, draw_layout(rng, problem).tolist())) for _ in range(10000))
    assert counts.keys() <= expected.keys()
    weights = np.array(list(expected.values()))
    found = np.array([counts[layout] for layout in expected])
    assert chisquare(found, weights / weights.sum() * found.sum()).pvalue > 1e-4


def test_no_scenelet_goes_from_one_person_to_the_next() -> None:
    problem, rng = bare_prior((0, 7, 13)), np.random.default_rng(4)
    items = np.concatenate([draw_layout(rng, problem) for _ in range(200)])
    ends = items[:, 1] + problem.lengths[items[:, 0]]
    for start in (7, 13):
        assert not ((items[:, 1] < start) & (ends > start)).any()
        assert (items[:, 1] == start).any()


def wrapped_cauchy(angles: Sequence[float], scale: float) -> np.ndarray:
    """Probabilities of smaller angles than these, from -pi on."""
    return 0.5 + np.arctan(np.tan(np.array(angles) / 2) / np.tanh(scale / 2)) / np.pi


@pytest.mark.slow
def test_parts_of_the_prior_have_their_distributions() -> None:
    """By Kolmogorov and Smirnov; of seventeen tests one is below 10^-4 once in 600 times."""
    problem, draws = bare_prior(), bare_draws()
    some = [s for s in draws if s.n_scenelets > 0]
    parts = {
        "yaw": wrapped_cauchy([apart(problem, s, 0) for s in some], problem.facing_spread),
        "last yaw": wrapped_cauchy([apart(problem, s, -1) for s in some], problem.facing_spread),
        "size": norm.cdf(np.array([s.sizes[-1] for s in some]) / problem.size_spread),
        "latent": norm.cdf(np.array([s.latent[7, 1] for s in draws])),
    }
    doubt = np.sqrt(np.diag(np.linalg.inv(problem.camera_precision)))
    for i in range(5):
        camera = np.array([s.camera[i] for s in draws])
        parts[f"camera {i}"] = norm.cdf((camera - problem.camera_mean[i]) / doubt[i])
    # The pelvis as seen in the first frame and, from its own last place, in a later one.
    errors = np.array([errors_of(problem, s) for s in draws])
    for axis, name in enumerate(("bearing", "log depth")):
        weights, spread_of_a_step = onwards(axis, 1)
        parts[f"first {name}"] = norm.cdf(errors[:, 0, axis])
        free = [
            errors[n, 12, axis] - weights @ errors[n, [11, 10], axis]
            for n, s in enumerate(draws)
            if not (covered(problem, s)[10:13]).any()
        ]
        parts[f"free steps of {name}"] = norm.cdf(free, 0, spread_of_a_step)
        between = [
            (errors[n, first, axis] - weights @ errors[n, [end - 1, end - 2], axis]) / spread
            for n, s in enumerate(draws)
            if s.n_scenelets > 1
            for end in [s.items[0, 1] + problem.lengths[s.items[0, 0]]]
            for first in [s.items[1, 1]]
            for weights, spread in [onwards(axis, first - end + 1)]
        ]
        parts[f"{name} from one to the next"] = norm.cdf(between)
    for name, values in parts.items():
        assert len(values) > 1000, name
        assert kstest(values, "uniform").pvalue > 1e-4, name


def as_seen(state: State, points: np.ndarray) -> np.ndarray:
    """(n, 2) bearing and log depth of points of the world, by the camera's own code."""
    pitch, elevation, _, _, roll = state.camera.tolist()
    camera = worlds.CAMERA.posed(pitch=pitch, elevation=elevation, roll=roll)
    x, depth, _ = camera.to_camera(points).T
    return np.stack([x / depth, np.log(depth)], -1)


def errors_of(problem: Problem, state: State) -> np.ndarray:
    """(T, 2) how far the pelvis is off the static path, in its deviations."""
    seen = as_seen(state, motion(problem, state)[:, PELV])
    path = [path_in_view(problem, state.camera, t) for t in range(problem.n_frames)]
    centre, scale = np.moveaxis(np.array(path), 1, 0)
    return (seen - centre) / scale


def covered(problem: Problem, state: State) -> np.ndarray:
    """(T,) frames under a scenelet."""
    under = np.zeros(problem.n_frames, bool)
    for scenelet, start in state.items.tolist():
        under[start : start + int(problem.lengths[scenelet])] = True
    return under


@pytest.mark.parametrize("starts", [(0,), (0, 11)])
def test_the_density_of_a_scene_is_that_of_its_steps(starts: tuple[int, ...]) -> None:
    """Placement and path of drawn scenes, written out with the camera's own projection."""
    problem, rng = bare_prior(starts), np.random.default_rng(1)
    for state in [draw_state(rng, problem) for _ in range(200)]:
        expected = float(norm.logpdf(state.sizes, scale=problem.size_spread).sum())
        known, at = np.zeros((2, 2)), -1
        joints = motion(problem, state)[:, PELV]
        for index, (scenelet, start) in enumerate(state.items.tolist()):
            seen = as_seen(state, joints[start : start + int(problem.lengths[scenelet])])
            centre, scale = path_in_view(problem, state.camera, start)
            mean, spread = said_of(known, at, start, starts)
            mean, spread = centre + scale * mean, scale * spread
            expected += norm.logpdf(seen[0], mean, spread).sum()
            # A wrapped Cauchy law by its Fourier series.
            n, turn = np.arange(1, 500), apart(problem, state, index)
            waves = np.exp(-problem.facing_spread * n) * np.cos(n * turn)
            expected += np.log((0.5 + waves.sum()) / np.pi)
            steps = 1e-5 * np.eye(3)[:2]
            slopes = [
                as_seen(state, joints[[start]] + d)[0] - as_seen(state, joints[[start]] - d)[0]
                for d in steps
            ]
            expected += np.log(abs(np.linalg.det(np.array(slopes) / 2e-5)))
            at = start + len(seen) - 1
            known = last_two(problem, state, at, seen)
        values = terms(problem, state)
        assert values["placement"] + values["path"] == pytest.approx(expected, abs=1e-6)


def said_of(
    known: np.ndarray, at: int, frame: int, starts: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (2,) of the errors in a frame, given those (2, 2) in ``at`` and before."""
    if at < max(start for start in starts if start <= frame):
        return np.zeros(2), np.ones(2)
    weights, spread = zip(*(onwards(axis, frame - at) for axis in range(2)), strict=True)
    return (known * np.array(weights).T).sum(0), np.array(spread)


def last_two(problem: Problem, state: State, at: int, seen: np.ndarray) -> np.ndarray:
    """(2, 2) errors of a scenelet's last pelvis, in frame ``at``, and of the one before it."""
    path = [path_in_view(problem, state.camera, at - k) for k in range(2)]
    return np.array([(seen[-1 - k] - path[k][0]) / path[k][1] for k in range(2)])


class Still(np.random.Generator):
    """Draws normal numbers that are all 0, and everything else by chance."""

    def standard_normal(self, size=None):  # type: ignore[no-untyped-def]
        return np.zeros(() if size is None else size)


def test_without_noise_errors_fade_from_one_scenelet_to_the_next() -> None:
    problem = bare_prior()
    problem = problem._replace(camera_mean=np.array([-0.2, 1.9, 0.1, 0.1, 0.15]))
    rng = Still(np.random.PCG64(0))
    followed = 0
    for _ in range(100):
        state = draw_state(rng, problem)
        seen = as_seen(state, motion(problem, state)[:, PELV])
        known, at = np.zeros((2, 2)), -1
        for scenelet, start in state.items.tolist():
            centre, scale = path_in_view(problem, state.camera, start)
            expected = centre + scale * said_of(known, at, start, (0,))[0]
            np.testing.assert_allclose(seen[start], expected, atol=1e-9)
            at = start + int(problem.lengths[scenelet]) - 1
            known = last_two(problem, state, at, seen[: at + 1])
        followed += state.n_scenelets > 1
    assert followed > 10


class Firm(np.random.Generator):
    """Refuses whatever costs more than 0.7 nats."""

    def standard_exponential(self):  # type: ignore[no-untyped-def]
        return 0.7


def test_scenes_are_refused_for_what_they_cost() -> None:
    rng = Firm(np.random.PCG64(0))
    problem = experiment().problem
    costs = []
    for _ in range(300):
        values = terms(problem, draw_state(rng, problem))
        costs.append(-values["collision"] - values["motion"] - values["ground"])
    assert 0.6 < max(costs) < 0.7
    # Chance refuses e^-cost of them: an exponential variable is above the cost as often.
    assert min(costs) == 0.0


@pytest.mark.slow
def test_draws_with_and_without_a_scenelet_have_the_density_of_the_posterior() -> None:
    """The mean of p(none) q(scenelet) / p(scenelet), q any density, is the share of none."""
    problem = bare_prior()
    counts = np.bincount([s.n_scenelets for s in bare_draws()], minlength=2)
    ratios = []
    for state in bare_draws():
        if state.n_scenelets == 1 and state.items[0, 1] == 0:
            values = terms(problem, state)
            # Of the path without scenelets nothing is left: it is integrated out.
            density = np.exp(values["placement"] + values["path"])
            alone = np.exp(
                log_posterior(problem, state) - log_posterior(problem, state.without_item(0))
            )
            rates = np.exp(problem.log_rate)
            ratios.append(density / alone * rates[state.items[0, 0]] / rates.sum())
    expected = counts[0] / len(bare_draws())
    found = np.sum(ratios) / len(bare_draws())
    error = np.sqrt(2 * expected / len(bare_draws()))
    assert abs(found - expected) < 5 * error


def test_data_are_as_probable_under_the_truth_as_on_average_elsewhere() -> None:
    """The mean of p(data | other) / p(data | truth) over data is one, for any other scene."""
    rng = np.random.default_rng(5)
    one = worlds.experiment(N_FRAMES, joints_a_frame=1, scenelets=worlds.mixed_library())
    draws = (draw_state(rng, one.problem) for _ in range(100))
    states = [s for s in draws if s.n_scenelets > 0][:8]
    ratios = []
    for state in states:
        other = replace(state, placements=state.placements + np.array([0.02, 0.04, 0.05]))
        for _ in range(60):
            problem = one.observed(rng, state).problem
            change = terms(problem, other)["detections"] - terms(problem, state)["detections"]
            ratios.append(np.exp(change))
    is_one(np.array(ratios))


def test_data_are_as_probable_under_the_truth_as_on_average_with_other_eyes() -> None:
    """The same for a detector that sees through furniture, or not what is in view, more often."""
    rng = np.random.default_rng(6)
    ratios = []
    for _ in range(400):
        state = draw_state(rng, experiment().problem)
        problem = experiment().observed(rng, state).problem
        other = problem._replace(visibility_error=0.08)
        change = terms(other, state)["detections"] - terms(problem, state)["detections"]
        ratios.append(np.exp(change))
    is_one(np.array(ratios))


def test_side_flips_last_as_long_as_they_should() -> None:
    flipped = draw_flips(np.random.default_rng(0), 200_000, begins=0.02, ends=0.1)
    begins = flipped[1:] & ~flipped[:-1]
    ends = ~flipped[1:] & flipped[:-1]
    assert begins.sum() / (~flipped[:-1]).sum() == pytest.approx(0.02, rel=5 / np.sqrt(3300))
    assert ends.sum() / flipped[:-1].sum() == pytest.approx(0.1, rel=5 / np.sqrt(3300))
    first = [draw_flips(np.random.default_rng(k), 1, begins=0.2, ends=0.2)[0] for k in range(400)]
    assert np.mean(first) == pytest.approx(0.5, abs=5 * 0.5 / 20)


def test_what_is_no_density_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="only if neither free frames nor"):
        draw_state(np.random.default_rng(0), worlds.problem())
    with pytest.raises(InputError, match="frames have weight 1"):
        replace(experiment(), settings=ModelSettings())
    problem = experiment().problem
    buried = problem._replace(lift=problem.lift - 1.0, motion_cost=1e9)
    monkeypatch.setattr(prior, "_TRIES", 50)
    with pytest.raises(InputError, match="none of 50 scenes was free of collisions"):
        draw_state(np.random.default_rng(0), buried)
