"""The recording of the solver's stages as rerun reads it back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.recording.stages import Curve, StageView, write_stages
from tests.recording.reading import Columns, read
from tests.recording.room import make_room


def written(path: Path, charness: dict[str, Curve]) -> Columns:
    clip, scenes, _ = make_room(12)
    scene = scenes[0].scene
    stage = StageView("Static path", "", scene.objects, (scene.joints,))
    write_stages(path, clip=clip, camera=scene.camera, stages=[stage], charness=charness)
    return read(path)


def test_names_that_the_viewer_cannot_draw_are_told_apart(tmp_path: Path) -> None:
    """The viewer ends at a character that its font lacks, and shows paths in the legend."""
    curve = np.array([5, 9]), np.array([0.2, 0.4])
    columns = written(tmp_path / "stages.rrd", {"部": curve, "屋": curve, "Ann": curve})
    bars = sorted(entity for entity, name in columns if name == "BarChart:values")
    assert [e.replace("\\", "") for e in bars] == [
        "/charness/1 ?", "/charness/2 ?", "/charness/3 Ann",
    ]  # fmt: skip


@pytest.mark.parametrize(("frames", "width"), [([10, 14, 18], 4.0), ([10], 1.0), ([3, 4, 9], 1.0)])
def test_bars_are_as_wide_as_windows_are_apart(
    tmp_path: Path, frames: list[int], width: float
) -> None:
    curve = np.array(frames), np.full(len(frames), 0.5)
    columns = written(tmp_path / "stages.rrd", {"Ann": curve})
    (widths,) = (w[None] for (_, name), w in columns.items() if name == "BarChart:widths")
    assert np.unique(widths).tolist() == [width]
