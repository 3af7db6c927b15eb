"""The truth of i3DB scenes as captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import PELV
from imapper_prob.scenelets.build import captures_from
from imapper_prob.scenelets.captures import i3db_folders, read_i3db_capture
from tests.clips.i3db_folder import I3dbFolder, true_joints


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return I3dbFolder().write(tmp_path / "Hall")


def test_odd_frames_lie_between_the_annotated_ones(scene: Path) -> None:
    capture = read_i3db_capture(scene)
    assert (capture.name, capture.scene, capture.fps) == ("Hall", "Hall", 10.0)
    assert [o.label for o in capture.objects] == ["couch", "table"]
    # Frames 2 to 12 are annotated or between two that are; the person walks evenly.
    pelvis = capture.joints[:, PELV]
    assert np.isnan(pelvis[0]).all()
    truth = true_joints()
    step = np.linalg.norm(truth[1, PELV] - truth[0, PELV])
    np.testing.assert_allclose(np.linalg.norm(np.diff(pelvis[1:], axis=0), axis=1), step, atol=1e-6)
    assert set(capture.actions) == {"walk"}


def test_actions_are_in_our_words(tmp_path: Path) -> None:
    files = I3dbFolder()
    words = ["walking"] * 3 + ["sitting"] * 3 + ["standing(from sitting)"] * 3 + ["reaching"] * 3
    files.actions = "".join(f"{i}\t{word}\n" for i, word in enumerate(words))
    capture = read_i3db_capture(files.write(tmp_path / "Hall"))
    ours = ["walk"] * 3 + ["sit"] * 3 + ["stand-up"] * 3 + ["reach"] * 3
    assert list(capture.actions) == ours


def test_an_unknown_action_is_named(tmp_path: Path) -> None:
    files = I3dbFolder()
    files.actions = files.actions.replace("walking", "flying", 1)
    with pytest.raises(InputError, match=r"actions\.txt: unknown action 'flying'"):
        read_i3db_capture(files.write(tmp_path / "Hall"))


def test_a_scene_is_left_out_by_name(tmp_path: Path) -> None:
    for name in ("Hall", "Attic"):
        I3dbFolder().write(tmp_path / name)
    assert [p.name for p in i3db_folders(tmp_path)] == ["Attic", "Hall"]
    assert [c.scene for c in captures_from("i3db", tmp_path, leave_out="Hall")] == ["Attic"]
    with pytest.raises(InputError, match="no scene 'Cellar' to leave out; there are Attic, Hall"):
        captures_from("i3db", tmp_path, leave_out="Cellar")


@pytest.mark.corpus
def test_the_benchmark_has_captures(i3db_scene: Path) -> None:
    capture = read_i3db_capture(i3db_scene)
    there = np.isfinite(capture.joints[:, PELV, 0])
    # From the first to the last annotated frame without a gap.
    assert there[np.flatnonzero(there)[0] : np.flatnonzero(there)[-1]].all()
    assert {"walk", "sit"} <= set(capture.actions)
