"""States that chains visit, from which references are learnt.

At its colder temperatures a chain records scenelets, start frames, placements and camera.
Placements are recorded in camera coordinates: bearing, log depth, yaw, log size
(:mod:`imapper_prob.models.view`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_view

__all__ = ["Visits", "camera_covariance", "camera_shape"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_COLD: Final = 0.5
"""Inverse temperature above which states are recorded; chosen."""
_CAMERAS: Final = 50
"""Least number of distinct cameras for estimating their covariance: ten per parameter."""
_SINGULAR: Final = 1e10
"""Condition number above which the covariance is not used."""


@dataclass
class Visits:
    """N visited states with R scenelets in total, one state after the other.

    Parameters
    ----------
    counts : list of (n,) int
        Number of scenelets of each state.
    cameras : list of (n, 5) float
    items : list of (r, 2) int
        Scenelet and start frame.
    where : list of (r, 4) float
        Bearing (tangent), log depth (log m), yaw (radians) and log size.
    """

    counts: list[Ints] = field(default_factory=list)
    cameras: list[Array] = field(default_factory=list)
    items: list[Ints] = field(default_factory=list)
    where: list[Array] = field(default_factory=list)

    def note(self, state: State, beta: float = 1.0) -> None:
        """Add a state.

        Parameters
        ----------
        state : State
            A state with a scenelet behind the camera is ignored.
        beta : float
            Inverse temperature of the state; hot states are ignored.
        """
        if beta > _COLD and (state.placements[:, 1] > 0).all():
            self.counts.append(np.array([state.n_scenelets]))
            self.cameras.append(state.camera[None])
            self.items.append(state.items)
            self.where.append(to_view(state.placements, state.sizes))

    @property
    def n_states(self) -> int:
        """Number of states, N."""
        return sum(map(len, self.counts))

    @classmethod
    def together(cls, several: Iterable[Visits]) -> Visits:
        """Join the visits of several chains, one chain after the other.

        Parameters
        ----------
        several : iterable of Visits
            One per chain.

        Returns
        -------
        Visits
        """
        whole = cls()
        for visits in several:
            whole.counts += visits.counts
            whole.cameras += visits.cameras
            whole.items += visits.items
            whole.where += visits.where
        return whole

    def halves(self) -> tuple[Visits, Visits]:
        """Split into the first half of the states and the second.

        Returns
        -------
        Visits
        Visits
        """
        rows = self.arrays()
        states = len(rows["counts"]) // 2
        scenelets = int(rows["counts"][:states].sum())
        cut = {"counts": states, "cameras": states, "items": scenelets, "where": scenelets}
        first = {name: values[: cut[name]] for name, values in rows.items()}
        second = {name: values[cut[name] :] for name, values in rows.items()}
        return Visits.of(first), Visits.of(second)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Convert to arrays.

        Returns
        -------
        dict of str to array
            By name.
        """
        return {
            "counts": np.concatenate([np.empty(0, np.int64), *self.counts]),
            "cameras": np.concatenate([np.empty((0, 5)), *self.cameras]),
            "items": np.concatenate([np.empty((0, 2), np.int64), *self.items]),
            "where": np.concatenate([np.empty((0, 4)), *self.where]),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Visits:
        """Restore visits from :meth:`arrays`.

        Parameters
        ----------
        arrays : mapping of str to array

        Returns
        -------
        Visits
        """
        names = ("counts", "cameras", "items", "where")
        return cls(*([arrays[name]] for name in names))

    def check(self, problem: Problem) -> None:
        """Refuse visits that no chain of a problem can have recorded.

        Parameters
        ----------
        problem : Problem

        Raises
        ------
        InputError
        """
        rows = self.arrays()
        items, counts = rows["items"], rows["counts"]
        n, r = len(counts), len(items)
        shapes: dict[str, tuple[int, ...]] = {
            "counts": (n,), "cameras": (n, 5), "items": (r, 2), "where": (r, 4),
        }  # fmt: skip
        sound = all(rows[name].shape == shape for name, shape in shapes.items())
        sound = sound and items.dtype == counts.dtype == np.int64
        sound = sound and all(
            rows[name].dtype == np.float64 and bool((np.abs(rows[name]) < 1e6).all())
            for name in ("cameras", "where")
        )
        sound = sound and bool((counts >= 0).all()) and int(counts.sum()) == r
        if sound and r:
            scenelets, starts = items.T
            sound = bool(((scenelets >= 0) & (scenelets < len(problem.log_rate))).all())
            sound = sound and bool((starts >= 0).all())
            sound = sound and bool((starts + problem.lengths[scenelets] <= problem.n_frames).all())
        if not sound:
            raise InputError("visits are of no chain of this run")


def camera_covariance(visits: Visits) -> Array | None:
    """Covariance of camera and body parameters.

    Parameters
    ----------
    visits : Visits

    Returns
    -------
    (5, 5) float or None
        The covariance; None if there are too few cameras or it is nearly singular.
    """
    cameras = np.unique(visits.arrays()["cameras"], axis=0)
    if len(cameras) < _CAMERAS:
        return None
    covariance: Array = np.cov(cameras.T).astype(np.float64)
    return covariance if np.linalg.cond(covariance) < _SINGULAR else None


def camera_shape(visits: Visits) -> Array | None:
    """The lower Cholesky factor (5, 5) of :func:`camera_covariance`; None if that is None.

    Parameters
    ----------
    visits : Visits

    Returns
    -------
    (5, 5) float or None
    """
    covariance = camera_covariance(visits)
    if covariance is None:
        return None
    return np.linalg.cholesky(covariance).astype(np.float64)
