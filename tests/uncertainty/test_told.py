"""Furniture of a draw as measured: places, sides and yaws have the conditional distribution."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import norm

import imapper_prob as im
from imapper_prob.layouts import placed_objects
from imapper_prob.models.log_posterior import State, camera_at, empty_state
from imapper_prob.models.problem import Problem, label_kinds, labels_of
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.settings import SIDE_SPREAD, ModelSettings
from imapper_prob.models.statement_rows import tell
from imapper_prob.models.statements import Statement
from imapper_prob.uncertainty.estimate import drawn_objects
from imapper_prob.uncertainty.told import as_told, label_shares
from tests.models import worlds

SETTINGS = ModelSettings(likelihood=0.0)
DRAWS = 1000
PIECES = (worlds.couch(-0.7, 6.0, 0.7), worlds.couch(1.2, 7.0, -0.4, label="chair"))
"""Far enough to be in the picture as a whole."""
CERTAIN = np.zeros(2)
"""Probabilities of labels by chance: every piece is what its scenelet calls it."""


@cache
def problem() -> Problem:
    return worlds.problem(12, settings=SETTINGS, scenelets=worlds.library())


@cache
def state() -> State:
    return empty_state(problem())


def asked_of(kinds: np.ndarray | None, said: tuple[Statement, ...]) -> Problem:
    """The problem with statements, and with other probabilities of labels by chance if given."""
    clip = worlds.clip_of(worlds.walk(12, depth=9.0), np.random.default_rng(0))
    asked = tell(problem(), said, clip, labels_of(worlds.library()))
    return asked if kinds is None else asked._replace(label_chance=kinds)


def told(
    rng: np.random.Generator, *said: Statement, kinds: np.ndarray | None = CERTAIN
) -> list[tuple[SceneObject, ...]]:
    """The pieces as measured, many times; they are what their scenelets call them."""
    asked = asked_of(kinds, said)
    camera = camera_at(worlds.CAMERA, state().camera)
    return [
        as_told(
            rng, PIECES, drawn_objects(rng, PIECES, SETTINGS), said,
            problem=asked, names=labels_of(worlds.library()), state=state(), camera=camera,
        )
        for _ in range(DRAWS)
    ]  # fmt: skip


def errors_of(o: SceneObject, piece: SceneObject) -> np.ndarray:
    """How far a drawn piece is from that of the scenelet: along, ahead (m), logs of sides, yaw."""
    x, y = (o.centre - piece.centre)[:2] @ o.placement.rotation
    sides = np.log(np.diff(o.bounds, axis=0)[0] / np.diff(piece.bounds, axis=0)[0])
    return np.array([x, y, *sides, o.placement.yaw - piece.placement.yaw])


def box_of(o: SceneObject) -> np.ndarray:
    camera = camera_at(worlds.CAMERA, state().camera)
    corners = np.array(list(product(*zip(*o.bounds, strict=True))))
    pixels = camera.project(o.placement.apply(corners))
    return np.concatenate([pixels.min(0), pixels.max(0)])


def prior(piece: SceneObject) -> np.ndarray:
    width = np.diff(piece.bounds, axis=0)[0, 0]
    aside = SETTINGS.furniture_aside * width
    ahead, yaw = SETTINGS.furniture_ahead, SETTINGS.furniture_yaw
    return np.diag(np.square([aside, ahead, *[SIDE_SPREAD] * 3, yaw]))


def conditional(
    piece: SceneObject, measured: Callable[[SceneObject], np.ndarray], said: object, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the errors given a measurement of the exact piece.

    By importance sampling: yaws of the prior, and others about the most probable ones given these.
    """
    rng, deviations = np.random.default_rng(0), np.sqrt(np.diag(prior(piece)))
    tries: list[np.ndarray] = []
    logs: list[float] = []
    for yaw in deviations[5] * norm.ppf((np.arange(100) + 0.5) / 100):

        def residuals(errors: np.ndarray, yaw: float = yaw) -> np.ndarray:
            off = measured(worlds.with_errors(piece, np.append(errors, yaw))) - np.asarray(said)
            return np.concatenate([off / noise, errors / deviations[:5]])

        found = least_squares(residuals, np.zeros(5), jac="3-point", xtol=1e-9)
        root = 1.2 * np.linalg.cholesky(np.linalg.inv(found.jac.T @ found.jac))
        for normal in rng.standard_normal((DRAWS // 5, 5)):
            errors = found.x + root @ normal
            tries.append(np.append(errors, yaw))
            squares = (normal**2).sum() - (residuals(errors) ** 2).sum()
            logs.append(squares / 2 + np.log(np.diag(root)).sum())
    weights, tried = np.exp(np.array(logs) - max(logs)), np.array(tries)
    weights /= weights.sum()
    # The error of these moments adds little to that of the draws that are compared.
    assert 1 / (weights**2).sum() > 4 * DRAWS
    mean = weights @ tried
    return mean, (tried - mean).T * weights @ (tried - mean)


def place_of(o: SceneObject) -> np.ndarray:
    return o.centre[:2]


def size_of(o: SceneObject) -> np.ndarray:
    return np.diff(o.bounds, axis=0)[0]


def has(errors: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether draws have this mean and covariance, both up to four standard errors."""
    deviations = np.sqrt(np.diag(covariance))
    centred = np.abs(errors.mean(0) - mean) < 4 * deviations / np.sqrt(len(errors)) + 1e-12
    products = np.sqrt((np.outer(deviations, deviations) ** 2 + covariance**2) / len(errors))
    return bool(centred.all() and (np.abs(np.cov(errors.T) - covariance) < 4 * products).all())


def test_a_measured_place_moves_a_piece_and_leaves_its_sides(rng: np.random.Generator) -> None:
    piece, other = PIECES
    said = im.ObjectAt("couch", place=(-0.6, 6.2), place_std=0.15, doubt=1e-12)
    found = told(rng, said)
    mean, covariance = conditional(piece, place_of, said.place, said.place_std)
    errors = np.array([errors_of(o, piece) for o, _ in found])
    assert has(errors[:, :2], mean[:2], covariance[:2, :2])
    np.testing.assert_allclose(errors[:, 2:], 0.0, atol=1e-12)
    # What was not measured is displaced as without a statement.
    assert has(
        np.array([errors_of(o, other) for _, o in found])[:, :2], np.zeros(2), prior(other)[:2, :2]
    )


def test_a_measured_size_gives_the_sides(rng: np.random.Generator) -> None:
    piece = PIECES[0]
    said = im.ObjectAt("couch", size=(1.8, 0.7, 1.0), size_std=0.1, doubt=1e-12)
    expected = conditional(piece, size_of, said.size, said.size_std)
    assert has(np.array([errors_of(o, piece) for o, _ in told(rng, said)]), *expected)


@pytest.mark.parametrize("detector", [False, True])
def test_a_box_in_the_picture_gives_place_and_sides(
    rng: np.random.Generator, detector: bool
) -> None:
    piece, other = PIECES
    # Half as large again: far from where the box is linear in the errors of the piece.
    box = tuple(
        box_of(worlds.with_errors(piece, np.array([0.1, 0.2, 0.4, 0.4, 0.4, 0.2]))).tolist()
    )
    away = (5.0, 5.0, 90.0, 60.0)
    said = (
        im.Seen(2, (box, away), ({"couch": 1.0}, {"couch": 1.0}), std=10.0, clutter=1e-9)
        if detector
        else im.ObjectAt("couch", box=box, box_std=10.0, doubt=1e-12)
    )
    found = told(rng, said)
    expected = conditional(piece, box_of, box, 10.0)
    assert has(np.array([errors_of(o, piece) for o, _ in found]), *expected)
    # The pieces that are drawn are about where the box is, though none of the scenelet's is.
    boxes = np.mean([box_of(o) for o, _ in found], axis=0)
    assert np.abs(boxes - box).max() < 8.0
    sides = np.array([errors_of(o, other) for _, o in found])[:, 2:]
    np.testing.assert_allclose(sides, 0.0, atol=1e-12)


def test_a_box_of_one_of_two_pieces_goes_to_either(rng: np.random.Generator) -> None:
    """By the probabilities of agreement, the detector's confusion included."""
    box = tuple(((box_of(PIECES[0]) + box_of(PIECES[1])) / 2).tolist())
    logs, variance = [], 0.0
    for named in ({"couch": 0.3, "chair": 0.6}, {"couch": 0.6, "chair": 0.3}):
        said = im.Seen(2, (box,), (named,), std=400.0, clutter=1e-9)
        share = 1.0 - first_is_measured(told(rng, said))
        logs.append(np.log(share / (1.0 - share)))
        variance += 1.0 / (DRAWS * share * (1.0 - share))
    # The odds of the chair are multiplied by 2 or by a half.
    assert logs[0] - logs[1] == pytest.approx(np.log(4.0), abs=4 * np.sqrt(variance))


def test_a_piece_does_not_stand_between_two_boxes(rng: np.random.Generator) -> None:
    """The second box is compared with the piece as the first one left it."""
    piece = PIECES[0]
    left, right = (
        box_of(worlds.with_errors(piece, np.array([aside, 0, 0, 0, 0, 0]))) for aside in (-0.3, 0.3)
    )
    assert np.abs(left - right).max() > 100.0
    boxes = (tuple(left.tolist()), tuple(right.tolist()))
    said = im.Seen(2, boxes, ({"couch": 1.0}, {"couch": 1.0}), std=10.0)
    for o, _ in told(rng, said)[:200]:
        away = [np.abs(box_of(o) - box).max() for box in (left, right)]
        assert min(away) < 50.0


def first_is_measured(found: list[tuple[SceneObject, ...]]) -> float:
    """How often the first piece has other sides than in its scenelet, and never both or none."""
    changed = np.array(
        [
            [bool(np.abs(errors_of(o, p)[2:]).max() > 1e-9) for o, p in zip(d, PIECES, strict=True)]
            for d in found
        ]
    )
    assert np.all(changed.sum(1) == 1)
    return float(changed[:, 0].mean())


def test_a_measured_couch_may_be_a_chair_in_its_scenelet(rng: np.random.Generator) -> None:
    """Which piece was measured is drawn with its probability of being a couch."""
    size = im.ObjectAt("couch", size=(1.6, 0.8, 0.95), size_std=9.0, doubt=1e-12)
    couch, chair = label_kinds(problem())[[1, 0], 1].tolist()
    assert couch > chair > 0
    # A size this inexact tells nothing.
    found = first_is_measured(told(rng, size, kinds=None))
    assert found == pytest.approx(couch / (couch + chair), abs=4 * 0.5 / np.sqrt(DRAWS))
    # A detector that confuses the two as often as the scenelets do says as much.
    box = tuple(((box_of(PIECES[0]) + box_of(PIECES[1])) / 2).tolist())
    sure, confused = (
        im.Seen(2, (box,), (labels,), std=400.0, clutter=1e-12)
        for labels in ({"couch": 1.0}, {"couch": couch, "chair": chair})
    )
    found = first_is_measured(told(rng, sure, kinds=None))
    expected = first_is_measured(told(rng, confused))
    assert found == pytest.approx(expected, abs=4 * 0.5 * np.sqrt(2 / DRAWS))


def test_each_object_has_the_labels_that_statements_leave() -> None:
    names = labels_of(worlds.library())
    assert names == ["chair", "couch"]
    two = state().with_item(0, 0, np.array([-0.7, 6.0, 0.7])).with_item(
        2, 6, np.array([1.2, 7.0, -0.4])
    )  # fmt: skip
    placed = [o for _, o in placed_objects(two, worlds.library())]
    kinds = label_kinds(problem())
    bare = label_shares(placed, problem=problem(), names=names, state=two)
    assert bare == tuple(
        pytest.approx(dict(zip(names, kinds[names.index(o.label)], strict=True))) for o in placed
    )
    asked = asked_of(None, (im.Presence("chair", there=False, doubt=1e-9),))
    shares = label_shares(placed, problem=asked, names=names, state=two)
    assert all(own["couch"] == pytest.approx(1.0, abs=1e-6) for own in shares)
    # In another order, and with another object, which is not there twice.
    again = label_shares(placed[1:], problem=asked, names=names, state=two)
    assert again == (pytest.approx(shares[1]),)
    assert label_shares([], problem=asked, names=names, state=state()) == ()


def test_place_size_and_box_together_turn_a_piece(rng: np.random.Generator) -> None:
    piece = PIECES[0]
    true = worlds.with_errors(piece, np.array([0.1, 0.1, 0.1, -0.1, 0.1, 0.3]))
    place, size, box = (tuple(f(true).tolist()) for f in (place_of, size_of, box_of))
    said = im.ObjectAt(
        "couch", place=place, place_std=0.1, size=size, size_std=0.1, box=box, box_std=10.0,
        doubt=1e-12,
    )  # fmt: skip
    exact = conditional(
        piece, lambda o: np.concatenate([100 * place_of(o), 100 * size_of(o), box_of(o)]),
        np.concatenate([100 * place_of(true), 100 * size_of(true), box_of(true)]), 10.0,
    )  # fmt: skip
    assert has(np.array([errors_of(o, piece) for o, _ in told(rng, said)]), *exact)


def test_measurements_that_contradict_each_other_are_drawn(rng: np.random.Generator) -> None:
    """Far from any piece that the scenelet makes probable, a draw still has finite errors."""
    piece = worlds.couch(-0.56, 3.07, -1.58)
    said = im.ObjectAt(
        "couch", place=(-0.1441, 3.1656), place_std=0.005, box=(425.8, 696.3, 1170.4, 1080.0),
        box_std=1.0,
    )  # fmt: skip
    asked = asked_of(CERTAIN, (said,))
    camera = camera_at(worlds.CAMERA, state().camera)
    for _ in range(20):
        (o,) = as_told(
            rng, (piece,), (piece,), (said,),
            problem=asked, names=labels_of(worlds.library()), state=state(), camera=camera,
        )  # fmt: skip
        assert np.abs(errors_of(o, piece)).max() < 2.0


@pytest.mark.parametrize("detector", [False, True])
def test_a_couch_of_a_scenelet_is_the_chair_that_was_measured(
    rng: np.random.Generator, detector: bool
) -> None:
    """It has the sides of a chair, up to the errors of the measurement, and its label."""
    piece, narrow = PIECES[0], np.array([0.5, 0.55, 0.9])
    sides = np.log([narrow, [1.6, 0.8, 0.95]])
    assert labels_of(worlds.library()) == ["chair", "couch"]
    there = np.append(piece.centre[:2], narrow[2] / 2)
    chair = SceneObject("chair", piece.placement, (Cuboid("all", there - (*there[:2], 0), narrow),))
    chair = chair.moved(Placement(*(piece.centre - chair.centre)[:2].tolist(), 0.0))
    said = (
        im.Seen(2, (tuple(box_of(chair).tolist()),), ({"chair": 1.0},), std=8.0, clutter=1e-9)
        if detector
        else im.ObjectAt("chair", place=tuple(piece.centre[:2]), place_std=0.1,
                         size=tuple(narrow.tolist()), size_std=0.05, doubt=1e-12)
    )  # fmt: skip
    asked = asked_of(None, (said,))._replace(label_sides=sides)
    camera = camera_at(worlds.CAMERA, state().camera)
    found = [
        as_told(
            rng, PIECES[:1], PIECES[:1], (said,),
            problem=asked, names=["chair", "couch"], state=state(), camera=camera,
        )[0]
        for _ in range(400)
    ]  # fmt: skip
    assert {o.label for o in found} == {"chair"}
    drawn = np.array([np.diff(o.bounds, axis=0)[0] for o in found])
    assert np.abs(drawn.mean(0) / narrow - 1).max() < 0.12
    off = np.array([o.centre[:2] for o in found]) - piece.centre[:2]
    assert np.abs(off.mean(0)).max() < 0.1
    assert all(o.bounds[0, 2] == pytest.approx(0.0) for o in found)
