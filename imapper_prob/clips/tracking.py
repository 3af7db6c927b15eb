"""Tracking: assign the skeletons of single frames to actors, by minimum-cost flow.

Every actor has at most one skeleton in each frame, and every skeleton belongs to at most one actor.
An actor is a path through time, so the optimum is a minimum-cost flow and is found exactly. Let
``c`` be the mean confidence of a skeleton and ``d`` the distance of two successive skeletons of an
actor, divided by the square root of the frames between them. :func:`associate` minimises

    sum over skeletons (1 - c)  +  sum over successions d  +  ABSENT x frames without skeleton.

A succession may skip frames: an actor who returns is recognised by position. The costs printed by
Monszpart et al. (2019, appendix A) can be used instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import DETECTED

__all__ = [
    "ABSENT",
    "PAIRWISE",
    "associate",
    "distances",
    "people_in",
    "step_cost",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
_STEP: Final = 0.1
"""Unit of distance, as a fraction of the body's height in the image: how far two skeletons of one
person may differ from frame to frame, the length of a step at ten frames a second."""
_FARTHEST: Final = 6.0
"""Cap on the distance of a joint, in those units, so that an outlier has bounded weight."""
_SMALLEST: Final = 20.0
"""Least height of a body in pixels that is assumed, since only a few joints may be visible."""
_ROWS_AT_ONCE: Final = 50_000
"""Pairs of skeletons that are compared at once, in some 20 MB; chosen."""


def distances(keypoints: Array, confidences: Array, one: Ints, other: Ints) -> Array:
    """Mean normalised joint distance of pairs of skeletons.

    Parameters
    ----------
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing; joints count in proportion to the lower confidence of the pair.
    one, other : (P,) int
        Row indices of the pairs.

    Returns
    -------
    (P,) float
        In units of ``_STEP``; pairs without a common joint have the greatest distance,
        ``_FARTHEST``.
    """
    there = (confidences > 0) & np.isfinite(keypoints).all(-1)
    points = np.where(there[..., None], keypoints, 0.0)
    high = np.where(there, keypoints[..., 1], -np.inf).max(1)
    low = np.where(there, keypoints[..., 1], np.inf).min(1)
    wide = np.where(there, keypoints[..., 0], -np.inf).max(1)
    narrow = np.where(there, keypoints[..., 0], np.inf).min(1)
    with np.errstate(invalid="ignore"):
        height = np.nan_to_num(np.hypot(high - low, wide - narrow), nan=0.0, posinf=0.0)
    result = np.empty(len(one))
    for start in range(0, len(one), _ROWS_AT_ONCE):
        a, b = one[start : start + _ROWS_AT_ONCE], other[start : start + _ROWS_AT_ONCE]
        weight = np.where(there[a] & there[b], np.minimum(confidences[a], confidences[b]), 0.0)
        unit = _STEP * np.maximum(np.maximum(height[a], height[b]), _SMALLEST)
        apart = np.linalg.norm(points[a] - points[b], axis=-1) / unit[:, None]
        total = weight.sum(1)
        mean = (weight * np.minimum(apart, _FARTHEST)).sum(1) / np.maximum(total, 1e-12)
        result[start : start + _ROWS_AT_ONCE] = np.where(total > 0, mean, _FARTHEST)
    return result


# ------------------------------------------------------------------------------------------------
# Networks: several paths of least total cost.

_WHOLE: Final = 1e-6
"""Greatest distance of a solver's result from an integer."""


@dataclass(frozen=True)
class Network:
    """A directed acyclic graph without duplicate edges.

    Parameters
    ----------
    tail, head : (E,) int
        Start and end node of each edge.
    cost : (E,) float
        Cost of one path along the edge; not negative.
    begin, end : int
        First and last node of all paths; ``end`` is the last node and can be reached.
    single : int
        Number of edges, the first ones, that carry one path at most; the others carry any number.
    """

    tail: Ints
    head: Ints
    cost: Array
    begin: int
    end: int
    single: int


def _cheapest_paths(network: Network, paths: int, *, passing: Mapping[int, int]) -> list[Ints]:
    """Paths of least total cost.

    Parameters
    ----------
    network : Network
    paths : int
        Number of paths.
    passing : mapping of int to int
        Single edges, and the path that must include each of them.

    Returns
    -------
    list of (n,) int
        The single edges along each path, in order.

    Raises
    ------
    InputError
        No paths include the required edges.
    """
    if not passing:
        return _walks(network, _one_flow(network, paths), paths)
    flows = _separate_flows(network, paths, passing)
    return [walk for flow in flows for walk in _walks(network, flow, 1)]


