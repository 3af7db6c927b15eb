"""The log-posterior of a scene by term, frame, scenelet and object, as tables and as JSON.

Everything is a difference or a share of the terms of
:func:`imapper_prob.models.log_posterior.terms`. Signs are those of the log-posterior: more is
better, and costs are negative.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from imapper_prob.files import written_whole
from imapper_prob.layouts import placed_objects, same_objects
from imapper_prob.models.errors import InputError
from imapper_prob.models.frame_terms import terms_by_frame
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.kernels.visibility import visibility_probability
from imapper_prob.models.log_posterior import State, motion, side_flips, terms
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.people import names_of_rows
from imapper_prob.solver.selection import with_own_scenelets

__all__ = [
    "FORMAT",
    "VERSION",
    "Explanation",
    "Worth",
    "explain",
    "object_worth_table",
    "scenelet_table",
    "term_table",
    "write_energy",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class FrameShares:
    """Contribution of each frame to the log-posterior, with flips and occlusion.

    Parameters
    ----------
    terms : mapping of str to (T,) float
        Nats by frame for terms that belong to frames; they add up to the terms exactly. For
        detections, the weighted log p(u_t, c_t | all earlier frames, s), marginalised over
        left-right flips. A jump counts for the frame it leads to.
    flipped : (T,) float
        Probability that left and right are flipped.
    hidden : (T,) float
        Prior probability, without the frame's detections, that furniture hides a joint; mean over
        the fourteen detected joints.
    """

    terms: Mapping[str, Array]
    flipped: Array
    hidden: Array

    @property
    def total(self) -> Array:
        """(T,) nats, without the terms that belong to no frame."""
        return np.asarray(np.sum(list(self.terms.values()), axis=0))


@dataclass(frozen=True)
class Worth:
    """The loss in log-posterior if one part of the scene is removed.

    Parameters
    ----------
    name : str
        Name of the scenelet, or category of the object.
    action : str
        Action of the scenelet; empty for an object.
    frames : tuple of (int, int)
        First and last row of the scenelet, or of each scenelet that has the object.
    terms : mapping of str to float
        Nats by term; positive if the part helps.
    """

    name: str
    action: str
    frames: tuple[tuple[int, int], ...]
    terms: Mapping[str, float]

    @property
    def total(self) -> float:
        """Sum over all terms, nats."""
        return sum(self.terms.values())


@dataclass(frozen=True)
class Explanation:
    """The decomposition of a scene's log-posterior.

    Parameters
    ----------
    frame_ids : (T,) int
        Frame numbers of the clip by row: all frames of one person, then of the next.
    actors : tuple of T str
        Name of the person of each row; empty for a single person.
    terms, bare_terms : mapping of str to float
        Nats by term, for the scene and for the same state without scenelets.
    frames, bare_frames : FrameShares
        The same by frame.
    scenelets : tuple of Worth
        In order of time. Each is removed with its furniture, and its frames become free.
    objects : tuple of Worth
        Merged objects. Each is removed alone while the motion is unchanged, so the value is that of
        lines of sight and intersections.
    """

    frame_ids: Ints
    actors: tuple[str, ...]
    terms: Mapping[str, float]
    bare_terms: Mapping[str, float]
    frames: FrameShares
    bare_frames: FrameShares
    scenelets: tuple[Worth, ...]
    objects: tuple[Worth, ...]

    @property
    def log_posterior(self) -> float:
        """Log-posterior in nats, up to a constant of the clip."""
        return sum(self.terms.values())

    @property
    def rows(self) -> Ints:
        """(T,) positions along an axis of frames: numbers of the first person's frames, and on."""
        return np.asarray(self.frame_ids[0] + np.arange(len(self.frame_ids)), np.int64)

    def actor_of(self, row: int) -> str:
        """Ending for the name of what is in a row; empty for a single person.

        Parameters
        ----------
        row : int

        Returns
        -------
        str
        """
        return f" {self.actors[row]}" if self.actors else ""


