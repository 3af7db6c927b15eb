"""Geweke's joint-distribution test, for one move at a time.

Draw a state from the prior and data given the state; then, in turn, move the state with the
data held and draw the data anew. Whatever the moves, as long as each leaves the posterior
invariant, state and data keep their joint distribution. Many short replicates, each begun
with a draw of its own, are compared with their own beginnings: they are independent, so that
p-values are those of a plain t test, and moves that alone do not reach every state can be
tested alone.

References
----------
Geweke 2004, JASA 99, 799. Gandy & Scott 2020, arXiv:2001.06465 (independent replicates).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import stats


def p_value(
    seed: int,
    *,
    draw_prior: Callable[[np.random.Generator], Any],
    draw_data: Callable[[np.random.Generator, Any], Any],
    transition: Callable[[np.random.Generator, Any, Any], Any],
    functionals: Callable[[Any, Any], list[float]],
    n_replicates: int = 2_000,
    n_rounds: int = 7,
) -> float:
    """How probable it is that replicates have changed that much.

    Parameters
    ----------
    transition : callable
        ``(rng, state, data) -> state``, which should leave p(state | data) invariant.
    functionals : callable
        ``(state, data) -> numbers`` whose means are compared; Bonferroni pays for asking
        several times.
    """
    changes = []
    for rng in np.random.default_rng(seed).spawn(n_replicates):
        state = draw_prior(rng)
        data = draw_data(rng, state)
        before = np.array(functionals(state, data), float)
        for _ in range(n_rounds):
            state = transition(rng, state, data)
            data = draw_data(rng, state)
        changes.append(functionals(state, data) - before)
    changing = np.ptp(changes, axis=0) > 0
    values = stats.ttest_1samp(np.array(changes)[:, changing], 0.0).pvalue
    return min(1.0, float(values.min()) * len(values))
