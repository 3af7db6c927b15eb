"""Where chains and their temperatures start."""

from __future__ import annotations

import numpy as np

from imapper_prob.models.log_posterior import log_posterior
from imapper_prob.sampling.actors import join_actors
from imapper_prob.sampling.chain import starts_of
from tests.runs import solution


def test_chains_start_far_apart_and_their_hot_ends_at_all_that_is_known() -> None:
    source = join_actors([solution()])
    starts = starts_of(source, 4)
    best, *others = source.states
    assert starts[0][0] is best
    assert starts[1][0].n_scenelets == 0
    if others:
        assert starts[2][0] is others[-1]
    for own, *hotter in starts:
        assert own is best or hotter[0] is best
        values = [log_posterior(source.problem, state) for state in hotter]
        assert np.all(np.diff(values) <= 0)
        assert {id(state) for state in (own, *hotter)} >= {id(state) for state in source.states}
