"""The paper's tracker: its costs by hand, and the optimum against all other answers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.clips.load import ClipOptions
from imapper_prob.clips.tracking import PAIRWISE, associate, step_cost
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED
from lab.crossings import simulate_crossing
from tests.clips.test_associate import figures, labels

Array = NDArray[np.float64]
HALF = 500.0
"""Pixels, half a diagonal."""


def test_a_step_by_hand() -> None:
    """A tenth of half the diagonal: .01, times .8 x .5; a joint that is lost adds nothing."""
    one, other = np.zeros((1, 16, 2)), np.zeros((1, 16, 2))
    other[..., 0], other[..., 1] = 30.0, 40.0
    c, d = np.full((1, 16), 0.8), np.full((1, 16), 0.5)
    assert step_cost(one, other, c, d, half_diagonal=HALF) == pytest.approx(0.01 * 0.4)
    lost = list(DETECTED)[:7]
    d[0, lost], other[0, lost] = 0.0, np.nan
    assert step_cost(one, other, c, d, half_diagonal=HALF) == pytest.approx(0.01 * 0.4 / 2)


def energy(
    frames: Array, keypoints: Array, confidences: Array, rows: list[int], n_frames: int
) -> float:
    """Of one actor by the printed sums, E_u with one minus."""
    joints = list(DETECTED)
    at = {int(frames[row]): row for row in rows}
    total = 0.0
    for t in range(n_frames):
        total += -confidences[at[t], joints].mean() if t in at else 1.0
        if t + 1 == n_frames:
            break
        if t in at and t + 1 in at:
            one, other = at[t], at[t + 1]
            apart = ((keypoints[one] - keypoints[other])[joints] / HALF) ** 2
            weight = confidences[one, joints] * confidences[other, joints]
            total += PAIRWISE * (apart.sum(-1) * weight).mean()
        else:
            total += PAIRWISE * 1.0
    return float(total)


def test_nothing_else_is_cheaper(rng: np.random.Generator) -> None:
    for _ in range(5):
        xs = [list(100 + 400 * rng.random(rng.integers(1, 3))) for _ in range(4)]
        frames, keypoints, _ = figures(xs)
        confidences = rng.uniform(0.05, 1, (len(frames), 16))
        found = associate(frames, keypoints, confidences, people=2, half_diagonal=HALF)
        found += [np.zeros(0, int)] * (2 - len(found))
        ours = sum(energy(frames, keypoints, confidences, list(r), 4) for r in found)
        others = []
        for owners in itertools.product((0, 1, None), repeat=len(frames)):
            rows = [[i for i, o in enumerate(owners) if o == a] for a in (0, 1)]
            if all(len({frames[i] for i in own}) == len(own) for own in rows):
                others.append(sum(energy(frames, keypoints, confidences, r, 4) for r in rows))
        assert ours == pytest.approx(min(others))


def test_of_two_detections_at_one_place_the_surer_is_taken() -> None:
    """As printed, with the minus twice, it would be the other one."""
    frames, keypoints, confidences = figures([[100.0, 100.0]] * 3)
    confidences[::2] = 0.4
    (rows,) = associate(frames, keypoints, confidences, people=1, half_diagonal=HALF)
    assert rows.tolist() == [1, 3, 5]


def test_crossings_are_told_apart() -> None:
    crossing = simulate_crossing(np.random.default_rng(0), missing=0.0, fps=10.0)
    rows = associate(
        crossing.frames, crossing.keypoints, crossing.confidences, half_diagonal=1101.0
    )
    found = labels(rows, len(crossing.frames))
    wrong = min((found != crossing.truth).sum(), (found != 1 - crossing.truth).sum())
    assert wrong / len(found) < 0.05


def test_marks_hold_with_these_costs() -> None:
    frames, keypoints, confidences = figures([[100.0, 300.0], [110.0, 310.0], [120.0, 320.0]])
    rows = associate(
        frames, keypoints, confidences, people=2, marks={0: 1, 3: 0}, half_diagonal=HALF
    )
    assert 0 in rows[1]
    assert 3 in rows[0]


def test_a_tracker_has_a_name() -> None:
    with pytest.raises(InputError, match="default or paper"):
        ClipOptions(tracker="hungarian")
