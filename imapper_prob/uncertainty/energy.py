"""Why this scene: its log-posterior by term, frame, scenelet and object, in tables and as JSON.

Everything is a difference or a share of what :func:`imapper_prob.models.log_posterior.terms`
computes; nothing is modelled a second time. Signs are those of the log-posterior: more is better,
and a cost is negative.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
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
from imapper_prob.models.scenelet import Library
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.solver.selection import of_scenelets

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
    """What each frame adds to the log-posterior, and what the scene says of it.

    Parameters
    ----------
    terms : mapping of str to (T,) float
        Nats by frame of the terms that belong to frames, adding up to them exactly. Of
        detections, log p(u_t, c_t | all earlier frames, s) with the frame weight and with
        left and right flipped or not summed out. A jump counts for the frame it leads to.
    flipped : (T,) float
        Probability that the detector took left for right.
    hidden : (T,) float
        Mean over the fourteen detected joints of the probability that furniture hides them,
        before the detections are asked.
    """

    terms: Mapping[str, Array]
    flipped: Array
    hidden: Array

    @property
    def total(self) -> Array:
        """(T,) nats; the terms that belong to no frame are left out."""
        return np.asarray(np.sum(list(self.terms.values()), axis=0))


@dataclass(frozen=True)
class Worth:
    """What the log-posterior would lose if one part of the scene were left out.

    Parameters
    ----------
    name : str
        Scenelet, or category of the object.
    action : str
        What the scenelet does; empty for an object.
    frames : tuple of (int, int)
        First and last frame index of the scenelet, or of each that brings the object.
    terms : mapping of str to float
        Nats by term; positive where the part helps.
    """

    name: str
    action: str
    frames: tuple[tuple[int, int], ...]
    terms: Mapping[str, float]

    @property
    def total(self) -> float:
        """Nats in all."""
        return sum(self.terms.values())


@dataclass(frozen=True)
class Explanation:
    """A scene's log-posterior taken apart.

    Parameters
    ----------
    frame_ids : (T,) int
        The clip's own numbers of the frames.
    terms, bare_terms : mapping of str to float
        Nats by term, of the scene and of the same state without any scenelet.
    frames, bare_frames : FrameShares
        The same by frame.
    scenelets : tuple of Worth
        In order of time. Left out with its furniture, its frames becoming free.
    objects : tuple of Worth
        Objects that are one merged. Left out alone: the person goes on moving as if it
        were there, so this is what is said by lines of sight and by intersections.
    """

    frame_ids: Ints
    terms: Mapping[str, float]
    bare_terms: Mapping[str, float]
    frames: FrameShares
    bare_frames: FrameShares
    scenelets: tuple[Worth, ...]
    objects: tuple[Worth, ...]

    @property
    def log_posterior(self) -> float:
        """Nats, up to the constant of the clip."""
        return sum(self.terms.values())

    @property
    def gained(self) -> dict[str, float]:
        """Nats by term that the scene is better than no scenelet at all."""
        return _lost(self.terms, self.bare_terms)


def explain(
    problem: Problem, state: State, library: Library, *, frame_ids: ArrayLike | None = None
) -> Explanation:
    """Take the log-posterior of a state apart.

    Parameters
    ----------
    problem : Problem
    state : State
    library : Library
        Whose scenelets ``problem`` was packed with.
    frame_ids : (T,) int, optional
        Numbers of the frames; counted from 0 if not given.

    Returns
    -------
    Explanation

    Raises
    ------
    InputError
        If the state is outside the support of the posterior, where nothing can be compared.
    """
    whole = terms(problem, state)
    if not np.isfinite(sum(whole.values())):
        raise InputError(
            "the scene has no finite log-posterior: scenelets overlap or stick out of the clip, "
            "or the camera is out of bounds; take another scene"
        )
    ids = np.arange(problem.n_frames) if frame_ids is None else np.array(frame_ids, np.int64)
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
        terms=whole,
        bare_terms=terms(problem, bare),
        frames=_frame_shares(problem, state, library),
        bare_frames=_frame_shares(problem, bare, library),
        scenelets=scenelets,
        objects=_worth_of_objects(problem, state, library, whole),
    )


def _frame_shares(problem: Problem, state: State, library: Library) -> FrameShares:
    """What each frame adds to the terms of a state."""
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
    """What each merged object does for the scene, in order of time."""
    own, own_state = _own_scenelets(problem, state)
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


def _own_scenelets(problem: Problem, state: State) -> tuple[Problem, State]:
    """The same state in a library of exactly its items, in their order.

    A scenelet may be in a state twice; here each has boxes of its own that can be taken away.
    """
    chosen = state.items[:, 0]
    items = np.stack([np.arange(len(chosen)), state.items[:, 1]], -1)
    return of_scenelets(problem, chosen), replace(state, items=items)


def _without_boxes(problem: Problem, gone: NDArray[np.bool_]) -> Problem:
    """The problem with some of its boxes taken away; ``gone`` is (B,)."""
    kept = np.concatenate([[0], np.cumsum(~gone)])
    return problem._replace(
        boxes=problem.boxes[~gone],
        box_first=kept[problem.box_first].astype(np.int64),
        box_object=problem.box_object[~gone],
        box_label=problem.box_label[~gone],
        box_yaw=problem.box_yaw[~gone],
    )


def _span(problem: Problem, state: State, index: int) -> tuple[int, int]:
    """First and last frame index of an item."""
    scenelet, start = state.items[index].tolist()
    return start, start + int(problem.lengths[scenelet]) - 1


def _lost(whole: Mapping[str, float], rest: Mapping[str, float]) -> dict[str, float]:
    return {name: whole[name] - rest[name] for name in whole}


# ------------------------------------------------------------------------------------------------
# Tables and files.

FORMAT: Final = "imapper-prob energy"
VERSION: Final = 1
"""Raised whenever a reader of an older version would misread the file."""
_HEADS: Final = {
    "layout": "lay-\nout",
    "placement": "pla-\nce-\nment",
    "detections": "de-\ntec-\ntions",
    "free_pose": "free\npose",
    "smoothness": "smo-\noth-\nness",
    "collision": "col-\nli-\nsion",
    "motion": "mo-\ntion",
    "ground": "floor",
    "support": "sup-\nport",
}
"""Heads in a few lines, for terminals of eighty columns."""
_SHOWN: Final = 0.05
"""Nats below which a cell of a table stays empty: it would round to 0.0."""


def term_table(explanation: Explanation) -> Table:
    """The log-posterior by term, beside that of no scenelet at all.

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
    """What each scenelet is worth, by term.

    Parameters
    ----------
    explanation : Explanation

    Returns
    -------
    rich.table.Table
    """
    return _worth_table("Lost without a scenelet, nats", explanation, False)


