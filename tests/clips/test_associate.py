"""Who is who: crossings with a known answer, and the optimum against all other answers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.clips import tracking as module
from imapper_prob.clips.tracking import associate, distances, people_in
from imapper_prob.models.errors import InputError
from lab.crossings import simulate_crossing

Array = NDArray[np.float64]


def labels(rows: list[NDArray[np.int64]], n: int) -> NDArray[np.int64]:
    result = np.full(n, -1)
    for actor, own in enumerate(rows):
        result[own] = actor
    return result


@pytest.mark.parametrize("fps", [10.0, 30.0])
def test_crossings_with_a_fifth_of_all_skeletons_missing(fps: float) -> None:
    wrong = total = 0
    for seed in range(8):
        crossing = simulate_crossing(np.random.default_rng(seed), missing=0.2, fps=fps)
        rows = associate(crossing.frames, crossing.keypoints, crossing.confidences)
        found = labels(rows, len(crossing.frames))
        wrong += min((found != crossing.truth).sum(), (found != 1 - crossing.truth).sum())
        total += len(found)
    assert wrong / total <= 0.01


def figures(xs: list[list[float]], confidence: float = 0.9) -> tuple[Array, Array, Array]:
    """Frames, keypoints and confidences of bodies 200 pixels high at the given places."""
    body = np.stack([np.linspace(-30, 30, 16), np.linspace(0, 200, 16)], -1)
    frames = np.repeat(np.arange(len(xs)), [len(x) for x in xs])
    at = np.concatenate([np.array(x, float) for x in xs])
    keypoints = body + np.stack([at, np.zeros_like(at)], -1)[:, None]
    return frames, keypoints, np.full((len(frames), 16), confidence)


def cost(
    frames: Array, keypoints: Array, confidences: Array, rows: list[int], n_frames: int
) -> float:
    """Of one actor, by the definition."""
    if not rows:
        return module.ABSENT * n_frames
    total = sum(1 - confidences[row].mean() for row in rows)
    total += module.ABSENT * (n_frames - len(rows))
    for one, other in itertools.pairwise(rows):
        step = distances(keypoints, confidences, np.array([one]), np.array([other]))[0]
        total += step / np.sqrt(frames[other] - frames[one])
    return float(total)


def test_nothing_else_is_cheaper(rng: np.random.Generator) -> None:
    """Against all ways to give the skeletons of four frames to two actors."""
    for _ in range(5):
        xs = [list(100 + 40 * rng.random(rng.integers(1, 3))) for _ in range(4)]
        frames, keypoints, _ = figures(xs)
        confidences = rng.uniform(0.05, 1, (len(frames), 16))
        found = associate(frames, keypoints, confidences, people=2)
        found += [np.zeros(0, int)] * (2 - len(found))
        ours = sum(cost(frames, keypoints, confidences, list(r), 4) for r in found)
        others = []
        for owners in itertools.product((0, 1, None), repeat=len(frames)):
            rows = [[i for i, o in enumerate(owners) if o == a] for a in (0, 1)]
            if all(len({frames[i] for i in own}) == len(own) for own in rows):
                others.append(sum(cost(frames, keypoints, confidences, r, 4) for r in rows))
        assert ours == pytest.approx(min(others))


def test_one_flow_costs_what_separate_flows_cost() -> None:
    """Successive shortest paths against the linear program, with a mark that costs nothing."""
    crossing = simulate_crossing(np.random.default_rng(3), missing=0.3, fps=10, n_frames=60)
    detected = crossing.frames, crossing.keypoints, crossing.confidences
    free = associate(*detected, people=2)
    marked = associate(*detected, people=2, marks={int(free[0][5]): 0})
    costs = [sum(cost(*detected, list(own), 60) for own in rows) for rows in (free, marked)]
    assert costs[0] == pytest.approx(costs[1])


def test_a_ghost_is_nobody() -> None:
    xs = [[100.0 + 2 * t] for t in range(20)]
    xs[7] = [114.0, 900.0]
    frames, keypoints, confidences = figures(xs)
    assert people_in(frames) == 1
    (rows,) = associate(frames, keypoints, confidences)
    assert 8 not in rows
    assert len(rows) == 20


def test_somebody_comes_back() -> None:
    xs = [[100.0, 500.0] if t not in range(8, 14) else [500.0] for t in range(24)]
    frames, keypoints, confidences = figures(xs)
    rows = associate(frames, keypoints, confidences, people=2)
    at = [np.unique(keypoints[own, 0, 0]) for own in rows]
    assert [len(a) for a in at] == [1, 1]


def test_marks_are_kept() -> None:
    frames, keypoints, confidences = figures([[100.0, 500.0]] * 6)
    free = associate(frames, keypoints, confidences, people=2)
    swapped = {int(free[0][0]): 1, int(free[1][0]): 0}
    rows = associate(frames, keypoints, confidences, marks=swapped)
    np.testing.assert_array_equal(rows[0], free[1])
    np.testing.assert_array_equal(rows[1], free[0])
    # Marked against all likelihood: they change places half-way.
    crossing = {int(free[0][0]): 0, int(free[0][-1]): 1}
    rows = associate(frames, keypoints, confidences, marks=crossing)
    assert free[0][0] in rows[0]
    assert free[0][-1] in rows[1]
    with pytest.raises(InputError, match="marked twice"):
        associate(frames, keypoints, confidences, marks={0: 0, 1: 0})


def test_order_of_rows_does_not_matter(rng: np.random.Generator) -> None:
    crossing = simulate_crossing(rng, missing=0.1, fps=10, n_frames=40)
    order = rng.permutation(len(crossing.frames))
    one = associate(crossing.frames, crossing.keypoints, crossing.confidences)
    other = associate(
        crossing.frames[order], crossing.keypoints[order], crossing.confidences[order]
    )
    assert {frozenset(rows) for rows in one} == {frozenset(order[rows]) for rows in other}
