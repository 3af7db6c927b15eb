"""Combinations of candidates: found best first, judged by the log-posterior, polished.

A combination S is scored by its members alone and two by two,

    Q(S) = sum_{c in S} gain_c + sum_{pairs in S} together_cd,

with ``together`` what a pair is worth beyond its members (-inf where it cannot be).
Combinations come out in the order of Q, the best first, and only as many as are asked for are
ever looked at.

*The bound.* Let the first groups be decided, with members S, and r_c = gain_c + sum_{d in S}
together_cd what a member c of an open group would add to S. Any completion R has

    Q(S + R) - Q(S) = sum_{c in R} r_c + sum_{pairs in R} together_cd.

Split its pairs into those of neighbouring groups and the others. A pair of the latter kind
with c in the earlier group is worth no more than max(0, max over the members d of the later
group of together_cd), and over all later groups these sum to at most o_c, whether R has
members there or not. So

    Q(S + R) <= Q(S) + max over R of [ sum_{c in R} (r_c + o_c) + sum_{neighbours in R} together ],

and the maximum on the right is over a chain of groups, which dynamic programming finds
exactly. Nothing is thus ever thrown away that could still be better than what came out: the
bound (of minus Q, a lower one) is admissible. Once all groups are decided it is Q itself, so
that whatever is taken from the queue complete is the best of all that is left.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, islice

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from imapper_prob.layouts import furniture_kinds
from imapper_prob.models.log_posterior import State, empty_state, log_posterior
from imapper_prob.models.problem import Problem
from imapper_prob.models.text import Listed, brief
from imapper_prob.models.view import to_floor, to_view
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
    """All combinations that are possible, with their scores Q, the best first.

    Parameters
    ----------
    groups : sequence of (k,) int
        Members of each group, by their index in ``gain``; a combination has one or none.
    gain : (N,) float
    together : (N, N) float
        Symmetric; -inf for pairs that cannot be.

    Yields
    ------
    members : tuple of int
        In the order of the groups.
    score : float
    """
    others = _optimistic(groups, together)
    order = count()  # of equal bounds the one found first; makes the order repeatable
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
    """Most that a chain of groups can add, pairs counted between neighbours only.

    Parameters
    ----------
    groups : sequence of (k,) int
    added : (N,) float
        What each member adds by itself.
    together : (N, N) float

    Returns
    -------
    float
        Nats.
    """
    best = np.zeros(1)  # by what is taken of the last group; the first entry is nothing
    last = np.empty(0, dtype=np.int64)
    for group in groups:
        pairs = np.zeros((1 + len(last), 1 + len(group)))
        pairs[1:, 1:] = together[np.ix_(last, group)]
        best = (best[:, None] + pairs).max(0) + np.concatenate([[0.0], added[group]])
        last = group
    return float(best.max())


def _optimistic(groups: Sequence[Ints], together: Array) -> Array:
    """(N,) o_c: most that later groups but the next can add to a member by pairs."""
    result = np.zeros(len(together))
    for position, group in enumerate(groups):
        for later in groups[position + 2 :]:
            if len(group) and len(later):
                result[group] += together[np.ix_(group, later)].max(1).clip(min=0.0)
    return result


# ------------------------------------------------------------------------------------------------
# Refinement of a whole scene.
#
# Each scenelet stands on the floor, so that where the camera looks and how far away everybody is
# hang together: moving one scenelet at a time, or the camera alone, gets nowhere. As the paper
# (Monszpart et al. 2019, section 5), L-BFGS moves all, in units in which all unknowns are about as
# uncertain.

_UNITS = np.array([0.01, 0.06, 0.1, 0.05])
"""Of bearing, log depth, yaw (rad), and of log size at the same look: their usual doubt."""
_STEP = 0.02
"""Of differences, in these units: much more than rounding, much less than a kink is wide."""
_NOWHERE = 1e6
"""Nats of a state outside the support, for a search that wants finite numbers."""
_ITERATIONS = 40
_FAR = 20.0
"""Log metres, farther than which a step of the search is outside the support anyway."""


def polish(problem: Problem, state: State) -> State:
    """The most probable state near one, with the same scenelets at the same times.

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

    def cost(theta: Array) -> float:
        return -max(log_posterior(problem, scene(theta)), -_NOWHERE)

    def slope(theta: Array) -> Array:
        steps = _STEP * np.eye(len(theta))
        ahead = np.array([cost(theta + step) for step in steps])
        behind = np.array([cost(theta - step) for step in steps])
        slopes: Array = (ahead - behind) / (2 * _STEP)
        return slopes

    home = to_view(state.placements, state.sizes)
    home[:, 3] -= home[:, 1]
    start = np.zeros(5 + home.size)
    found = minimize(cost, start, jac=slope, method="L-BFGS-B", options={"maxiter": _ITERATIONS})
    return scene(found.x) if found.fun < cost(start) else state


