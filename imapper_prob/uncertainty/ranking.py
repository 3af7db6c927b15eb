"""The scenes and layouts of a run, ranked by their probability."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.layouts import through_one_lens
from imapper_prob.samplers.diagnostics import (
    LayoutProbabilities,
    ShortChainWarning,
    layout_probabilities,
    unanimous_error,
)
from imapper_prob.uncertainty.draws import Draws
from imapper_prob.uncertainty.scenes import (
    Representative,
    WeightedScene,
    covariances_about,
    describe_difference,
    explained_by,
    group_scenes,
    representative,
)

__all__ = ["Ranking"]

_GHOSTS: Final = 6
"""Number of draws of the motion shown in addition to the representative one."""


@dataclass(frozen=True)
class Ranking:
    """Scenes and layouts of a run, in descending order of probability.

    Parameters
    ----------
    draws : Draws
    """

    draws: Draws

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.probabilities.layouts)

    def scene(self, rank: int) -> WeightedScene:
        """The scene with a rank.

        Parameters
        ----------
        rank : int
            From 0, which is the most probable, to the number of scenes less one.

        Returns
        -------
        WeightedScene
        """
        if rank not in self._made:
            made = self._weighted(
                np.flatnonzero(self._scene_of_layout == self.probabilities.layouts[rank]),
                self.probabilities.probability[rank],
                self.probabilities.standard_error[rank],
            )
            if rank:
                made = replace(made, difference=self._difference(self.scene(0), made))
            self._made[rank] = made
        return self._made[rank]

    def layout(self, rank: int) -> WeightedScene:
        """The layout with a rank.

        Parameters
        ----------
        rank : int
            From 0, which is the most probable, to the number of layouts less one.

        Returns
        -------
        WeightedScene
        """
        found = self.draws.samples.probabilities
        return self._weighted(
            found.layouts[[rank]] - 1, found.probability[rank], self._errors(found)[rank]
        )

    @cached_property
    def probabilities(self) -> LayoutProbabilities:
        """Probabilities of all scenes in descending order, with scene indices in order of
        creation."""
        samples = self.draws.samples
        scene_of_draw = self._scene_of_layout[samples.layouts.indicator]
        with warnings.catch_warnings():
            # The verdict reports chains that are too short.
            warnings.simplefilter("ignore", ShortChainWarning)
            found = layout_probabilities(
                scene_of_draw.reshape(samples.shape),
                rng=np.random.default_rng(self.draws.config.seed),
            )
        return found._replace(standard_error=self._errors(found))

    def _errors(self, found: LayoutProbabilities) -> NDArray[np.float64]:
        """Standard errors of probabilities; that of draws that agree if all have one scene."""
        if len(found.probability) > 1:
            return found.standard_error
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ShortChainWarning)
            return np.array([unanimous_error(self.draws.samples.log_posterior)])

    def rank_of(self, layout: int) -> int:
        """The rank of the scene that a layout belongs to.

        Parameters
        ----------
        layout : int
            Index of the layout, from 0.

        Returns
        -------
        int
        """
        ranks: list[int] = self.probabilities.layouts.tolist()
        return ranks.index(self._scene_of_layout[layout])

    @cached_property
    def _representatives(self) -> tuple[Representative, ...]:
        """Representative draw of each layout, in the order of the layout indicator."""
        samples, radius = self.draws.samples, self.draws.config.sample.layout_radius
        return tuple(
            representative(samples, layout, seen=samples.seen, radius=radius)
            for layout in range(len(samples.layouts.leaders))
        )

    @cached_property
    def _scene_of_layout(self) -> NDArray[np.int64]:
        return group_scenes([self.draws.samples.seen[r.draw] for r in self._representatives])

    @cached_property
    def _made(self) -> dict[int, WeightedScene]:
        """Cache of scenes by rank, because each needs several motions."""
        return {}

    def _weighted(
        self, layouts: NDArray[np.int64], probability: float, error: float
    ) -> WeightedScene:
        """Combine layouts (from 0, in descending order) to one scene, represented by the first
        one."""
        samples, chosen = self.draws.samples, self._representatives[layouts[0]]
        scene = replace(self.draws.draw(chosen.draw), objects=chosen.objects)
        members = np.flatnonzero(np.isin(samples.layouts.indicator, layouts))
        spread = members[np.linspace(0, len(members) - 1, _GHOSTS).round().astype(int)]
        ghosts = [self.draws.draw(int(m)).joints for m in np.unique(spread)]
        covariances = covariances_about(
            chosen,
            [self._representatives[layout] for layout in layouts],
            seen=samples.seen,
            standing=self.draws.furniture,
        )
        return WeightedScene(
            scene,
            float(probability),
            float(error),
            covariances,
            np.array(ghosts),
            layouts=tuple((1 + layouts).tolist()),
            explains=explained_by(
                self.draws.clip, self.draws.solution.problem, scene, samples.states[chosen.draw]
            ),
            draw=chosen.draw,
        )

    def _difference(self, best: WeightedScene, other: WeightedScene) -> str:
        """Describe how a scene differs from the best one, seen through the other's lens."""
        states = self.draws.samples.states
        longer = float(states[best.draw].camera[2] - states[other.draw].camera[2])
        (first,) = through_one_lens([best.objects], [longer])
        return describe_difference(first, other.objects)
