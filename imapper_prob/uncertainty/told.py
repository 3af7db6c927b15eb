"""Furniture of a draw at the places, with the sizes and with the labels that statements say.

A piece stands where its scenelet says, up to the errors of :mod:`~imapper_prob.models.kernels.
measured`, and a seat has its scenelet's label with a certain probability only. The likelihood of
statements sums both out. Here errors are drawn given the statements, normal about their most
probable values, and labels get their probabilities.
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
    measure_box,
    measure_object,
    project_outline,
    resize,
    set_errors,
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
    """The objects of a draw, with mean and covariance of their errors given statements.

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
        self._errors = [self._prior(k, 0) for k in range(len(placed))]
        self._measured: list[list[tuple[Array, Array]]] = [[] for _ in placed]
        self._placed, self._sized = np.zeros((2, len(placed)), np.bool_)

    def _prior(self, k: int, case: int) -> tuple[Array, Array]:
        mean, covariance = np.empty(ERRORS), np.empty((ERRORS, ERRORS))
        set_errors(self._boxes[k, case], self._spread, mean, covariance)
        return mean, covariance

    def _so_far(self, k: int, case: int) -> tuple[Array, Array]:
        """Mean and covariance of a piece's errors given earlier measurements."""
        if self._cases[k] == _UNDECIDED:
            return self._prior(k, case)
        mean, covariance = self._errors[k]
        return mean.copy(), covariance.copy()

    def _possible(self, shares: Array) -> list[tuple[int, int]]:
        """The cases (k, case) with a share that no earlier measurement excludes."""
        return [
            (k, case)
            for k, case in np.argwhere(shares).tolist()
            if self._cases[k] in (_UNDECIDED, case)
        ]

    def _condition(self, k: int, case: int, measured: Array, lens: Array) -> None:
        """Fix what a piece is, and condition its errors on the numbers of `measure_object`.

        These are linear in the errors to first order only, so the errors are found again about the
        piece that has the mean ones (Gauss-Newton).
        """
        before, spread = self._so_far(k, case)
        about = np.zeros(ERRORS)
        for _ in range(_PASSES):
            mean, covariance = before - about, spread.copy()
            piece, turn = self._piece(k, case, about)
            measure_object(measured, lens, self._camera, piece, turn, mean, covariance)
            about = about + mean
        self._cases[k], self._errors[k] = case, (about, covariance)
        self._measured[k].append((measured, lens))

    def _piece(self, k: int, case: int, errors: Array) -> tuple[Array, Array]:
        """Box of a piece with errors, and cosine and sine of its yaw."""
        piece = self._boxes[k, case].copy()
        piece[6] += errors[5]
        cosine, sine = math.cos(piece[6]), math.sin(piece[6])
        piece[0] += cosine * errors[0] - sine * errors[1]
        piece[1] += sine * errors[0] + cosine * errors[1]
        piece[3:6] *= np.exp(errors[2:5])
        piece[2] *= math.exp(errors[4])
        return piece, np.array([cosine, sine])

    def _draw(self, rng: np.random.Generator, k: int) -> Array:
        """Errors of a piece given all that was measured of it.

        They are one of several, in proportion to importance (Rubin 1987): of yaws from the prior,
        in which the outline is far from linear, with other errors from the normal approximation
        given the yaw.
        """
        case = int(self._cases[k])
        mean, covariance = self._prior(k, case)
        deviations = np.sqrt(np.diag(covariance))
        covariance[5], tries, logs = 0.0, np.empty((_TRIES, ERRORS)), np.empty(_TRIES)
        tries[:, 5] = deviations[5] * ndtri((np.arange(_TRIES) + rng.random(_TRIES)) / _TRIES)
        normal = rng.standard_normal((_TRIES, 5))
        nothing, sure = np.zeros(ERRORS), np.zeros((ERRORS, ERRORS))
        for i, own in enumerate(tries):
            middle, spread = self._given_yaw(k, case, np.append(mean[:5], own[5]), covariance)
            root = np.linalg.cholesky(spread[:5, :5])
            own[:5] = middle[:5] + root @ normal[i]
            logs[i] = self._log_measured(k, case, own, nothing, sure)
            logs[i] += np.log(np.diag(root)).sum()
        logs += 0.5 * (normal**2 - (tries[:, :5] / deviations[:5]) ** 2).sum(1)
        return np.asarray(tries[_one_of(rng, logs.tolist())])

    def _given_yaw(self, k: int, case: int, before: Array, spread: Array) -> tuple[Array, Array]:
        """Mean and covariance of the errors given all that was measured, as in `_condition`.

        ``before`` and ``spread`` are those without the measurements; the yaw has no spread.
        """
        about, covariance = before, spread
        for _ in range(_PASSES):
            mean, covariance = before - about, spread.copy()
            self._log_measured(k, case, about, mean, covariance)
            about = about + mean
        return about, covariance

    def _log_measured(
        self, k: int, case: int, about: Array, mean: Array, covariance: Array
    ) -> float:
        """Log density of what was measured; conditions errors, less those of ``about``, on it."""
        piece, turn = self._piece(k, case, about)
        return sum(
            measure_object(measured, lens, self._camera, piece, turn, mean, covariance)
            for measured, lens in self._measured[k]
        )

    def measure(
        self, rng: np.random.Generator, said: ObjectAt, numbers: Array, shares: Array
    ) -> None:
        """Condition the object that was measured, if any.

        ``numbers`` are those of the problem. ``shares`` (k, 1 + C) are the probabilities of the
        cases in which the objects have one of the labels.
        """
        lens = np.concatenate([self._lens, numbers[PICTURE_OF_OBJECT:][:2]])

        def agreement(k: int, case: int) -> float:
            box, turn = self._boxes[k, case], self._turns[k]
            so_far = self._so_far(k, case)
            return measure_object(numbers[SAID:], lens, self._camera, box, turn, *so_far)

        ours = self._possible(shares)
        right = probability_right(said.doubt, shares)
        logs = [
            math.log(right * shares[k, case] / shares.sum()) + agreement(k, case)
            for k, case in ours
        ]
        which = _one_of(rng, [*logs, math.log(said.doubt) + numbers[WRONG]])
        if which < len(ours):
            k, case = ours[which]
            self._condition(k, case, numbers[SAID:], lens)
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
        edges, slopes = (
            np.empty((*self._boxes.shape[:2], 5)),
            np.empty((*self._boxes.shape[:2], 4, ERRORS)),
        )
        for k, case in np.ndindex(*self._boxes.shape[:2]):
            box, turn = self._boxes[k, case], self._turns[k]
            project_outline(lens, self._camera, box, turn, edges[k, case], slopes[k, case])
        outlines = np.ascontiguousarray(edges[:, 0])
        rates = [detection_rate(said.rate, lens, outlines, k, person) for k in range(len(outlines))]
        for box, own in zip(boxes, shares, strict=True):
            ours = self._possible(own)
            logs = [
                _log(rates[k] * own[k, case])
                + measure_box(
                    box, said.std, lens, edges[k, case], slopes[k, case], *self._so_far(k, case)
                )
                for k, case in ours
            ]
            which = _one_of(rng, [*logs, math.log(said.clutter) + numbers[CLUTTER]])
            if which < len(ours):
                k, case = ours[which]
                measured = np.array([*np.zeros(7), *box, said.std])  # neither place nor size
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
            case, sized = self._cases[k], self._sized[k]
            # A place alone is linear in the errors, so the normal distribution is exact.
            errors = self._draw(rng, k) if sized else rng.multivariate_normal(*self._errors[k])
            sides = self._boxes[k, case, 3:6] / self._boxes[k, 0, 3:6]
            factor = sides * np.exp(errors[2:5]) if sized else np.ones(3)
            label = placed[k].label if case == 0 else names[case - 1]
            turn = float(errors[5]) if sized else 0.0
            result[k] = _with_errors(placed[k], label, errors[:2], factor, turn)
        return tuple(result)


_PASSES: Final = 3
"""Gauss-Newton steps; a test compares their result with least squares until convergence."""
_TRIES: Final = 24
"""Draws of which one is kept; their yaws are in steps of some .04 rad about the middle."""
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
