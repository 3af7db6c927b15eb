"""Somebody who passes before the person of a clip."""

from __future__ import annotations

import numpy as np

from imapper_prob.api import demo_clip
from lab.passers import passed, passing


def test_a_passer_hides_some_of_the_body_some_of_the_time() -> None:
    behind = passing(demo_clip())
    crossed = behind.any(1)
    assert 0.05 < crossed.mean() < 0.5
    assert behind[crossed].mean() > 0.3
    # To and fro: several times, each for some frames.
    assert (np.diff(crossed.astype(int)) == 1).sum() >= 2


def test_clips_differ_by_what_is_hidden() -> None:
    clip = demo_clip()
    alone, crossed = passed(clip, 3)
    again, _ = passed(clip, 3)
    np.testing.assert_array_equal(alone.tracks[0].keypoints, again.tracks[0].keypoints)
    behind = passing(clip)
    sure = [t.tracks[0].confidences[behind].mean() for t in (alone, crossed)]
    assert sure[1] < sure[0]
