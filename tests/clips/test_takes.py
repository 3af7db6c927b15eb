"""Several takes of one room: one camera, one set of furniture, each take its own motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

import imapper_prob as im
from imapper_prob.cli.main import main
from imapper_prob.clips.load import window
from imapper_prob.models.scene import Clip
from imapper_prob.results.folders import write_run
from tests.runs import BRIEF

FIRST, SECOND = (0, 64), (65, 129)
"""Frames of the demo in which somebody sits on the couch, and in which they are at the shelf."""


def takes() -> list[Clip]:
    """One a little shorter than the other."""
    clip = im.demo_clip()
    couch, shelf = window(clip, *FIRST), window(clip, SECOND[0], SECOND[1] - 10)
    return [replace(couch, name="couch"), replace(shelf, name="shelf")]


def test_everybody_is_there_from_the_first_frame_on() -> None:
    couch, shelf = takes()
    together = im.same_room([couch, shelf])
    assert together.name == "couch + shelf"
    assert [track.name for track in together.tracks] == ["couch", "shelf"]
    assert together.n_frames == couch.n_frames
    for take, track in zip((couch, shelf), together.tracks, strict=True):
        n = take.n_frames
        assert_array_equal(track.keypoints[:n], take.tracks[0].keypoints)
        assert_array_equal(track.poses[:n], take.tracks[0].poses)
        assert not track.confidences[n:].any()
        assert not track.has_pose[n:].any()


def test_a_single_take_stays_as_it_is() -> None:
    clip = takes()[0]
    assert im.same_room([clip]) is clip


def test_no_two_have_the_same_name() -> None:
    couch, shelf = takes()
    both = im.same_room([couch, replace(shelf, name="couch")])
    again = im.same_room([both, replace(shelf, name="couch (2)")])
    assert [track.name for track in both.tracks] == ["couch", "couch (2)"]
    assert len({track.name for track in again.tracks}) == 3


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"camera": {"fx": 1000.0}}, "couch and shelf: their cameras differ, fx is 1955 and 1000"),
        ({"camera": {"width": 1280}}, "their cameras differ, width is 1920 and 1280"),
        ({"camera": {"pitch": 0.1}}, "their cameras differ, pitch is -0.0698132 and 0.1"),
        ({"fps": 25.0}, "couch and shelf: 10 and 25 frames a second"),
        ({"focal_spread": 0.1}, "couch and shelf: 0.05 and 0.1 as focal spread"),
    ],
)
def test_takes_of_different_cameras_are_refused_by_name(changed: dict, said: str) -> None:
    couch, shelf = takes()
    camera = replace(shelf.camera, **changed.pop("camera", {}))
    with pytest.raises(im.InputError, match=said):
        im.same_room([couch, replace(shelf, camera=camera, **changed)])


def test_no_take_is_no_clip() -> None:
    with pytest.raises(im.InputError, match="no take"):
        im.solve([])


@pytest.mark.slow
def test_takes_are_sampled_as_one_scene(tmp_path: Path) -> None:
    """Of a library that holds little else than what is done there."""
    library = im.Library(
        "few",
        tuple(
            s
            for k, s in enumerate(im.load_library())
            if k % 40 == 0 or s.name in ("sit-couch-table-003", "reach-shelf-001")
        ),
    )
    posterior = im.sample(takes(), library, config=BRIEF, progress=False)
    best = posterior.scenes(1)[0]
    assert {"couch", "shelf"} <= {placed.label for placed in best.scene.objects}
    assert len(posterior.joints().mean) == 2 * posterior.clip.n_frames
    write_run(tmp_path / "run", posterior, overwrite=False)
    again = im.load_posterior(tmp_path / "run")
    assert [track.name for track in again.clip.tracks] == ["couch", "shelf"]
    assert_array_equal(again.samples.log_posterior, posterior.samples.log_posterior)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["b.npz"], "2 clips: takes of one room need --same-room"),
        (["--same-room"], "--same-room: several takes are needed, and there is one clip"),
    ],
)
def test_clips_of_different_rooms_are_refused(
    more: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", "a.npz", *more, "-o", str(out)]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_takes_of_different_cameras_are_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    couch, shelf = takes()
    im.write_clip(tmp_path / "couch.npz", couch)
    camera = replace(shelf.camera, fx=1500.0, fy=1500.0)
    im.write_clip(tmp_path / "shelf.npz", replace(shelf, camera=camera))
    paths = [str(tmp_path / f"{name}.npz") for name in ("couch", "shelf")]
    assert main(["run", *paths, "--same-room", "-o", str(tmp_path / "out")]) == 2
    assert "fx is 1955 and 1500" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
