"""A recording in the format of PiGraphs, made from a world that the test knows."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.skeleton import JOINTS, N_JOINTS

NAME = "office_kinect_2014-05-01"
KINECT_OF = dict(zip(JOINTS, (18, 17, 16, 12, 13, 14, 0, 20, 2, 3, 10, 9, 8, 4, 5, 6), strict=True))
FLOOR = 0.35
"""Height of the floor in the scan, metres."""
STEPS = (330_000, 340_000, 360_000)
"""Ticks of 100 ns between skeletons, in turn."""
N_SKELETONS = 60
CHAIR_YAW, TABLE_YAW = np.deg2rad(25.0), np.deg2rad(-40.0)


def motion(seconds: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 16, 3) somebody gliding through the room at even speed, floor at 0."""
    body = np.random.default_rng(5).uniform((-0.3, -0.3, 0.1), (0.3, 0.3, 1.7), (N_JOINTS, 3))
    body[JOINTS.index("HEAD")] = (0.0, 0.0, 1.6)
    body[JOINTS.index("PELV")] = (0.0, 0.0, 0.9)
    moved: NDArray[np.float64] = body + seconds[:, None, None] * np.array([0.6, 0.3, 0.0])
    return moved


def camera() -> NDArray[np.float64]:
    """Camera axes (x left, y up, z forward) to the world of the scan."""
    c, s = np.cos(0.3), np.sin(0.3)
    rotation = np.array([[c, 0.0, s], [s, 0.0, -c], [0.0, 1.0, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, (1.0, -2.0, 1.4)
    return matrix


def group(
    label: str,
    owner: int,
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    yaw: float,
) -> dict[str, Any]:
    """A labelled box; the file has its upright axis in the middle, ``size`` is x, y, z."""
    c, s = float(np.cos(yaw)), float(np.sin(yaw))
    x, y, z = centre
    return {
        "id": owner,
        "label": label,
        "objectId": owner,
        "obb": {
            "centroid": [x, y, z + FLOOR],
            "axesLengths": [size[0], size[2], size[1]],
            "normalizedAxes": [c, s, 0.0, 0.0, 0.0, 1.0, -s, c, 0.0],
        },
    }


@dataclass
class PigraphsFolder:
    """The files of one recording, to be spoiled by a test before they are written."""

    recording: dict[str, Any] = field(default_factory=dict)
    scan: dict[str, Any] = field(default_factory=dict)
    interactions: str = "0.0-1.0,walk:floor\n1.0-1.5,sit:chair|touch:table\n"

    def __post_init__(self) -> None:
        ticks = 77_000_000 + np.cumsum([0, *(STEPS[i % 3] for i in range(N_SKELETONS - 1))])
        joints = motion((ticks - ticks[0]) * 1e-7) + np.array([0.0, 0.0, FLOOR])
        matrix = camera()
        seen = (joints - matrix[:3, 3]) @ matrix[:3, :3]
        kinect = np.zeros((len(ticks), 25, 3))
        kinect[:, list(KINECT_OF.values())] = seen
        self.recording = {
            "id": NAME,
            "camera": matrix.reshape(-1).tolist(),
            "startTime": 0,
            "endTime": 2_000_000,
            "skeletons": [
                {
                    "trackingId": 72057594037934458,
                    "timestamp": int(tick),
                    "jointPositions": positions.tolist(),
                    "jointConfidences": [1.0] * 25,
                }
                for tick, positions in zip(ticks, kinect, strict=True)
            ],
        }
        back = 0.25 * np.array([np.sin(CHAIR_YAW), -np.cos(CHAIR_YAW)])
        self.scan = {
            "segGroups": [
                group("floor", 1, (0.0, 0.0, 0.0), (6.0, 5.0, 0.0), 0.0),
                group("wall", 2, (0.0, 3.0, 1.2), (6.0, 0.1, 2.4), 0.0),
                group("chair/seat", 3, (1.0, 1.5, 0.225), (0.5, 0.45, 0.45), CHAIR_YAW),
                group(
                    "chair/backrest", 3, (1.0 + back[0], 1.5 + back[1], 0.65), (0.5, 0.06, 0.4),
                    CHAIR_YAW,
                ),
                group("desk", 4, (-2.0, 1.0, 0.375), (0.7, 1.4, 0.75), TABLE_YAW),
            ]
        }  # fmt: skip

    @property
    def skeletons(self) -> list[dict[str, Any]]:
        skeletons: list[dict[str, Any]] = self.recording["skeletons"]
        return skeletons

    def write(self, folder: Path) -> Path:
        """Write recording and scan into folders of their own; the recording's path."""
        recordings, scans = folder / "recordings", folder / "scans"
        recordings.mkdir(parents=True)
        scans.mkdir()
        path = recordings / f"{NAME}.json"
        path.write_text(json.dumps(self.recording))
        if self.interactions:
            path.with_name(f"{NAME}.interactions.txt").write_text(self.interactions)
        if self.scan:
            (scans / "office.segs.json").write_text(json.dumps(self.scan))
        return path
