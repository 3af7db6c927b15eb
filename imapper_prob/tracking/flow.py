"""Several paths through one network, of least cost together, by linear programming."""

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
    """Directed edges without a circle.

    Parameters
    ----------
    tail, head : (E,) int
        Nodes that an edge leads from and to.
    cost : (E,) float
        Of one path along it.
    begin, end : int
        Nodes where all paths begin and end; ``end`` is the last node.
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
        Single edges, and which path must pass there. Without any the paths are one flow,
        whose linear program has whole numbers for a solution by itself. With some each path
        is a flow of its own; then whole numbers are asked for where they do not come
        by themselves.

    Returns
    -------
    list of (n,) int
        The single edges along each path, in order.

    Raises
    ------
    InputError
        No paths pass where they must.
    """
    # Imported late: reading a clip of one person needs none of it.
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import block_diag, csr_array, hstack

    kinds = paths if passing else 1
    units = paths // kinds
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
    supply[network.begin], supply[network.end] = units, -units
    constraints = [
        LinearConstraint(
            block_diag([balance] * kinds, format="csr"),
            np.tile(supply, kinds),
            np.tile(supply, kinds),
        )
    ]
    if kinds > 1:
        once = csr_array(
            (np.ones(network.single), (np.arange(network.single),) * 2),
            shape=(network.single, n_edges),
        )
        constraints.append(LinearConstraint(hstack([once] * kinds, format="csr"), 0, 1))
    low = np.zeros((kinds, n_edges))
    high = np.tile(np.where(edges < network.single, 1.0, float(units)), (kinds, 1))
    for edge, path in passing.items():
        low[path, edge] = 1.0

    def solved(*, whole: bool) -> Array:
        solution = milp(
            np.tile(network.cost, kinds),
            constraints=constraints,
            bounds=Bounds(low.ravel(), high.ravel()),
            integrality=np.full(kinds * n_edges, int(whole)),
        )
        if solution.x is None:
            raise InputError("the marks of the actors cannot all be kept")
        amounts: Array = solution.x
        return amounts

    amounts = solved(whole=False)
    if np.abs(amounts - np.rint(amounts)).max() > _WHOLE:
        amounts = solved(whole=True)
    flow = np.rint(amounts).astype(np.int64).reshape(kinds, n_edges)
    return [path for own in flow for path in _walks(network, own, units)]


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
                passed.append(int(edge))
            node = int(network.head[edge])
        walks.append(np.array(passed, dtype=np.int64))
    return walks
