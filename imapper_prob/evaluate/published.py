"""What others published, and what can be said of it."""

from __future__ import annotations

from typing import Final

from imapper_prob.evaluate.pose import SUBSETS
from imapper_prob.evaluate.score import Summary
from imapper_prob.evaluate.tables import Rows, number

__all__ = ["NAMES", "WITHOUT_OUTPUT", "published_object_rows", "published_pose_rows"]

NAMES: Final = {
    "Scene04": "Scene4", "Scene10": "Lobby2", "Scene13": "Library1", "Scene14": "Garden",
}  # fmt: skip
"""Scenes of the public files by their names in the paper."""

OBJECTS: Final = {
    "Office1": (81, 43), "LvRoom": (57, 32), "Library1": (83, 29), "Garden": (58, 28),
    "Lobby1": (70, 55), "Lobby2": (51, 21), "Scene3": (25, None), "Scene4": (70, 57),
    "PiGraphs, hold-one-out": (110, 56),
}  # fmt: skip
"""Monszpart et al. (2019), table 1, their method: mean and standard deviation, cm."""

POSES: Final = {
    "LvRoom": (71.5, 20.9, 197.6), "Lobby1": (60.8, 29.2, 148.9), "Lobby2": (32.0, 19.2, 68.6),
    "Scene3": (56.7, 19.7, 65.4), "Scene4": (61.8, 13.6, 46.3),
}  # fmt: skip
"""The same, table 2: world cm, local cm, pixels, of frames with three hidden joints or more."""

WITHOUT_OUTPUT: Final = (
    "per-frame region detector", "monocular depth", "Tome3D", "LCR-Net++", "VNect",
)  # fmt: skip
"""Methods that the paper compares with and whose output on these scenes nobody published."""

_CLOSE: Final = 0.05
"""Half a unit of the last printed digit of table 2, within which a row is reproduced."""


def published_object_rows(authors: dict[str, Summary]) -> Rows:
    """Table 1 beside the scores of the authors' public files, by the name of the clip."""
    rows: Rows = [("scene", "clip", "published, cm", "public files, our code, cm", "reproduced")]
    for name, (mean, spread) in OBJECTS.items():
        clip = _clip(name)
        found = authors.get(clip)
        printed = f"{mean}" if spread is None else f"{mean} ({spread})"
        if found is None:
            rows.append((name, "not at hand", printed, "–", "–"))
            continue
        same = round(found.error) == mean and round(found.spread) == spread
        ours = f"{number(found.error)} ({number(found.spread)})"
        rows.append((name, clip, printed, ours, "yes" if same else "no"))
    return rows


def published_pose_rows(authors: dict[str, Summary]) -> Rows:
    """Table 2 beside the scores of the authors' public files."""
    rows: Rows = [("scene", "clip", "published", "public files, our code", "reproduced")]
    for name, values in POSES.items():
        clip = _clip(name)
        found = authors.get(clip)
        printed = " / ".join(str(v) for v in values)
        if found is None:
            rows.append((name, "not at hand", printed, "–", "–"))
            continue
        ours = found.pose[SUBSETS[2]]
        same = all(abs(a - b) <= _CLOSE for a, b in zip(ours, values, strict=True))
        told = " / ".join(number(v, 1) for v in ours)
        rows.append((name, clip, printed, told, "yes" if same else "no"))
    return rows


def _clip(name: str) -> str:
    return next((clip for clip, own in NAMES.items() if own == name), "")
