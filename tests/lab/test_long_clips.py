"""What long clips take, measured in processes of their own."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lab.long_clips import SETTINGS, Taken, long_clips_section, measured


def test_the_table_has_each_stage_and_end() -> None:
    short = Taken(5, 1e9, {"reading": (1.0, 0.2e9), "writing": (2.0, 0.5e9)}, "finished")
    long = Taken(5000, 2e9, {"reading": (3.0, 0.3e9)}, "too | large")
    assert long_clips_section([short, long]).splitlines() == [
        "| | 5 frames | 5,000 frames |",
        "|---|---|---|",
        "| asked for, GB | 1.0 | 2.0 |",
        "| largest peak, GB | 0.5 | 0.3 |",
        "| reading: s, GB | 1, 0.2 | 3, 0.3 |",
        "| writing: s, GB | 2, 0.5 | – |",
        "| end | finished | too \\| large |",
    ]


@pytest.mark.slow
def test_a_clip_is_measured_until_its_end() -> None:
    taken = measured(130, minutes=30, settings=replace(SETTINGS, steps=60, draws=5))
    assert taken.end == "finished"
    assert taken.stages.keys() >= {"reading", "fitting scenelets", "jumping between scenes"}
    peaks = [peak for _, peak in taken.stages.values()]
    assert peaks == sorted(peaks)
    assert 0.1e9 < peaks[-1] < taken.asked
