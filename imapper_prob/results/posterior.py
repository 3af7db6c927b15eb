"""The posterior of a clip: its draws as ranked scenes, whether to believe them, and their files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np

from imapper_prob.models.errors import InputError
from imapper_prob.progress import shown
from imapper_prob.uncertainty.checks import alarms
from imapper_prob.uncertainty.draws import Draws
from imapper_prob.uncertainty.ranking import Ranking
from imapper_prob.uncertainty.scenes import WeightedScene

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.axes import Axes
    from rerun_notebook import Viewer

    from imapper_prob.models.scenelet import Library
    from imapper_prob.models.statements import Statement
    from imapper_prob.progress import Progress
    from imapper_prob.recording.posterior import Certainty
    from imapper_prob.recording.video import Video
    from imapper_prob.samplers.diagnostics import LayoutProbabilities
    from imapper_prob.uncertainty.questions import Question

__all__ = ["Posterior"]


@dataclass(frozen=True)
class Posterior(Draws):
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

    def __repr__(self) -> str:
        chains, draws = self.samples.shape
        return (
            f"Posterior(clip={self.clip.name!r}, chains={chains}, draws={draws}, "
            f"layouts={len(self.samples.layouts.leaders)}, verdict={self.samples.verdict.text!r})"
        )

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self._ranking)

    def __iter__(self) -> Iterator[WeightedScene]:
        """Iterate over all scenes in descending order of probability."""
        return (self._ranking.scene(rank) for rank in range(len(self)))

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
            return tuple(self._ranking.scene(rank) for rank in range(len(self))[index])
        try:
            return self._ranking.scene(range(len(self))[index])
        except IndexError:
            raise IndexError(
                f"scene [{index}]: the run has {len(self)}, counted from [0]"
            ) from None

    @cached_property
    def _ranking(self) -> Ranking:
        return Ranking(self)

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
        return self[:count]

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
        if not 1 <= number <= len(self):
            raise InputError(f"scene {number}: the run has {len(self)} scenes, counted from 1")
        return self._ranking.scene(number - 1)

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
        ranks = range(len(self.samples.probabilities.layouts))
        return tuple(self._ranking.layout(rank) for rank in ranks[:count])

    @property
    def scene_probabilities(self) -> LayoutProbabilities:
        """Probabilities of all scenes in descending order, with scene indices in order of creation.

        Examples
        --------
        >>> float(posterior.scene_probabilities.probability.sum())
        1.0
        """
        return self._ranking.probabilities

    @property
    def disputed(self) -> tuple[int, ...]:
        """Numbers of the scenes whose layouts the chains disagree about: none, one, or two.

        Examples
        --------
        >>> len(posterior.disputed) <= 2
        True
        """
        pair = self.samples.verdict.disagreement or ()
        return tuple(sorted({1 + self._ranking.rank_of(layout - 1) for layout in pair}))

    @property
    def converged(self) -> bool:
        """Whether the chains have converged, and no check is alarmed.

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

    def record(self, path: str | Path, *, video: str | Path | Video | None = None) -> None:
        """Write a recording (``.rrd``) for the rerun viewer.

        Parameters
        ----------
        path : path
            Ends in ``.rrd``; an existing recording is replaced.
        video : path or Video, optional
            Images of the clip, shown behind the detections: a folder of images whose names end in
            the frame number, or a video file; see
            :func:`imapper_prob.recording.video.read_video`.

        Raises
        ------
        InputError
            The name has another suffix, or is that of another file of a run.

        Examples
        --------
        >>> from pathlib import Path
        >>> posterior.record("recording.rrd")
        >>> Path("recording.rrd").stat().st_size > 0
        True
        """
        from imapper_prob.files import require_output
        from imapper_prob.recording.log import write_recording
        from imapper_prob.recording.posterior import drawn_chains
        from imapper_prob.recording.video import read_video
        from imapper_prob.uncertainty.summary import describe

        require_output(Path(path), ".rrd", of_run="recording.rrd")
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
            draws=drawn_chains(self.clip, self.solution.problem, self.samples),
            acceptance=self.samples.acceptance.rates(),
            video=read_video(video, self.clip) if isinstance(video, str | Path) else video,
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
            Ends in ``.html``; an existing file is replaced.

        Raises
        ------
        InputError
            The name has another suffix, or is that of another file of a run.

        Examples
        --------
        >>> posterior.report("report.html")
        """
        from imapper_prob.files import require_output
        from imapper_prob.results.report import write_report

        require_output(Path(path), ".html", of_run="report.html")
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
            Such as :class:`imapper_prob.models.furniture_statements.ObjectAt`; they are added to
            earlier statements of this posterior.
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
