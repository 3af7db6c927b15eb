"""Somebody who passes before the person of a clip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.api import demo_clip
from lab.passers import main, passed, passing


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


@pytest.mark.slow
def test_clips_are_scored_with_and_without(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([str(tmp_path), "--clips", "1", "--steps", "100", "--workers", "1"])
    rows = [
        line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if "|" in line
    ]
    assert rows.count("alone") == rows.count("passed") == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip-0-alone", "clip-0-passed"]
