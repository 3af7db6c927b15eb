"""Recordings that are filmed, and a room that the library knows nothing of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED, PELV
from imapper_prob.scenelets.captures import Capture
from imapper_prob.simulate.scene import FEWEST_SEEN, in_image
from lab.held_out import _longest_stretch, filmed, main
from tests.conftest import CORPUS
from tests.scenelets.motions import box, standing


@pytest.fixture
def capture() -> Capture:
    """Somebody goes three metres past a chair in six seconds."""
    along = np.linspace(0.0, 3.0, 60)[:, None, None] * np.array([1.0, 0.0, 0.0])
    furniture = (box("chair", x=0.6, y=1.0),)
    return Capture("hall", "hall", standing(60) + along, furniture, 10.0)


def test_the_longest_stretch_is_cut_and_has_its_words(capture: Capture) -> None:
    joints = capture.joints.copy()
    joints[4] = np.nan
    words = ("walk",) * 5 + ("sit",) * (len(joints) - 5)
    gappy = replace(capture, joints=joints, actions=words)
    found, actions = _longest_stretch(gappy, 1.0)
    assert_array_equal(found, capture.joints[5:15])
    assert actions == ("sitting",) * 10


def test_other_rates_become_ten_a_second(capture: Capture) -> None:
    slow = replace(capture, joints=capture.joints[::2], fps=5.0, actions=())
    found, actions = _longest_stretch(slow, 2.0)
    assert actions == ()
    # The middle stays the middle, so the first half step is cut off.
    assert_allclose(found[1::2], slow.joints[1 : 1 + len(found[1::2])], atol=1e-12)


def test_the_room_goes_before_the_camera_as_a_whole(capture: Capture) -> None:
    clip = filmed(np.random.default_rng(0), capture, 5.0)
    truth = clip.truth
    assert truth is not None
    assert clip.n_frames == 50
    joints, _ = _longest_stretch(capture, 5.0)
    for piece, before in zip(truth.objects, capture.objects, strict=True):
        apart = np.linalg.norm(truth.joints[:, PELV, :2] - piece.centre[:2], axis=-1)
        once = np.linalg.norm(joints[:, PELV, :2] - before.centre[:2], axis=-1)
        assert_allclose(apart, once, atol=1e-9)
    seen = in_image(truth.camera, truth.joints) & ~truth.hidden
    assert seen[:, list(DETECTED)].mean() >= FEWEST_SEEN


def test_who_is_never_in_view_is_refused(capture: Capture) -> None:
    apart = capture.joints.copy()
    apart[::2, :, 0] += 40.0
    with pytest.raises(InputError, match="too little of the person is seen"):
        filmed(np.random.default_rng(0), replace(capture, joints=apart), 5.0)


@pytest.mark.slow
def test_a_room_is_held_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if not CORPUS.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    how = ("--from", "i3db", "--room", "Scene04", "--seconds", "6", "--steps", "100")
    main([str(CORPUS), str(tmp_path), *how])
    first = capsys.readouterr().out
    assert first.splitlines()[2].startswith("| posterior, most probable scene | Scene04 |")
    main([str(CORPUS), str(tmp_path), *how])
    assert capsys.readouterr().out == first
    assert [path.name for path in tmp_path.iterdir()] == ["Scene04"]
