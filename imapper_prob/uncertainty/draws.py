"""The draws of a run, and what all of them together say about objects, motion and camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.config import Config
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import camera_at, motion
from imapper_prob.models.scene import Clip, Scene
from imapper_prob.sampling.conditioning import Told
from imapper_prob.sampling.sample import Samples
from imapper_prob.solver.limbs import Limbs, limbs_of
from imapper_prob.uncertainty.checks import Check, checks_of, from_json
from imapper_prob.uncertainty.clusters import ObjectCluster, object_clusters
from imapper_prob.uncertainty.estimate import drawn_objects, expected_scene
from imapper_prob.uncertainty.furniture import (
    FurnitureOfDraws,
    object_draws,
    object_summary,
)
from imapper_prob.uncertainty.hidden import HiddenJoints, hidden_joints
from imapper_prob.uncertainty.motion import JointSummary, joint_summary
from imapper_prob.uncertainty.occupancy import Occupancy, occupancy
from imapper_prob.uncertainty.parameters import Nuisance, nuisances
from imapper_prob.uncertainty.stored import Source, categories_of
from imapper_prob.uncertainty.told import as_told, label_shares
from imapper_prob.uncertainty.tree import arviz_tree, posterior_tree

__all__ = ["Draws"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Draws:
    """The draws of a run, with its input and settings, and their summaries.

    :class:`imapper_prob.results.posterior.Posterior` adds which scenes they are, whether they have
    converged, and files.

    Parameters
    ----------
    solution : Source
        Clip, library and packed log-posterior; for a fresh run, the result of the staged solver.
    samples : Samples
        Draws, layouts and verdict.
    config : Config
        All settings that are needed to repeat the run on the same clip.
    seconds : mapping of str to float
        Wall-clock duration of each part of the run.
    stored : DataTree, optional
        Content of the file from which the draws were read.
    told : Told, optional
        Statements that they were conditioned on.
    """

    solution: Source
    samples: Samples
    config: Config
    seconds: Mapping[str, float] = field(default_factory=dict, repr=False)
    stored: xr.DataTree | None = field(default=None, repr=False)
    told: Told | None = field(default=None, repr=False)

    @property
    def clip(self) -> Clip:
        """The input clip.

        Examples
        --------
        >>> posterior.clip.name
        'demo'
        """
        return self.solution.clip

    def draw(self, number: int) -> Scene:
        """One draw with its camera, furniture and motion.

        Parameters
        ----------
        number : int
            Index from 0, chain by chain.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            There are not as many draws.

        Examples
        --------
        >>> posterior.draw(0).camera.width
        1920
        """
        there = len(self.samples.states)
        if not 0 <= number < there:
            raise InputError(f"draw {number}: there are {there}, counted from 0")
        state = self.samples.states[number]
        camera = self._camera(state.camera)
        return Scene(
            camera=camera,
            objects=self.samples.objects[number],
            joints=limbs_of(self.solution.problem, state, camera).joints,
            assignment=tuple((self.solution.library[s].name, t) for s, t in state.items.tolist()),
            log_posterior=float(self.samples.log_posterior.flat[number]),
            people=len(self.clip.tracks),
        )

    def _camera(self, phi: Array) -> Camera:
        return camera_at(self.clip.camera, phi)

    @cached_property
    def furniture(self) -> FurnitureOfDraws:
        """Furniture of each draw, displaced randomly or as measured, in the draw's world frame.

        ``samples.objects`` has the positions given by scenelets.

        Examples
        --------
        >>> len(posterior.furniture) == len(posterior.samples.states)
        True
        """
        rng, settings = np.random.default_rng(self.config.seed), self.config.model
        statements = () if self.told is None else self.told.statements
        names = categories_of(self.solution)
        return FurnitureOfDraws(
            as_told(
                rng,
                objects,
                drawn_objects(rng, objects, settings),
                statements,
                problem=self.solution.problem,
                names=names,
                state=state,
                camera=self._camera(state.camera),
            )
            for objects, state in zip(self.samples.objects, self.samples.states, strict=True)
        )

    def clusters(self, *, least: float = 0.05) -> tuple[ObjectCluster, ...]:
        """Objects matched across all draws, in descending order of probability.

        Parameters
        ----------
        least : float
            Least probability of the listed objects.

        Returns
        -------
        tuple of ObjectCluster

        Examples
        --------
        >>> [cluster.label for cluster in posterior.clusters(least=0.5)]
        ['couch', 'table']
        """
        if least not in self._clusters:
            kept = tuple(c for c in self._every_cluster if c.presence >= least)
            self._clusters[least] = kept
        return self._clusters[least]

    @cached_property
    def _every_cluster(self) -> tuple[ObjectCluster, ...]:
        """Clusters of any probability."""
        return object_clusters(
            self.samples.objects,
            self.samples.log_posterior,
            radius=self.config.sample.layout_radius,
            least=0.0,
            standing=self.furniture,
            seen=self.samples.seen,
            labels=self._label_shares,
        )

    @cached_property
    def _label_shares(self) -> tuple[tuple[dict[str, float], ...], ...]:
        """Probabilities of the true label of each object, by draw."""
        problem, names = self.solution.problem, categories_of(self.solution)
        return tuple(
            label_shares(objects, problem=problem, names=names, state=state)
            for objects, state in zip(self.samples.objects, self.samples.states, strict=True)
        )

    @cached_property
    def _clusters(self) -> dict[float, tuple[ObjectCluster, ...]]:
        """Cache of clusters by least probability."""
        return {}

    def summary(self) -> xr.Dataset:
        """Summary of objects over all draws: :meth:`clusters` as a table.

        Returns
        -------
        Dataset
            Along ``object``, in descending order of probability: ``label`` with its
            ``label_probability`` given that the object exists, ``presence`` with
            ``presence_error``, ``x`` and ``y`` in the world frame with standard deviations ``x_sd``
            and ``y_sd``, ``yaw`` and ``yaw_sd``; units are attributes. ``to_dataframe()`` converts
            it to a pandas table. The coordinate ``object`` has the same names as in
            :meth:`to_arviz`.

        Examples
        --------
        >>> posterior.summary()["object"].values.tolist()
        ['couch', 'table']
        >>> posterior.summary()["label"].values.tolist()
        ['couch', 'table']
        """
        return object_summary(self.clusters())

    def occupancy(self, *, cell: float = 0.1) -> Occupancy:
        """Probability by category that positions on the floor are covered.

        Parameters
        ----------
        cell : float
            Side of a cell, metres.

        Returns
        -------
        Occupancy

        Examples
        --------
        >>> "couch" in posterior.occupancy(cell=0.2).categories
        True
        """
        return occupancy(self.furniture, cell=cell)

    def joints(self) -> JointSummary:
        """Mean and covariance of every joint in every frame, one person after the other.

        Returns
        -------
        JointSummary

        Examples
        --------
        >>> posterior.joints().mean.shape == (posterior.clip.n_frames, 16, 3)
        True
        """
        return joint_summary(self._limbs(), problem=self.solution.problem)

    def hidden(self) -> HiddenJoints:
        """Probability that joints are hidden, by frame, joint and object of :meth:`clusters`.

        For several people, the frames of each follow those of the one before.

        Returns
        -------
        HiddenJoints

        Examples
        --------
        >>> posterior.hidden().probability.shape == (posterior.clip.n_frames, 16)
        True
        """
        return self._hidden

    @cached_property
    def _hidden(self) -> HiddenJoints:
        elevations = [float(state.camera[1]) for state in self.samples.states]
        return hidden_joints(self.samples.objects, self._motions(), elevations, self.clusters())

    @property
    def sides_flipped(self) -> Array:
        """(T,) probability that left and right are flipped, by frame.

        Examples
        --------
        >>> posterior.sides_flipped.shape == (posterior.clip.n_frames,)
        True
        """
        drawn = self.data["motion"]["sides_flipped"]
        return np.asarray(drawn.mean(("chain", "draw")).to_numpy(), np.float64)

    def nuisances(self) -> dict[str, Nuisance]:
        """Prior and posterior of the camera and body parameters by name.

        Returns
        -------
        dict of str to Nuisance

        Examples
        --------
        >>> sorted(posterior.nuisances())[:2]
        ['elevation', 'log_body_scale']
        """
        problem, shape = self.solution.problem, self.samples.shape
        draws = np.array([state.camera for state in self.samples.states]).reshape(*shape, -1)
        covariance = np.asarray(np.linalg.inv(problem.camera_precision), np.float64)
        return nuisances(draws, mean=problem.camera_mean, covariance=covariance)

    @cached_property
    def estimate(self) -> Scene:
        """The scene of least expected loss, a point estimate.

        Examples
        --------
        >>> posterior.estimate.objects[0].label
        'couch'
        """
        states = self.samples.states
        mean = np.mean([state.camera for state in states], axis=0)
        cameras = (self._camera(state.camera) for state in states)
        motions = zip(cameras, (limbs.joints for limbs in self._limbs()), strict=True)
        found = expected_scene(self._camera(mean), self.clusters(), self.furniture, motions)
        return replace(found, people=len(self.clip.tracks))

    def _motions(self) -> Iterator[Array]:
        """The motion of each draw in its world frame, one after the other."""
        return (motion(self.solution.problem, state) for state in self.samples.states)

    def _limbs(self) -> Iterator[Limbs]:
        """The motion of each draw with the person's deviations given the detections."""
        problem = self.solution.problem
        return (limbs_of(problem, s, self._camera(s.camera)) for s in self.samples.states)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """Checks of camera, detections, library and draws.

        Examples
        --------
        >>> [check.name for check in posterior.checks][:2]
        ['upright', 'height']
        """
        if self.stored is not None and "checks" in self.stored.attrs:
            return from_json(str(self.stored.attrs["checks"]))
        return checks_of(
            self.clip,
            self.solution.problem,
            self.samples.states,
            self.solution.best_fits,
            rng=np.random.default_rng(self.config.seed),
        )

    @property
    def traces(self) -> dict[str, Array]:
        """Log-posterior and number of objects of the kept draws, by name: (chains, draws) each.

        ``samples.traces`` is the log-posterior over the whole run.

        Examples
        --------
        >>> posterior.traces["log posterior"].shape
        (2, 10)
        """
        shape = self.samples.shape
        return {
            "log posterior": self.samples.log_posterior,
            "number of objects": np.reshape([len(o) for o in self.samples.objects], shape).astype(
                float
            ),
        }

    @cached_property
    def data(self) -> xr.DataTree:
        """Labelled draws and diagnostics in the structure of ArviZ.

        Examples
        --------
        >>> posterior.data["posterior"].sizes["chain"]
        2
        """
        if self.stored is not None:
            return self.stored
        return posterior_tree(
            self.solution,
            self.samples,
            self.config,
            self._object_draws,
            seconds=self.seconds,
            checks=self.checks,
            told=self.told,
        )

    def to_arviz(self) -> xr.DataTree:
        """Convert the draws for ArviZ, including furniture.

        The group ``posterior`` has camera and body, and for every object of :meth:`clusters`, by
        name along ``object``: ``presence``, ``x``, ``y``, ``yaw``, ``width``, ``depth`` and
        ``height``. In a draw without the object all but ``presence`` are NaN: pass ``skipna=True``
        for means and intervals given that it exists. For R-hat and effective draws of such an
        object use its ``presence``.

        Returns
        -------
        DataTree
            Groups ``posterior``, ``sample_stats``, ``observed_data`` and ``constant_data``.

        Examples
        --------
        >>> tree = posterior.to_arviz()
        >>> tree["posterior"]["x"].dims
        ('chain', 'draw', 'object')
        >>> import arviz_stats as az
        >>> table = az.summary(tree, var_names=["x", "y"], skipna=True)
        >>> table.index.tolist()
        ['x[couch]', 'x[table]', 'y[couch]', 'y[table]']
        """
        return arviz_tree(self.data, self._object_draws)

    def to_dataframe(self) -> Any:
        """A table with one row per object and draw.

        Returns
        -------
        pandas.DataFrame
            Rows by ``chain``, ``draw`` and ``object`` for draws that have the object: ``x``, ``y``,
            ``width``, ``depth`` and ``height`` in metres, ``yaw`` in radians.

        Examples
        --------
        >>> table = posterior.to_dataframe()
        >>> list(table.columns)
        ['x', 'y', 'yaw', 'width', 'depth', 'height']
        >>> places = table.groupby("object")[["x", "y"]].mean()
        """
        table = self._object_draws.to_dataframe()
        there = table.pop("presence") > 0
        return table[there]

    @cached_property
    def _object_draws(self) -> xr.Dataset:
        if self.stored is not None and "furniture" in self.stored.children:
            return self.stored["furniture"].to_dataset()
        return object_draws(self.clusters(), self.furniture, self.samples.shape)
