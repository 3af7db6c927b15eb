"""Several paths through one network, of least cost together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError

__all__ = ["Network", "cheapest_paths"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_WHOLE: Final = 1e-6
"""How far from a whole number a solver's result may be."""


@dataclass(frozen=True)
class Network:
    """Directed edges without a circle, and none of them twice.

    Parameters
    ----------
    tail, head : (E,) int
        Nodes that an edge leads from and to.
    cost : (E,) float
        Of one path along it; not negative.
    begin, end : int
        Nodes where all paths begin and end; ``end`` is the last node and can be reached.
    single : int
        So many of the first edges bear one path at most; the others any number.
    """

    tail: Ints
    head: Ints
    cost: Array
    begin: int
    end: int
    single: int


def cheapest_paths(network: Network, paths: int, *, passing: Mapping[int, int]) -> list[Ints]:
    """Paths of least cost together.

    Parameters
    ----------
    network : Network
    paths : int
        How many.
    passing : mapping of int to int
        Single edges, and which path must pass there.

    Returns
    -------
    list of (n,) int
        The single edges along each path, in order.

    Raises
    ------
    InputError
        No paths pass where they must.
    """
    if not passing:
        return _walks(network, _one_flow(network, paths), paths)
    flows = _separate_flows(network, paths, passing)
    return [walk for flow in flows for walk in _walks(network, flow, 1)]


def _one_flow(network: Network, paths: int) -> Ints:
    """(E,) how many paths go along each edge, if it does not matter which.

    Successive shortest paths: each takes the shortest way that is left, and may send earlier
    ones another way (Ahuja, Magnanti and Orlin, *Network Flows*, section 9.7). Node potentials
    keep all lengths positive.
    """
    # Imported late: reading a clip of one person needs none of it.
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
    """(paths, E) whether each path goes along each edge, as a linear program.

    Whole numbers are asked for only where they do not come by themselves.
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
    """The single edges along each unit of a flow."""
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