def _one_flow(network: Network, paths: int) -> Ints:
    """(E,) number of paths along each edge, when the paths are interchangeable.

    Successive shortest paths: each iteration takes the shortest path in the residual network, which
    may reroute earlier ones (Ahuja, Magnanti and Orlin, *Network Flows*, section 9.7). Node
    potentials keep all edge lengths non-negative.
    """
    # Imported late: reading a clip of one person does not need it.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    tail, head, cost = network.tail, network.head, network.cost
    n_nodes = network.end + 1
    edge_between = {
        ends: e for e, ends in enumerate(zip(tail.tolist(), head.tolist(), strict=True))
    }
    capacity = np.where(np.arange(len(cost)) < network.single, 1, paths)
    flow = np.zeros(len(cost), np.int64)
    potential = np.zeros(n_nodes)
    for _ in range(paths):
        onward, back = flow < capacity, flow > 0
        start = np.concatenate([tail[onward], head[back]])
        stop = np.concatenate([head[onward], tail[back]])
        length = np.concatenate([cost[onward], -cost[back]]) + potential[start] - potential[stop]
        graph = csr_array((np.maximum(length, 0.0), (start, stop)), shape=(n_nodes, n_nodes))
        distance, previous = dijkstra(graph, indices=network.begin, return_predecessors=True)
        reached = np.isfinite(distance)
        potential += np.where(reached, distance, distance[reached].max())
        node = network.end
        while node != network.begin:
            before = int(previous[node])
            edge = edge_between.get((before, node))
            if edge is not None and onward[edge]:
                flow[edge] += 1
            else:
                flow[edge_between[node, before]] -= 1
            node = before
    return flow


def _separate_flows(network: Network, paths: int, passing: Mapping[int, int]) -> Ints:
    """(paths, E) whether each path uses each edge, from a linear program.

    Integrality is enforced only if the relaxed solution is not integral.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import block_diag, csr_array, hstack

    n_edges, n_nodes = len(network.cost), network.end + 1
    edges = np.arange(n_edges)
    balance = csr_array(
        (
            np.repeat([1.0, -1.0], n_edges),
            (np.concatenate([network.tail, network.head]), np.tile(edges, 2)),
        ),
        shape=(n_nodes, n_edges),
    )
    supply = np.zeros(n_nodes)
    supply[network.begin], supply[network.end] = 1, -1
    once = csr_array(
        (np.ones(network.single), (np.arange(network.single),) * 2),
        shape=(network.single, n_edges),
    )
    constraints = [
        LinearConstraint(
            block_diag([balance] * paths, format="csr"),
            np.tile(supply, paths),
            np.tile(supply, paths),
        ),
        LinearConstraint(hstack([once] * paths, format="csr"), 0, 1),
    ]
    low = np.zeros((paths, n_edges))
    for edge, path in passing.items():
        low[path, edge] = 1.0

    def solved(*, whole: bool) -> Array:
        solution = milp(
            np.tile(network.cost, paths),
            constraints=constraints,
            bounds=Bounds(low.ravel(), 1),
            integrality=np.full(paths * n_edges, int(whole)),
        )
        if solution.x is None:
            raise InputError("the marks of the actors cannot all be kept")
        amounts: Array = solution.x
        return amounts

    amounts = solved(whole=False)
    if np.abs(amounts - np.rint(amounts)).max() > _WHOLE:
        amounts = solved(whole=True)
    return np.rint(amounts).astype(np.int64).reshape(paths, n_edges)


def _walks(network: Network, flow: Ints, units: int) -> list[Ints]:
    """The single edges along each of the paths that make up a flow."""
    leaving: dict[int, list[int]] = {}
    for used in np.flatnonzero(flow):
        leaving.setdefault(int(network.tail[used]), []).extend([int(used)] * int(flow[used]))
    walks = []
    for _ in range(units):
        node: int = network.begin
        passed: list[int] = []
        while node != network.end:
            edge = leaving[node].pop()
            if edge < network.single:
                passed.append(edge)
            node = int(network.head[edge])
        walks.append(np.array(passed, dtype=np.int64))
    return walks


# ------------------------------------------------------------------------------------------------
# The costs of the paper's tracker (Monszpart et al. 2019, appendix A).
#
#     E = sum_t sum_a E_u(a, s, t) + w_pw sum_t sum_a C(a, s_0, s_1, t)
#
#     E_u = -mean_k c_k of the skeleton, or 1 for the dummy
#     C   = mean_k |u_k - u'_k|^2 / diag^2 c_k c'_k, or 1 where one of the two is the dummy
#
# with half the diagonal of the image as the unit of length and w_pw = 10^3. Two misprints are
# corrected: E_u has a minus sign and is subtracted again, which would favour unsure skeletons; the
# quantifiers of the two constraints are exchanged. Steps lead from each frame to the next, and
# staying invisible costs 1 + w_pw a frame.

PAIRWISE: Final = 1e3
"""Weight w_pw of the pairwise costs."""
_DUMMY: Final = 1.0
"""Cost of the dummy skeleton, and of a step from or to it."""
_LIFT: Final = 1.0
"""Constant added to every actor's cost in every frame, so that no cost is negative."""