def explain(
    problem: Problem, state: State, library: Library, *, clip: Clip | None = None
) -> Explanation:
    """Decompose the log-posterior of a state.

    Parameters
    ----------
    problem : Problem
    state : State
    library : Library
        Library of the problem.
    clip : Clip, optional
        Clip of the problem, with its frame numbers and names of people; frames are counted from 0
        if not given.

    Returns
    -------
    Explanation

    Raises
    ------
    InputError
        The state is outside the support of the posterior.
    """
    whole = terms(problem, state)
    if not np.isfinite(sum(whole.values())):
        raise InputError(
            "the scene has no finite log-posterior: scenelets overlap or stick out of the clip, "
            "or the camera is out of bounds; take another scene"
        )
    ids, actors = np.arange(problem.n_frames), ()
    if clip is not None:
        ids = np.tile(clip.frame_ids, len(clip.tracks))
        actors = tuple(names_of_rows(clip).tolist()) if len(clip.tracks) > 1 else ()
    bare = replace(
        state, items=state.items[:0], placements=state.placements[:0], sizes=state.sizes[:0]
    )
    scenelets = tuple(
        Worth(
            library[scenelet].name,
            library[scenelet].action,
            (_span(problem, state, index),),
            _lost(whole, terms(problem, state.without_item(index))),
        )
        for index, scenelet in enumerate(state.items[:, 0].tolist())
    )
    return Explanation(
        frame_ids=ids,
        actors=actors,
        terms=whole,
        bare_terms=terms(problem, bare),
        frames=_frame_shares(problem, state, library),
        bare_frames=_frame_shares(problem, bare, library),
        scenelets=scenelets,
        objects=_worth_of_objects(problem, state, library, whole),
    )


def _frame_shares(problem: Problem, state: State, library: Library) -> FrameShares:
    """Contribution of each frame to the terms of a state."""
    joints = motion(problem, state)
    boxes = pack_boxes(o for _, o in placed_objects(state, library))
    clearance = sight_clearance((0, 0, state.camera[1]), joints[:, list(DETECTED)], boxes)
    seen = [
        visibility_probability(gap, problem.sight_width, problem.visibility_error)
        for gap in clearance.ravel()
    ]
    return FrameShares(
        terms=terms_by_frame(problem, state),
        flipped=side_flips(problem, state),
        hidden=1 - np.reshape(seen, clearance.shape).mean(1),
    )


def _worth_of_objects(
    problem: Problem, state: State, library: Library, whole: Mapping[str, float]
) -> tuple[Worth, ...]:
    """The value of each merged object, in order of time."""
    own, own_state = with_own_scenelets(problem, state)
    item_of_box = np.repeat(np.arange(state.n_scenelets), np.diff(own.box_first))
    placed = placed_objects(state, library)
    number = [sum(item == i for i, _ in placed[:k]) for k, (item, _) in enumerate(placed)]
    result = []
    for group in same_objects(placed, problem.merge_angle):
        gone = np.full(len(own.boxes), False)
        for k in group:
            gone |= (item_of_box == placed[k][0]) & (own.box_object == number[k])
        spans = sorted({_span(problem, state, placed[k][0]) for k in group})
        lost = _lost(whole, terms(_without_boxes(own, gone), own_state))
        result.append(Worth(placed[group[0]][1].label, "", tuple(spans), lost))
    return tuple(sorted(result, key=lambda worth: worth.frames))


def _without_boxes(problem: Problem, gone: NDArray[np.bool_]) -> Problem:
    """The problem without the boxes in ``gone`` (B,)."""
    kept = np.concatenate([[0], np.cumsum(~gone)])
    return problem._replace(
        boxes=problem.boxes[~gone],
        box_first=kept[problem.box_first].astype(np.int64),
        box_object=problem.box_object[~gone],
        box_label=problem.box_label[~gone],
        box_yaw=problem.box_yaw[~gone],
    )


def _span(problem: Problem, state: State, index: int) -> tuple[int, int]:
    """First and last row of an item."""
    scenelet, start = state.items[index].tolist()
    return start, start + int(problem.lengths[scenelet]) - 1


def _lost(whole: Mapping[str, float], rest: Mapping[str, float]) -> dict[str, float]:
    return {name: whole[name] - rest[name] for name in whole}


# ------------------------------------------------------------------------------------------------
# Tables and files.

FORMAT: Final = "imapper-prob energy"
VERSION: Final = 2
"""Format version, raised whenever an older reader would misread the file."""
_HEADS: Final = {
    "assignment": "assign-\nment",
    "placement": "pla-\nce-\nment",
    "detections": "de-\ntec-\ntions",
    "free_pose": "free\npose",
    "smoothness": "smo-\noth-\nness",
    "collision": "col-\nli-\nsion",
    "motion": "mo-\ntion",
    "ground": "floor",
    "support": "sup-\nport",
}
"""Column heads in several lines, for terminals of eighty columns."""
_SHOWN: Final = 0.05
"""Nats below which a table cell stays empty, because it would round to 0.0."""


