"""Combinations of candidates: best-first search, evaluation by log-posterior, refinement.

The score of a combination S has a part for each member and one for each pair,

    Q(S) = sum_{c in S} gain_c + sum_{pairs in S} together_cd,

where ``together`` is the additional gain of a pair (-inf if it is impossible). Combinations are
generated in descending order of Q, and only as many as are wanted.

*The bound.* Suppose the first groups are decided, with members S. A member c of an open group would
add r_c = gain_c + sum_{d in S} together_cd to S. Any completion R has

    Q(S + R) - Q(S) = sum_{c in R} r_c + sum_{pairs in R} together_cd.

Split its pairs into those of neighbouring groups and the others. A pair of the latter kind with c
in the earlier group adds at most max(0, max over the members d of the later group of together_cd).
Over all later groups these sum to at most o_c, whether or not R has members there. So

    Q(S + R) <= Q(S) + max over R of [ sum_{c in R} (r_c + o_c) + sum_{neighbours in R} together ],

and dynamic programming finds the maximum on the right exactly, because it is over a chain of
groups. So no combination is discarded that could still be better: the bound is admissible. For a
complete combination the bound is Q itself, so a complete combination taken from the queue is the
best of all that remain.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.log_posterior import (
    State,
    empty_state,
    log_posterior,
    log_posterior_near,
)
from imapper_prob.models.problem import Problem
from imapper_prob.models.text import Listed, brief
from imapper_prob.models.view import to_floor, to_view
from imapper_prob.progress import Progress
from imapper_prob.solver.candidates import (
    Candidate,
    CharnessCurve,
    apart_from_stays,
    assigned,
    refine,
)
from imapper_prob.solver.sequences import Exchange, exchange

__all__ = [
    "Combination",
    "Combinations",
    "best_first",
    "bound",
    "combine",
    "groups_of",
    "polish",
    "search",
    "state_of",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def best_first(
    groups: Sequence[Ints], gain: Array, together: Array
) -> Iterator[tuple[tuple[int, ...], float]]:
    """Generate all possible combinations with their scores Q, the best first.

    Parameters
    ----------
    groups : sequence of (k,) int
        Members of each group, as indices in ``gain``; a combination has at most one of each group.
    gain : (N,) float
    together : (N, N) float
        Symmetric; -inf for impossible pairs.

    Yields
    ------
    members : tuple of int
        In the order of the groups.
    score : float
    """
    others = _optimistic(groups, together)
    order = count()  # among equal bounds the one found first, for a deterministic order
    queue: list[tuple[float, int, int, tuple[int, ...], float, Array]] = []

    def push(decided: int, members: tuple[int, ...], score: float, added: Array) -> None:
        best = score + bound(groups[decided:], added + others, together)
        heapq.heappush(queue, (-best, next(order), decided, members, score, added))

    push(0, (), 0.0, np.asarray(gain, float))
    while queue:
        _, _, decided, members, score, added = heapq.heappop(queue)
        if decided == len(groups):
            yield members, score
            continue
        push(decided + 1, members, score, added)
        for c in groups[decided].tolist():
            if np.isfinite(added[c]):
                push(decided + 1, (*members, c), score + float(added[c]), added + together[c])


def bound(groups: Sequence[Ints], added: Array, together: Array) -> float:
    """Upper bound of what a chain of groups can add, with pairs of neighbouring groups only.

    Parameters
    ----------
    groups : sequence of (k,) int
    added : (N,) float
        What each member adds alone.
    together : (N, N) float

    Returns
    -------
    float
        Nats.
    """
    best = np.zeros(1)  # by the member taken of the last group; the first entry is none
    last = np.empty(0, dtype=np.int64)
    for group in groups:
        pairs = np.zeros((1 + len(last), 1 + len(group)))
        pairs[1:, 1:] = together[np.ix_(last, group)]
        best = (best[:, None] + pairs).max(0) + np.concatenate([[0.0], added[group]])
        last = group
    return float(best.max())


def _optimistic(groups: Sequence[Ints], together: Array) -> Array:
    """(N,) o_c: upper bound of a member's pairs with later groups, except the next one."""
    result = np.zeros(len(together))
    for position, group in enumerate(groups):
        for later in groups[position + 2 :]:
            if len(group) and len(later):
                result[group] += together[np.ix_(group, later)].max(1).clip(min=0.0)
    return result


# ------------------------------------------------------------------------------------------------
# Refinement of a whole scene.
#
# Scenelets stand on the floor, so the camera's pose and all distances are correlated: moving one
# scenelet or the camera alone achieves little. As in the paper (Monszpart et al. 2019, section 5),
# L-BFGS optimises all unknowns, in units of about equal uncertainty.

