"""Steps with every ratio checked."""

from __future__ import annotations

from itertools import islice

from imapper_prob.samplers.reversible_jump import AcceptanceTable, sample


def check_rounds(rng, state, log_density_fn, mixture, *, n) -> AcceptanceTable:
    """Take n steps with ``check=True``; what was accepted."""
    table = AcceptanceTable()
    chain = sample(rng, state, log_density_fn=log_density_fn, mixture=mixture, check=True)
    for _, info in islice(chain, n):
        table.record(info)
    return table
