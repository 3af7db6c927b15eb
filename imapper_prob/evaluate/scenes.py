"""Where a truth comes from, and what a result is always held beside."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from imapper_prob.evaluate.baselines import couch_where_sat, static_path
from imapper_prob.evaluate.i3db import read_authors, read_input_path, read_truth_in_view
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.truth import TruthInView, truth_in_view
from imapper_prob.inputs import load_clip
from imapper_prob.inputs.i3db import DETECTIONS
from imapper_prob.inputs.i3db_capture import i3db_folders
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip

__all__ = ["KnownScene", "known_clip", "known_scene", "scenes_with_truth"]


@dataclass(frozen=True, eq=False)
class KnownScene:
    """A clip whose truth is known.

    Parameters
    ----------
    clip : Clip
    truth : TruthInView
    others : tuple of Prediction
        The authors' output where it is public, and answers that take no thought.
    """

    clip: Clip
    truth: TruthInView
    others: tuple[Prediction, ...]


def known_scene(path: str | Path) -> KnownScene:
    """An i3DB scene with its ``gt/``, or a clip file that carries its truth.

    Raises
    ------
    InputError
        If there is no truth, or a file is damaged.
    """
    path = Path(path)
    clip = load_clip(path)
    if not (path.is_dir() and any(path.glob(DETECTIONS))):
        return known_clip(clip)
    if not (path / "gt").is_dir():
        raise InputError(f"{path}: has no gt/, so nobody knows its truth; name another scene")
    truth = read_truth_in_view(path, clip)
    published = (read_authors(path, clip),) if (path / "iMapper").is_dir() else ()
    lifted = read_input_path(path, clip)
    paths = (lifted, static_path(clip))
    return KnownScene(
        clip, truth, (*published, lifted, *(couch_where_sat(p, truth.actions) for p in paths))
    )


def known_clip(clip: Clip) -> KnownScene:
    """A clip that carries its truth, as simulated ones do.

    Raises
    ------
    InputError
        If it does not.
    """
    truth = truth_in_view(clip)
    return KnownScene(clip, truth, (couch_where_sat(static_path(clip), truth.actions),))


def scenes_with_truth(folder: str | Path) -> list[Path]:
    """The scenes of a folder of i3DB that have a truth.

    Raises
    ------
    InputError
        If there are none.
    """
    found = [path for path in i3db_folders(folder) if (path / "gt").is_dir()]
    if not found:
        raise InputError(f"{folder}: no scene there has a gt/; nothing to hold results to")
    return found
