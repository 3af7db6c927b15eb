"""Furniture of a draw at the places, with the sizes and with the labels that statements say.

A piece stands where its scenelet says, up to the errors of :mod:`~imapper_prob.models.kernels.
measured`, and a seat has its scenelet's label with a certain probability only. The likelihood of
statements sums both out. Here errors are drawn given the statements, by importance, and labels get
their probabilities.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from imapper_prob.models.camera import Camera
from imapper_prob.models.furniture_statements import ObjectAt, Seen
from imapper_prob.models.kernels.given import set_shares
from imapper_prob.models.kernels.measured import (
    ERRORS,
    detection_rate,
    measure_object,
    project_outline,
    resize,
    set_errors,
    settle_errors,
    try_errors,
)
from imapper_prob.models.kernels.statement_terms import (
    CLUTTER,
    PICTURE_OF_BOXES,
    PICTURE_OF_OBJECT,
    SAID,
    WRONG,
    probability_right,
)
from imapper_prob.models.log_posterior import State, label_probabilities, motion
from imapper_prob.models.problem import Problem, label_kinds
from imapper_prob.models.scene import Cuboid, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.statements import Statement

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
    """Draw the places, sizes and yaws of objects that statements measured.

    Which object a measurement belongs to, if to any, is drawn with the probabilities of agreement.
    Sides and yaws are drawn only of objects with a measured size or box; others have those of their
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
    own = [names.index(o.label) for o in placed]
    for s, said in found:
        count = len(said.boxes) if isinstance(said, Seen) else 1
        first = problem.given_kinds[s, 1]
        shares = np.empty((count, len(placed), 1 + len(names)))
        for row in range(count):
            for k, label in enumerate(own):
                labels = problem.given_labels[first + row]
                set_shares(problem.label_chance, labels, label, shares[row, k])
        if isinstance(said, ObjectAt):
            pieces.measure(rng, said, problem.given[s], shares[0])
        else:
            joints = motion(problem, state)[problem.given_kinds[s, 5]]
            boxes = problem.given_rows[slice(*problem.given_kinds[s, 2:4])]
            pieces.see(rng, said, problem.given[s], boxes, shares, _outline_of(joints, camera))
    return pieces.standing(rng, placed, drawn, names)


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
    shares = label_kinds(problem)[own]
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
    """The objects of a draw, and what statements measured of each.

    Each is as its scenelet says or a seat of some kind by chance, until a measurement decides; its
    errors are about that.
    """

    def __init__(self, placed: Sequence[SceneObject], problem: Problem, state: State) -> None:
        yaws = np.array([o.placement.yaw for o in placed])
        halves = np.array([np.diff(o.bounds, axis=0)[0] / 2 for o in placed])
        own = np.column_stack([[o.centre for o in placed], halves, yaws])
        self._boxes = np.repeat(own[:, None], 1 + len(problem.label_sides), axis=1)
        for k, case in np.ndindex(len(placed), len(problem.label_sides)):
            resize(own[k], problem.label_sides[case], self._boxes[k, 1 + case])
        self._turns = np.column_stack([np.cos(yaws), np.sin(yaws)])
        self._lens = np.array([problem.cx, problem.cy, problem.fx, problem.fy])
        self._spread = np.array(
            [problem.furniture_aside, problem.furniture_spread, problem.furniture_yaw]
        )
        self._camera = state.camera
        self._cases = np.full(len(placed), _UNDECIDED)
        nothing = np.empty((0, PICTURE_OF_OBJECT - SAID)), np.empty((0, len(self._lens) + 2))
        self._measured = [nothing] * len(placed)
        self._placed, self._sized = np.zeros((2, len(placed)), np.bool_)

    def _prior(self, k: int, case: int) -> tuple[Array, Array]:
        mean, covariance = np.empty(ERRORS), np.empty((ERRORS, ERRORS))
        set_errors(self._boxes[k, case], self._spread, mean, covariance)
        return mean, covariance

    def _possible(self, shares: Array) -> list[tuple[int, int]]:
        """The cases (k, case) with a share that no earlier measurement excludes."""
        return [
            (k, case)
            for k, case in np.argwhere(shares).tolist()
            if self._cases[k] in (_UNDECIDED, case)
        ]

    def _agreement(self, k: int, case: int, measured: Array, lens: Array) -> float:
        """Log density of measured numbers given the earlier ones; the first as in the likelihood.

        The numbers are those of `measure_object`.
        """
        said, lenses = self._measured[k]
        mean, covariance = self._prior(k, case)
        if not len(said):
            box, turn = self._boxes[k, case], self._turns[k]
            return measure_object(measured, lens, self._camera, box, turn, mean, covariance)
        both = np.vstack([said, measured]), np.vstack([lenses, lens])
        known, _, _ = self._settled(k, case, (said, lenses), mean, covariance)
        return self._settled(k, case, both, mean, covariance)[0] - known

    def _condition(self, k: int, case: int, measured: Array, lens: Array) -> None:
        """Fix what a piece is, and keep the numbers of `measure_object` measured of it."""
        said, lenses = self._measured[k]
        self._measured[k] = np.vstack([said, measured]), np.vstack([lenses, lens])
        self._cases[k] = case

    def _settled(
        self, k: int, case: int, measured: tuple[Array, Array], before: Array, spread: Array
    ) -> tuple[float, Array, Array]:
        """Log density of what was measured, and mean and covariance of the errors given it."""
        mean, covariance = np.empty(ERRORS), np.empty((ERRORS, ERRORS))
        box = self._boxes[k, case]
        log = settle_errors(*measured, self._camera, box, before, spread, mean, covariance)
        return log, mean, covariance

    def _draw(self, rng: np.random.Generator, k: int) -> Array:
        """Errors of a piece given all that was measured of it.

        They are one of several, in proportion to importance (Rubin 1987). The outline is far from
        linear in the yaw. So half of the yaws are from the prior, and half from the normal
        approximation. The other errors are from the normal approximation given the yaw.
        """
        case, measured = int(self._cases[k]), self._measured[k]
        nothing, prior = self._prior(k, case)
        _, mean, covariance = self._settled(k, case, measured, nothing, prior)
        middles = np.array([0.0, mean[5]])
        widths = np.sqrt([prior[5, 5], covariance[5, 5]])
        tries = rng.standard_normal((2 * _TRIES, ERRORS))
        strata = (np.arange(_TRIES)[:, None] + rng.random((_TRIES, 2))) / _TRIES
        tries[:, 5] = (middles + widths * ndtri(strata)).ravel()
        densities = np.exp(-0.5 * ((tries[:, 5:] - middles) / widths) ** 2) / widths
        logs = np.empty(len(tries))
        try_errors(*measured, self._camera, self._boxes[k, case], prior, tries, logs)
        logs += np.log(densities[:, 0] / densities.sum(1))
        return np.asarray(tries[_one_of(rng, logs.tolist())])

    def _draw_place(self, rng: np.random.Generator, k: int) -> Array:
        """Errors of a piece of which only places were measured, which are linear in the errors."""
        case = int(self._cases[k])
        nothing, prior = self._prior(k, case)
        prior[5] = 0.0
        _, mean, covariance = self._settled(k, case, self._measured[k], nothing, prior)
        own = rng.multivariate_normal(mean[:5], covariance[:5, :5], method="cholesky")
        return np.append(own, 0.0)

    def measure(
        self, rng: np.random.Generator, said: ObjectAt, numbers: Array, shares: Array
    ) -> None:
        """Condition the object that was measured, if any.

        ``numbers`` are those of the problem. ``shares`` (k, 1 + C) are the probabilities of the
        cases in which the objects have one of the labels.
        """
        lens = np.concatenate([self._lens, numbers[PICTURE_OF_OBJECT:][:2]])
        measured = numbers[SAID:PICTURE_OF_OBJECT]
        ours = self._possible(shares)
        right = probability_right(said.doubt, shares)
        logs = [
            math.log(right * shares[k, case] / shares.sum())
            + self._agreement(k, case, measured, lens)
            for k, case in ours
        ]
        which = _one_of(rng, [*logs, math.log(said.doubt) + numbers[WRONG]])
        if which < len(ours):
            k, case = ours[which]
            self._condition(k, case, measured, lens)
            self._placed[k] |= said.place is not None
            self._sized[k] |= said.size is not None or said.box is not None

    def see(
        self,
        rng: np.random.Generator,
        said: Seen,
        numbers: Array,
        boxes: Array,
        shares: Array,
        person: Array,
    ) -> None:
        """Condition the objects that a detector's ``boxes`` (boxes, 4) belong to.

        ``shares`` (boxes, k, 1 + C) are the probabilities of each case of the objects, times those
        of the box's label.
        """
        lens = np.concatenate([self._lens, numbers[PICTURE_OF_BOXES:][:2]])
        outlines, slopes = np.empty((len(self._boxes), 5)), np.empty((4, ERRORS))
        for k, outline in enumerate(outlines):
            box, turn = self._boxes[k, 0], self._turns[k]
            project_outline(lens, self._camera, box, turn, outline, slopes)
        rates = [detection_rate(said.rate, lens, outlines, k, person) for k in range(len(outlines))]
        for box, own in zip(boxes, shares, strict=True):
            ours = self._possible(own)
            measured = np.array([*np.zeros(7), *box, said.std])  # neither place nor size
            logs = [
                _log(rates[k] * own[k, case]) + self._agreement(k, case, measured, lens)
                for k, case in ours
            ]
            which = _one_of(rng, [*logs, math.log(said.clutter) + numbers[CLUTTER]])
            if which < len(ours):
                k, case = ours[which]
                self._condition(k, case, measured, lens)
                self._sized[k] = True

    def standing(
        self,
        rng: np.random.Generator,
        placed: Sequence[SceneObject],
        drawn: Sequence[SceneObject],
        names: Sequence[str],
    ) -> tuple[SceneObject, ...]:
        """The objects with errors drawn given all statements."""
        result = list(drawn)
        for k in np.flatnonzero(self._placed | self._sized).tolist():
            case, sized = int(self._cases[k]), self._sized[k]
            errors = self._draw(rng, k) if sized else self._draw_place(rng, k)
            sides = self._boxes[k, case, 3:6] / self._boxes[k, 0, 3:6]
            factor = sides * np.exp(errors[2:5]) if sized else np.ones(3)
            label = placed[k].label if case == 0 else names[case - 1]
            result[k] = _with_errors(placed[k], label, errors[:2], factor, float(errors[5]))
        return tuple(result)


