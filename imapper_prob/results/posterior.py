"""The posterior of a clip: draws, scenes with probabilities, and their files."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import Config
from imapper_prob.models.camera import Camera
from imapper_prob.models.posterior import State, motion
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.results.scenes import WeightedScene
from imapper_prob.sampling.layouts import match_objects
from imapper_prob.sampling.sample import Samples

if TYPE_CHECKING:
    import xarray

    from imapper_prob.results.stored_input import Source

__all__ = ["Posterior"]

Array = NDArray[np.float64]

_GHOSTS = 6
"""Draws of the motion shown beside the representative one."""


@dataclass(frozen=True)
class Posterior:
    """What was sampled, and what it was sampled with.

    Parameters
    ----------
    solution : Source
        Clip, library and packed log-posterior; of a fresh run all that the staged solver found.
    samples : Samples
        Draws and layouts.
    config : Config
        Everything needed to repeat the run on the same clip.
    stored : DataTree, optional
        The file that it was read from.
    """

    solution: Source
    samples: Samples
    config: Config
    stored: xarray.DataTree | None = field(default=None, repr=False)

    @property
    def clip(self) -> Clip:
        """The input."""
        return self.solution.clip

    def scenes(self, count: int = 5) -> tuple[WeightedScene, ...]:
        """The most probable layouts, at most ``count``, by their representative draws."""
        return self._all_scenes[:count]

    @cached_property
    def _all_scenes(self) -> tuple[WeightedScene, ...]:
        found = self.samples.probabilities
        shares = dict(zip(found.layouts.tolist(), found.probability.tolist(), strict=True))
        errors = dict(zip(found.layouts.tolist(), found.standard_error.tolist(), strict=True))
        return tuple(
            self._weighted(layout, shares[layout + 1], errors[layout + 1])
            for layout in range(min(len(self.samples.layouts.leaders), 10))
        )

    def _weighted(self, layout: int, probability: float, error: float) -> WeightedScene:
        """The draw nearest to the mean object positions of its layout, with their spread."""
        samples = self.samples
        members = np.flatnonzero(samples.layouts.indicator == layout)
        leader = samples.objects[samples.layouts.leaders[layout]]
        partners = [
            match_objects(leader, samples.objects[m], radius=self.config.sample.layout_radius)
            for m in members
        ]
        matched = [(m, p) for m, p in zip(members, partners, strict=True) if p is not None]
        centres = np.array(
            [[samples.objects[m][k].centre[:2] for k in partner] for m, partner in matched]
        ).reshape(len(matched), len(leader), 2)
        offset = centres - centres.mean(0)
        nearest = int((offset**2).sum((1, 2)).argmin())
        chosen, partner = matched[nearest]
        covariances = np.einsum("nki,nkj->kij", offset, offset) / max(len(matched) - 1, 1)
        objects = tuple(samples.objects[chosen][k] for k in partner)
        spread = members[np.linspace(0, len(members) - 1, _GHOSTS).round().astype(int)]
        ghosts = [motion(self.solution.problem, samples.states[m]) for m in np.unique(spread)]
        scene = self._scene(samples.states[chosen], samples.log_posterior.flat[chosen])
        scene = replace(scene, objects=objects)
        return WeightedScene(scene, probability, error, covariances, np.array(ghosts))

    def _scene(self, state: State, log_posterior: float) -> Scene:
        pitch, elevation, focal, _, roll = state.camera.tolist()
        camera: Camera = self.clip.camera.posed(
            pitch=pitch, roll=roll, elevation=elevation, focal_scale=float(np.exp(focal))
        )
        layout = tuple((self.solution.library[s].name, t) for s, t in state.items.tolist())
        joints = motion(self.solution.problem, state)
        return Scene(camera, (), joints, layout, float(log_posterior))

    @cached_property
    def data(self) -> xarray.DataTree:
        """Draws and diagnostics with names, as ArviZ expects them."""
        from imapper_prob.results.tree import posterior_tree

        if self.stored is not None:
            return self.stored
        return posterior_tree(self.solution, self.samples, self.config)

    def record(self, path: str | Path) -> None:
        """Write the recording (``.rrd``) that opens in the rerun viewer."""
        from imapper_prob.recording.log import write_recording
        from imapper_prob.results.summary import describe

        write_recording(
            path,
            clip=self.clip,
            scenes=self.scenes(),
            traces=self.traces,
            truth=self.clip.truth,
            description=describe(self.clip, self.samples),
        )

    @property
    def traces(self) -> dict[str, Array]:
        """What to plot of the chains: name to (chains, draws)."""
        shape = self.samples.shape
        return {
            "log posterior": self.samples.log_posterior,
            "number of objects": np.reshape([len(o) for o in self.samples.objects], shape).astype(
                float
            ),
        }
