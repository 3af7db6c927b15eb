"""The reference is a distribution: what is drawn has the density that is said, and all of it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from imapper_prob.models.log_posterior import State, empty_state
from imapper_prob.models.problem import Problem
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.view import to_view
from imapper_prob.sampling.image_pelvis import place_from_image, project_pelvis
from imapper_prob.sampling.jit import compiled
from imapper_prob.sampling.learning import _SHIFTS, learn
from imapper_prob.sampling.redraws import _draw_run, _log_run
from imapper_prob.sampling.redraws import draw_scene as _draw_scene
from imapper_prob.sampling.reference import COMPONENTS, FLUSH_NEXT, Reference
from imapper_prob.sampling.reference_density import log_reference, next_probability
from imapper_prob.sampling.scene import state_of
from imapper_prob.sampling.visits import Visits
from lab.prior import draw_state
from tests.models import worlds
from tests.sampling.scenes import random_gains, similarity

N_FRAMES = 20
PROBLEM = worlds.problem(N_FRAMES, settings=ModelSettings(likelihood=0.0, scenelet_rate=0.5))
LIMIT = 4.5
"""Standard errors; one mean in 150,000 is beyond."""


def two_films() -> Problem:
    starts = np.array(PROBLEM.path_starts)
    starts[9] = True
    return PROBLEM._replace(path_starts=starts)


@cache
def known(films: int = 1, count: int = 80, seed: int = 0) -> Reference:
    """Learnt from scenes of the prior; each component of the mixture is drawn often."""
    problem = PROBLEM if films == 1 else two_films()
    rng, visits = np.random.default_rng(seed), Visits()
    for _ in range(count):
        visits.note(draw_state(rng, problem))
    learnt = learn(problem, random_gains(problem), similarity(), visits)
    return learnt._replace(weights=np.array([0.15, 0.1, 0.4, 0.15, 0.05, 0.15]))


def draw_scene(reference: Reference, rng: np.random.Generator) -> State:
    return state_of(_draw_scene(reference, rng))


@compiled
def chances_of(
    reference: Reference, kind: int, end: int, code: int, probability: np.ndarray
) -> None:
    next_probability(reference, kind, end, code, probability)


def log_density(reference: Reference, state: State) -> float:
    return log_reference(reference, state.camera, state.items, state.placements, state.sizes)


@hypothesis_settings(max_examples=30, deadline=None)
@given(films=st.sampled_from([1, 2]), end=st.integers(0, N_FRAMES), seed=st.integers(0, 3))
def test_something_comes_next_or_nothing(films: int, end: int, seed: int) -> None:
    reference = known(films, count=(2, 80)[seed % 2], seed=seed)
    for kind in range(int(reference.kinds.max()) + 1):
        total, probability = 0.0, np.empty(COMPONENTS)
        for code in range(N_FRAMES * len(reference.kinds) + 1):
            chances_of(reference, kind, end, code, probability)
            assert (probability >= 0).all()
            total += probability.sum()
        assert total == pytest.approx(1.0, abs=1e-12)


def test_flush_scenelets_come_by_their_fit_and_by_the_kind_before() -> None:
    reference = known()._replace(weights=np.eye(COMPONENTS)[FLUSH_NEXT])
    n_scenelets, end = len(reference.kinds), 8
    fits, kinds = reference.fitting[end], reference.kinds
    assert fits.sum() == pytest.approx(1.0)
    for kind in set(kinds.tolist()):
        same = np.where(kinds == kind, fits, 0.0)
        chance = np.zeros((N_FRAMES, n_scenelets))
        for (start, scenelet), probability in zip(
            np.ndindex(chance.shape), np.empty((chance.size, COMPONENTS)), strict=True
        ):
            code = start * n_scenelets + scenelet
            chances_of(reference, kind, end, code, probability)
            chance[start, scenelet] = probability.sum()
        assert chance[end] == pytest.approx(0.25 * fits + 0.75 * same / same.sum())
        assert chance.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("films", [1, 2])
def test_scenes_are_as_frequent_as_is_said(films: int) -> None:
    """The five most frequent sequences, and how many scenelets there are."""
    reference, n = known(films), 4000
    n_scenelets, end_code = len(reference.kinds), N_FRAMES * len(reference.kinds)
    rng = np.random.default_rng(1)
    drawn = [draw_scene(reference, rng) for _ in range(n)]
    keys = [tuple(map(tuple, state.items.tolist())) for state in drawn]
    for key in sorted(set(keys), key=keys.count)[-5:]:
        kind, end, chance, probability = 0, 0, 1.0, np.empty(COMPONENTS)
        for scenelet, start in key:
            chances_of(reference, kind, end, start * n_scenelets + scenelet, probability)
            chance *= probability.sum()
            kind, end = reference.kinds[scenelet], start + reference.lengths[scenelet]
        chances_of(reference, kind, end, end_code, probability)
        chance *= probability.sum()
        error = np.sqrt(chance * (1 - chance) / n)
        assert abs(keys.count(key) / n - chance) < LIMIT * error
    begins = np.flatnonzero(PROBLEM.path_starts if films == 1 else two_films().path_starts)
    for state in drawn:
        ends = state.items[:, 1] + PROBLEM.lengths[state.items[:, 0]]
        assert (ends[:-1] <= state.items[1:, 1]).all()
        for start, end in zip(state.items[:, 1], ends, strict=True):
            assert end <= N_FRAMES
            assert not ((begins > start) & (begins < end)).any()


def narrower(reference: Reference) -> Reference:
    """Another distribution of scenes, whose density is nowhere much higher.

    Yaws scatter as before, so that as many of them lie within half a turn.
    """
    return reference._replace(
        camera_factor=0.8 * reference.camera_factor,
        camera_constant=reference.camera_constant - 5 * np.log(0.8),
        factors=np.diag([0.8, 0.8, 1.0, 0.8]) @ reference.factors,
        constants=reference.constants - 3 * np.log(0.8),
    )


def mean_ratio(one: Reference, drawn_of: Reference, said: Reference, n: int) -> float:
    """How far the mean of ``one`` over ``said``, for draws, is from one, in standard errors."""
    rng = np.random.default_rng(2)
    states = [draw_scene(drawn_of, rng) for _ in range(n)]
    ratios = np.exp([log_density(one, s) - log_density(said, s) for s in states])
    assert ratios.std() > 0
    return float((ratios.mean() - 1) / (ratios.std() / np.sqrt(n)))


@pytest.mark.parametrize("films", [1, 2])
def test_the_density_is_that_of_the_draws(films: int) -> None:
    """The mean of h / q over draws of q is the integral of h: one."""
    reference = known(films)
    assert abs(mean_ratio(narrower(reference), reference, reference, 6000)) < LIMIT
    other = known(films, seed=5)
    flat = reference._replace(factors=other.factors, constants=other.constants)
    mixed = flat._replace(camera_mean=reference.camera_mean + 0.2 * reference.camera_factor[:, 0])
    assert abs(mean_ratio(mixed, reference, reference, 6000)) < LIMIT


@pytest.mark.parametrize(
    "error", ["constant", "reprojected", "regression", "camera", "start", "ends"]
)
@pytest.mark.slow
def test_wrong_densities_are_seen(error: str) -> None:
    """What is as wrong again is, on average over draws, not as dense as it should be."""
    right = known()

    def wrong(by: float) -> Reference:
        camera = right.library_camera + 0.1 * by * np.eye(5)[1]
        ends = right.later_probability ** (1 - 0.1 * by)
        changes = {
            "constant": {"constants": right.constants - 0.1 * by},
            "reprojected": {"library_camera": camera},
            "regression": {
                "displacement_regression": right.displacement_regression + 0.4 * by * np.eye(4)
            },
            "camera": {"camera_regression": right.camera_regression + 0.4 * by},
            "start": {"start_deviations": right.start_deviations + np.float32(0.02 * by)},
            "ends": {"later_probability": ends},
        }
        return right._replace(**changes[error])

    assert abs(mean_ratio(wrong(2), right, wrong(1), 6000)) > LIMIT
    assert abs(mean_ratio(narrower(right), right, right, 6000)) < LIMIT


def test_centres_by_camera_and_start_are_learnt() -> None:
    """What is learnt from draws of a narrow reference is this reference."""
    rng, wide = np.random.default_rng(3), known()
    turns = rng.choice([-0.1, 0.1], wide.yaw.shape).astype(np.float32)
    by_camera = np.zeros((3, 4, 5))
    by_camera[:, 1, 3] = 0.6
    true = wide._replace(
        start_deviations=np.eye(4, dtype=np.float32)[2] * turns[..., None],
        camera_regression=by_camera, factors=0.3 * wide.factors,
    )  # fmt: skip
    visits = Visits()
    for _ in range(3000):
        visits.note(draw_scene(true, rng))
    learnt = learn(PROBLEM, random_gains(PROBLEM), similarity(), visits)
    scenelet, start = visits.arrays()["items"].T
    number = np.zeros(turns.shape)
    np.add.at(number, (start, scenelet), 1)
    often = number > 30
    assert often.sum() > 30
    # Means of neighbouring starts and of the scenelet are taken for a part of it.
    found = learnt.yaw + learnt.scenelet_deviations[:, 0, 2] + learnt.start_deviations[..., 2]
    expected = true.scenelet_deviations[:, 0, 2] + turns
    assert np.corrcoef((found - true.yaw)[often], expected[often])[0, 1] > 0.8
    assert learnt.camera_regression[0, 1, 3] == pytest.approx(0.6, abs=0.2)


def test_sizes_that_fit_are_expected_until_visits_say_otherwise() -> None:
    gains, none, many = random_gains(PROBLEM), Visits(), Visits()
    none.note(empty_state(PROBLEM))
    for n in range(2000):
        scenelet, start = n % 3, n % 10
        many.note(empty_state(PROBLEM).with_item(scenelet, start, np.array([0.3, 3.5, 1.0])))
    expected, otherwise = (
        learn(PROBLEM, gains, similarity(), v).start_deviations[..., 3] for v in (none, many)
    )
    assert expected == pytest.approx(gains.sizes, abs=1e-6)
    assert np.abs(otherwise[12:]).max() < 0.2 * np.abs(gains.sizes[12:]).max()


def test_scenelets_are_reprojected_as_moves_reproject_them() -> None:
    """What looks the same through another camera is as far from what was met."""
    reference = known()
    before, after = np.array(PROBLEM.camera_mean), np.array(PROBLEM.camera_mean)
    after += [0.01, 0.05, -0.02, 0.03, 0.02]
    # Somebody of whom the first frame is the middle one, in the middle of the scenelet.
    pelvis = np.array(reference.pelvis)
    pelvis[..., :2] = 0.0
    height = float(pelvis[0, 0, 2])
    state = empty_state(PROBLEM).with_item(0, 5, np.array([0.4, 4.0, 0.3]), 0.02)
    x, y, size = place_from_image(after, project_pelvis(before, 0.4, 4.0, 0.02, height), height)
    there, size = np.array([[x, y, 0.3]]), np.array([size])
    moved = State(after, state.items, there, size, state.latent)
    # Visited there, and hardly scattered.
    path, yaw = np.array(reference.path), np.array(reference.yaw)
    path[5], yaw[5, 0] = to_view(state.placements[0], state.sizes[0])[:2], 0.3
    only = reference._replace(
        pelvis=pelvis, path=path, yaw=yaw, size=0.02,
        scenelet_deviations=np.zeros_like(reference.scenelet_deviations),
        start_deviations=np.zeros_like(reference.start_deviations),
        camera_regression=np.zeros_like(reference.camera_regression),
        camera_factor=reference.camera_factor * 1e6, factors=reference.factors * 0.1,
    )  # fmt: skip
    area = 2 * np.log([state.placements[0, 1], moved.placements[0, 1]])
    one, other = (log_density(only, s) for s in (state, moved))
    # Not quite: scenelets anywhere are not reprojected. As much further off it would be nats.
    assert one + area[0] == pytest.approx(other + area[1], abs=0.01)
    elsewhere = replace(moved, placements=there + np.array([[0.0, 0.2, 0.0]]))
    assert log_density(only, elsewhere) < other - 1


def test_nobody_is_behind_the_camera_nor_overlaps() -> None:
    reference, state = known(), empty_state(PROBLEM)
    ahead = state.with_item(0, 2, np.array([0.1, 4.0, 0.0]))
    assert np.isfinite(log_density(reference, ahead))
    behind = state.with_item(0, 2, np.array([0.1, -4.0, 0.0]))
    assert log_density(reference, behind) == -np.inf
    twice = ahead.with_item(1, 3, np.array([0.1, 4.0, 0.0]))
    assert log_density(reference, twice) == -np.inf
    late = replace(ahead, items=np.array([[0, N_FRAMES - 1]]))
    assert log_density(reference, late) == -np.inf


def test_what_was_visited_is_drawn_more_often() -> None:
    visits = Visits()
    state = empty_state(PROBLEM).with_item(1, 4, np.array([0.3, 3.5, 1.0]))
    for _ in range(50):
        visits.note(state)
    for _ in range(50):
        visits.note(empty_state(PROBLEM), 0.1)  # hot: does not count
    reference = learn(PROBLEM, random_gains(PROBLEM), similarity(), visits)
    rng = np.random.default_rng(0)
    drawn = [draw_scene(reference, rng) for _ in range(400)]
    same = [s for s in drawn if s.n_scenelets == 1 and s.items[0].tolist() == [1, 4]]
    assert len(same) > 80
    near = np.array([to_view(s.placements[0], s.sizes[0]) for s in same])
    # Through the camera that was drawn, bearing and depth are elsewhere; the yaw is not.
    assert np.median(np.abs(near[:, 2] - 1.0)) < 0.1


def test_rows_count_what_followed_and_what_came_later() -> None:
    """As told state by state, with every shift of ends and starts on its own."""
    rng, visits = np.random.default_rng(3), Visits()
    for _ in range(60):
        visits.note(draw_state(rng, PROBLEM))
    reference = learn(PROBLEM, random_gains(PROBLEM), similarity(), visits)
    lengths, frames_left, n_scenelets = (
        reference.lengths,
        reference.frames_left,
        len(reference.kinds),
    )
    the_end = N_FRAMES * n_scenelets
    followed, later = Counter[tuple[int, int]](), Counter[tuple[int, int]]()
    visited = visits.arrays()
    for items in np.split(visited["items"], np.cumsum(visited["counts"])[:-1]):
        kind, end, begun = 0, 0, 0
        for scenelet, start in [*items.tolist(), (0, N_FRAMES)]:
            ends = start == N_FRAMES
            flush = not ends and start == end and kind > 0
            for by, share in _SHIFTS.items():
                after = end + by * (kind > 0)
                row = kind * (N_FRAMES + 1) + after
                for off, part in ({0: 1.0} if ends or flush else _SHIFTS).items():
                    begins = after if flush else start + off
                    fits = ends or (after <= begins and 0 <= begins < N_FRAMES)
                    if (
                        0 <= after <= N_FRAMES
                        and fits
                        and (ends or lengths[scenelet] <= frames_left[begins])
                    ):
                        code = the_end if ends else begins * n_scenelets + scenelet
                        followed[row, code] += share * part
                begins = N_FRAMES if ends else start + by
                if ends or (0 <= begins < N_FRAMES and lengths[scenelet] <= frames_left[begins]):
                    code = the_end if ends else begins * n_scenelets + scenelet
                    for frame in range(begun, begins + 1):
                        later[frame, code] += share
            kind, end = int(reference.kinds[scenelet]), start + int(lengths[scenelet])
            begun = start + 1
    for counted, first, codes, probability in (
        (followed, reference.followed_first, reference.followed, reference.followed_probability),
        (later, reference.later_first, reference.later, reference.later_probability),
    ):
        sums = Counter[int]()
        for (row, _), weight in counted.items():
            sums[row] += weight
        rows = np.repeat(np.arange(len(first) - 1), np.diff(first)).tolist()
        found = dict(zip(zip(rows, codes.tolist(), strict=True), probability, strict=True))
        assert found == pytest.approx({at: counted[at] / sums[at[0]] for at in counted})


def test_shares_are_of_what_foretells_other_visits() -> None:
    """What always comes at one frame is foretold by what came there; chance, by nothing met."""
    rng, always, never = np.random.default_rng(0), Visits(), Visits()
    for _ in range(200):
        place = np.array([0.3, 3.5, 1.0])
        always.note(empty_state(PROBLEM).with_item(1, 4, place))
        never.note(draw_state(rng, PROBLEM))
    gains = random_gains(PROBLEM)
    met, unmet = (learn(PROBLEM, gains, similarity(), v).weights for v in (always, never))
    for weights in (met, unmet):
        assert weights.sum() == pytest.approx(1.0)
        assert (weights > 0).all()
    # Half of the initial weights is kept, of which a fourth are these two.
    assert met[:2].sum() > 0.6 > 0.3 > unmet[:2].sum()


def test_halves_are_the_whole() -> None:
    rng, visits = np.random.default_rng(0), Visits()
    for _ in range(7):
        visits.note(draw_state(rng, PROBLEM))
    first, second = visits.halves()
    assert [len(half.arrays()["counts"]) for half in (first, second)] == [3, 4]
    whole = Visits.together([first, second]).arrays()
    for name, values in visits.arrays().items():
        assert np.array_equal(whole[name], values)


def test_an_empty_scene_is_enough_to_learn_from() -> None:
    visits = Visits()
    visits.note(empty_state(PROBLEM))
    reference = learn(PROBLEM, random_gains(PROBLEM), similarity(), visits)
    rng = np.random.default_rng(0)
    drawn = [draw_scene(reference, rng) for _ in range(300)]
    assert all(np.isfinite(log_density(reference, state)) for state in drawn)
    assert 0 < sum(s.n_scenelets == 0 for s in drawn) < 300


def test_runs_are_chosen_as_often_as_is_said() -> None:
    lengths = np.array([6, 8, 4])
    items = np.array([(0, 0), (1, 9), (0, 17), (2, 25), (2, 29), (0, 33)])
    rng, n = np.random.default_rng(1), 20000
    drawn = Counter(_draw_run(lengths, items, rng) for _ in range(n))
    places = [(i, j) for i in range(7) for j in range(i, 7)]
    chance = {run: np.exp(_log_run(lengths, items, *run)) for run in places}
    assert sum(chance.values()) == pytest.approx(1.0)
    assert set(drawn) <= set(places)
    for run, probability in chance.items():
        assert abs(drawn[run] / n - probability) < LIMIT * np.sqrt(probability / n)
    # Groups of flush scenelets are 1 to 2 and 3 to 5.
    assert chance[3, 6] > chance[2, 5]
    assert chance[1, 3] > chance[0, 2] == chance[2, 4]
    assert chance[0, 1] == chance[4, 5] > chance[0, 2]
