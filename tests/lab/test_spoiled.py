"""Scoring of spoiled clips: times, costs, and counts of frames found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imapper_prob.evaluate.score import SUBSETS
from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import N_JOINTS
from lab.elsewhere import Counts, count
from lab.spoiled.__main__ import cost_of, joint_cells, page, there_of
from lab.spoiled.scores import UNSPOILED, at_times, settings, spoil
from lab.spoiled.spoilings import SPOILINGS, at_rate


def make_clip(n: int = 100) -> Clip:
    rng = np.random.default_rng(0)
    track = Track(
        "somebody", rng.uniform(300, 700, (n, N_JOINTS, 2)), rng.uniform(0.1, 1, (n, N_JOINTS)),
        rng.normal(size=(n, N_JOINTS, 3)), np.zeros(n, bool),
    )  # fmt: skip
    return Clip(
        "clip", Camera(1920, 1080, 1955.0, 1953.0, 960.0, 540.0), 10.0, np.arange(n), (track,)
    )


def record(name: str, errors: list[float], affected: list[bool]) -> dict[str, Any]:
    squares = [e**2 for e in errors]
    mean = float(np.sqrt(np.mean(squares)))
    subsets = {subset: [mean, 1.0, 1.0] for subset in SUBSETS}
    static = {**subsets, "squares": squares, "depth": [-0.02, 0.05]}
    return {"spoiling": name, "affected": affected, "static": static}


@pytest.mark.parametrize("fps", [10.0, 15.0, 25.0])
def test_answers_come_back_to_the_times_of_the_truth(fps: float) -> None:
    clip = make_clip()
    other = at_rate(clip, np.random.default_rng(0), fps=fps).clip
    seconds = np.arange(other.n_frames) / fps
    found = at_times(clip.n_frames, other, np.stack([seconds, -seconds], -1))
    wanted = np.minimum(np.arange(clip.n_frames) / 10.0, seconds[-1])
    np.testing.assert_allclose(found, np.stack([wanted, -wanted], -1), atol=1e-9)
    turned = at_times(clip.n_frames, other, seconds[None], axis=1)
    np.testing.assert_allclose(turned[0], wanted, atol=1e-9)


def test_what_is_not_affected_costs_what_it_is_worse_and_the_rest_counts_apart() -> None:
    flags = [False, False, True]
    clean = record(UNSPOILED, [10.0, 10.0, 20.0], [False] * 3)
    ghost = record("elsewhere-low", [13.0, 13.0, 50.0], flags)
    assert cost_of(ghost, clean, "static") == pytest.approx(3.0)
    assert there_of(ghost, clean, "static") == pytest.approx((50.0, 20.0))
    jump = record("limbs-jump", [10.0, 10.0, 20.0], flags)
    assert cost_of(jump, clean, "static") == pytest.approx(0.0)
    _, good = joint_cells({"a": ghost}, {"a": clean}, "static")
    assert good
    worse = record("elsewhere-low", [13.0, 13.0, 60.0], flags)
    _, good = joint_cells({"a": worse}, {"a": clean}, "static")
    assert not good


def test_the_page_says_what_does_not_keep_the_limits() -> None:
    clean = record(UNSPOILED, [10.0, 10.0], [False] * 2)
    dear = record("trunk-0.6", [20.0, 20.0], [True] * 2)
    text = page({UNSPOILED: {"a": clean}, "trunk-0.6": {"a": dear}}, (), static=True, scenes=1)
    assert "**+10.0**" in text
    assert "depth -2.0 ± 5.0 %" in text
    assert "1 of 2 rows keep all limits" in text


def test_a_draw_depends_on_the_seed() -> None:
    clip = make_clip()
    name = SPOILINGS[13].name
    one, same, other = (spoil(clip, name, seed).clip.tracks[0].keypoints for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    untouched, affected = spoil(clip, UNSPOILED, 0)
    assert untouched is clip
    assert not affected.any()


def test_short_chains_keep_what_draws_they_can() -> None:
    assert settings(60_000).draws == 800
    assert settings(100).draws == settings(100).most_draws


def test_counts_of_frames_and_stretches() -> None:
    affected = np.array([0, 1, 1, 0, 0, 1, 1, 0], bool)
    flagged = np.array([0, 1, 1, 1, 0, 0, 0, 0], bool)
    assert count(flagged, affected) == Counts(4, 2, 2, 1, 4, 1)
    assert count(flagged, affected) + Counts(1, 1, 1, 1, 1, 1) == Counts(5, 3, 3, 2, 5, 2)
