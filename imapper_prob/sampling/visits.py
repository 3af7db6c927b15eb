"""What a chain has visited while it burns in, and the table of scenelets that is made of it.

What a scenelet is worth depends on the others of the scene: alone in the clip the best of a
window are other ones than those in which a chain stays. So a chain notes at all its
temperatures which scenelet stands when and where. Its table has each of these, and the same
a frame or two earlier and later, with how often it was met and where it stood on average. One
covariance serves all, for what leaves a place open is the same camera and detector everywhere.

Places are noted and drawn as they look: bearing, log depth, yaw and log size, carried from one
camera to another (:mod:`imapper_prob.sampling.camera_moves`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State, empty_state, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_view
from imapper_prob.sampling.camera_moves import middle_heights
from imapper_prob.sampling.pool_kernels import Table, carry

__all__ = ["Visits", "camera_shape", "table_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_COLD: Final = 0.5
"""Power above which a visit counts for the sharp weights; chosen."""
_SELDOM: Final = 0.02
"""Visits that a scenelet counts for the sharp weights which was met at lower powers only,
chosen."""
_SHIFTS: Final = {0: 0.6, -1: 0.15, 1: 0.15, -2: 0.05, 2: 0.05}
"""Frames by which a scenelet is tried earlier or later than it was met, and how often; chosen."""
_CAMERAS: Final = 50
"""Cameras from which on their covariance is taken: ten for each of its five numbers."""
_SINGULAR: Final = 1e10
"""Condition number of a covariance from which on it is not taken."""
_OFTEN: Final = 3
"""Visits of one scenelet from which on they tell how places scatter; chosen."""
_LEAST: Final = np.array([0.002, 0.01, 0.03, 0.01])
"""Standard deviations of bearing (tangent), log depth, yaw (radians) and log size below which
none is taken to scatter, and by which all scatter where hardly any was met twice; chosen, a few
times less than they scatter on the demo."""


@dataclass
class Visits:
    """Rows of what was visited: in each one scenelet of one state.

    Parameters
    ----------
    items : list of (k, 2) int
        Scenelet and start frame.
    where : list of (k, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size.
    cameras : list of (k, 5) float
    powers : list of (k,) float
        Of the likelihood, where the state was.
    """

    items: list[Ints] = field(default_factory=list)
    where: list[Array] = field(default_factory=list)
    cameras: list[Array] = field(default_factory=list)
    powers: list[Array] = field(default_factory=list)

    def note(self, state: State, power: float) -> None:
        """Add the scenelets of a state."""
        if state.n_scenelets and (state.placements[:, 1] > 0).all():
            self.items.append(state.items)
            self.where.append(to_view(state.placements, state.sizes))
            self.cameras.append(np.tile(state.camera, (state.n_scenelets, 1)))
            self.powers.append(np.full(state.n_scenelets, power))

    @classmethod
    def together(cls, several: Iterable[Visits]) -> Visits:
        """The rows of several chains, one chain after the other."""
        whole = cls()
        for visits in several:
            whole.items += visits.items
            whole.where += visits.where
            whole.cameras += visits.cameras
            whole.powers += visits.powers
        return whole

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All rows as arrays."""
        return {
            "items": np.concatenate([np.empty((0, 2), np.int64), *self.items]),
            "where": np.concatenate([np.empty((0, 4)), *self.where]),
            "cameras": np.concatenate([np.empty((0, 5)), *self.cameras]),
            "powers": np.concatenate([np.empty(0), *self.powers]),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Visits:
        """The rows that :meth:`arrays` gave."""
        return cls(*([arrays[name]] for name in ("items", "where", "cameras", "powers")))

    def check(self, problem: Problem) -> None:
        """Refuse rows that no chain of a problem can have noted.

        Raises
        ------
        InputError
        """
        rows = self.arrays()
        items = rows["items"]
        n = len(items)
        shapes: dict[str, tuple[int, ...]] = {
            "items": (n, 2), "where": (n, 4), "cameras": (n, 5), "powers": (n,),
        }  # fmt: skip
        sound = all(rows[name].shape == shape for name, shape in shapes.items())
        sound &= items.dtype == np.int64
        sound &= all(
            rows[name].dtype == np.float64 and bool((np.abs(rows[name]) < 1e6).all())
            for name in ("where", "cameras", "powers")
        )
        if sound and len(items):
            sound = bool(((items[:, 0] >= 0) & (items[:, 0] < len(problem.log_rate))).all())
            sound = sound and bool((items[:, 1] >= 0).all())
            sound = sound and bool(
                (items[:, 1] + problem.lengths[items[:, 0]] <= problem.n_frames).all()
            )
        if not sound:
            raise InputError("visits are of no chain of this run")


def camera_shape(visits: Visits) -> Array | None:
    """How camera and body scatter at the colder temperatures.

    Parameters
    ----------
    visits : Visits

    Returns
    -------
    (5, 5) float or None
        Lower Cholesky factor of their covariance; None where that is not known.
    """
    rows = visits.arrays()
    # A state has as many rows as scenelets, one camera for all.
    cameras = np.unique(rows["cameras"][rows["powers"] > _COLD], axis=0)
    if len(cameras) < _CAMERAS:
        return None
    covariance = np.cov(cameras.T)
    if not np.linalg.cond(covariance) < _SINGULAR:
        return None
    factor: Array = np.linalg.cholesky(covariance)
    return factor


class _Met(NamedTuple):
    """K scenelets at starts that were met, each once."""

    items: Ints
    where: Array
    visits: Array
    cold: Array
    factor: Array


def table_of(problem: Problem, visits: Visits) -> Table:
    """The table of what was visited.

    Parameters
    ----------
    problem : Problem
    visits : Visits

    Returns
    -------
    Table
    """
    heights = np.array(middle_heights(problem))
    met = _met(problem, visits, heights)
    sharp: dict[tuple[int, int], float] = {}
    flat: dict[tuple[int, int], float] = {}
    nearest: dict[tuple[int, int], tuple[float, int]] = {}
    for row, (scenelet, start) in enumerate(met.items.tolist()):
        for shift, share in _SHIFTS.items():
            key = start + shift, scenelet
            sharp[key] = sharp.get(key, 0.0) + share * (met.cold[row] + _SELDOM)
            flat[key] = flat.get(key, 0.0) + share * math.sqrt(met.visits[row])
            nearest[key] = max(nearest.get(key, (0.0, 0)), (share * met.visits[row], row))
    film = np.cumsum(problem.path_starts).astype(np.int64)
    keys = sorted(key for key in nearest if _fits(problem, film, *key))
    items = np.array([(scenelet, start) for start, scenelet in keys], np.int64).reshape(-1, 2)
    starts = np.ascontiguousarray(items[:, 1])
    return Table(
        items=items,
        ends=starts + problem.lengths[items[:, 0]],
        starting=np.searchsorted(starts, np.arange(problem.n_frames + 2)),
        where=np.array([met.where[nearest[key][1]] for key in keys]).reshape(-1, 4),
        heights=heights[items[:, 0]],
        sharp=np.array([sharp[key] for key in keys]),
        flat=np.array([flat[key] for key in keys]),
        factor=met.factor,
        film=film,
        loose=np.ascontiguousarray(motion(problem, empty_state(problem)).transpose(0, 2, 1)),
    )


def _fits(problem: Problem, film: Ints, start: int, scenelet: int) -> bool:
    """Whether a scenelet lies in the film of one person."""
    end = start + int(problem.lengths[scenelet])
    return start >= 0 and end <= problem.n_frames and bool(film[start] == film[end - 1])


def _met(problem: Problem, visits: Visits, heights: Array) -> _Met:
    rows = visits.arrays()
    items = rows["items"]
    where = carry(
        heights[items[:, 0]], rows["where"], rows["cameras"], np.array(problem.camera_mean)
    )
    seen = np.isfinite(where).all(1)
    items, where, powers = items[seen], where[seen], rows["powers"][seen]
    found, first, of, count = np.unique(
        items, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    of = of.ravel()
    # Yaws within half a turn of the first one of the same scenelet.
    yaw = where[first, 2][of]
    where[:, 2] = yaw + np.remainder(where[:, 2] - yaw + np.pi, 2 * np.pi) - np.pi
    total = np.stack([np.bincount(of, column, len(found)) for column in where.T], -1)
    mean = total / count[:, None]
    often = count[of] >= _OFTEN
    off = (where - mean[of])[often]
    free = int(often.sum() - (count >= _OFTEN).sum())
    covariance = np.diag(_LEAST**2)
    if free > 0:
        covariance = covariance + off.T @ off / free
    cold = np.bincount(of, (powers > _COLD).astype(float), len(found)).astype(float)
    return _Met(found, mean, count.astype(float), cold, np.linalg.cholesky(covariance))
