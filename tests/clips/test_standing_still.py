"""A camera that stands still, one that pans, and a film that is cut."""

from __future__ import annotations

import numpy as np
import pytest

from imapper_prob.clips.video import grey_thumbnail, stillness
from tests.clips.films import film


def looks(frames: list[np.ndarray]) -> list[np.ndarray]:
    return [grey_thumbnail(frame) for frame in frames[::4]]


def test_somebody_walks_before_a_fixed_camera() -> None:
    found = stillness(looks(film()))
    assert found.shift == 0
    assert not found.moving
    assert not found.cut


def test_noise_and_light_do_not_count(rng: np.random.Generator) -> None:
    frames = [
        np.clip(frame * (0.6 + 0.02 * t) + rng.normal(0, 8, frame.shape), 0, 255).astype(np.uint8)
        for t, frame in enumerate(film())
    ]
    found = stillness(looks(frames))
    assert not found.moving
    assert not found.cut


@pytest.mark.parametrize("pan", [12, 30, 60])
def test_a_pan_is_seen(pan: int) -> None:
    found = stillness(looks(film(left=lambda t: 60 + pan * t // 40)))
    assert found.moving or found.cut


def test_a_nudge_is_forgiven() -> None:
    found = stillness(looks(film(left=lambda t: 60 + (t >= 20))))
    assert not found.moving
    assert not found.cut


def test_a_cut_is_seen() -> None:
    assert stillness(looks(film(20) + film(20, seed=1))).cut


def test_a_single_frame_and_a_blank_wall_say_nothing() -> None:
    assert not stillness(looks(film(1))).moving
    blank = [np.full((240, 320, 3), 200, np.uint8)] * 12
    found = stillness(looks(blank))
    assert not found.moving
    assert not found.cut