_UNITS = np.array([0.01, 0.06, 0.1, 0.05])
"""Typical uncertainty of bearing, log depth, yaw (rad), and log size at constant apparent size."""
_STEP = 0.02
"""Step of finite differences in these units, well above rounding errors and below kinks."""
_NOWHERE = 1e6
"""Cost in nats of a state outside the support, because the optimiser needs finite values."""
_ITERATIONS = 40
"""Largest number of L-BFGS iterations; chosen."""
_FAR = 20.0
"""Largest log depth (log m) of the search, which is outside the support."""


def polish(problem: Problem, state: State) -> State:
    """Maximise the log-posterior locally, with the same scenelets and start frames.

    Parameters
    ----------
    problem : Problem
    state : State

    Returns
    -------
    State
    """
    spread = np.sqrt(np.diag(np.linalg.inv(problem.camera_precision)))

    def scene(theta: Array) -> State:
        camera: Array = state.camera + spread * theta[:5]
        where = home + theta[5:].reshape(-1, 4) * _UNITS
        where[:, 3] += where[:, 1]
        where[:, 1] = np.minimum(where[:, 1], _FAR)
        return State(camera, state.items, *to_floor(where), state.latent)

    def cost(theta: Array, log_density: Callable[[State], float]) -> float:
        return -max(log_density(scene(theta)), -_NOWHERE)

    def slope(theta: Array, _: Callable[[State], float]) -> Array:
        # A step changes one scenelet or the camera, so most of the scene is not evaluated again.
        near = log_posterior_near(problem, scene(theta))
        steps = _STEP * np.eye(len(theta))
        ahead = np.array([cost(theta + step, near) for step in steps])
        behind = np.array([cost(theta - step, near) for step in steps])
        slopes: Array = (ahead - behind) / (2 * _STEP)
        return slopes

    home = to_view(state.placements, state.sizes)
    home[:, 3] -= home[:, 1]
    start = np.zeros(5 + home.size)
    whole = partial(log_posterior, problem)
    options = {"maxiter": _ITERATIONS}
    found = minimize(cost, start, whole, jac=slope, method="L-BFGS-B", options=options)
    return scene(found.x) if found.fun < cost(start, whole) else state


# ------------------------------------------------------------------------------------------------
# From candidates at the maxima of charness to whole scenes.
#
# The paper tries every combination of three candidates per maximum (Monszpart et al. 2019, section
# 5). Here a maximum may also stay empty, and there may be twelve of them: combinations are
# evaluated by log-posterior in the order of :func:`best_first`, all of them if there are few. The
# best scenes are refined, and in the best one candidates are exchanged
# (:mod:`imapper_prob.solver.sequences`).

_KEPT: Final = 3
"""Candidates per maximum (Monszpart et al. 2019), each of another kind of furniture."""
_TRIED: Final = 1024
"""Combinations evaluated by the full log-posterior: as many as three candidates or none at five
maxima can give."""
_ALTERNATIVES: Final = 4
"""Scenes in addition to the best one; chosen."""


@dataclass(frozen=True)
class Combination:
    """An evaluated combination of candidates.

    Parameters
    ----------
    members : tuple of int
        Indices of the candidates in the pool, in order of time.
    score : float
        Gain over the empty scene in nats, as the sum of single and pair gains; candidates of one
        stay share its value.
    gain : float
        Gain over the empty scene in nats, by the full log-posterior.
    """

    members: tuple[int, ...]
    score: float
    gain: float


@dataclass(frozen=True)
class Combinations:
    """The combinations that were tried, and the resulting scenes.

    Parameters
    ----------
    pool : tuple of Candidate
        Candidates kept at the maxima.
    tried : tuple of Combination
        The best first.
    left : float
        Best score of a combination that was not tried; -inf if all were tried.
    exchanges : tuple of Exchange
        Exchanges made in the best combination after its refinement.
    states : tuple of State
        The best scene, then others with different furniture, all refined.
    """

    pool: tuple[Candidate, ...]
    tried: tuple[Combination, ...]
    left: float
    exchanges: tuple[Exchange, ...]
    states: tuple[State, ...]

    __repr__ = brief

    def __post_init__(self) -> None:
        for name in ("pool", "tried", "exchanges", "states"):
            object.__setattr__(self, name, Listed(getattr(self, name)))

    @property
    def complete(self) -> bool:
        """Whether every combination was evaluated."""
        return self.left == -np.inf


