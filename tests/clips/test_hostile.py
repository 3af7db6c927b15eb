"""Whatever is in a file: it is read, or refused with one sentence, and soon."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imapper_prob.clips.load import ClipOptions, load_clip, read_whatever
from imapper_prob.models.errors import InputError
from lab.robustness.attack import attack
from lab.robustness.inputs import READERS
from tests.clips import bodies

INPUTS = 6
"""Of each kind; ``python -m lab.robustness`` tries more."""


@pytest.mark.parametrize("name", READERS)
def test_damaged_inputs_are_read_or_refused(name: str) -> None:
    outcomes = attack(READERS[name], inputs=INPUTS)
    assert [fault for row in outcomes.values() for fault in row.faults] == []
    refused = sum(row.counts["refused"] for row in outcomes.values())
    assert refused > INPUTS  # the damage was real


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                ["people", "pose_keypoints_2d", "image_id", "keypoints", "frames", "landmarks",
                 "frame", "instance_info", "instances", "x", "y", "visibility"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)  # fmt: skip


@settings(max_examples=200)
@given(JSON)
def test_any_json_is_refused(tmp_path_factory: pytest.TempPathFactory, data: object) -> None:
    folder = tmp_path_factory.mktemp("any")
    options = ClipOptions(size=(640, 480), fps=10.0, focal=600.0)
    for path in (
        bodies.write_json(folder / "frame_0001_keypoints.json", data).parent,
        bodies.write_json(folder / "frame_0001_keypoints.json", data),
    ):
        with pytest.raises(InputError):
            load_clip(path, options=options)


@settings(max_examples=200)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.mktemp("any")
    for name in ("a.json", "a.npz", "a.trc", "a"):
        (folder / name).write_bytes(content)
        with pytest.raises(InputError):
            load_clip(folder / name)


def test_a_keypoint_beyond_reason_is_named(tmp_path: Path) -> None:
    options = ClipOptions(size=bodies.SIZE, fps=10.0, focal=600.0)
    folder = bodies.write_openpose(tmp_path / "openpose", "body_25")
    file = sorted(folder.iterdir())[3]
    data = json.loads(file.read_text())
    data["people"][0]["pose_keypoints_2d"][3] = 1e90
    bodies.write_json(file, data)
    with pytest.raises(InputError, match=rf"{file.name}, person 0, keypoint 1: .*is no pixel"):
        load_clip(folder, options=options)
    entries = bodies.results("coco_17")
    entries[3]["keypoints"][3] = 1e90
    path = bodies.write_json(tmp_path / "results.json", entries)
    with pytest.raises(InputError, match=r"entry 3, frame 3, keypoint left_eye: 1e\+90 is not"):
        load_clip(path, options=options)


def test_a_folder_that_cannot_be_read_as_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.json").mkdir()
    with pytest.raises(InputError):
        load_clip(tmp_path)
    with pytest.raises(InputError, match="mediapipe is a file"):
        load_clip(tmp_path, options=ClipOptions("mediapipe"))


def test_a_span_of_a_million_frames_is_refused_at_once(tmp_path: Path) -> None:
    entries = bodies.results("coco_17")
    entries[3]["image_id"] = 10**6
    path = bodies.write_json(tmp_path / "results.json", entries)
    with pytest.raises(InputError, match=r"frames run from 0 to 1000000, more than 36000"):
        read_whatever(path, ClipOptions(size=(640, 480)))


def test_a_long_clip_is_read(tmp_path: Path) -> None:
    """Three minutes at 10 frames a second, of which a few frames are there."""
    entries = bodies.results("coco_17")
    entries[-1]["image_id"] = 1800
    path = bodies.write_json(tmp_path / "results.json", entries)
    clip = read_whatever(path, ClipOptions(size=(640, 480), fps=10.0))
    assert clip.n_frames == 1801
    assert np.isnan(clip.tracks[0].keypoints[1000]).all()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "film_000000000000_keypoints.json",
            '{"people": [',
            "film_000000000000_keypoints.json: not",
        ),
        ("a_meta_99.json", "{}", "a_meta_99.json: no list 'people'"),
    ],
)
def test_a_bad_file_among_those_of_openpose_is_named(
    tmp_path: Path, name: str, content: str, words: str
) -> None:
    folder = bodies.write_openpose(tmp_path / "film", "body_25")
    (folder / "._film_000000000001_keypoints.json").write_bytes(b"\x00\x05")
    load = partial(read_whatever, folder, ClipOptions(size=bodies.SIZE, fps=10.0, focal=600.0))
    assert load().n_frames == bodies.N_FRAMES
    (folder / name).write_text(content)
    with pytest.raises(InputError, match=words):
        load()


def test_scores_in_percent_are_refused_unless_they_are_explained(tmp_path: Path) -> None:
    folder = bodies.write_openpose(tmp_path / "film", "body_25")
    for file in folder.iterdir():
        data = json.loads(file.read_text())
        data["people"][0]["pose_keypoints_2d"][2::3] = [70.0] * 25
        bodies.write_json(file, data)
    options = ClipOptions(size=bodies.SIZE, fps=10.0, focal=600.0)
    with pytest.raises(InputError, match="film: frame 0, joint RANK: score 70; scores of"):
        read_whatever(folder, options)
    told = read_whatever(folder, replace(options, confidence="0:0,100:1"))
    assert told.tracks[0].confidences.max() == pytest.approx(0.7)


def test_a_landmark_that_is_not_finite_is_named(tmp_path: Path) -> None:
    dump = bodies.landmarks()
    dump["frames"][4]["landmarks"][0]["x"] = float("nan")
    path = bodies.write_json(tmp_path / "dump.json", dump)
    with pytest.raises(InputError, match=r"dump.json, frame 4, landmark nose: x is not finite"):
        read_whatever(path, ClipOptions())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is a pipe or device"):
        load_clip(tmp_path / "pipe")
