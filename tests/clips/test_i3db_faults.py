"""Each fault of a scene folder gives one sentence that names the file and the place."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.clips.load import load_clip
from imapper_prob.models.errors import InputError
from tests.clips.i3db_folder import STEM, I3dbFolder

Spoil = Callable[[I3dbFolder], object]


def values(files: I3dbFolder) -> list[dict[str, object]]:
    found: list[dict[str, object]] = files.detections["confidence"]["values"]
    return found


DETECTIONS, LIFTED = f"{STEM}_2d_00.json", f"{STEM}_unannot.json"
CONTENT_FAULTS: dict[str, tuple[Spoil, str]] = {
    "coordinate not a number": (
        lambda f: f.detections["3d"]["00004"]["9"].__setitem__(0, float("nan")),
        rf"{DETECTIONS}, frame 4, joint HEAD: .*not finite",
    ),
    "infinite lifted joint": (
        lambda f: f.lifted["3d"]["00010"]["0"].__setitem__(2, float("inf")),
        rf"{LIFTED}, frame 10, joint RANK: .*not finite",
    ),
    "coordinate is text": (
        lambda f: f.detections["3d"]["00004"]["9"].__setitem__(0, "12"),
        rf"{DETECTIONS}, frame 4, joint HEAD: expected 3 numbers",
    ),
    "coordinate is null": (
        lambda f: f.detections["3d"]["00004"]["9"].__setitem__(0, None),
        rf"{DETECTIONS}, frame 4, joint HEAD: expected 3 numbers",
    ),
    "two coordinates": (
        lambda f: f.lifted["3d"]["00002"]["3"].pop(),
        rf"{LIFTED}, frame 2, joint LHIP: expected 3 numbers",
    ),
    "joint missing": (
        lambda f: f.detections["3d"]["00003"].pop("7"),
        rf"{DETECTIONS}, frame 3: expected joints 0 to 15, got 15",
    ),
    "joint too many": (
        lambda f: f.lifted["3d"]["00003"].update({"16": [0, 0, 0]}),
        rf"{LIFTED}, frame 3: expected joints 0 to 15, got 17",
    ),
    "frame is a list": (
        lambda f: f.detections["3d"].update({"00003": []}),
        rf"{DETECTIONS}, frame 3: expected joints",
    ),
    "no table of joints": (lambda f: f.detections.pop("3d"), rf"{DETECTIONS}: no entry '3d'"),
    "table of joints is a list": (
        lambda f: f.detections.update({"3d": [1, 2]}),
        rf"{DETECTIONS}: '3d' must map",
    ),
    "table of joints is empty": (lambda f: f.lifted["3d"].clear(), rf"{LIFTED}: '3d' must"),
    "frame number is text": (
        lambda f: f.detections["3d"].update(last=f.detections["3d"]["00001"]),
        rf"{DETECTIONS}: 'last' is not a frame number",
    ),
    "frame number is fractional": (
        lambda f: f.lifted["3d"].update({"1.5": f.lifted["3d"]["00001"]}),
        rf"{LIFTED}: '1.5' is not a frame number",
    ),
    "frame twice": (
        lambda f: f.lifted["3d"].update({"1": f.lifted["3d"]["00001"]}),
        rf"{LIFTED}: frame 1 occurs twice",
    ),
    "frame number out of all reason": (
        lambda f: (
            f.detections["3d"].update({"100000000": f.detections["3d"]["00001"]}),
            values(f).append(values(f)[0]),
        ),
        rf"{DETECTIONS}: frames run from 1 to 100000000",
    ),
    "confidences too few": (
        lambda f: values(f).pop(),
        rf"{DETECTIONS}: 11 confidences for 12 frames",
    ),
    "confidences no list": (
        lambda f: f.detections["confidence"].update(values=3),
        rf"{DETECTIONS}: no list of confidences",
    ),
    "confidence of a joint missing": (
        lambda f: values(f)[1].pop("10"),
        rf"{DETECTIONS}, frame 2, joint RWRI, confidence: expected one",
    ),
    "confidence above one": (
        lambda f: values(f)[1].update({"10": 1.5}),
        rf"{DETECTIONS}, frame 2, joint RWRI: confidence 1.5 is not in",
    ),
    "confidence negative": (
        lambda f: values(f)[2].update({"15": -0.2}),
        rf"{DETECTIONS}, frame 3, joint LWRI: confidence -0.2 is not in",
    ),
    "no confidences": (
        lambda f: f.detections.pop("confidence"),
        rf"{DETECTIONS}: no entry 'confidence'",
    ),
    "filled frames are text": (
        lambda f: f.lifted.update(frame_ids_filled_in="3"),
        rf"{LIFTED}: 'frame_ids_filled_in' must be a list",
    ),
    "filled frame is fractional": (
        lambda f: f.lifted["frame_ids_filled_in"].append(2.5),
        rf"{LIFTED}: 2\.5 is not a frame number",
    ),
    "negative focal length": (
        lambda f: f.intrinsics[0].__setitem__(0, -1900.0),
        r"intrinsics\.json: matrix must be",
    ),
    "intrinsic matrix too small": (
        lambda f: f.intrinsics.pop(),
        r"intrinsics\.json: intrinsic matrix: expected 3 x 3 numbers",
    ),
}


@pytest.mark.parametrize("fault", CONTENT_FAULTS)
def test_spoiled_content_is_named(fault: str, tmp_path: Path) -> None:
    spoil, message = CONTENT_FAULTS[fault]
    files = I3dbFolder()
    spoil(files)
    with pytest.raises(InputError, match=message) as caught:
        read_i3db(files.write(tmp_path / "Hall"))
    assert "\n" not in str(caught.value)


FILE_FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "intrinsics missing": (
        lambda p: (p / "intrinsics.json").unlink(),
        r"intrinsics\.json: no such file",
    ),
    "poses missing": (lambda p: (p / LIFTED).unlink(), rf"{LIFTED}: no such file"),
    "cut in half": (
        lambda p: (p / LIFTED).write_bytes((p / LIFTED).read_bytes()[:3_000]),
        rf"{LIFTED}: not valid JSON",
    ),
    "empty file": (lambda p: (p / DETECTIONS).write_text(""), rf"{DETECTIONS}: not valid JSON"),
    "not text": (
        lambda p: (p / DETECTIONS).write_bytes(b"\xff\xfe\x00"),
        rf"{DETECTIONS}: no text file",
    ),
    "detections twice": (
        lambda p: (p / "skel_copy_2d_00.json").write_bytes((p / DETECTIONS).read_bytes()),
        r"more than one file skel_\*_2d_00\.json \(skel_copy_2d_00\.json",
    ),
    "frame rate negative": (
        lambda p: (p / "video_params.json").write_text('{"rate-avconv": -10}'),
        r"video_params\.json: frame rate -10.0 must be positive",
    ),
    "frame rate text": (
        lambda p: (p / "video_params.json").write_text('{"rate-avconv": "ten"}'),
        r"video_params\.json: rate-avconv: expected one number",
    ),
    "root is a list": (
        lambda p: (p / LIFTED).write_text("[]"),
        rf"{LIFTED}: no entry '3d'",
    ),
    "a folder in place of a file": (
        lambda p: ((p / LIFTED).unlink(), (p / LIFTED).mkdir()),
        rf"{LIFTED}: cannot be read",
    ),
}


@pytest.mark.parametrize("fault", FILE_FAULTS)
def test_spoiled_files_are_named(fault: str, tmp_path: Path) -> None:
    spoil, message = FILE_FAULTS[fault]
    folder = I3dbFolder().write(tmp_path / "Hall")
    spoil(folder)
    with pytest.raises(InputError, match=message) as caught:
        load_clip(folder)
    assert "\n" not in str(caught.value)


TRUTH_FAULTS: dict[str, tuple[Spoil, str]] = {
    "object file missing": (
        lambda f: f.objects.pop("00_couch_back"),
        r"00_couch_back\.json: no such file",
    ),
    "object with an odd name": (
        lambda f: f.truth["scenelets"]["obbs"].append("x/couch.obj"),
        r"object 'x/couch\.obj' is not named",
    ),
    "object in another folder": (
        lambda f: f.truth["scenelets"]["obbs"].append("../../00_couch_seat.obj"),
        r"object '\.\./\.\./00_couch_seat\.obj' is not named",
    ),
    "object anywhere": (
        lambda f: f.truth["scenelets"]["obbs"].append("/etc/00_couch_seat.obj"),
        r"object '/etc/00_couch_seat\.obj' is not named",
    ),
    "no objects": (
        lambda f: f.truth["scenelets"].update(obbs=[]),
        r"'scenelets\.obbs' lists no objects",
    ),
    "axes not a matrix": (
        lambda f: f.objects["00_couch_seat"].update(axes=[1, 2, 3]),
        r"00_couch_seat\.json: axes: expected 3 x 3",
    ),
    "axes of no direction": (
        lambda f: f.objects["00_couch_seat"].update(axes=[[0.0] * 3] * 3),
        r"00_couch_seat\.json: axes must be unit vectors",
    ),
    "box without volume": (
        lambda f: f.objects["00_couch_seat"].update(scales=[[2.0], [0.0], [0.4]]),
        r"00_couch_seat\.json: scales must be positive",
    ),
    "flags missing": (
        lambda f: f.truth["occluded"].pop("4"),
        r"frame 4, occlusion flags: expected 16 numbers",
    ),
    "flags no table": (
        lambda f: f.truth.update(occluded=[]),
        r"'occluded' must map frame numbers",
    ),
    "action without a number": (
        lambda f: setattr(f, "actions", "walking\n"),
        r"actions\.txt: 'walking' is not a frame number",
    ),
}


@pytest.mark.parametrize("fault", TRUTH_FAULTS)
def test_spoiled_truth_is_named(fault: str, tmp_path: Path) -> None:
    spoil, message = TRUTH_FAULTS[fault]
    files = I3dbFolder()
    spoil(files)
    folder = files.write(tmp_path / "Hall")
    clip = read_i3db(folder)
    with pytest.raises(InputError, match=message):
        read_i3db_truth(folder, clip)


def test_scene_without_truth(tmp_path: Path) -> None:
    folder = I3dbFolder().write(tmp_path / "Hall")
    clip = read_i3db(folder)
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "other" / "gt"))):
        read_i3db_truth(tmp_path / "other", clip)
