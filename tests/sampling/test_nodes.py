"""Which scenelets become nodes, and where they stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imapper_prob.models.single_scenelet import judge
from imapper_prob.sampling.nodes import find_nodes
from tests.sampling.test_redraw import candidates, crowded


def test_nodes_are_in_order_and_lie_in_one_film_each() -> None:
    problem = crowded()
    nodes = find_nodes(problem, candidates(problem))
    order = nodes.items[:, 1] * len(problem.lengths) + nodes.items[:, 0]
    assert (np.diff(order) > 0).all()
    last = nodes.items[:, 1] + problem.lengths[nodes.items[:, 0]] - 1
    film = np.cumsum(problem.path_starts)
    assert (film[nodes.items[:, 1]] == film[last]).all()
    # Windows are three frames apart, and so every start is near one.
    assert len(set(nodes.items[:, 1].tolist())) > 25


def test_nodes_are_worth_what_they_say_and_more_than_fits() -> None:
    problem = crowded()
    given = candidates(problem)
    nodes = find_nodes(problem, given)
    values, beside = judge(problem, nodes.items, nodes.where)
    np.testing.assert_allclose(nodes.values, values, atol=1e-4)
    np.testing.assert_allclose(nodes.beside, beside, atol=1e-4)
    middle = given.centres[2] - problem.lengths // 2
    at = {(scenelet, start): i for i, (scenelet, start) in enumerate(nodes.items.tolist())}
    items = np.stack([np.arange(len(problem.lengths)), middle], -1)
    x, y, yaw = given.placements[2].T
    fits, _ = judge(problem, items, np.stack([x / y, np.log(y), yaw, given.sizes[2]], -1))
    gained = [
        nodes.values[at[scenelet, start]].sum() - fit.sum()
        for (scenelet, start), fit in zip(items.tolist(), fits, strict=True)
        if (scenelet, start) in at
    ]
    assert len(gained) > 2
    assert min(gained) > -1e-4


def test_without_fits_there_are_no_nodes() -> None:
    problem = crowded()
    given = candidates(problem)
    nothing = find_nodes(problem, replace(given, weights=np.zeros_like(given.weights)))
    assert len(nothing.items) == 0