def term_table(explanation: Explanation) -> Table:
    """A table of the log-posterior by term, compared with the empty scene.

    Parameters
    ----------
    explanation : Explanation

    Returns
    -------
    rich.table.Table
    """
    table = _table("The scene by term, nats")
    table.add_column("term")
    for name in ("scene", "no scenelet", "gained"):
        table.add_column(name, justify="right")
    rows = [(t, explanation.terms[t], explanation.bare_terms[t]) for t in explanation.terms]
    for name, scene, bare in rows:
        table.add_row(name, f"{scene:.1f}", f"{bare:.1f}", _signed(scene - bare))
    table.add_section()
    bare = sum(explanation.bare_terms.values())
    scene = explanation.log_posterior
    table.add_row("log posterior", f"{scene:.1f}", f"{bare:.1f}", _signed(scene - bare))
    return table


def scenelet_table(explanation: Explanation) -> Table:
    """A table of the value of each scenelet by term.

    Parameters
    ----------
    explanation : Explanation

    Returns
    -------
    rich.table.Table
    """
    return _worth_table("Lost without a scenelet, nats", explanation, False)


def object_worth_table(explanation: Explanation) -> Table:
    """A table of the value of each object by term, with the motion unchanged.

    Parameters
    ----------
    explanation : Explanation

    Returns
    -------
    rich.table.Table
    """
    return _worth_table("Lost without an object, nats", explanation, True)


def write_energy(path: Path, explanation: Explanation, **provenance: str) -> None:
    """Write an explanation as JSON; an existing file is replaced atomically.

    Parameters
    ----------
    path : Path
    explanation : Explanation
    **provenance : str
        Entries at the top of the file, such as the clip's name.
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        **provenance,
        "units": {"terms": "nat", "probability": "1", "frame": "number in the clip"},
        "log_posterior": explanation.log_posterior,
        "terms": dict(explanation.terms),
        "terms_without_scenelets": dict(explanation.bare_terms),
        "scenelets": [_worth(w, explanation) for w in explanation.scenelets],
        "objects": [_worth(w, explanation) for w in explanation.objects],
        "frame": explanation.frame_ids.tolist(),
        **({"actor": list(explanation.actors)} if explanation.actors else {}),
        "frames": _frames(explanation.frames),
        "frames_without_scenelets": _frames(explanation.bare_frames),
    }
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _worth_table(title: str, explanation: Explanation, of_objects: bool) -> Table:
    parts = explanation.objects if of_objects else explanation.scenelets
    ids = explanation.frame_ids
    shown = [t for t in explanation.terms if any(abs(w.terms[t]) >= _SHOWN for w in parts)]
    table = _table(title)
    table.add_column("object" if of_objects else "scenelet", no_wrap=True)
    table.add_column("frames" if of_objects else "from")
    for name in (*shown, "all"):
        table.add_column(_HEADS.get(name, name), justify="right")
    for worth in parts:
        cells = [_signed(worth.terms[t]) for t in shown]
        when = [
            f"{ids[first]}-{ids[last]}{explanation.actor_of(first)}"
            if of_objects
            else f"{ids[first]}{explanation.actor_of(first)}"
            for first, last in worth.frames
        ]
        table.add_row(worth.name, ", ".join(when), *cells, _signed(worth.total))
    return table


def _table(title: str) -> Table:
    """An empty table that fits a terminal of eighty columns."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0, pad_edge=False)


def _signed(nats: float) -> str:
    return f"{nats:+.1f}" if abs(nats) >= _SHOWN else "·"


def _worth(worth: Worth, explanation: Explanation) -> dict[str, Any]:
    ids, actors = explanation.frame_ids, explanation.actors
    return {
        "name": worth.name,
        "frames": [[int(ids[first]), int(ids[last])] for first, last in worth.frames],
        **({"actors": [actors[first] for first, _ in worth.frames]} if actors else {}),
        "lost": worth.total,
        "lost_by_term": dict(worth.terms),
    }


def _frames(shares: FrameShares) -> dict[str, list[float]]:
    of_terms = {name: nats.tolist() for name, nats in shares.terms.items()}
    return of_terms | {"flipped": shares.flipped.tolist(), "hidden": shares.hidden.tolist()}