def object_worth_table(explanation: Explanation) -> Table:
    """What each object is worth while the person moves as before, by term.

    Parameters
    ----------
    explanation : Explanation

    Returns
    -------
    rich.table.Table
    """
    return _worth_table("Lost without an object, nats", explanation, True)


def write_energy(path: Path, explanation: Explanation, **provenance: str) -> None:
    """Write an explanation as JSON; a file in the way is replaced as a whole.

    Parameters
    ----------
    path : Path
    explanation : Explanation
    **provenance : str
        What is said at the top of the file, such as the clip's name.
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        **provenance,
        "units": {"terms": "nat", "probability": "1", "frame": "number in the clip"},
        "log_posterior": explanation.log_posterior,
        "terms": dict(explanation.terms),
        "terms_without_scenelets": dict(explanation.bare_terms),
        "scenelets": [_worth(w, explanation.frame_ids) for w in explanation.scenelets],
        "objects": [_worth(w, explanation.frame_ids) for w in explanation.objects],
        "frame": explanation.frame_ids.tolist(),
        "frames": _frames(explanation.frames),
        "frames_without_scenelets": _frames(explanation.bare_frames),
    }
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _worth_table(title: str, explanation: Explanation, of_objects: bool) -> Table:
    parts = explanation.objects if of_objects else explanation.scenelets
    shown = [t for t in explanation.terms if any(abs(w.terms[t]) >= _SHOWN for w in parts)]
    table = _table(title)
    table.add_column("object" if of_objects else "scenelet", no_wrap=True)
    table.add_column("frames" if of_objects else "from")
    for name in (*shown, "all"):
        table.add_column(_HEADS.get(name, name), justify="right")
    for worth in parts:
        cells = [_signed(worth.terms[t]) for t in shown]
        spans = [tuple(explanation.frame_ids[list(span)]) for span in worth.frames]
        when = [f"{first}-{last}" if of_objects else str(first) for first, last in spans]
        table.add_row(worth.name, ", ".join(when), *cells, _signed(worth.total))
    return table


def _table(title: str) -> Table:
    """Narrow enough for a terminal of eighty columns."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0, pad_edge=False)


def _signed(nats: float) -> str:
    return f"{nats:+.1f}" if abs(nats) >= _SHOWN else "·"


def _worth(worth: Worth, ids: NDArray[np.int64]) -> dict[str, Any]:
    return {
        "name": worth.name,
        "frames": [[int(ids[first]), int(ids[last])] for first, last in worth.frames],
        "lost": worth.total,
        "lost_by_term": dict(worth.terms),
    }


def _frames(shares: FrameShares) -> dict[str, list[float]]:
    of_terms = {name: nats.tolist() for name, nats in shares.terms.items()}
    return of_terms | {"flipped": shares.flipped.tolist(), "hidden": shares.hidden.tolist()}
