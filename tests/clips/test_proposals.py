"""Appendix B: confidences of LCR-Net++ keypoints, worked by hand, and files of proposals."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.clips.load import ClipOptions, format_of, read_whatever
from imapper_prob.clips.result_lists import proposal_confidence, proposal_variance, read_proposals
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED, NECK, PELV, RANK, RHIP

NAMES = [
    "right_ankle", "left_ankle", "right_knee", "left_knee", "right_hip", "left_hip",
    "right_wrist", "left_wrist", "right_elbow", "left_elbow", "right_shoulder", "left_shoulder",
    "head",
]  # fmt: skip


def content(n_frames: int = 10, proposals: int = 4) -> dict[str, Any]:
    """Proposals that agree to a centimetre, but on ankles, where they are 20 cm apart."""
    rng = np.random.default_rng(0)
    people = []
    for frame in range(1, n_frames + 1):
        group = []
        for _ in range(proposals):
            spread = np.full((13, 1), 0.01)
            spread[:2] = 0.2
            space = np.linspace(0, 1.2, 13)[:, None] + spread * rng.standard_normal((13, 3))
            group.append({"pose2d": (900 + 100 * space[:, :2]).tolist(), "pose3d": space.tolist()})
        people.append({"frame": frame, "score": 20.0, "proposals": group})
    return {"size": [1920, 1080], "fps": 10, "joints": NAMES, "people": people}


def written(folder: Path, data: Any) -> Path:
    path = folder / "lcr.json"
    path.write_text(json.dumps(data))
    return path


# --- The formulas


def test_variance_by_hand() -> None:
    """Two proposals .2 m and 1 m apart: .01 and .25 m^2, halved at s' = 17.5."""
    positions = np.zeros((2, 3, 3))
    positions[1, 0, 0] = 0.2
    positions[1, 1] = (0.0, 0.6, 0.8)
    found = proposal_variance(positions, 17.5)  # 1 + exp(0) = 2
    np.testing.assert_allclose(found, [0.005, 0.125, 0.0])
    # 1 + exp(-.2 x 10 + 3.5) = 1 + e^1.5 = 5.4817
    np.testing.assert_allclose(proposal_variance(positions, 10.0)[1], 0.25 / 5.4817, rtol=1e-4)


@pytest.mark.parametrize(
    ("log_variance", "confidence"),
    [
        (-2.0, 0.96018),  # at the percentile: 1 / (1 + exp(24 - 10 e))
        (-2.0 * np.log(2.4), 0.5),  # 10 x 2.4 = 24
        (-1.0, 5.4576e-4),  # 10 e^.5 = 16.4872
        (-6.0, 1.0),  # 10 e^3 = 201
    ],
)
def test_confidence_by_hand(log_variance: float, confidence: float) -> None:
    found = proposal_confidence(np.exp(log_variance), -2.0)
    assert found == pytest.approx(confidence, rel=1e-4)


def test_agreement_gives_confidence() -> None:
    variances = np.geomspace(1e-6, 0.9, 50)
    assert (np.diff(proposal_confidence(variances, -1.5)) <= 0).all()
    assert proposal_confidence(0.0, -1.5) == 1.0
    with pytest.raises(InputError, match="in metres"):
        proposal_confidence(variances, 3.0)


# --- Files


def test_a_file_is_read(tmp_path: Path) -> None:
    data = content()
    path = written(tmp_path, data)
    assert format_of(path) == "proposals"
    clip = read_whatever(path, ClipOptions(focal=1500.0))
    (track,) = clip.tracks
    assert (clip.camera.width, clip.camera.height) == (1920, 1080)
    assert clip.fps == 10
    assert clip.frame_ids.tolist() == list(range(1, 11))
    group = data["people"][3]["proposals"]
    np.testing.assert_allclose(
        track.keypoints[3, RANK], np.mean([p["pose2d"][0] for p in group], axis=0)
    )
    space = np.mean([p["pose3d"] for p in group], axis=0)
    x, y, z = space[0] - (space[4] + space[5]) / 2
    np.testing.assert_allclose(track.poses[3, RANK], (x, z, -y), atol=1e-12)
    # Ankles are the least sure, and what is made of others says nothing.
    assert track.confidences[:, RANK].mean() < track.confidences[:, RHIP].min()
    assert (track.confidences[:, [PELV, NECK]] == 0).all()
    assert (track.confidences[:, RHIP] > 0.99).all()


def test_confidences_are_those_of_the_formula(tmp_path: Path) -> None:
    data = content()
    found = read_proposals(written(tmp_path, data))
    groups = [np.array([p["pose3d"] for p in person["proposals"]]) for person in data["people"]]
    # The fourteenth joint is the thorax, between the shoulders.
    whole = [np.concatenate([g, g[:, 10:12].mean(1, keepdims=True)], 1) for g in groups]
    logs = np.log([proposal_variance(g, 20.0) for g in whole])
    expected = proposal_confidence(np.exp(logs[4, 0]), float(np.percentile(logs, 99)))
    assert found.scores[4, RANK] == pytest.approx(expected)
    assert len(DETECTED) == logs.shape[1]


def test_a_group_of_one_is_nobody(tmp_path: Path) -> None:
    data = content()
    data["people"][2]["proposals"] = data["people"][2]["proposals"][:1]
    found = read_proposals(written(tmp_path, data))
    assert found.frames.tolist() == [1, 2, 4, 5, 6, 7, 8, 9, 10]
    assert found.span == (1, 10)


def _no_score(data: dict[str, Any]) -> None:
    del data["people"][4]["score"]


def _no_pose(data: dict[str, Any]) -> None:
    del data["people"][4]["proposals"][1]["pose3d"]


def _short(data: dict[str, Any]) -> None:
    data["people"][4]["proposals"][1]["pose2d"].pop()


def _no_number(data: dict[str, Any]) -> None:
    data["people"][4]["proposals"][1]["pose3d"][3][2] = None


def _no_metres(data: dict[str, Any]) -> None:
    for person in data["people"]:
        for proposal in person["proposals"]:
            proposal["pose3d"] = (1000 * np.array(proposal["pose3d"])).tolist()


def _no_joint(data: dict[str, Any]) -> None:
    data["joints"] = ["right_big_toe", *NAMES[1:]]


def _alone(data: dict[str, Any]) -> None:
    for person in data["people"]:
        person["proposals"] = person["proposals"][:1]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_no_score, r"lcr\.json, frame 5: proposals without a 'score'"),
        (_no_pose, r"frame 5: no joints in 'pose3d', expected 13"),
        (_short, r"frame 5: 12 joints in 'pose2d', expected 13"),
        (_no_number, r"frame 5, joint left_knee, pose3d: expected 3 numbers"),
        (_no_metres, r"lcr\.json: .*in metres"),
        (_no_joint, "no joint called RANK"),
        (_alone, "two proposals"),
    ],
)
def test_faults_are_named(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], None], said: str
) -> None:
    data = content()
    spoil(data)
    with pytest.raises(InputError, match=said):
        read_proposals(written(tmp_path, data))
