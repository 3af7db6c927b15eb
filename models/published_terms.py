"""The published energy of a state by term and by frame, for reports and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.published_energy import PAPER_TERMS, evaluate_paper
from imapper_prob.models.settings import PaperWeights

__all__ = ["PaperEnergy", "paper_energy"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PaperEnergy:
    """The published energy of a state.

    Parameters
    ----------
    terms : mapping of str to float
        Weighted terms by name of the fields of :class:`PaperWeights`; all infinite if the state is
        outside the support.
    by_frame : mapping of str to (T,) float
        The same for each frame, without ``collision``, which belongs to no frame. A step of the
        pelvis counts for the frame it leads to.
    """

    terms: Mapping[str, float]
    by_frame: Mapping[str, Array]

    @property
    def total(self) -> float:
        """The energy, the sum of all terms."""
        return sum(self.terms.values())


def paper_energy(
    problem: Problem, state: State, *, weights: PaperWeights | None = None
) -> PaperEnergy:
    """Compute the published energy of a state.

    Parameters
    ----------
    problem : Problem
        A problem of either preset.
    state : State
    weights : PaperWeights, optional

    Returns
    -------
    PaperEnergy
    """
    weights = weights or PaperWeights()
    names = [f.name for f in fields(weights)]
    joints, shares = np.empty((problem.n_frames, 3, 16)), np.zeros((problem.n_frames, 4))
    values = evaluate_paper(
        problem._replace(paper_nats=np.array(astuple(weights)), likelihood=1.0),
        state.camera, state.items, state.placements, state.sizes, state.latent, joints, shares,
    )  # fmt: skip
    if not np.isfinite(values[0]):
        # Outside the support (overlapping scenelets, or an invalid camera) there is no motion.
        nowhere = np.full(problem.n_frames, np.inf)
        by_frame = {name: nowhere for name in names if name != "collision"}
        return PaperEnergy(dict.fromkeys(names, np.inf), by_frame)
    by_frame = {
        name: getattr(weights, name) * share
        for name, share in zip((n for n in names if n != "collision"), shares.T, strict=True)
    }
    nats = dict(zip(PAPER_TERMS, (-values).tolist(), strict=True))
    return PaperEnergy({name: nats[name] for name in names}, by_frame)
