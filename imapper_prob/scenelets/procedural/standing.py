"""Standing about, working at a table and reaching into a shelf."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.scenelets.procedural.body import (
    ANKLE_HEIGHT,
    FOREARM,
    HIP_HEIGHT,
    SIDES,
    UPPER_ARM,
    Trunk,
    hanging_wrists,
    pose_body,
    reachable_height,
)
from imapper_prob.scenelets.procedural.gait import minimum_jerk

__all__ = ["reach_and_hold", "stand_idle"]

Array = NDArray[np.float64]


def _feet(rng: np.random.Generator, n_frames: int) -> Array:
    apart = rng.uniform(0.09, 0.15)
    ahead = rng.uniform(-0.04, 0.04)
    ankles = np.stack([SIDES * apart, SIDES * ahead, np.full(2, ANKLE_HEIGHT)], -1)
    return np.broadcast_to(ankles, (n_frames, 2, 3))


def _sway(rng: np.random.Generator, times: Array) -> Array:
    """(n, 2) slow shifts of weight: 1 cm sideways and half of that to and fro."""
    slow = 2 * np.pi * (times / rng.uniform(2.5, 5.0) + rng.random())
    return np.stack([0.010 * np.sin(slow), 0.005 * np.sin(1.3 * slow + 1)], -1)


def stand_idle(rng: np.random.Generator, times: Array) -> Array:
    """(n, 16, 3) joints of somebody who stands and waits, arms hanging, metres."""
    ankles = _feet(rng, len(times))
    pelvis = np.zeros((len(times), 3))
    pelvis[:, :2] = _sway(rng, times)
    trunk = Trunk.of(pelvis, 0.0, lean=rng.uniform(0.0, 0.06), nod=rng.uniform(0.0, 0.2))
    pelvis[:, 2] = np.minimum(HIP_HEIGHT, reachable_height(trunk, ankles))
    wrists = hanging_wrists(trunk, rng.uniform(-0.05, 0.2), bend=rng.uniform(0.04, 0.12))
    return pose_body(trunk, ankles=ankles, wrists=wrists)


def _posture(pelvis: Array, lean: Array, crouch: Array, ankles: Array) -> Trunk:
    """The trunk at a lean, with the hips drawn back so that the weight stays over the feet."""
    hips = pelvis.copy()
    hips[:, 1] -= 0.18 * np.sin(lean) + 0.22 * crouch
    trunk = Trunk.of(hips, 0.0, lean=lean, nod=0.1 - 0.4 * lean)
    hips[:, 2] = np.minimum(HIP_HEIGHT, reachable_height(trunk, ankles)) - crouch
    return trunk


def reach_and_hold(
    rng: np.random.Generator,
    times: Array,
    *,
    target: ArrayLike,
    hands: ArrayLike = (True, True),
    start: float = 0.0,
    finish: float | None = None,
    travel: float = 0.8,
) -> Array:
    """(n, 16, 3) joints of somebody who stands and reaches for something, metres.

    The trunk leans, and for low targets the knees bend, just as far as the arms need.

    Parameters
    ----------
    rng : numpy.random.Generator
    times : (n,) float
        Seconds.
    target : (2, 3) float
        Where the right and the left wrist go; the feet are about the origin, facing +y.
    hands : (2,) bool
        Which hands reach; the other hangs.
    start : float
        When the hands set off, seconds; before the first time for hands already there.
    finish : float, optional
        When they set off back; never, if not given.
    travel : float
        Seconds that the way takes.
    """
    target, hands = np.asarray(target, float), np.asarray(hands, bool)
    n = len(times)
    away = minimum_jerk((times - start) / travel)
    if finish is not None:
        away = away * (1 - minimum_jerk((times - finish) / travel))
    ankles = _feet(rng, n)
    pelvis = np.zeros((n, 3))
    pelvis[:, :2] = _sway(rng, times)
    lean, crouch = _effort(ankles[:1], target[hands])
    trunk = _posture(pelvis, 0.03 + away * lean, away * crouch, ankles)
    hanging = hanging_wrists(trunk, rng.uniform(0.0, 0.15))
    work = np.zeros((n, 1, 3))
    work[:, 0, 0] = 0.02 * np.sin(2 * np.pi * times / rng.uniform(1.5, 3.0))
    part = away[:, None, None] * hands[:, None]
    # On the way the hand keeps clear of what it reaches for by rising first.
    arch = 0.10 * np.sin(np.pi * part) * np.array([0.0, -1.0, 0.6])
    wrists = hanging + part * (target + work - hanging) + arch
    return pose_body(trunk, ankles=ankles, wrists=wrists)


def _effort(ankles: Array, targets: Array) -> tuple[float, float]:
    """Least lean (rad) and crouch (m) that bring targets (k, 3) into comfortable reach."""
    comfortable = 0.93 * (UPPER_ARM + FOREARM)
    crouches, leans = np.linspace(0.0, 0.45, 10), np.linspace(0.0, 1.1, 23)
    best, effort = np.inf, (0.0, 0.0)
    for crouch in crouches:
        for lean in leans:
            trunk = _posture(np.zeros((1, 3)), np.array([lean]), np.array([crouch]), ankles)
            gap = np.linalg.norm(trunk.shoulders[0][:, None] - targets, axis=-1).min(0).max()
            # A metre out of reach outweighs any posture; knees are spared before the back.
            cost = 20 * max(gap - comfortable, 0.0) + 0.5 * lean + crouch
            if cost < best:
                best, effort = cost, (float(lean), float(crouch))
    return effort