_TRIES: Final = 24
"""Draws with yaws of either kind, of which one is kept; chosen, a test compares the result with the
exact distribution."""
_UNDECIDED: Final = -1
"""Case of a piece that nothing measured."""


def _with_errors(
    o: SceneObject, label: str, away: Array, factor: Array, turn: float
) -> SceneObject:
    """The object with a label, turned, displaced along its axes (m), its sides times factors."""
    # About its middle on the floor.
    middle = o.bounds.mean(0) * (1, 1, 0)
    turned = replace(o.placement, yaw=o.placement.yaw + turn)
    x, y = o.placement.apply(middle)[:2] + turned.rotation @ away - turned.apply(middle)[:2]
    place = replace(turned, x=turned.x + float(x), y=turned.y + float(y))
    cuboids = tuple(
        Cuboid(c.part, middle + factor * (c.centre - middle), factor * c.size) for c in o.cuboids
    )
    return SceneObject(label, place, cuboids)


def _one_of(rng: np.random.Generator, logs: Sequence[float]) -> int:
    """An index, drawn with the given log weights."""
    weights = np.exp(np.array(logs) - max(logs))
    return int(rng.choice(len(weights), p=weights / weights.sum()))


def _log(x: float) -> float:
    return math.log(x) if x > 0 else -math.inf
