"""A body in the image whose joints are known, written as other programs would write it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.clips.keypoints import KEYPOINT_SETS

Array = NDArray[np.float64]

SIZE = (1280, 720)
N_FRAMES = 12
POINTS: dict[str, tuple[float, float]] = {
    "nose": (0, -160), "left_eye": (4, -165), "right_eye": (-4, -165), "left_ear": (9, -162),
    "right_ear": (-9, -162), "neck": (0, -125), "upper_neck": (0, -138), "head_top": (0, -185),
    "left_shoulder": (30, -125), "right_shoulder": (-30, -125), "left_elbow": (38, -70),
    "right_elbow": (-38, -70), "left_wrist": (40, -20), "right_wrist": (-40, -20),
    "mid_hip": (0, 0), "left_hip": (20, 0), "right_hip": (-20, 0), "left_knee": (22, 80),
    "right_knee": (-22, 80), "left_ankle": (24, 160), "right_ankle": (-24, 160),
    "left_big_toe": (30, 172), "left_small_toe": (34, 170), "left_heel": (22, 168),
    "right_big_toe": (-30, 172), "right_small_toe": (-34, 170), "right_heel": (-22, 168),
}  # fmt: skip
"""Pixels from the middle of the hips of somebody who faces the camera: their left is the
image's right."""


def body(names: tuple[str, ...], *, at: tuple[float, float]) -> Array:
    """(J, 2) pixels; points that the drawing does not have lie at the nose."""
    return np.array([POINTS.get(name, POINTS["nose"]) for name in names]) + at


def place(frame: int, person: int = 0) -> tuple[float, float]:
    """Where the hips of a person are in a frame."""
    return 400 + 4.0 * frame + 300.0 * person, 360.0


def table(form: str, frame: int, person: int = 0) -> Array:
    """(J, 3) pixels and score of one person as the keypoint set ``form`` has them."""
    points = body(KEYPOINT_SETS[form], at=place(frame, person))
    return np.column_stack([points, np.full(len(points), 0.7)])


def write_openpose(
    folder: Path, form: str, *, people: int = 1, frames: range = range(N_FRAMES)
) -> Path:
    """A folder with one file a frame."""
    folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        persons: list[dict[str, Any]] = [
            {"person_id": [-1], "pose_keypoints_2d": table(form, frame, p).ravel().tolist()}
            for p in range(people)
        ]
        # People come in any order.
        persons = persons[::-1] if frame % 2 else persons
        content = json.dumps({"version": 1.3, "people": persons})
        (folder / f"film_{frame:012d}_keypoints.json").write_text(content)
    return folder


def results(form: str, *, frames: range = range(N_FRAMES)) -> list[dict[str, Any]]:
    """A list of COCO results, one person a frame."""
    return [
        {
            "image_id": f"{frame:04d}.jpg",
            "category_id": 1,
            "keypoints": table(form, frame).ravel().tolist(),
            "score": 2.7,
        }
        for frame in frames
    ]


def instances(form: str) -> dict[str, Any]:
    """The same as MMPose's own program writes it."""
    return {
        "meta_info": {"dataset_name": "coco"},
        "instance_info": [
            {
                "frame_id": frame,
                "instances": [
                    {
                        "keypoints": table(form, frame)[:, :2].tolist(),
                        "keypoint_scores": table(form, frame)[:, 2].tolist(),
                    }
                ],
            }
            for frame in range(N_FRAMES)
        ],
    }


def landmarks(*, world: bool = True) -> dict[str, Any]:
    """A MediaPipe dump of one person, whose body is 1 m for 200 pixels."""
    names = KEYPOINT_SETS["mediapipe_33"]
    frames = []
    for frame in range(N_FRAMES):
        points = body(names, at=place(frame)) / SIZE
        metres = body(names, at=(0, 0)) / 200
        entry: dict[str, Any] = {
            "frame": frame,
            "landmarks": [{"x": x, "y": y, "z": 0.0, "visibility": 0.9} for x, y in points],
        }
        if world:
            entry["world_landmarks"] = [{"x": x, "y": y, "z": 0.1 * x} for x, y in metres]
        frames.append(entry)
    return {"fps": 25, "width": SIZE[0], "height": SIZE[1], "frames": frames}


def write_json(path: Path, data: Any) -> Path:
    """The file it was written to."""
    path.write_text(json.dumps(data))
    return path


def write_trc(path: Path, joints: Array, names: tuple[str, ...], *, unit: str = "m") -> Path:
    """A TRC file of (T, J, 3) joints at 25 frames a second; NaN becomes an empty cell."""
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate",
        f"25\t25\t{len(joints)}\t{len(names)}\t{unit}\t25",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i}" for i in range(1, len(names) + 1) for axis in "XYZ"),
    ]
    for frame, row in enumerate(joints, start=1):
        cells = ["" if np.isnan(value) else repr(float(value)) for value in row.ravel()]
        lines.append("\t".join([str(frame), f"{frame / 25:.3f}", *cells]))
    path.write_text("\n".join(lines) + "\n")
    return path
