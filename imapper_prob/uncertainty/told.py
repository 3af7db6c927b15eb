"""Furniture of a draw at the places, with the sizes and with the labels that statements say.

A piece stands where its scenelet says, up to the errors of :mod:`~imapper_prob.models.kernels.
measured`, and a seat has its scenelet's label with a certain probability only. The likelihood of
statements sums both out. Here errors are drawn given the statements, and labels get their
probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.kernels.measured import (
    ERRORS,
    find_outline,
    measure_box,
    measure_object,
    set_errors,
    shown,
)
from imapper_prob.models.log_posterior import State, label_probabilities, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Cuboid, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.statements import ObjectAt, Seen, Statement

__all__ = ["as_told", "label_shares"]

Array = NDArray[np.float64]


def as_told(
    rng: np.random.Generator,
    placed: Sequence[SceneObject],
    drawn: Sequence[SceneObject],
    statements: Sequence[Statement],
    *,
    problem: Problem,
    names: Sequence[str],
    state: State,
    camera: Camera,
) -> tuple[SceneObject, ...]:
    """Draw the places and sizes of objects that statements measured.

    Which object a measurement belongs to, if to any, is drawn with the probabilities of agreement.
    Sides are drawn only of objects with a measured size or box; others have those of their
    scenelet.

    Parameters
    ----------
    rng : numpy.random.Generator
    placed : sequence of SceneObject
        Objects of a draw at their places in scenelets, in its world frame.
    drawn : sequence of SceneObject
        The same objects displaced; those that nothing measured are returned so.
    statements : sequence of Statement
        Only measured objects and boxes of a detector are used.
    problem : Problem
        With these statements.
    names : sequence of C str
        Labels by their category number in the problem.
    state : State
        Of the draw.
    camera : Camera
        Of the draw.

    Returns
    -------
    tuple of SceneObject
    """
    found = [(s, said) for s, said in enumerate(statements) if isinstance(said, ObjectAt | Seen)]
    if not found or not placed:
        return tuple(drawn)
    pieces = _Pieces(placed, problem, state)
    kinds = problem.label_kinds[[names.index(o.label) for o in placed]]
    for s, said in found:
        first = problem.given_kinds[s, 1]
        if isinstance(said, ObjectAt):
            shares = kinds @ problem.given_labels[first]
            pieces.measure(rng, said, problem.given[s], shares)
        else:
            joints = motion(problem, state)[problem.given_kinds[s, 5]]
            shares = problem.given_labels[first : first + len(said.boxes)] @ kinds.T
            pieces.see(rng, said, problem.given[s], shares, _outline_of(joints, camera))
    return pieces.standing(rng, placed, drawn)


def label_shares(
    placed: Sequence[SceneObject], *, problem: Problem, names: Sequence[str], state: State
) -> tuple[dict[str, float], ...]:
    """Probabilities of the true label of each object of a draw, given the statements.

    Parameters
    ----------
    placed : sequence of SceneObject
        Objects of a draw at their places in scenelets, in its world frame.
    problem : Problem
    names : sequence of C str
        Labels by their category number in the problem.
    state : State
        Of the draw.

    Returns
    -------
    tuple of dict of str to float
        One for each object.
    """
    own = np.array([names.index(o.label) for o in placed], np.int64)
    shares = problem.label_kinds[own]
    if len(problem.given_labels) and len(placed):
        centres, labels, told = label_probabilities(problem, state)
        for k, o in enumerate(placed):
            # An object that several scenelets have is there once, at the place in the first.
            away = np.linalg.norm(centres - o.centre, axis=1)
            shares[k] = told[np.where(labels == own[k], away, np.inf).argmin()]
    return tuple(
        {names[label]: float(row[label]) for label in np.flatnonzero(row).tolist()}
        for row in shares
    )


def _outline_of(joints: Array, camera: Camera) -> Array:
    """Left, top, right and bottom (px) of a person's joints, and the depth of the pelvis (m)."""
    pixels = camera.project(joints)
    return np.array([*pixels.min(0), *pixels.max(0), camera.to_camera(joints[PELV])[1]])


