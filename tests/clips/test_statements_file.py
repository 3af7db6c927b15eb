"""Statements from TOML, boxes from COCO's results, depths from tables; nonsense is refused."""

from __future__ import annotations

import json
import os
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
from numpy.typing import NDArray

import imapper_prob as im
from imapper_prob.clips.statements_file import _box_of_mask, _counts, check_file

EVERYTHING = """
[camera]
height = [1.6, 0.02]
pitch = [-4, 0.5]
focal = [1955.0, 20.0]

[person]
stature = [1.8, 0.03]

[[object]]
label = "couch"
place = [0.5, 3]
place_std = 0.05

[[object]]
label = ["chair", "couch"]
box = [100, 200, 400, 500]

[[present]]
label = "table"
region = [[-1, 2], [1, 2], [1, 4], [-1, 4]]

[[absent]]
label = "shelf"
doubt = 0.01

[room]
walls = [[-2, 1], [2, 1], [2, 6], [-2, 6]]

[[joint]]
joint = "PELV"
frame = 3
point = [0, 3, 0.9]
std = 0.1

[[depth]]
file = "depth.csv"
error = 0.05
scale_error = 0.1

[[contact]]
label = "couch"
frames = [3, 9]

[[same_object]]
label = "couch"
frames = [[1, 3], [7, 9]]
kind = "touches"

[[behind]]
label = "couch"
before = ["table", "chair"]

[[detections]]
file = "boxes.json"
frame = 3
image = 17
labels = { 62 = { chair = 0.8 }, 63 = { couch = 0.9, chair = 0.2 } }
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "given.toml"
    path.write_text(text)
    (folder / "depth.csv").write_text("frame,depth\n3,3.1\n5,3.25\n")
    np.savez(folder / "depth.npz", frame=[3, 5], depth=[3.1, 3.25])
    results = [
        {"image_id": 17, "category_id": 63, "bbox": [10, 20, 100, 50], "score": 0.9},
        {"image_id": 17, "category_id": 62, "bbox": [10, 20, 100, 50], "score": 0.1},
        {"image_id": 17, "category_id": 1, "bbox": [10, 20, 100, 50], "score": 0.9},
        {"image_id": 18, "category_id": 62, "bbox": [10, 20, 100, 50], "score": 0.9},
    ]
    (folder / "boxes.json").write_text(json.dumps(results))
    (folder / "commas.csv").write_text("frame,depth\n3,3,1\n5,3,25\n")
    (folder / "twice.csv").write_text("frame,depth,depth\n3,3.1,1\n")
    for name, change in {"percent": {"score": 90}, "text": {"bbox": "1234"}}.items():
        result = {"image_id": 17, "category_id": 62, "bbox": [1, 2, 3, 4], "score": 0.9, **change}
        (folder / f"{name}.json").write_text(json.dumps([result]))
    (folder / "keys.json").write_text('[{"image_id": 17, "bbox": [1, 2, 3, 4], "bbox": [1]}]')
    return path


def test_a_file_says_what_the_classes_say(tmp_path: Path) -> None:
    assert im.read_statements(written(tmp_path, EVERYTHING)) == (
        im.Measured("height", 1.6, 0.02),
        im.Measured("pitch", -4.0, 0.5),
        im.Measured("focal", 1955.0, 20.0),
        im.Measured("stature", 1.8, 0.03),
        im.ObjectAt("couch", place=(0.5, 3.0), place_std=0.05),
        im.ObjectAt(("chair", "couch"), box=(100, 200, 400, 500)),
        im.Presence("table", region=((-1, 2), (1, 2), (1, 4), (-1, 4))),
        im.Presence("shelf", there=False, doubt=0.01),
        im.Room(((-2, 1), (2, 1), (2, 6), (-2, 6))),
        im.JointAt("PELV", 3, (0, 3, 0.9), 0.1),
        im.DepthOf((3, 5), (3.1, 3.25), 0.05, 0.1),
        im.Contact("couch", 3, 9),
        im.SameObject("couch", ((1, 3), (7, 9)), sits=False),
        im.Behind("couch", ("table", "chair")),
        im.Seen(
            3,
            ((10, 20, 110, 70),),
            ({"couch": 0.9, "chair": 0.2},),
            named={"couch": 0.9, "chair": 1.0},
        ),
    )


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    said = im.read_statements(written(tmp_path, EVERYTHING))
    for name in ("given.toml", "depth.csv", "boxes.json"):
        path = tmp_path / name
        path.write_text(path.read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert im.read_statements(tmp_path / "given.toml") == said


def test_what_no_scene_fulfils_is_named_with_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, '[[present]]\nlabel = "couch"')
    library, clip = im.load_library(), im.demo_clip()
    check_file(path, im.read_statements(path), clip, library)
    for said, words in (
        (im.Presence("throne"), "given.toml: a throne: the library has no 'throne'"),
        (im.ObjectAt("couch", box=(100, 100, 5000, 400)), "given.toml: .*ends far outside"),
    ):
        with pytest.raises(im.InputError, match=words):
            check_file(path, [said], clip, library)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "given.toml")
    with pytest.raises(im.InputError, match="is a pipe or device"):
        im.read_statements(tmp_path / "given.toml")


def mask_of(box: tuple[int, int, int, int], height: int, width: int) -> NDArray[np.bool_]:
    left, top, right, bottom = box
    mask = np.zeros((height, width), bool)
    mask[top:bottom, left:right] = True
    return mask


def runs_of(mask: NDArray[np.bool_]) -> list[int]:
    """Lengths of runs down the columns, of 0 first."""
    flat = mask.T.ravel().astype(int)
    edges = np.flatnonzero(np.diff(flat, prepend=0, append=1 - flat[-1]))
    return np.diff(edges, prepend=0).tolist()


def compressed(runs: list[int]) -> str:
    """As COCO writes runs, five bits a character, the low ones first."""
    text = ""
    for k, run in enumerate(runs):
        value, more = run - (runs[k - 2] if k > 2 else 0), True
        while more:
            bits = value & 31
            value >>= 5
            more = value != (-1 if bits & 16 else 0)
            text += chr(48 + bits + (32 if more else 0))
    return text


@hypothesis.given(st.tuples(*[st.integers(0, 29)] * 4), st.booleans())
def test_a_mask_has_the_box_of_its_pixels(box: tuple[int, int, int, int], short: bool) -> None:
    left, right = sorted((box[0], box[2]))
    top, bottom = sorted((box[1], box[3]))
    mask = mask_of((left, top, right + 1, bottom + 1), 31, 33)
    mask |= mask_of((left, bottom, left + 1, bottom + 1), 31, 33)
    runs = runs_of(mask)
    said = {"size": [31, 33], "counts": compressed(runs) if short else runs}
    assert _box_of_mask(said) == [left, top, right + 1 - left, bottom + 1 - top]


def test_runs_are_decompressed_as_coco_does() -> None:
    """Worked by hand: 6, 1, 40, then 40 = 1 + 39 and 5 = 40 - 35."""
    assert _counts("61X1W1mN") == [6, 1, 40, 40, 5]


def test_polygons_are_masks_too() -> None:
    assert _box_of_mask([[10, 20, 60, 20, 60, 50], [5, 30, 9, 44, 7, 40]]) == [5, 20, 55, 30]


def test_masks_stand_for_their_boxes(tmp_path: Path) -> None:
    text = '[[detections]]\nfile = "masks.json"\nframe = 3\nlabels = { 62 = "chair" }'
    path = written(tmp_path, text)
    mask = {"size": [50, 60], "counts": runs_of(mask_of((10, 20, 25, 45), 50, 60))}
    result = {"image_id": 3, "category_id": 62, "score": 0.9, "segmentation": mask}
    (tmp_path / "masks.json").write_text(json.dumps([result]))
    (said,) = im.read_statements(path)
    assert said == im.Seen(3, ((10, 20, 25, 45),), ({"chair": 1.0},), named={"chair": 1.0})


@pytest.mark.parametrize(
    "mask",
    [
        3, [], [[1, 2, 3]], {"size": [5, 5]}, {"size": [5, 5], "counts": [3, 4]},
        {"size": [5, 5], "counts": [25]}, {"size": [5, 5], "counts": [30, -5]},
        {"size": [10**9, 10**9], "counts": [1, 2]}, {"size": [5, 5], "counts": "~~~"},
        {"size": [5, 5], "counts": "oooooooooooooooo"}, {"size": [5, 5], "counts": [10**30, 1]},
    ],
)  # fmt: skip
def test_what_is_no_mask_is_refused_by_its_number(mask: object, tmp_path: Path) -> None:
    text = '[[detections]]\nfile = "masks.json"\nframe = 3\nlabels = { 62 = "chair" }'
    path = written(tmp_path, text)
    result = {"image_id": 3, "category_id": 62, "score": 0.9, "segmentation": mask}
    (tmp_path / "masks.json").write_text(json.dumps([result]))
    with pytest.raises(im.InputError, match=r"masks\.json: result 0"):
        im.read_statements(path)


def test_depths_are_read_from_arrays_too(tmp_path: Path) -> None:
    text = '[[depth]]\nfile = "depth.npz"\nerror = 0.1\njoint = "NECK"'
    (said,) = im.read_statements(written(tmp_path, text))
    assert said == im.DepthOf((3, 5), (3.1, 3.25), 0.1, joint="NECK")
    path, depths = written(tmp_path, text), tmp_path / "depth.npz"
    whole = depths.read_bytes()
    for content in (b"", whole[: len(whole) // 2]):
        depths.write_bytes(content)
        with pytest.raises(im.InputError, match=r"depth\.npz: damaged"):
            im.read_statements(path)
    np.savez(depths, frame=[0.6, 1.6], depth=[3.1, 3.25])
    with pytest.raises(im.InputError, match="a frame is no whole number"):
        im.read_statements(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "says nothing"),
        ("[camera", "not a TOML file"),
        ("[walls]\nx = 1", "unknown table 'walls'; known are absent, behind, camera"),
        ("[camera]\nheigth = [1, 1]", "unknown key 'heigth'; known are pitch, height, focal"),
        ("[camera]\nheight = 1.6", "height must be \\[value, standard deviation\\]"),
        ("[camera]\nheight = [1.6, -1]", "std of the measured height = -1.0 must be at least"),
        ("[[object]]\nplace = [0, 1]", "object 1: has no 'label'"),
        ('[[object]]\nlabel = "couch"\nat = [0, 1]', "object 1: unknown key 'at'"),
        ('[[object]]\nlabel = "couch"\nplace = ["a", 1]', "object 1: the place of couch must be"),
        ('[[object]]\nlabel = "couch"\nplace = [0, 1]\nplace_std = "x"', "must be a finite number"),
        ("[[object]]\nlabel = 7\nplace = [0, 1]", "object 1: .*has a value|must be a label"),
        ("object = 3", "must be a table"),
        ('[[contact]]\nlabel = "couch"\nframes = 3', "frames must be \\[first, last\\]"),
        ('[[contact]]\nlabel = "couch"\nframes = [1, 2]\nkind = "lies"', "'sits' or 'touches'"),
        ('[[joint]]\njoint = "PELV"\nframe = 1.5\npoint = [0, 1, 1]\nstd = 1', "whole number"),
        ("[[depth]]\nerror = 0.1", "neither a file nor frames"),
        ('[[same_object]]\nlabel = "couch"\nframes = [1, 2]', "must be \\[\\[first, last\\]"),
        ('[[same_object]]\nlabel = "couch"\nframes = [[1, 2]]', "two spans or more"),
        (
            '[[same_object]]\nlabel = "couch"\nframes = [[1, 2], [3, 4]]\npeople = 3',
            "has a value of the wrong kind",
        ),
        ('[[behind]]\nlabel = "couch"', "behind 1: has no 'before'"),
        ('[[behind]]\nlabel = "couch"\nbefore = 3', "labels 3 must be a label or some"),
        ('[[depth]]\nerror = 0.1\nfile = "no.csv"', "no.csv: cannot be read"),
        ('[[depth]]\nerror = 0.1\nfile = "boxes.json"', "must have frame"),
        ('[[detections]]\nfile = "no.json"\nframe = 1\nlabels = {}', "no.json: no such file"),
        ('[[detections]]\nfile = "depth.csv"\nframe = 1\nlabels = {}', "depth.csv: not valid JSON"),
        ('[[detections]]\nfile = "boxes.json"\nframe = 1\nlabels = 3', "labels must be a table"),
        (
            '[[detections]]\nfile = "boxes.json"\nframe = 1\nlabels = { 62 = "chair" }',
            r"boxes\.json: has no result for image 1, but for 17, 18; name",
        ),
        ("[camera]\nheight = [1.6, 1e-300]", "must be at least"),
        ("[camera]\nheight = [1.6, 1e300]", "\\[value, standard deviation\\]"),
        (f"[camera]\nheight = [1{'0' * 400}, 0.1]", "\\[value, standard deviation\\]"),
        ('[[object]]\nlabel = "couch"\nplace = [0, 3e3]', "the place of couch: .*1000 at most"),
        ('[[present]]\nlabel = "couch"\nregion = [[0, 1], [1, 1], [0, 1e4]]', "1000 m away"),
        ("[[depth]]\nerror = 0.1\nframes = [3]\ndepths = [3100]", "in metres,: .*1000 at most"),
        ("[[depth]]\nerror = 3\nframes = [3]\ndepths = [3.1]", "must be at most 1"),
        ("[[depth]]\nerror = 0.1\nframes = 3\ndepths = [3.1]", "frames must be whole numbers"),
        ('[[depth]]\nerror = 0.1\nfile = "commas.csv"', "more cells than columns"),
        ('[[depth]]\nerror = 0.1\nfile = "twice.csv"', "a column occurs twice"),
        (
            '[[detections]]\nfile = "boxes.json"\nframe = 17\nlabels = { 62 = "chair" }\nscore = 2',
            "score = 2 must be a number from 0 to 1",
        ),
        (
            '[[detections]]\nfile = "percent.json"\nframe = 17\nlabels = { 62 = "chair" }',
            "result 0: score 90 must be from 0 to 1",
        ),
        (
            '[[detections]]\nfile = "text.json"\nframe = 17\nlabels = { 62 = "chair" }',
            "result 0 must have .*bbox: expected 4 numbers, got '1234'",
        ),
        (
            '[[detections]]\nfile = "keys.json"\nframe = 17\nlabels = { 62 = "chair" }',
            "keys.json: key 'bbox' occurs twice",
        ),
        (
            '[[detections]]\nfile = "boxes.json"\nframe = 17\nlabels = { 56 = "chair" }',
            r"boxes\.json: has no category of labels \(56\), but 1, 62, 63",
        ),
        (
            '[[detections]]\nfile = "boxes.json"\nframe = 17\n'
            'labels = { 62 = "chair", 63 = { chair = 1.0 } }',
            "detections 1: labels: a chair is called by one of them with probability 2",
        ),
    ],
)
def test_what_a_file_cannot_say_is_refused_by_its_table(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(im.InputError, match=words):
        im.read_statements(written(tmp_path, text))


@pytest.mark.parametrize(("image", "category"), [("17", 62.0), (17.0, "62"), (17, 62)])
def test_images_and_categories_are_known_by_number_or_text(
    image: object, category: object, tmp_path: Path
) -> None:
    path = written(
        tmp_path,
        '[[detections]]\nfile = "boxes.json"\nframe = 17\nlabels = { 62 = "chair" }',
    )
    result = {"image_id": image, "category_id": category, "bbox": [1, 2, 3, 4], "score": 1}
    (tmp_path / "boxes.json").write_text(json.dumps([result]))
    (said,) = im.read_statements(path)
    assert isinstance(said, im.Seen)
    assert said.boxes == ((1, 2, 4, 6),)
    assert said.named == {"chair": 1.0}


def test_categories_of_one_name_share_its_label(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        '[[detections]]\nfile = "boxes.json"\nframe = 17\nlabels = { 62 = "chair", 13 = "chair" }',
    )
    (said,) = im.read_statements(path)
    assert isinstance(said, im.Seen)
    assert said.named == {"chair": 1.0}


def test_results_that_are_none_are_refused_by_number(tmp_path: Path) -> None:
    path = written(tmp_path, '[[detections]]\nfile = "boxes.json"\nframe = 1\nlabels = {}')
    (tmp_path / "boxes.json").write_text('[{"image_id": 1, "bbox": [1, 2, 3, 4], "score": 1}]')
    with pytest.raises(im.InputError, match="result 0 must have image_id, category_id"):
        im.read_statements(path)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(im.InputError, match=r"nowhere.toml: cannot be read"):
        im.read_statements("nowhere.toml")


def test_depths_with_a_mark_of_byte_order_are_read(tmp_path: Path) -> None:
    (tmp_path / "given.toml").write_text("[[depth]]\nfile = 'depth.csv'\nerror = 0.05\n")
    (tmp_path / "depth.csv").write_text("\ufeffframe,depth\n3,2.5\n", encoding="utf-8")
    (said,) = im.read_statements(tmp_path / "given.toml")
    assert said.frames == (3,)  # type: ignore[union-attr]
    (tmp_path / "depth.csv").write_text(f"frame,depth\n3,{'9' * 200_000}\n", encoding="utf-8")
    with pytest.raises(im.InputError, match=r"depth.csv: must have frame .*field larger"):
        im.read_statements(tmp_path / "given.toml")


def test_a_label_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "given.toml").write_text("[[present]]\nlabel = 5\n")
    with pytest.raises(im.InputError, match="present 1: labels 5 must be a label"):
        im.read_statements(tmp_path / "given.toml")