# ------------------------------------------------------------------------------------------------
# From candidates at the maxima of charness to whole scenes.
#
# The paper tries every combination of three candidates a maximum (Monszpart et al. 2019, section
# 5). Here a maximum may also stay empty, and there may be twelve of them: combinations are judged
# by the log-posterior in the order of :func:`search`, all of them where there are few. The best
# scenes are refined, and in the best one candidates are exchanged
# (:mod:`imapper_prob.solver.sequences`).

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class CombineSettings:
    """Parameters
    ----------
    kept : int
        Candidates a maximum (3 in the paper), each of another kind of furniture.
    tried : int
        Combinations judged by the full log-posterior: all that three candidates or none at
        five maxima can give.
    alternatives : int
        Scenes returned beside the best.
    """

    kept: int = 3
    tried: int = 1024
    alternatives: int = 4


@dataclass(frozen=True)
class Combination:
    """One combination of candidates that was judged.

    Parameters
    ----------
    members : tuple of int
        Indices in the pool, in order of time.
    score : float
        Nats over no scenelet by its candidates alone and two by two, those of one stay
        sharing what it is worth.
    gain : float
        Nats over no scenelet by the full log-posterior.
    """

    members: tuple[int, ...]
    score: float
    gain: float


@dataclass(frozen=True)
class Combinations:
    """What was tried, and the scenes that came of it.

    Parameters
    ----------
    pool : tuple of Candidate
        Those kept at the maxima.
    tried : tuple of Combination
        The best first.
    left : float
        Best score of a combination that was not tried; -inf if all were.
    exchanges : tuple of Exchange
        What was exchanged in the best combination once that was refined.
    states : tuple of State
        The best scene, then others with other furniture, all refined.
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
        """Whether every combination was judged; if not, the search was pruned."""
        return self.left == -np.inf


def combine(
    problem: Problem,
    candidates: Sequence[Candidate],
    curve: CharnessCurve,
    *,
    settings: CombineSettings | None = None,
    progress: Progress | None = None,
) -> Combinations:
    """The best scene by log-posterior, then its diverse alternatives.

    Parameters
    ----------
    problem : Problem
    candidates : sequence of Candidate
    curve : CharnessCurve
    settings : CombineSettings, optional
    progress : callable, optional
        Called with a stage's name and the part of it that is done.

    Returns
    -------
    Combinations
    """
    settings = settings or CombineSettings()
    groups = groups_of(candidates, curve, kept=settings.kept)
    tried, left = search(problem, groups, tried=settings.tried)
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
    for own in _diverse(problem, ranked, best, settings.alternatives):
        states.append(polish(problem, refine(problem, state_of(problem, own))))
        if progress is not None:
            progress("refining scenes", len(states) / (1 + settings.alternatives))
    states.sort(key=lambda s: -log_posterior(problem, s))
    return Combinations(pool, tried, left, exchanges, tuple(states))


def groups_of(
    candidates: Sequence[Candidate], curve: CharnessCurve, *, kept: int
) -> list[list[Candidate]]:
    """The best candidates of each maximum, in order of time.

    Parameters
    ----------
    candidates : sequence of Candidate
    curve : CharnessCurve
    kept : int
        How many of each.

    Returns
    -------
    list of list of Candidate
    """
    return [_at(window, candidates, kept) for window in sorted(curve.maxima.tolist())]


def search(
    problem: Problem, groups: Sequence[Sequence[Candidate]], *, tried: int
) -> tuple[tuple[Combination, ...], float]:
    """The first combinations by score, the best by log-posterior first.

    Parameters
    ----------
    problem : Problem
    groups : sequence of sequence of Candidate
        By maximum.
    tried : int
        How many.

    Returns
    -------
    combinations : tuple of Combination
    left : float
        Score of the best one left out, nats; -inf if there is none.
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
    """All pairs of members of different groups, the earlier group first."""
    return [
        (a, b)
        for position, group in enumerate(groups)
        for later in groups[position + 1 :]
        for a in group.tolist()
        for b in later.tolist()
    ]


def state_of(problem: Problem, members: Sequence[Candidate]) -> State:
    """The scene in which these candidates, and no others, are assigned.

    Parameters
    ----------
    problem : Problem
    members : sequence of Candidate

    Returns
    -------
    State
    """
    return assigned(empty_state(problem), members)


def _at(window: int, candidates: Sequence[Candidate], kept: int) -> list[Candidate]:
    """The best candidate of each kind in a window and those beside it, the best few of these."""
    best: dict[tuple[int, ...], Candidate] = {}
    for c in candidates:
        near = abs(c.window - window) <= 1
        if near and c.kind and (c.kind not in best or c.gain > best[c.kind].gain):
            best[c.kind] = c
    return sorted(best.values(), key=lambda c: -c.gain)[:kept]


def _diverse(
    problem: Problem, ranked: Sequence[Sequence[Candidate]], best: State, count: int
) -> list[Sequence[Candidate]]:
    """The best combinations no two of which have the same kinds of furniture in the same order.

    Neither has any of them the same as the ``best`` scene.
    """
    kinds = furniture_kinds(problem)
    story = tuple(kinds[scenelet] for scenelet in best.items[:, 0])
    chosen: dict[tuple[tuple[int, ...], ...], Sequence[Candidate]] = {}
    for members in ranked:
        chosen.setdefault(tuple(kinds[c.scenelet] for c in members), members)
    return [members for own, members in chosen.items() if own != story][:count]