def combine(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    *,
    progress: Progress | None = None,
) -> Combinations:
    """Find the best scene by log-posterior, and diverse alternatives.

    Parameters
    ----------
    problem : Problem
    candidates : sequence of Candidate
    curve : CharnessCurve
    progress : callable, optional
        Called with the name of a stage and its completed share.

    Returns
    -------
    Combinations
    """
    groups = groups_of(candidates, curve)
    tried, left = search(problem, groups, tried=_TRIED)
    pool = tuple(c for group in groups for c in group)
    ranked = [[pool[k] for k in t.members] for t in tried]
    if progress is not None:
        progress("combining", 1.0)
    best = refine(problem, state_of(problem, ranked[0]))
    exchanges = exchange(problem, best, candidates, step=curve.step)
    best = exchanges[-1].state if exchanges else best
    if progress is not None:
        progress("exchanging", 1.0)
    states = [polish(problem, best)]
    for own in _diverse(problem, ranked, best, _ALTERNATIVES):
        states.append(polish(problem, refine(problem, state_of(problem, own))))
        if progress is not None:
            progress("refining scenes", len(states) / (1 + _ALTERNATIVES))
    states.sort(key=lambda s: -log_posterior(problem, s))
    return Combinations(pool, tried, left, exchanges, tuple(states))


def groups_of(candidates: Sequence[Candidate], curve: CharnessCurve) -> list[list[Candidate]]:
    """The best candidates of each maximum, in order of time.

    Parameters
    ----------
    candidates : sequence of Candidate
    curve : CharnessCurve

    Returns
    -------
    list of list of Candidate
    """
    return [_at(window, candidates) for window in sorted(curve.maxima.tolist())]


def search(
    problem: Problem, groups: Sequence[Sequence[Candidate]], *, tried: int
) -> tuple[tuple[Combination, ...], float]:
    """Evaluate the first combinations by score, and sort them by log-posterior.

    Parameters
    ----------
    problem : Problem
    groups : sequence of sequence of Candidate
        Candidates of each maximum.
    tried : int
        Number of combinations.

    Returns
    -------
    combinations : tuple of Combination
    left : float
        Score of the best combination that was not tried, nats; -inf if there is none.
    """
    pool = [c for group in groups for c in group]
    ends = np.cumsum([len(group) for group in groups])
    members = [np.arange(e - len(g), e) for g, e in zip(groups, ends, strict=True)]
    base = log_posterior(problem, empty_state(problem))
    shared = apart_from_stays(problem, empty_state(problem))

    def gain(*chosen: int) -> float:
        return shared([pool[k] for k in chosen])

    def judged_gain(chosen: Sequence[int]) -> float:
        return log_posterior(problem, state_of(problem, [pool[k] for k in chosen])) - base

    alone = np.array([gain(k) for k in range(len(pool))])
    together = np.zeros((len(pool), len(pool)))
    for first, second in _pairs(members):
        extra = gain(first, second) - alone[first] - alone[second]
        together[first, second] = together[second, first] = extra
    found = best_first(members, alone, together)
    judged = [
        Combination(chosen, score, judged_gain(chosen)) for chosen, score in islice(found, tried)
    ]
    _, left = next(found, ((), -np.inf))
    return tuple(sorted(judged, key=lambda c: -c.gain)), left


def _pairs(groups: Sequence[NDArray[np.int64]]) -> list[tuple[int, int]]:
    """All pairs of members of different groups, the member of the earlier group first."""
    return [
        (a, b)
        for position, group in enumerate(groups)
        for later in groups[position + 1 :]
        for a in group.tolist()
        for b in later.tolist()
    ]


def state_of(problem: Problem, members: Sequence[Candidate]) -> State:
    """The state with exactly these candidates.

    Parameters
    ----------
    problem : Problem
    members : sequence of Candidate

    Returns
    -------
    State
    """
    return assigned(empty_state(problem), members)


def _at(window: int, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best candidates near a window, each of another kind of furniture."""
    best: dict[tuple[int, ...], Candidate] = {}
    for c in candidates:
        near = abs(c.window - window) <= 1
        if near and c.kind and (c.kind not in best or c.gain > best[c.kind].gain):
            best[c.kind] = c
    return sorted(best.values(), key=lambda c: -c.gain)[:_KEPT]


def _diverse(
    problem: Problem, ranked: Sequence[Sequence[Candidate]], best: State, count: int
) -> list[Sequence[Candidate]]:
    """The best combinations that differ in the sequence of kinds of furniture.

    They also differ from the ``best`` scene.
    """
    kinds = furniture_kinds(problem)
    story = tuple(kinds[scenelet] for scenelet in best.items[:, 0])
    chosen: dict[tuple[tuple[int, ...], ...], Sequence[Candidate]] = {}
    for members in ranked:
        chosen.setdefault(tuple(kinds[c.scenelet] for c in members), members)
    return [members for own, members in chosen.items() if own != story][:count]
