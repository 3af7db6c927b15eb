"""Validate problems and states read from files, because compiled code does not check them.

Indices are within range, shapes agree, and numbers are finite and of plausible size. Stored
posteriors and checkpoints are checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.statement_terms import (
    BEHIND,
    CONTACT,
    DEPTH,
    DETECTIONS_OF_OBJECTS,
    OBJECT,
    POINT,
    PRESENCE,
    SAME_OBJECT,
)
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import GIVEN_KINDS, GIVEN_NUMBERS, GIVEN_ROW, Problem
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["check_problem", "check_state"]


_LARGEST: Final = 1e9
"""Largest number in a problem (pixels, metres or nats)."""
_FARTHEST: Final = 1e4
"""Largest coordinate of a scenelet or camera in a state, metres."""
_LARGEST_LOG: Final = 5.0
"""Largest log size or log scale, a factor of about 150."""
_LARGEST_WEIGHT: Final = 2.0
"""Largest weight of a frame after it in drawing a frame of the path: both rates are below 1."""
_LARGEST_LATENT: Final = 100.0
"""Largest latent variable, in standard deviations."""

_SHAPES: Final[Mapping[str, tuple[str | int, ...]]] = {
    "keypoints": ("T", N_JOINTS, 2), "used": ("T", N_JOINTS), "confidences": ("T", N_JOINTS),
    "confidence_density": ("T", N_JOINTS, 2), "error_scale": ("T", N_JOINTS, 2),
    "error_dof": ("T", N_JOINTS, 2), "path_centre": ("T", 2), "path_scale": ("T", 2),
    "path_starts": ("T",), "path_stay": ("T",), "stay_steps": (),
    "path_mean": (2, "P+1", 2), "path_draw": (2, "P+1", 3, 3),
    "lift": ("T",), "poses": ("T", N_JOINTS, 3), "path_facing": ("T", 2),
    "static_density": (2, "T", N_JOINTS, 2), "free_cost": ("T",), "joints": ("N", N_JOINTS, 3),
    "joint_facing": ("N", 2), "joint_first": ("L+1",), "boxes": ("B", 7), "box_first": ("L+1",),
    "box_object": ("B",), "box_label": ("B",), "box_yaw": ("B",), "label_front": ("C",),
    "label_chance": ("C",), "label_sides": ("C", 3),
    "stays": ("K", 3), "lowered": ("L", 2), "log_rate": ("L",), "camera_mean": (5,),
    "camera_precision": (5, 5), "pose_tolerance": (N_JOINTS,), "start_mean": (2,),
    "start_variance": (2,), "paper_nats": (5,),
    "given_kinds": ("G", GIVEN_KINDS), "given": ("G", GIVEN_NUMBERS), "given_labels": ("Q", "C"),
    "given_rows": ("R", GIVEN_ROW),
    "given_power": ("G",),
}  # fmt: skip
"""Shapes of a problem's arrays: T frames, at most P of them of one person, N frames and B boxes of
L scenelets, C categories, K stays and G statements with Q rows of labels and R other rows."""
_INDICES: Final = (
    "path_stay", "stay_steps", "joint_first", "box_first", "box_object", "box_label", "lowered",
    "given_kinds",
)  # fmt: skip
_FLAGS: Final = ("used", "path_starts", "label_front")
_POSITIVE: Final = (
    "fx", "fy", "error_scale", "error_dof", "path_scale", "start_variance", "size_spread",
    "facing_spread", "pose_tolerance", "sight_width", "joint_step", "merge_angle",
)  # fmt: skip


def check_problem(problem: Problem) -> None:
    """Refuse a problem on which compiled code would access memory outside its arrays.

    Parameters
    ----------
    problem : Problem

    Raises
    ------
    InputError
        The message names the field.
    """
    lengths: dict[str, int] = {}
    for name, values in problem._asdict().items():
        shape, array = _SHAPES.get(name, ()), np.asarray(values)
        kinds = "iu" if name in _INDICES else "b" if name in _FLAGS else "f"
        if array.dtype.kind not in kinds or array.ndim != len(shape):
            raise InputError(f"{name} has shape {array.shape} and type {array.dtype}")
        for wanted, there in zip(shape, array.shape, strict=True):
            if isinstance(wanted, str):
                letter, _, more = wanted.partition("+")
                own = there - int(more or 0)
                agrees = lengths.setdefault(letter, own) == own >= 0
            else:
                agrees = wanted == there
            if not agrees:
                raise InputError(f"{name} has shape {array.shape}, unlike the others")
        _check_numbers(name, array)
    if min(lengths["T"], lengths["L"]) < 1:
        raise InputError("no frame, or no scenelet")
    begins = np.append(np.flatnonzero(problem.path_starts), lengths["T"])
    if begins[0] != 0 or np.diff(begins).max() > lengths["P"]:
        raise InputError("path_starts does not fit the tables of the path")
    if problem.stay_steps < 1:
        raise InputError("stay_steps must be positive")
    if (problem.label_chance < 0).any() or problem.label_chance.sum() > 1 + 1e-9:
        raise InputError("label_chance are no probabilities")
    if not (np.abs(problem.label_sides) <= _LARGEST_LOG).all():
        raise InputError("label_sides are of no furniture that there is")
    _check_pointers(problem, lengths)
    _check_path(problem, lengths)
    precision = problem.camera_precision
    if not np.allclose(precision, precision.T) or np.linalg.eigvalsh(precision)[0] <= 0:
        raise InputError("camera_precision is no precision")


def _check_numbers(name: str, array: NDArray[np.generic]) -> None:
    if array.dtype.kind != "f":
        return
    numbers = array.astype(np.float64)
    if not (np.isfinite(numbers).all() and (np.abs(numbers) <= _LARGEST).all()):
        raise InputError(f"{name} has a number that is not finite, or too large to be true")
    if name in _POSITIVE and not (numbers > 0).all():
        raise InputError(f"{name} must be positive")


def _check_path(problem: Problem, lengths: Mapping[str, int]) -> None:
    """Refuse a path that leaves the room: its joints would be at the camera, or infinitely far."""
    for name, most in (
        ("path_draw", _LARGEST_WEIGHT),
        ("path_mean", lengths["P"] + 1.0),  # as in a straight line through two frames
        ("path_scale", _LARGEST_LOG),
        ("path_centre", [_FARTHEST, math.log(_FARTHEST)]),
    ):
        if not (np.abs(getattr(problem, name)) <= most).all():
            raise InputError(f"{name} is too large for the path of a person")


def _check_pointers(problem: Problem, lengths: Mapping[str, int]) -> None:
    for name, end, least in (("joint_first", "N", 2), ("box_first", "B", 0)):
        first = getattr(problem, name)
        if first[0] != 0 or first[-1] != lengths[end] or (np.diff(first) < least).any():
            raise InputError(f"{name} does not fit what it points at")
    boxes_of = np.diff(problem.box_first)
    owner = np.repeat(np.arange(lengths["L"]), boxes_of)
    for name, limit in (("box_object", boxes_of[owner]), ("box_label", lengths["C"])):
        index = getattr(problem, name)
        if not ((index >= 0) & (index < limit)).all():
            raise InputError(f"{name} points at nothing")
    begin, end_ = problem.lowered.T
    if not ((begin >= 0) & (begin <= end_) & (end_ <= problem.lengths)).all():
        raise InputError("lowered names frames that are not there")
    if not ((problem.stays[:, :2] >= 0) & (problem.stays[:, :2] <= lengths["T"])).all():
        raise InputError("stays name frames that are not there")
    _check_statements(problem, lengths)


def _check_statements(problem: Problem, lengths: Mapping[str, int]) -> None:
    kind, label, first, end, joint, begin, last = problem.given_kinds.T
    rows_of_labels = np.where(label >= 0, np.where(kind == BEHIND, 2, 1), 0)
    detected = np.where(kind == DETECTIONS_OF_OBJECTS, end - first, rows_of_labels)
    framed, spans = (
        problem.given_rows[
            [k for s in np.flatnonzero(kind == one) for k in range(first[s], end[s])]
        ]
        for one in (DEPTH, SAME_OBJECT)
    )
    holds = (
        ((kind >= 0) & (kind <= BEHIND)).all()
        and (label + detected <= lengths["Q"]).all()
        and ((first >= 0) & (first <= end) & (end <= lengths["R"])).all()
        and ((joint >= 0) & (joint < N_JOINTS)).all()
        and ((begin >= 0) & (begin <= last) & (last <= lengths["T"])).all()
        and (last > begin)[np.isin(kind, (POINT, CONTACT, DETECTIONS_OF_OBJECTS))].all()
        and (label >= 0)[np.isin(kind, (OBJECT, PRESENCE, CONTACT, SAME_OBJECT, BEHIND))].all()
        and ((framed[:, 0] >= 0) & (framed[:, 0] < lengths["T"])).all()
        and ((spans[:, 0] >= 0) & (spans[:, 0] < spans[:, 1])).all()
        and (spans[:, 1] <= lengths["T"]).all()
    )
    if not holds:
        raise InputError("a statement names something that is not there")


def check_state(problem: Problem, state: State) -> None:
    """Refuse a state that is invalid for a problem.

    Parameters
    ----------
    problem : Problem
    state : State

    Raises
    ------
    InputError
        The message says what is wrong.
    """
    count = len(state.items)
    arrays = (
        ("camera", state.camera, (5,), _FARTHEST),
        ("placements", state.placements, (count, 3), _FARTHEST),
        ("sizes", state.sizes, (count,), _LARGEST_LOG),
        ("latent", state.latent, (problem.n_frames, 2), _LARGEST_LATENT),
    )
    for name, array, shape, most in arrays:
        if array.shape != shape or array.dtype != np.float64:
            raise InputError(f"{name} of a state has shape {array.shape} and type {array.dtype}")
        if not (np.abs(array) <= most).all():
            raise InputError(f"{name} of a state is not finite, or too large to be true")
    if not (np.abs(state.camera[2:4]) <= _LARGEST_LOG).all():
        raise InputError("camera of a state is of no size that there is")
    if state.items.shape != (count, 2) or state.items.dtype != np.int64:
        raise InputError("items of a state are no scenelets with start frames")
    _check_items(problem, state.items)


def _check_items(problem: Problem, items: NDArray[np.int64]) -> None:
    scenelets, starts = items.T
    if not ((scenelets >= 0) & (scenelets < len(problem.log_rate))).all():
        raise InputError("a state has a scenelet that is not there")
    ends = starts + problem.lengths[scenelets]
    inside = (starts >= 0).all() and (ends <= problem.n_frames).all()
    if not inside or (ends[:-1] > starts[1:]).any():
        raise InputError("scenelets of a state overlap, or stick out of the clip")
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if problem.path_starts[start + 1 : end].any():
            raise InputError("a scenelet of a state goes on where somebody else begins")
