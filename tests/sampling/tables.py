"""Tables for draws of stretches, of scenelets that nobody has visited."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.problem import Problem
from imapper_prob.models.view import to_view
from imapper_prob.sampling.pool_kernels import Table
from imapper_prob.sampling.proposals import Candidates
from imapper_prob.sampling.visits import Visits, table_of


def visited(problem: Problem, candidates: Candidates, *, spread: float = 1.0) -> Table:
    """All scenelets at all starts from which they fit, each met some times where it was fitted."""
    rng, rows = np.random.default_rng(0), []
    scatter = spread * np.array([0.02, 0.1, 0.3, 0.05])
    for scenelet, length in enumerate(problem.lengths.tolist()):
        for start in range(problem.n_frames - length + 1):
            window = np.abs(candidates.centres - start - length // 2).argmin()
            where = to_view(
                candidates.placements[window, scenelet], candidates.sizes[window, scenelet]
            )
            for _ in range(4):
                rows.append(((scenelet, start), where + scatter * rng.standard_normal(4)))
    visits = Visits.of(
        {
            "items": np.array([item for item, _ in rows]),
            "where": np.array([where for _, where in rows]),
            "cameras": np.tile(problem.camera_mean, (len(rows), 1)),
            "powers": np.ones(len(rows)),
        }
    )
    return table_of(problem, visits)
