"""A small scene in the benchmark's format, made from a world that the test knows."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.skeleton import DETECTED, N_JOINTS

CAMERA = Camera(
    1920, 1080, 1900.0, 1950.0, 960.0, 540.0,
    pitch=np.deg2rad(-6.0), roll=np.deg2rad(2.0), elevation=1.3,
)  # fmt: skip
FRAMES = range(1, 13)
SHRINKING = 368 / 1080
STEM = "skel_hall"


def true_joints() -> np.ndarray:
    """(12, 16, 3) somebody walking to the right at 4 m, world frame, metres."""
    body = np.random.default_rng(3).uniform((-0.3, 3.8, 0.1), (0.3, 4.2, 1.7), (N_JOINTS, 3))
    step = np.array([0.1, 0.02, 0.0])
    return np.stack([body + t * step for t in range(len(FRAMES))])


def file_axes(points: np.ndarray) -> np.ndarray:
    """World to the files' axes: camera at the origin, x right, y down, z forward."""
    x, forward, up = np.moveaxis(CAMERA.to_camera(points), -1, 0)
    return np.stack([x, -up, forward], -1)


def table_of_joints(joints: np.ndarray) -> dict[str, Any]:
    return {
        f"{frame:05d}": {str(j): list(map(float, joints[t, j])) for j in range(N_JOINTS)}
        for t, frame in enumerate(FRAMES)
    }


def box(
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    yaw: float,
    *,
    left_handed: bool = False,
    turned: bool = False,
) -> dict[str, Any]:
    """A part's file: column 1 of the axes points backwards, column 2 up.

    ``size`` is width, depth, height; ``turned`` exchanges the two level axes, as the
    annotators did with some backrests.
    """
    sideways = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    backward = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    if left_handed:
        sideways = -sideways
    axes = np.stack([sideways, backward, [0.0, 0.0, 1.0]], 1)
    scales = np.array(size)
    if turned:
        axes, scales = axes[:, [1, 0, 2]], scales[[1, 0, 2]]
    origin = file_axes(np.zeros(3))
    return {
        "axes": np.stack([file_axes(a) - origin for a in axes.T], 1).tolist(),
        "centroid": file_axes(np.array(centre))[:, None].tolist(),
        "scales": scales[:, None].tolist(),
        "part_id": 0,
    }


@dataclass
class I3dbFolder:
    """The files of one scene, to be spoiled by a test before they are written."""

    detections: dict[str, Any] = field(default_factory=dict)
    lifted: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)
    objects: dict[str, Any] = field(default_factory=dict)
    intrinsics: Any = field(
        default_factory=lambda: [[1900.0, 0.0, 960.0], [0.0, 1950.0, 540.0], [0.0, 0.0, 1.0]]
    )
    actions: str = ""

    def __post_init__(self) -> None:
        joints = true_joints()
        pixels = np.zeros((len(FRAMES), N_JOINTS, 3))
        pixels[..., :2] = CAMERA.project(joints) * SHRINKING
        self.detections = {
            "3d": table_of_joints(pixels),
            "frame_ids": [0.1 * f for f in FRAMES],
            "confidence_normalized": True,
            "confidence": {
                "frame_ids": list(FRAMES),
                "values": [{str(j): (frame + j) / 100 + 0.5 for j in DETECTED} for frame in FRAMES],
            },
        }
        self.lifted = {
            "3d": table_of_joints(file_axes(joints)),
            "frame_ids": [f - 1 for f in FRAMES],
            "frame_ids_filled_in": [4, 6],
        }
        yaw = np.deg2rad(30.0)
        back = 0.35 * np.array([np.sin(yaw), -np.cos(yaw)])
        self.objects = {
            "00_couch_seat": box((0.5, 4.5, 0.2), (2.0, 0.8, 0.4), yaw, left_handed=True),
            "00_couch_back": box(
                (0.5 + back[0], 4.5 + back[1], 0.6), (2.0, 0.1, 0.4), yaw, turned=True
            ),
            "01_table_top-1": box((-1.0, 3.0, 0.7), (1.2, 0.6, 0.1), np.deg2rad(-70.0)),
            "01_table_leg-2": box((-1.0, 3.0, 0.325), (0.1, 0.1, 0.65), np.deg2rad(-70.0)),
        }
        self.truth = {
            "3d": table_of_joints(file_axes(joints)),
            "occluded": {str(f): [int(j == f) for j in range(N_JOINTS)] for f in FRAMES},
            "scenelets": {"obbs": [f"{STEM}_GT_objects/{name}.obj" for name in self.objects]},
        }
        self.actions = "".join(f"{f - 1}\twalking\n" for f in FRAMES)

    def drop_detection(self, frame: int) -> None:
        """Remove a frame from both lists, as a detector that lost the person does."""
        self.detections["3d"].pop(f"{frame:05d}")
        confidence = self.detections["confidence"]
        index = confidence["frame_ids"].index(frame)
        del confidence["frame_ids"][index], confidence["values"][index]

    def write(self, folder: Path) -> Path:
        objects = folder / "gt" / f"{STEM}_GT_objects"
        objects.mkdir(parents=True)
        contents = {
            folder / f"{STEM}_2d_00.json": self.detections,
            folder / f"{STEM}_unannot.json": self.lifted,
            folder / "intrinsics.json": self.intrinsics,
            folder / "video_params.json": {"rate": 2.4, "rate-avconv": 10},
            folder / "gt" / f"{STEM}_GT.json": self.truth,
            **{objects / f"{name}.json": part for name, part in self.objects.items()},
        }
        for path, content in contents.items():
            path.write_text(json.dumps(content))
        (folder / "gt" / "actions.txt").write_text(self.actions)
        return folder