class _Pieces:
    """The objects of a draw, with mean and covariance of their errors given statements."""

    def __init__(self, placed: Sequence[SceneObject], problem: Problem, state: State) -> None:
        yaws = np.array([o.placement.yaw for o in placed])
        halves = np.array([np.diff(o.bounds, axis=0)[0] / 2 for o in placed])
        self._boxes = np.column_stack([[o.centre for o in placed], halves, yaws])
        self._turns = np.column_stack([np.cos(yaws), np.sin(yaws)])
        self._lens = np.array([problem.cx, problem.cy, problem.fx, problem.fy])
        self._spread = np.array([problem.furniture_aside, problem.furniture_spread])
        self._camera = state.camera
        self._errors = [self._prior(k) for k in range(len(placed))]
        self._placed, self._sized = np.zeros((2, len(placed)), np.bool_)

    def _prior(self, k: int) -> tuple[Array, Array]:
        mean, covariance = np.empty(ERRORS), np.empty((ERRORS, ERRORS))
        set_errors(self._boxes[k], self._spread, mean, covariance)
        return mean, covariance

    def measure(
        self, rng: np.random.Generator, said: ObjectAt, numbers: Array, shares: Array
    ) -> None:
        """Condition the object that was measured, if any.

        ``numbers`` are those of the problem, ``shares`` the probabilities that the objects have one
        of the labels.
        """
        lens = np.concatenate([self._lens, numbers[14:16]])

        def agreement(k: int, mean: Array, covariance: Array) -> float:
            box, turn = self._boxes[k], self._turns[k]
            return measure_object(numbers[2:14], lens, self._camera, box, turn, mean, covariance)

        ours = np.flatnonzero(shares).tolist()
        there = (1 - said.doubt) * (1 - np.prod(1 - shares))
        logs = [
            math.log(there * shares[k] / shares.sum()) + agreement(k, *self._prior(k)) for k in ours
        ]
        which = _one_of(rng, [*logs, math.log(said.doubt) + numbers[1]])
        if which < len(ours):
            k = ours[which]
            agreement(k, *self._errors[k])
            self._placed[k] |= said.place is not None
            self._sized[k] |= said.size is not None or said.box is not None

    def see(
        self,
        rng: np.random.Generator,
        said: Seen,
        numbers: Array,
        shares: Array,
        person: Array,
    ) -> None:
        """Condition the objects that a detector's boxes belong to.

        ``shares`` are the probabilities of each box's label, if it is of each of the objects.
        """
        lens = np.concatenate([self._lens, numbers[4:6]])
        outlines = np.empty((len(self._boxes), 5))
        slopes = np.empty((len(self._boxes), 4, ERRORS))
        for k, (box, turn) in enumerate(zip(self._boxes, self._turns, strict=True)):
            find_outline(lens, self._camera, box, turn, outlines[k], slopes[k])
        rates = [-math.log1p(-said.rate * shown(outlines, k, person)) for k in range(len(outlines))]
        for box, own in zip(np.array(said.boxes), shares, strict=True):
            logs = [
                _log(rate * own[k])
                + measure_box(box, said.std, outlines[k], slopes[k], *self._prior(k))
                for k, rate in enumerate(rates)
            ]
            k = _one_of(rng, [*logs, math.log(said.clutter) + numbers[2]])
            if k < len(logs):
                measure_box(box, said.std, outlines[k], slopes[k], *self._errors[k])
                self._sized[k] = True

    def standing(
        self,
        rng: np.random.Generator,
        placed: Sequence[SceneObject],
        drawn: Sequence[SceneObject],
    ) -> tuple[SceneObject, ...]:
        """The objects with errors drawn given all statements."""
        result = list(drawn)
        for k in np.flatnonzero(self._placed | self._sized).tolist():
            errors = rng.multivariate_normal(*self._errors[k], method="cholesky")
            result[k] = _with_errors(placed[k], errors, sized=bool(self._sized[k]))
        return tuple(result)


def _with_errors(o: SceneObject, errors: Array, *, sized: bool) -> SceneObject:
    """The object displaced along its own axes and, if sized, with other sides."""
    x, y = o.placement.rotation @ errors[:2]
    place = replace(o.placement, x=o.placement.x + float(x), y=o.placement.y + float(y))
    if not sized:
        return SceneObject(o.label, place, o.cuboids)
    # About its middle on the floor.
    middle, factor = o.bounds.mean(0) * (1, 1, 0), np.exp(errors[2:])
    cuboids = tuple(
        Cuboid(c.part, middle + factor * (c.centre - middle), factor * c.size) for c in o.cuboids
    )
    return SceneObject(o.label, place, cuboids)


def _one_of(rng: np.random.Generator, logs: Sequence[float]) -> int:
    """An index, drawn with the given log weights."""
    weights = np.exp(np.array(logs) - max(logs))
    return int(rng.choice(len(weights), p=weights / weights.sum()))


def _log(x: float) -> float:
    return math.log(x) if x > 0 else -math.inf