def step_cost(one: Array, other: Array, c: Array, d: Array, *, half_diagonal: float) -> Array:
    """Pairwise cost C of pairs of skeletons.

    Parameters
    ----------
    one, other : (P, 16, 2) float
        Pixels; any number or NaN where the confidence is 0.
    c, d : (P, 16) float
        Confidences of ``one`` and ``other``.
    half_diagonal : float
        Half the diagonal of the image, pixels.

    Returns
    -------
    (P,) float
    """
    joints = list(DETECTED)
    weight = (c * d)[:, joints]
    apart = np.where(weight[..., None] > 0, (one - other)[:, joints], 0.0) / half_diagonal
    cost: Array = (weight * (apart**2).sum(-1)).mean(1)
    return cost


def _published_network(
    frames: Ints, keypoints: Array, confidences: Array, *, half_diagonal: float
) -> Network:
    """The network whose cheapest paths minimise the paper's costs; rows are sorted by frame.

    Parameters
    ----------
    frames : (N,) int
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing.
    half_diagonal : float
        Half the diagonal of the image, pixels.
    """
    n, at = len(frames), frames - frames[0]
    times = int(at[-1]) + 1
    arrive, depart = np.arange(n), n + np.arange(n)
    nobody, begin = 2 * n + np.arange(times), 2 * n + times
    end = begin + 1
    low = np.searchsorted(frames, frames + 1, side="left")
    counts = np.searchsorted(frames, frames + 1, side="right") - low
    before = np.repeat(np.arange(n), counts)
    after = low[before] + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    step = step_cost(
        keypoints[before], keypoints[after], confidences[before], confidences[after],
        half_diagonal=half_diagonal,
    )  # fmt: skip
    unsure = _LIFT - confidences[:, list(DETECTED)].mean(1)
    hidden, change = _LIFT + _DUMMY, PAIRWISE * _DUMMY
    left, came = at < times - 1, at > 0
    first, last = at == 0, at == times - 1
    edges: list[tuple[Ints, Ints, Array]] = [
        (arrive, depart, unsure),
        (depart[before], arrive[after], PAIRWISE * step),
        (depart[left], nobody[at[left] + 1], np.full(left.sum(), change + hidden)),
        (nobody[at[came] - 1], arrive[came], np.full(came.sum(), change)),
        (nobody[:-1], nobody[1:], np.full(times - 1, change + hidden)),
        (np.full(first.sum(), begin), arrive[first], np.zeros(first.sum())),
        (depart[last], np.full(last.sum(), end), np.zeros(last.sum())),
        (np.array([begin]), nobody[:1], np.array([hidden])),
        (nobody[-1:], np.array([end]), np.zeros(1)),
    ]
    tail, head, cost = (np.concatenate(part) for part in zip(*edges, strict=True))
    return Network(tail=tail, head=head, cost=cost, begin=int(begin), end=int(end), single=n)


# ------------------------------------------------------------------------------------------------
# Association.

ABSENT: Final = 1.2
"""Cost of a frame without a skeleton. It slightly exceeds the cost of the least confident skeleton,
so that skeletons are left out for their position and never for low confidence."""
_STRANGER: Final = 4.0
"""Cost of continuing at an unrelated skeleton, after long absence or from far away. It must be less
than the cost of exchanging two actors and more than that of any real step."""
_MOST_GAP: Final = 45
"""Frames of absence after which a position is no longer informative: 1.5 s at 30 frames a
second."""
_MOST_LINKS: Final = 300_000
"""Most successions considered; with more skeletons, only shorter absences are bridged."""
_REGULARLY: Final = 0.25
"""Least fraction of frames in which a person must be present to be counted."""


def people_in(frames: Ints) -> int:
    """Number of people: the most that are present in at least a quarter of the frames.

    Parameters
    ----------
    frames : (N,) int
        Frame number of each skeleton.

    Returns
    -------
    int
    """
    _, counts = np.unique(frames, return_counts=True)
    return max(1, int(np.quantile(counts, 1 - _REGULARLY, method="lower")))


