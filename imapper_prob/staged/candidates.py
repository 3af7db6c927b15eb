"""Candidates: fits judged, and the good ones refined, under the full log-posterior.

Reprojection alone cannot tell a chair from a couch. So in every window the best fits of
each kind of furniture are kept apart, judged with occlusion and intersections (the paper's
200 per maximum after motion intersection, Monszpart et al. 2019, section 5), and the best
of each kind that is still worth it is refined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.models.energy.support import unsupported
from imapper_prob.models.incremental import log_posterior_near
from imapper_prob.models.posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.staged.fit import Fits
from imapper_prob.staged.kinds import furniture_kinds

__all__ = [
    "Candidate", "ScreenSettings", "along_the_ray", "apart_from_stays", "assigned", "refine",
    "screen",
]  # fmt: skip

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ScreenSettings:
    """Parameters
    ----------
    each_kind : int
        Fits of each kind of furniture that are judged, a window.
    worth : float
        Nats by which a kind may be worse than the window's best and still be refined.
    """

    each_kind: int = 3
    worth: float = 20.0


@dataclass(frozen=True)
class Candidate:
    """A scenelet fitted to a window.

    Parameters
    ----------
    scenelet, start : int
        Index in the library, and start frame.
    placement : (3,) float
        x, y in metres, yaw in radians.
    size : float
        Log size of the person.
    gain : float
        Nats by which it alone improves on the scene without any scenelet.
    kind : tuple of int
        Categories of its objects; scenelets of one kind say the same about the furniture.
    window : int
        Index of the window it was fitted to.
    """

    scenelet: int
    start: int
    placement: Array
    size: float
    gain: float
    kind: tuple[int, ...]
    window: int


def screen(
    problem: Problem,
    fits: Fits,
    *,
    settings: ScreenSettings | None = None,
    progress: Progress | None = None,
) -> tuple[Candidate, ...]:
    """The best fits of every window and kind, with what each gains, in order of time."""
    settings = settings or ScreenSettings()
    empty = empty_state(problem)
    value = log_posterior_near(problem, empty)
    base = value(empty)
    kinds = furniture_kinds(problem)
    found: list[Candidate] = []
    for w, centre in enumerate(fits.centres.tolist()):
        judged: dict[tuple[int, ...], list[Candidate]] = {}
        for scenelet in np.argsort(fits.cost[w], kind="stable").tolist():
            own = judged.setdefault(kinds[scenelet], [])
            if len(own) == settings.each_kind or not np.isfinite(fits.cost[w, scenelet]):
                continue
            start = centre - int(problem.lengths[scenelet]) // 2
            placed = along_the_ray(problem, centre, fits.placements[w, scenelet])
            gain = value(empty.with_item(scenelet, start, *placed)) - base
            if np.isfinite(gain):
                own.append(Candidate(scenelet, start, *placed, gain, kinds[scenelet], w))
        found += _refined(problem, empty, base, judged, settings)
        if progress is not None:
            progress("judging candidates", (w + 1) / len(fits.centres))
    return tuple(found)


def _refined(
    problem: Problem,
    empty: State,
    base: float,
    judged: dict[tuple[int, ...], list[Candidate]],
    settings: ScreenSettings,
) -> list[Candidate]:
    """One window's candidates, the best of each kind with furniture refined where worth it."""
    everything = [c for own in judged.values() for c in own]
    if not everything:
        return []
    enough = max(0.0, max(c.gain for c in everything)) - settings.worth
    result = []
    for kind, own in judged.items():
        for rank, candidate in enumerate(sorted(own, key=lambda c: -c.gain)):
            if rank == 0 and kind and candidate.gain > enough:
                state = refine(problem, assigned(empty, [candidate]))
                candidate = replace(
                    candidate,
                    placement=state.placements[0],
                    size=float(state.sizes[0]),
                    gain=log_posterior(problem, state) - base,
                )
            result.append(candidate)
    return result


def assigned(state: State, members: Iterable[Candidate]) -> State:
    """The state with these candidates as well."""
    for c in members:
        state = state.with_item(c.scenelet, c.start, c.placement, c.size)
    return state


def apart_from_stays(problem: Problem, context: State) -> Callable[[Sequence[Candidate]], float]:
    """What candidates gain in a scene, where those of one stay share what it is worth.

    One scenelet holds a whole stay, and the next gains nothing by it: gains of single candidates
    would not add up. So each has its part of the stay's frames, in which its person is off their
    feet, and sums over candidates of one stay come to no more than all of it.

    Parameters
    ----------
    problem : Problem
    context : State
        The scene without them; the gain of none is 0. What it holds already is nobody's gain.
    """
    bare = problem._replace(stays=problem.stays[:0])
    held = [unsupported(stay[None], problem.lowered, context.items) == 0 for stay in problem.stays]
    stays = problem.stays[~np.array(held, dtype=bool)]
    value = log_posterior_near(bare, context)
    base = value(context)

    def share(candidate: Candidate) -> float:
        first, end = (candidate.start + problem.lowered[candidate.scenelet]).tolist()
        covered = np.minimum(stays[:, 1], end) - np.maximum(stays[:, 0], first)
        lasts = stays[:, 1] - stays[:, 0]
        return float((stays[:, 2] * np.maximum(covered, 0.0) / lasts).sum())

    def gain(members: Sequence[Candidate]) -> float:
        worth = problem.likelihood * sum(share(c) for c in members)
        return value(assigned(context, members)) - base + worth

    return gain


def along_the_ray(problem: Problem, frame: int, placement: Array) -> tuple[Array, float]:
    """The most probable of all places that look the same, and the log size it takes.

    A fit knows how large the person looks. How far away they are then depends on how large
    they are, and on how far the static path has them in that frame; both are normal.

    Parameters
    ----------
    placement : (3,) float
        Of a person of the body's own size: x, y in metres, yaw in radians.
    """
    _, _, log_focal, log_body, _ = problem.camera_mean
    apart = problem.path_centre[frame, 1] + log_focal + log_body - np.log(placement[1])
    doubt, spread = problem.path_scale[frame, 1] ** 2, problem.size_spread**2
    size = float(apart * spread / (spread + doubt))
    return placement * [np.exp(size), np.exp(size), 1.0], size


def refine(problem: Problem, state: State, *, only: Iterable[int] | None = None) -> State:
    """Placements and sizes under the full posterior, one scenelet at a time (Nelder and Mead).

    All of them one after the other, or ``only`` those with these indices.
    """
    # Of bearing, log depth, yaw, and of what a person's size leaves to the depth.
    step = np.array([0.02, 0.05, 0.15, 0.05])
    for index in range(state.n_scenelets) if only is None else only:
        value = log_posterior_near(problem, state)
        start = to_view(state.placements[index], state.sizes[index])
        start[3] -= start[1]

        def placed(theta: Array, index: int = index, state: State = state) -> State:
            placement, size = to_floor(theta + np.array([0.0, 0.0, 0.0, theta[1]]))
            return state.with_placement(index, placement, float(size))

        simplex = start + np.vstack([np.zeros(4), np.diag(step)])
        result = minimize(
            lambda theta, placed=placed, value=value: -value(placed(theta)),
            start,
            method="Nelder-Mead",
            options={"maxfev": 90, "initial_simplex": simplex},
        )
        state = placed(result.x)
    return state
