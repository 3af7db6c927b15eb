from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imapper_prob.staged.candidates import screen
from imapper_prob.staged.facing import Facing
from imapper_prob.staged.fit import fit_windows
from tests.staged.test_solver import PLACE, performed

START = 6
"""Frame from which the scenelet is performed."""


def test_facing_as_the_path_does_is_worth_more_the_nearer() -> None:
    problem, path, _ = performed()
    facing = Facing.of_path(problem, path, fps=10.0)
    off = np.radians([0.0, 10.0, 40.0, 90.0, 180.0])
    worth = [facing.nats(0, START, PLACE[2] + angle) for angle in off]
    assert worth == sorted(worth, reverse=True)
    assert worth[0] > 0 > worth[2]


def test_a_full_turn_changes_nothing() -> None:
    problem, path, _ = performed()
    facing = Facing.of_path(problem, path, fps=10.0)
    assert facing.nats(0, START, 0.3 + 2 * np.pi) == pytest.approx(facing.nats(0, START, 0.3))


def test_true_errors_are_neither_paid_nor_charged() -> None:
    """A scenelet that faces as true ones do gains nothing on average: 4 standard errors."""
    problem, path, _ = performed()
    facing = Facing.of_path(problem, path, fps=10.0)
    rng = np.random.default_rng(0)
    n = len(facing.within[0])
    flat = replace(facing, within=(np.zeros(n), *facing.within[1:]), weight=1.0)
    worth = []
    for _ in range(4000):
        error = flat.scale[:n] * rng.standard_t(flat.dof[:n])
        # Angles fold over: the few errors beyond half a turn are what the tolerance adds.
        shown = replace(flat, yaw=np.concatenate([error, flat.yaw[n:]]))
        worth.append(shown.nats(0, 0, 0.0))
    assert abs(np.mean(worth)) < 4 * np.std(worth) / np.sqrt(len(worth)) + 0.05 * n


def test_filled_poses_say_less() -> None:
    problem, path, _ = performed()
    own = Facing.of_path(problem, replace(path, posed=np.ones_like(path.posed)), fps=10.0)
    filled = Facing.of_path(problem, replace(path, posed=np.zeros_like(path.posed)), fps=10.0)
    away = PLACE[2] + np.radians(30)
    assert own.nats(0, START, away) < filled.nats(0, START, away)


def test_it_is_part_of_what_a_candidate_gains() -> None:
    problem, path, _ = performed()
    fits = fit_windows(problem, path, fps=10.0)
    facing = Facing.of_path(problem, path, fps=10.0)
    mute = replace(facing, weight=0.0)
    for told, bare in zip(screen(problem, fits, facing), screen(problem, fits, mute), strict=True):
        assert bare.facing == 0.0
        assert told.facing == facing.nats(told.scenelet, told.start, float(told.placement[2]))
