"""The posterior of a clip: draws, scenes with probabilities, and their files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import Config
from imapper_prob.models.camera import Camera
from imapper_prob.models.posterior import State, motion
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.scenes import WeightedScene
from imapper_prob.sampling.layouts import match_objects
from imapper_prob.sampling.sample import Samples
from imapper_prob.staged.solver import Solution

if TYPE_CHECKING:
    from collections.abc import Iterator

    import xarray

    from imapper_prob.recording.certainty import Certainty
    from imapper_prob.recording.draws import DrawnChain
    from imapper_prob.results.uncertainty.clusters import ObjectCluster
    from imapper_prob.results.uncertainty.hidden import HiddenJoints
    from imapper_prob.results.uncertainty.joints import JointSummary
    from imapper_prob.results.uncertainty.nuisances import Nuisance
    from imapper_prob.results.uncertainty.occupancy import Occupancy

__all__ = ["Posterior"]

Array = NDArray[np.float64]

_GHOSTS = 6
"""Draws of the motion shown beside the representative one."""


@dataclass(frozen=True)
class Posterior:
    """What was sampled, and what it was sampled with.

    Parameters
    ----------
    solution : Solution
        Clip, library, staged solution and packed log-posterior.
    samples : Samples
        Draws and layouts.
    config : Config
        Everything needed to repeat the run on the same clip.
    """

    solution: Solution
    samples: Samples
    config: Config

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

        return posterior_tree(self.solution, self.samples, self.config)

    def occupancy(self, *, cell: float = 0.1) -> Occupancy:
        """Probability by category that a place on the floor is covered, cells in metres."""
        from imapper_prob.results.uncertainty.occupancy import occupancy

        return occupancy(self.samples.objects, cell=cell)

    def clusters(self, *, least: float = 0.05) -> tuple[ObjectCluster, ...]:
        """Objects matched across all draws, most probable first, down to a probability."""
        from imapper_prob.results.uncertainty.clusters import object_clusters

        return object_clusters(
            self.samples.objects,
            self.samples.log_posterior,
            radius=self.config.sample.layout_radius,
            least=least,
        )

    def joints(self) -> JointSummary:
        """Mean and covariance of every joint in every frame."""
        from imapper_prob.results.uncertainty.joints import joint_summary

        return joint_summary(self._motions())

    def hidden(self) -> HiddenJoints:
        """P(joint hidden) by frame and joint, and by which of :meth:`clusters`."""
        from imapper_prob.results.uncertainty.hidden import hidden_joints

        elevations = [float(state.camera[1]) for state in self.samples.states]
        return hidden_joints(self.samples.objects, self._motions(), elevations, self.clusters())

    def nuisances(self) -> dict[str, Nuisance]:
        """Prior against posterior of camera and body, by name."""
        from imapper_prob.results.uncertainty.nuisances import nuisances

        problem, shape = self.solution.problem, self.samples.shape
        draws = np.array([state.camera for state in self.samples.states]).reshape(*shape, -1)
        covariance = np.linalg.inv(problem.camera_precision)
        return nuisances(draws, mean=problem.camera_mean, covariance=covariance)

    def _motions(self) -> Iterator[Array]:
        """The motion of each draw in its world, one after the other."""
        return (motion(self.solution.problem, state) for state in self.samples.states)

    def record(self, path: str | Path, *, video: str | Path | None = None) -> None:
        """Write the recording (``.rrd``) that opens in the rerun viewer.

        Parameters
        ----------
        path : path
        video : path, optional
            The pictures of the clip, to lie behind the detections: a folder of pictures whose
            names end in the number of their frame, or a video file.
        """
        from imapper_prob.recording.log import write_recording
        from imapper_prob.recording.video import read_video
        from imapper_prob.results.summary import describe

        write_recording(
            path,
            clip=self.clip,
            scenes=self.scenes(),
            traces=self.traces,
            truth=self.clip.truth,
            description=describe(self.clip, self.samples),
            certainty=self._certainty,
            draws=self._drawn_chains(),
            acceptance=self.samples.acceptance.rates(),
            video=None if video is None else read_video(video, self.clip),
        )

    @property
    def _certainty(self) -> Certainty:
        from imapper_prob.recording.certainty import Certainty

        return Certainty(self.occupancy(), self.hidden(), self.joints(), self.nuisances())

    def _drawn_chains(self) -> tuple[DrawnChain, ...]:
        """Draws of each chain, evenly spread, as many as a recording may hold."""
        from imapper_prob.recording.draws import MOST, DrawnChain

        samples, problem = self.samples, self.solution.problem
        chains, draws = samples.shape
        kept = np.unique(np.linspace(0, draws - 1, max(1, MOST // chains)).round().astype(int))
        numbers = [c * draws + kept for c in range(chains)]
        return tuple(
            DrawnChain(
                kept,
                [samples.objects[n] for n in own],
                np.array([motion(problem, samples.states[n])[:, PELV] for n in own]),
            )
            for own in numbers
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
