"""The posterior of a clip: draws, scenes with probabilities, and their files."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.config import Config, from_toml
from imapper_prob.files import require_intact
from imapper_prob.layouts import through_one_lens
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import camera_at, motion
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import PELV
from imapper_prob.people import by_person
from imapper_prob.progress import shown
from imapper_prob.samplers.diagnostics import (
    LayoutProbabilities,
    ShortChainWarning,
    layout_probabilities,
)
from imapper_prob.sampling.conditioning import Told
from imapper_prob.sampling.sample import Samples
from imapper_prob.solver.limbs import Limbs, limbs_of
from imapper_prob.uncertainty.checks import Check, alarms, checks_of, from_json
from imapper_prob.uncertainty.estimate import drawn_objects
from imapper_prob.uncertainty.furniture import FurnitureOfDraws, object_draws
from imapper_prob.uncertainty.scenes import (
    Representative,
    WeightedScene,
    describe_difference,
    explained_by,
    group_scenes,
    representative,
)
from imapper_prob.uncertainty.stored import read_samples, read_source
from imapper_prob.uncertainty.told import as_told
from imapper_prob.uncertainty.tree import FORMAT, seconds_of, told_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import xarray
    from matplotlib.axes import Axes
    from rerun_notebook import Viewer

    from imapper_prob.models.scenelet import Library
    from imapper_prob.models.statements import Statement
    from imapper_prob.progress import Progress
    from imapper_prob.recording.posterior import Certainty, DrawnChain
    from imapper_prob.uncertainty.clusters import ObjectCluster
    from imapper_prob.uncertainty.hidden import HiddenJoints
    from imapper_prob.uncertainty.motion import JointSummary
    from imapper_prob.uncertainty.occupancy import Occupancy
    from imapper_prob.uncertainty.parameters import Nuisance
    from imapper_prob.uncertainty.questions import Question
    from imapper_prob.uncertainty.stored import Source

__all__ = ["Posterior", "load_posterior"]

Array = NDArray[np.float64]
_GHOSTS = 6
"""Number of draws of the motion shown in addition to the representative one."""


@dataclass(frozen=True)
class Posterior:
    """The posterior of a clip: draws, with the input and settings of the run.

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
        Content of the file from which the posterior was read.
    told : Told, optional
        Statements that it was conditioned on, see :meth:`given`.

    Examples
    --------
    >>> posterior = im.load_posterior("run")
    >>> len(posterior.scenes(3)) <= 3
    True
    >>> posterior.converged
    False
    >>> posterior[0].probability >= posterior[-1].probability
    True
    >>> len(posterior) == len([scene.objects for scene in posterior])
    True
    """

    solution: Source
    samples: Samples
    config: Config
    seconds: Mapping[str, float] = field(default_factory=dict, repr=False)
    stored: xarray.DataTree | None = field(default=None, repr=False)
    told: Told | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        chains, draws = self.samples.shape
        return (
            f"Posterior(clip={self.clip.name!r}, chains={chains}, draws={draws}, "
            f"layouts={len(self.samples.layouts.leaders)}, verdict={self.samples.verdict.text!r})"
        )

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.scene_probabilities.layouts)

    def __iter__(self) -> Iterator[WeightedScene]:
        """Iterate over all scenes in descending order of probability."""
        return (self._scene_at(rank) for rank in range(len(self)))

    @overload
    def __getitem__(self, index: int) -> WeightedScene: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[WeightedScene, ...]: ...

    def __getitem__(self, index: int | slice) -> WeightedScene | tuple[WeightedScene, ...]:
        """A scene, or a slice of scenes; ``posterior[0]`` is the most probable.

        Raises
        ------
        IndexError
            There are not as many scenes.
        """
        if isinstance(index, slice):
            return tuple(self._scene_at(rank) for rank in range(len(self))[index])
        try:
            return self._scene_at(range(len(self))[index])
        except IndexError:
            raise IndexError(
                f"scene [{index}]: the run has {len(self)}, counted from [0]"
            ) from None

    @property
    def clip(self) -> Clip:
        """The input clip.

        Examples
        --------
        >>> posterior.clip.name
        'demo'
        """
        return self.solution.clip

    def scenes(self, count: int = 5) -> tuple[WeightedScene, ...]:
        """The most probable scenes, in descending order.

        Parameters
        ----------
        count : int
            Largest number of scenes; :mod:`imapper_prob.uncertainty.scenes` defines their distance.

        Returns
        -------
        tuple of WeightedScene

        Raises
        ------
        InputError
            ``count`` is less than 1.

        Examples
        --------
        >>> best = posterior.scenes(2)[0]
        >>> 0 < best.probability <= 1
        True
        >>> [o.label for o in best.scene.objects]
        ['couch', 'table']
        """
        if count < 1:
            raise InputError(f"{count} scenes: ask for at least 1")
        number = len(self.scene_probabilities.layouts)
        return tuple(self._scene_at(rank) for rank in range(min(count, number)))

    def layouts(self, count: int = 10) -> tuple[WeightedScene, ...]:
        """The most probable layouts, which are finer than scenes; the verdict refers to layouts.

        Parameters
        ----------
        count : int
            Largest number of layouts.

        Returns
        -------
        tuple of WeightedScene

        Examples
        --------
        >>> posterior.layouts(1)[0].layouts
        (1,)
        """
        found = self.samples.probabilities
        each = zip(found.layouts, found.probability, found.standard_error, strict=True)
        return tuple(
            self._weighted((int(number) - 1,), float(share), float(error))
            for number, share, error in list(each)[:count]
        )

    @cached_property
    def scene_probabilities(self) -> LayoutProbabilities:
        """Probabilities of all scenes in descending order, with scene indices in order of creation.

        Examples
        --------
        >>> float(posterior.scene_probabilities.probability.sum())
        1.0
        """
        samples = self.samples
        scene_of_draw = self._scene_of_layout[samples.layouts.indicator]
        with warnings.catch_warnings():
            # The verdict reports chains that are too short.
            warnings.simplefilter("ignore", ShortChainWarning)
            return layout_probabilities(
                scene_of_draw.reshape(samples.shape), rng=np.random.default_rng(self.config.seed)
            )

    @cached_property
    def disputed(self) -> tuple[int, ...]:
        """Numbers of the scenes whose layouts the chains disagree about: none, one, or two.

        Examples
        --------
        >>> len(posterior.disputed) <= 2
        True
        """
        pair = self.samples.verdict.disagreement or ()
        ranks = self.scene_probabilities.layouts.tolist()
        return tuple(sorted({1 + ranks.index(self._scene_of_layout[n - 1]) for n in pair}))

    @property
    def converged(self) -> bool:
        """Whether the chains have converged and no check raises an alarm.

        Examples
        --------
        >>> posterior.converged
        False
        """
        return self.samples.verdict.good and not alarms(self.checks)

    @property
    def verdict(self) -> str:
        """Alarms of checks, followed by the verdict on the chains.

        Examples
        --------
        >>> posterior.chain_verdict in posterior.verdict
        True
        """
        return " ".join([*alarms(self.checks), self.chain_verdict])

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
    def chain_verdict(self) -> str:
        """The convergence verdict on the chains, with scene numbers for the layouts it mentions.

        Examples
        --------
        >>> posterior.chain_verdict.startswith("Not converged")
        True
        """
        text, disputed = self.samples.verdict.text, self.disputed
        if not disputed:
            return text
        if len(disputed) == 1:
            return f"{text} These layouts are both shown as scene {disputed[0]}."
        return f"{text} These layouts are shown as scenes {disputed[0]} and {disputed[1]}."

    @cached_property
    def _representatives(self) -> tuple[Representative, ...]:
        """Representative draw of each layout, in the order of the layout indicator."""
        radius = self.config.sample.layout_radius
        return tuple(
            representative(self.samples, layout, seen=self._seen, radius=radius)
            for layout in range(len(self.samples.layouts.leaders))
        )

    @cached_property
    def _scene_of_layout(self) -> NDArray[np.int64]:
        return group_scenes([self._seen[r.draw] for r in self._representatives])

    @cached_property
    def _seen(self) -> tuple[tuple[SceneObject, ...], ...]:
        """Furniture of each draw converted to the nominal focal length, for comparisons."""
        focal = [self._log_focal(draw) for draw in range(len(self.samples.states))]
        return through_one_lens(self.samples.objects, focal)

    def _log_focal(self, draw: int) -> float:
        return float(self.samples.states[draw].camera[2])

    @cached_property
    def _made(self) -> dict[int, WeightedScene]:
        """Cache of scenes by rank, because each needs several motions."""
        return {}

    def _scene_at(self, rank: int) -> WeightedScene:
        if rank not in self._made:
            found = self.scene_probabilities
            layouts = np.flatnonzero(self._scene_of_layout == found.layouts[rank])
            made = self._weighted(
                tuple(layouts.tolist()),
                float(found.probability[rank]),
                float(found.standard_error[rank]),
            )
            if rank:
                best = self._scene_at(0)
                longer = self._log_focal(best.draw) - self._log_focal(made.draw)
                (first,) = through_one_lens([best.scene.objects], [longer])
                difference = describe_difference(first, made.scene.objects)
                made = replace(made, difference=difference)
            self._made[rank] = made
        return self._made[rank]

    def _weighted(
        self, layouts: tuple[int, ...], probability: float, error: float
    ) -> WeightedScene:
        """Combine layouts (from 0, in descending order) to one scene, represented by the first
        one."""
        samples, chosen = self.samples, self._representatives[layouts[0]]
        state = samples.states[chosen.draw]
        scene = replace(self.draw(chosen.draw), objects=chosen.objects)
        members = np.flatnonzero(np.isin(samples.layouts.indicator, layouts))
        spread = members[np.linspace(0, len(members) - 1, _GHOSTS).round().astype(int)]
        ghosts = [self.draw(int(m)).joints for m in np.unique(spread)]
        return WeightedScene(
            scene,
            probability,
            error,
            chosen.covariances,
            np.array(ghosts),
            layouts=tuple(layout + 1 for layout in layouts),
            explains=explained_by(self.clip, self.solution.problem, scene, state),
            draw=chosen.draw,
        )

    def scene(self, number: int = 1) -> WeightedScene:
        """A scene by number.

        Parameters
        ----------
        number : int
            From 1, which is the most probable.

        Returns
        -------
        WeightedScene

        Raises
        ------
        InputError
            There are not as many scenes.

        Examples
        --------
        >>> posterior.scene(1).scene.joints.shape == (posterior.clip.n_frames, 16, 3)
        True
        """
        there = len(self.scene_probabilities.layouts)
        if not 1 <= number <= there:
            raise InputError(f"scene {number}: the run has {there} scenes, counted from 1")
        return self._scene_at(number - 1)

    @cached_property
    def estimate(self) -> Scene:
        """The scene of least expected loss, a point estimate.

        Examples
        --------
        >>> [o.label for o in posterior.estimate.objects]
        ['couch', 'table']
        """
        from imapper_prob.uncertainty.estimate import expected_scene

        states = self.samples.states
        mean = np.mean([state.camera for state in states], axis=0)
        cameras = (self._camera(state.camera) for state in states)
        motions = zip(cameras, (limbs.joints for limbs in self._limbs()), strict=True)
        return expected_scene(self._camera(mean), self.clusters(), self.furniture, motions)

    def _camera(self, phi: Array) -> Camera:
        return camera_at(self.clip.camera, phi)

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
            layout=tuple((self.solution.library[s].name, t) for s, t in state.items.tolist()),
            log_posterior=float(self.samples.log_posterior.flat[number]),
        )

    def summary(self) -> xarray.Dataset:
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
        from xarray import Dataset

        from imapper_prob.uncertainty.clusters import names_of

        found = self.clusters()
        spread = np.array([np.sqrt(np.diag(c.covariance)) for c in found]).reshape(-1, 2)
        mean = np.array([c.mean for c in found]).reshape(-1, 2)
        columns = {
            "label": ([c.label for c in found], ""),
            "label_probability": ([c.labels[c.label] for c in found], "1"),
            "presence": ([c.presence for c in found], "1"),
            "presence_error": ([c.presence_error for c in found], "1"),
            "x": (mean[:, 0], "m"),
            "x_sd": (spread[:, 0], "m"),
            "y": (mean[:, 1], "m"),
            "y_sd": (spread[:, 1], "m"),
            "yaw": ([c.yaw for c in found], "rad"),
            "yaw_sd": ([c.yaw_spread for c in found], "rad"),
        }
        return Dataset(
            {
                name: ("object", np.asarray(values), {"units": unit} if unit else {})
                for name, (values, unit) in columns.items()
            },
            coords={"object": np.array(names_of(found), dtype=np.str_)},
        )

    def _repr_html_(self) -> str:
        """The scenes from above with their probabilities, and the verdict, for notebooks."""
        from io import BytesIO

        from imapper_prob.plotting import save_figure
        from imapper_prob.results.figures import scenes_figure

        drawn = BytesIO()
        save_figure(scenes_figure(self), drawn, dpi=100, format="svg")
        picture = drawn.getvalue().decode()
        return f"<p>{escape(self.verdict)}</p>{picture[picture.index('<svg') :]}"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw objects over all draws from above, and the path of the best scene.

        Objects are those of :meth:`clusters`, with their draws and regions of 50 and 90 %.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = posterior.plot()
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('x, to the right [m]', 'y, away from the camera [m]')
        """
        from imapper_prob.models.drawing import axes_for, draw_outlines, draw_paths
        from imapper_prob.uncertainty.drawing import draw_clusters

        axes, truth = axes_for(ax, size=(6.4, 5.6)), self.clip.truth
        people = len(self.clip.tracks)
        draw_paths(axes, self[0].scene.joints, people=people, label="pelvis")
        draw_outlines(axes, truth.objects if truth is not None else (), label="truth")
        draw_clusters(axes, self.clusters())
        return axes

    def to_arviz(self) -> xarray.DataTree:
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
        names = ("posterior", "sample_stats", "observed_data", "constant_data")
        groups = {name: self.data[name].to_dataset() for name in names}
        groups["posterior"] = groups["posterior"].merge(self._object_draws)
        tree: xr.DataTree = xr.DataTree.from_dict(groups)
        tree.attrs = self.data.attrs
        return tree

    @cached_property
    def _object_draws(self) -> xarray.Dataset:
        if self.stored is not None and "furniture" in self.stored.children:
            return self.stored["furniture"].to_dataset()
        return object_draws(self.clusters(), self.furniture, self.samples.shape)

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
    def data(self) -> xarray.DataTree:
        """Labelled draws and diagnostics in the structure of ArviZ.

        Examples
        --------
        >>> posterior.data["posterior"].sizes["chain"]
        2
        """
        from imapper_prob.uncertainty.tree import posterior_tree

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
        return FurnitureOfDraws(
            as_told(
                rng,
                objects,
                drawn_objects(rng, objects, settings),
                statements,
                problem=self.solution.problem,
                state=state,
                camera=self._camera(state.camera),
            )
            for objects, state in zip(self.samples.objects, self.samples.states, strict=True)
        )

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
        from imapper_prob.uncertainty.occupancy import occupancy

        return occupancy(self.furniture, cell=cell)

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
        from imapper_prob.uncertainty.clusters import object_clusters

        if least not in self._clusters:
            self._clusters[least] = object_clusters(
                self.samples.objects,
                self.samples.log_posterior,
                radius=self.config.sample.layout_radius,
                least=least,
                standing=self.furniture,
                seen=self._seen,
            )
        return self._clusters[least]

    @cached_property
    def _clusters(self) -> dict[float, tuple[ObjectCluster, ...]]:
        """Cache of clusters by least probability."""
        return {}

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
        from imapper_prob.uncertainty.motion import joint_summary

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
        from imapper_prob.uncertainty.hidden import hidden_joints

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
        from imapper_prob.uncertainty.parameters import nuisances

        problem, shape = self.solution.problem, self.samples.shape
        draws = np.array([state.camera for state in self.samples.states]).reshape(*shape, -1)
        covariance = np.asarray(np.linalg.inv(problem.camera_precision), np.float64)
        return nuisances(draws, mean=problem.camera_mean, covariance=covariance)

    def _motions(self) -> Iterator[Array]:
        """The motion of each draw in its world frame, one after the other."""
        return (motion(self.solution.problem, state) for state in self.samples.states)

    def _limbs(self) -> Iterator[Limbs]:
        """The motion of each draw with the person's deviations given the detections."""
        problem = self.solution.problem
        return (limbs_of(problem, s, self._camera(s.camera)) for s in self.samples.states)

    def record(self, path: str | Path, *, video: str | Path | None = None) -> None:
        """Write a recording (``.rrd``) for the rerun viewer.

        Parameters
        ----------
        path : path
        video : path, optional
            Images of the clip, shown behind the detections: a folder of images whose names end in
            the frame number, or a video file.

        Examples
        --------
        >>> from pathlib import Path
        >>> posterior.record("recording.rrd")
        >>> Path("recording.rrd").stat().st_size > 0
        True
        """
        from imapper_prob.recording.log import write_recording
        from imapper_prob.recording.video import read_video
        from imapper_prob.uncertainty.summary import describe

        write_recording(
            path,
            clip=self.clip,
            scenes=self.scenes(),
            traces=self.traces,
            truth=self.clip.truth,
            description=describe(
                self.clip, self.samples, verdict=self.chain_verdict, alarms=alarms(self.checks)
            ),
            certainty=self.certainty,
            draws=self._drawn_chains(),
            acceptance=self.samples.acceptance.rates(),
            video=None if video is None else read_video(video, self.clip),
        )

    def view(self, *, video: str | Path | None = None) -> Viewer:
        """Show the recording in a notebook; in a shell use ``imapper-prob view DIR``.

        Parameters
        ----------
        video : path, optional
            See :meth:`record`.

        Returns
        -------
        rerun_notebook.Viewer
            An interactive view with a timeline; it works offline.

        Raises
        ------
        InputError
            rerun's notebook package is not installed.

        Examples
        --------
        >>> posterior.view()  # doctest: +SKIP
        """
        from tempfile import TemporaryDirectory

        from imapper_prob.recording.video import recording_widget

        with TemporaryDirectory() as folder:
            recording = Path(folder) / "recording.rrd"
            self.record(recording, video=video)
            return recording_widget(recording)

    def report(self, path: str | Path) -> None:
        """Write the report, a single self-contained HTML page.

        Parameters
        ----------
        path : path
            An existing file is replaced.

        Examples
        --------
        >>> posterior.report("report.html")
        """
        from imapper_prob.results.report import write_report

        write_report(Path(path), self)

    def given(
        self,
        statements: Sequence[Statement],
        *,
        library: Library | None = None,
        steps: int | None = None,
        workers: int = 1,
        progress: Progress | bool | None = True,
    ) -> Posterior:
        """Condition the posterior on statements, i.e. knowledge besides the clip.

        If enough draws agree with the statements, draws are reweighted. Otherwise some draws are
        annealed to the conditional posterior, and chains continue from there.

        Parameters
        ----------
        statements : sequence of Statement
            Such as :class:`imapper_prob.models.statements.ObjectAt`; they are added to earlier
            statements of this posterior.
        library : Library, optional
            The library of the run, if it was opened from its folder; by default as in its settings.
        steps : int, optional
            Steps of continued chains at each temperature; a fourth of the run's if not given.
        workers : int
            Number of processes of continued chains; draws do not depend on it.
        progress : callable or bool
            Progress bars in a terminal or notebook if ``True``, nothing if ``False``; a callable is
            called with the name of a stage and its completed share.

        Returns
        -------
        Posterior
            Its ``told`` has all statements, and the log evidence ratio of the new ones with its
            error.

        Raises
        ------
        InputError
            A statement refers to something that clip or library do not have, statements contradict
            each other, or the library is not that of the run.

        Examples
        --------
        >>> told = posterior.given([im.Presence("couch")])
        >>> told.told.evidence.method
        'reweighted'
        """
        from imapper_prob.results.conditioned import conditioned

        with shown(progress) as report:
            return conditioned(
                self, statements, library=library, steps=steps, workers=workers, progress=report
            )

    def questions(self) -> tuple[Question, ...]:
        """Questions whose answers would tell most about the layout, in descending order.

        Questions are whether an object exists or has a label, how high the camera is, how tall the
        person is, and how far away and where everybody is in the frame in which the two most
        probable layouts differ most; each with the expected reduction in bits of the entropy of
        layouts.

        Returns
        -------
        tuple of Question

        Examples
        --------
        >>> questions = posterior.questions()
        >>> questions[0].bits >= questions[-1].bits
        True
        """
        from imapper_prob.uncertainty.questions import questions_of

        return questions_of(
            self.samples,
            self.clusters(),
            self.solution,
            radius=self.config.sample.layout_radius,
            rng=np.random.default_rng(self.config.seed),
        )

    def save(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write the files of a run, which :func:`load_posterior` opens again.

        Parameters
        ----------
        folder : path
            Created if needed.
        overwrite : bool
            Replace an earlier run in the folder; other files are never replaced.

        Raises
        ------
        InputError
            The folder has other contents, or the disk refuses.

        Examples
        --------
        >>> posterior.save("saved")
        >>> im.load_posterior("saved").clip.n_frames == clip.n_frames
        True
        """
        from imapper_prob.results.folders import write_run

        write_run(Path(folder), self, overwrite=overwrite)

    @cached_property
    def certainty(self) -> Certainty:
        """Summaries over all draws: occupancy, hidden joints with objects, joints, camera.

        Examples
        --------
        >>> bool(posterior.certainty.hidden.probability.max() <= 1)
        True
        """
        from imapper_prob.recording.posterior import Certainty

        return Certainty(self.occupancy(), self.hidden(), self.joints(), self.nuisances())

    def _drawn_chains(self) -> tuple[DrawnChain, ...]:
        """Evenly spaced draws of each chain, as many as a recording may hold."""
        from imapper_prob.recording.posterior import MOST, DrawnChain

        samples, problem = self.samples, self.solution.problem
        chains, draws = samples.shape
        kept = np.unique(np.linspace(0, draws - 1, max(1, MOST // chains)).round().astype(int))
        numbers = [c * draws + kept for c in range(chains)]
        return tuple(
            DrawnChain(
                kept,
                [samples.objects[n] for n in own],
                np.array(
                    [by_person(self.clip, motion(problem, samples.states[n])[:, PELV]) for n in own]
                ),
            )
            for own in numbers
        )

    @property
    def traces(self) -> dict[str, Array]:
        """Quantities of the chains for plots, by name: (chains, draws) each.

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


# ------------------------------------------------------------------------------------------------
# Opening a finished run from its folder.

_SAID = (
    "clip", "clip_digest", "config", "config_digest", "ensembles", "library", "library_digest",
    "program", "seed", "verdict",
)  # fmt: skip
"""Attributes that reports show."""


def load_posterior(folder: str | Path) -> Posterior:
    """Open a run from its folder: draws, scenes, clip and recording.

    Nothing is solved or sampled again, and neither clip nor library files are needed. The latent
    variables of paths are stored in single precision, and so are motions.

    Parameters
    ----------
    folder : path
        Folder of ``imapper-prob run``, or the ``posterior.nc`` in it.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        The file is missing, damaged, of another program or of an earlier version.

    Examples
    --------
    >>> im.load_posterior("run").clip.name
    'demo'
    """
    path = Path(folder)
    if path.name != "posterior.nc":
        path = path / "posterior.nc"
    if not path.is_file():
        raise InputError(f"{path}: no such file; name the folder of a finished run")
    require_intact(path)
    try:
        with xr.open_datatree(path, engine="h5netcdf") as opened:
            tree = opened.load()
    except Exception as error:  # the exceptions of xarray, h5netcdf and h5py differ
        raise InputError(f"{path}: damaged, or not the posterior of a run; run it again") from error
    if tree.attrs.get("format") != FORMAT:
        raise InputError(f"{path}: not the posterior of a run of this version; run the clip again")
    groups = tree.to_dict()
    try:
        source = read_source(path, groups)
        samples = read_samples(groups, source)
        told = told_of(tree.attrs)
        seconds, said = seconds_of(tree.attrs), {name: str(tree.attrs[name]) for name in _SAID}
        from_json(str(tree.attrs.get("checks", "[]")))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is not what a run wrote ({error}); run it again") from error
    config = from_toml(said["config"], where=str(path))
    return Posterior(source, samples, config, seconds=seconds, stored=tree, told=told)
