"""Steps with the ratio of every proposal checked."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from itertools import islice

from imapper_prob.samplers.reversible_jump import AcceptanceTable, Mixture, Proposal, sample

# Log densities are sums of few doubles: 1e-8 is far above their rounding error and far below any
# factor that could be missing.
TOLERANCE = 1e-8


class RoundTripError(AssertionError):
    """The ratio of a proposal differs from the one that both directions, evaluated alone, give."""


@dataclass(frozen=True)
class CheckedMove:
    """A move that compares its ratio with the proposal densities of both directions.

    The move and its reverse need ``log_proposal_density(old, new)``, the log density of proposing
    ``new`` from ``old``. Densities of both directions refer to the same coordinates of ``old`` and
    ``new``, so their difference contains the Jacobian.
    """

    move: object
    back: object

    @property
    def name(self) -> str:
        return self.move.name

    @property
    def reverse(self) -> str:
        return self.move.reverse

    def propose(self, rng, state) -> Proposal | None:
        proposal = self.move.propose(rng, state)
        if proposal is None:
            return None
        forward = self.move.log_proposal_density(state, proposal.state)
        backward = self.back.log_proposal_density(proposal.state, state)
        # A proposal that was made must have positive density; the reverse density may be 0.
        if forward == -math.inf or not math.isclose(
            proposal.log_ratio, backward - forward, rel_tol=TOLERANCE, abs_tol=TOLERANCE
        ):
            raise RoundTripError(
                f"move '{self.name}' gives the log ratio {proposal.log_ratio:.12g}, but the log "
                f"density of '{self.reverse}' back is {backward:.12g} and that of '{self.name}' "
                f"{forward:.12g}"
            )
        return proposal


def check_rounds(rng, state, log_density_fn, mixture: Mixture, *, n) -> AcceptanceTable:
    """Take n steps with every ratio checked; what was accepted."""
    by_name = {move.name: move for move in mixture.moves}
    moves = [CheckedMove(move, by_name[move.reverse]) for move in mixture.moves]
    checked = dataclasses.replace(mixture, moves=moves)
    table = AcceptanceTable()
    chain = sample(rng, state, log_density_fn=log_density_fn, mixture=checked)
    for _, info in islice(chain, n):
        table.record(info)
    return table