def associate(
    frames: Ints,
    keypoints: Array,
    confidences: Array,
    *,
    people: int | None = None,
    marks: Mapping[int, int] | None = None,
    half_diagonal: float | None = None,
) -> list[Ints]:
    """Assign skeletons to actors, and return the rows of each.

    Parameters
    ----------
    frames : (N,) int
        Frame number of each skeleton.
    keypoints : (N, 16, 2) float
        Pixels; NaN where missing.
    confidences : (N, 16) float
        0 where missing.
    people : int, optional
        Number of actors; :func:`people_in` if not given, and at least the number marked.
    marks : mapping of int to int, optional
        Rows whose actor is known.
    half_diagonal : float, optional
        Half the diagonal of the image, pixels. If given, the costs printed in the paper are used.

    Returns
    -------
    list of (n,) int
        The rows of each actor in order of time. Actors are sorted by their first frame unless there
        are marks. Actors without rows are left out unless they are marked.

    Raises
    ------
    InputError
        The marks contradict each other.
    """
    frames = np.asarray(frames, np.int64)
    marks = dict(marks or {})
    _check(frames, marks)
    wanted = people if people is not None else people_in(frames)
    actors = max(wanted, max(marks.values(), default=-1) + 1)
    alone = len(np.unique(frames)) == len(frames)
    if alone and actors == 1:
        return [np.argsort(frames, kind="stable")]
    order = np.argsort(frames, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    found = _solve(
        frames[order],
        keypoints[order],
        confidences[order],
        actors,
        {int(place[row]): actor for row, actor in marks.items()},
        half_diagonal,
    )
    rows = [order[own] for own in found]
    if marks:
        return rows
    return sorted((r for r in rows if len(r)), key=lambda r: (frames[r[0]], r[0]))


def _check(frames: Ints, marks: Mapping[int, int]) -> None:
    seen: dict[tuple[int, int], int] = {}
    for row, actor in marks.items():
        when = (int(frames[row]), actor)
        if when in seen:
            raise InputError(f"frame {when[0]}: actor {actor} is marked twice")
        seen[when] = row


def _solve(
    frames: Ints,
    keypoints: Array,
    confidences: Array,
    actors: int,
    marks: Mapping[int, int],
    half_diagonal: float | None,
) -> list[Ints]:
    """Rows of each actor, for rows sorted by frame."""
    network = (
        _network(frames, keypoints, confidences)
        if half_diagonal is None
        else _published_network(frames, keypoints, confidences, half_diagonal=half_diagonal)
    )
    return _cheapest_paths(network, actors, passing=marks)


def _network(frames: Ints, keypoints: Array, confidences: Array) -> Network:
    """The network of the default costs, for rows sorted by frame."""
    n, first, last = len(frames), frames[0], frames[-1]
    before, after = _links(frames)
    gap = frames[after] - frames[before]
    step = distances(keypoints, confidences, before, after) / np.sqrt(gap)
    near = step < _STRANGER
    before, after, gap, step = before[near], after[near], gap[near], step[near]

    # Nodes: arrival and departure of each row, "nobody" in each frame, begin and end.
    times = last - first + 1
    arrive, depart = np.arange(n), n + np.arange(n)
    nobody, begin = 2 * n + np.arange(times), 2 * n + times
    end = begin + 1
    at = frames - first
    left, came = at < times - 1, at > 0
    half = _STRANGER / 2
    edges: list[tuple[Ints, Ints, Array]] = [
        (arrive, depart, 1 - _mean_confidence(confidences)),
        (depart[before], arrive[after], step + ABSENT * (gap - 1)),
        (np.full(n, begin), arrive, ABSENT * at),
        (depart, np.full(n, end), ABSENT * (times - 1.0 - at)),
        (depart[left], nobody[at[left] + 1], np.full(left.sum(), half + ABSENT)),
        (nobody[:-1], nobody[1:], np.full(times - 1, ABSENT)),
        (nobody[at[came] - 1], arrive[came], np.full(came.sum(), half)),
        (np.array([begin]), np.array([end]), np.array([ABSENT * times])),
    ]
    tail, head, cost = (np.concatenate(part) for part in zip(*edges, strict=True))
    return Network(tail=tail, head=head, cost=cost, begin=int(begin), end=int(end), single=n)


def _links(frames: Ints) -> tuple[Ints, Ints]:
    """Pairs of rows that may directly succeed each other, for rows sorted by frame."""
    low = np.searchsorted(frames, frames, side="right")
    reach = _MOST_GAP
    while True:
        counts = np.searchsorted(frames, frames + reach, side="right") - low
        if counts.sum() <= _MOST_LINKS or reach == 1:
            break
        reach //= 2
    before = np.repeat(np.arange(len(frames)), counts)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return before, low[before] + offset


def _mean_confidence(confidences: Array) -> Array:
    there = confidences > 0
    result: Array = np.where(there, confidences, 0).sum(1) / np.maximum(there.sum(1), 1)
    return result
