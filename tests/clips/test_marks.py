"""Marks: who is who in some frames, said by the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.clips.load import ClipOptions, read_marks, read_whatever
from imapper_prob.clips.options import CameraFile
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import PELV
from tests.clips.bodies import SIZE, place, write_json, write_openpose


def marks(**changes: Any) -> dict[str, Any]:
    """Ben is the one on the left."""
    at = [list(place(2, person)) for person in (0, 1)]
    return {
        "actors": ["anna", "ben"],
        "marks": [
            {"frame": 2, "at": at[0], "actor": "ben"},
            {"frame": 2, "at": at[1], "actor": "anna"},
        ],
    } | changes


def test_names_go_where_they_were_marked(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25", people=2)
    said = read_marks(write_json(tmp_path / "marks.json", marks()))
    clip = read_whatever(folder, ClipOptions(size=SIZE, marks=said))
    assert [track.name for track in clip.tracks] == ["anna", "ben"]
    anna, ben = (track.keypoints[:, PELV, 0] for track in clip.tracks)
    np.testing.assert_allclose(anna - ben, 300)


def test_marks_are_in_the_picture_as_it_is(tmp_path: Path) -> None:
    """With the distortion of the lens, which moves detections."""
    folder = write_openpose(tmp_path / "film", "body_25", people=2)
    said = read_marks(write_json(tmp_path / "marks.json", marks()))
    matrix = np.array([[600.0, 0, 900], [0, 600, 360], [0, 0, 1]])
    lens = CameraFile(SIZE, matrix, np.array([-0.25, 0.05, 0.0, 0.0, 0.0]))
    clip = read_whatever(folder, ClipOptions(camera=lens, fps=25, marks=said))
    anna, ben = (track.keypoints[:, PELV, 0] for track in clip.tracks)
    assert (anna > ben).all()
    assert abs(ben[2] - place(2, 0)[0]) > 100


def test_names_alone_are_enough(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25", people=2)
    said = read_marks(write_json(tmp_path / "marks.json", marks(marks=[])))
    clip = read_whatever(folder, ClipOptions(size=SIZE, marks=said))
    assert [track.name for track in clip.tracks] == ["anna", "ben"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"actors": []}, "1 to 16 different names"),
        ({"actors": ["anna", "anna"]}, "different names"),
        ({"actors": [1, 2]}, "different names"),
        ({"actors": ["anna"]}, "'ben' is not among the actors"),
        ({"marks": {}}, "must be a list"),
        ({"marks": [{"frame": 1.5, "at": [1, 2], "actor": "ben"}]}, "no whole number"),
        ({"marks": [{"frame": 1, "at": [1], "actor": "ben"}]}, "expected 2 numbers"),
        ({"marks": [{"frame": 1, "actor": "ben"}]}, "no entry 'at'"),
    ],
)
def test_faulty_files(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_marks(write_json(tmp_path / "marks.json", marks(**changes)))


@pytest.mark.parametrize(
    ("listed", "message"),
    [
        ([{"frame": 2, "at": [5, 5], "actor": "ben"}], "nobody at this mark"),
        ([{"frame": 99, "at": [408, 360], "actor": "ben"}], "nobody at this mark"),
        (
            [{"frame": 2, "at": [408, 360], "actor": who} for who in ("ben", "anna")],
            "ben and anna are marked on one skeleton",
        ),
        (
            [{"frame": 2, "at": [x, 360], "actor": "ben"} for x in (408, 708)],
            "actor 1 is marked twice",
        ),
    ],
)
def test_marks_that_cannot_be(listed: list[Any], message: str, tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "film", "body_25", people=2)
    said = read_marks(write_json(tmp_path / "marks.json", marks(marks=listed)))
    with pytest.raises(InputError, match=message):
        read_whatever(folder, ClipOptions(size=SIZE, marks=said))
