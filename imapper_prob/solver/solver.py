"""The staged solver: deterministic, from a clip to its best scene and alternatives.

The stages are those of the paper (Monszpart et al. 2019, section 6), in the same order: static path
and camera, independent fits, charness over time, candidates, combinations, refinement. The result
can be used by itself, and is the start of the sampler. With the published energy the stages are
exactly the paper's (:mod:`imapper_prob.solver.published`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from html import escape
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.log_posterior import State
from imapper_prob.models.path_prior import CameraPrior, StaticPath
from imapper_prob.models.problem import Problem, pack_problem, with_stays
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import Settings
from imapper_prob.models.text import Listed, brief
from imapper_prob.progress import Progress
from imapper_prob.scenelets.charness import charness, motion_distances
from imapper_prob.solver.camera_prior import estimate_camera, find_stays
from imapper_prob.solver.candidates import (
    Candidate,
    CharnessCurve,
    MaximaSettings,
    MaximumTable,
    charness_curve,
    screen,
    shortlist,
)
from imapper_prob.solver.combinations import Combinations, combine, groups_of, search, state_of
from imapper_prob.solver.detections import own_detections
from imapper_prob.solver.fits import Fits, best_fits, fit_windows, free_pose_cost
from imapper_prob.solver.poses import FrameTable
from imapper_prob.solver.published import NEARBY, combine_published, filter_published
from imapper_prob.solver.selection import published_objects, selected_objects
from imapper_prob.solver.static_path import examine_frames, examine_published

__all__ = [
    "METHODS",
    "Chosen",
    "Fitted",
    "Solution",
    "diverse_scenes",
    "fit_clip",
    "method_of",
    "solve",
    "solve_fitted",
    "solve_published",
]

_TRIED: Final = 64
"""Combinations evaluated for each further scene, fewer than for the best one; chosen."""


def diverse_scenes(
    solution: Solution, first: State, *, finish: Callable[[Problem, State], State], count: int
) -> tuple[State, ...]:
    """The best scene, and others that do not share its scenelets at nearby times.

    There are fewer if no other scene improves on the empty one. The paper has the same requirement
    for its five solutions of a long clip (Monszpart et al. 2019, section 5).

    Parameters
    ----------
    solution : Solution
    first : State
        The best scene.
    finish : callable
        Optimises the best remaining combination, such as
        :func:`imapper_prob.solver.combinations.polish`.
    count : int
        Largest number of scenes.

    Returns
    -------
    tuple of State
        ``first`` and the others.
    """
    scenes, problem = [first], solution.problem
    while len(scenes) < count:
        used = np.concatenate([scene.items for scene in scenes])
        near = NEARBY * solution.clip.fps
        left = [c for c in solution.candidates if not _nearby(c, used, near)]
        groups = groups_of(left, solution.curve)
        tried, _ = search(problem, groups, tried=_TRIED)
        if not tried[0].members:
            break
        pool = [c for group in groups for c in group]
        scenes.append(finish(problem, state_of(problem, [pool[k] for k in tried[0].members])))
    return tuple(scenes)


def _nearby(candidate: Candidate, used: np.ndarray, frames: float) -> bool:
    """Whether its scenelet was used at a start less than ``frames`` away."""
    same = used[:, 0] == candidate.scenelet
    return bool((same & (np.abs(used[:, 1] - candidate.start) < frames)).any())


# ------------------------------------------------------------------------------------------------
# The stages.

_PUBLISHED = MaximaSettings(most=5)
"""The paper uses at most five maxima of charness per clip."""
_LEAST_CHARNESS = 0.01
"""Added to charness where it weights scenelets, so that none is impossible a priori."""


class Chosen(NamedTuple):
    """The results of the stages after the fits, see :class:`Solution`.

    Parameters
    ----------
    candidates : tuple of Candidate
    curve : CharnessCurve
    shortlists : tuple of MaximumTable
    combinations : Combinations
    """

    candidates: tuple[Candidate, ...]
    curve: CharnessCurve
    shortlists: tuple[MaximumTable, ...]
    combinations: Combinations


@dataclass(frozen=True)
class Solution:
    """The result of the staged solver, with all intermediate results.

    Parameters
    ----------
    clip, library
        The input.
    path : StaticPath
        The static path of the person.
    frames : FrameTable
        Which frames have their own pose, and why others do not.
    camera : CameraPrior
        Gaussian of pitch, elevation, focal length, body size and roll.
    problem : Problem
        The packed log-posterior.
    curve : CharnessCurve
        Charness over time with its maxima.
    candidates : tuple of Candidate
        Fits that were judged, in order of time: by the log-posterior, or at the maxima of charness
        by the published energy.
    shortlists : tuple of MaximumTable
        For each maximum, in order of time, which candidates were kept and why others were not.
    combinations : Combinations
        The combinations of kept candidates, with their gains.
    distances : (L, L) float
        Distances between the motions of scenelets, metres.
    fits : Fits
        Fits of every scenelet in every window.
    settings : Settings
        Constants with which the clip was solved.

    Examples
    --------
    >>> solution = solved.actors[0]
    >>> len(solution.candidates) > 0
    True
    """

    clip: Clip
    library: Library
    path: StaticPath
    frames: FrameTable = field(repr=False)
    camera: CameraPrior
    problem: Problem = field(repr=False)
    curve: CharnessCurve = field(repr=False)
    candidates: tuple[Candidate, ...] = field(repr=False)
    shortlists: tuple[MaximumTable, ...] = field(repr=False)
    combinations: Combinations = field(repr=False)
    distances: NDArray[np.float64] = field(repr=False)
    fits: Fits = field(repr=False)
    settings: Settings = field(repr=False)

    __repr__ = brief

    def __post_init__(self) -> None:
        for name in ("candidates", "shortlists"):
            object.__setattr__(self, name, Listed(getattr(self, name)))

    def _repr_html_(self) -> str:
        """A table of the candidates left at each maximum of charness, for notebooks."""
        ids, rows = self.clip.frame_ids, []
        for table in self.shortlists:
            counts = table.counts()
            told = "".join(f"<td>{count}" for count in counts.values())
            value = self.curve.values[table.window]
            rows.append(f"<tr><td>{ids[self.curve.centres[table.window]]}<td>{value:.2f}{told}")
        steps = (
            "".join(f"<th>{escape(step)}" for step in self.shortlists[0].counts()) if rows else ""
        )
        said = f"{self!r}; candidates left at the maxima of charness, step by step:"
        head = f"<tr><th>frame<th>charness{steps}"
        return f"<p>{escape(said)}</p><table>{head}{''.join(rows)}</table>"

    @property
    def states(self) -> tuple[State, ...]:
        """The best scene, then diverse alternatives.

        Examples
        --------
        >>> best = solved.actors[0].states[0]
        >>> best.n_scenelets > 0
        True
        """
        return self.combinations.states

    @cached_property
    def best_fits(self) -> NDArray[np.float64]:
        """(T,) excess cost of the best scenelet over each frame (`imapper_prob.solver.fits`).

        Examples
        --------
        >>> len(solved.actors[0].best_fits) == clip.n_frames
        True
        """
        return method_of(self.problem).best_fits(self.problem, self.fits)


def solve(
    clip: Clip,
    library: Library,
    *,
    settings: Settings | None = None,
    camera: CameraPrior | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Solve a clip of one actor; deterministic.

    Parameters
    ----------
    clip, library
        The input.
    settings : Settings, optional
        Constants of the model and of the stages.
    camera : CameraPrior, optional
        Prior of camera and body; estimated from the actor's feet if not given.
    progress : callable, optional
        Called with the name of the stage and its completed share.

    Returns
    -------
    Solution
    """
    fitted = fit_clip(clip, library, settings=settings, camera=camera, progress=progress)
    return solve_fitted(clip, library, fitted, progress=progress)


@dataclass(frozen=True)
class Fitted:
    """The results of the stages before scenelets are selected.

    Parameters
    ----------
    path : StaticPath
    frames : FrameTable
    camera : CameraPrior
    problem : Problem
        The log-posterior, including the cost of free poses.
    fits : Fits
        Fits of every scenelet in every window.
    charness : (L,) float
        Charness of the library's scenelets.
    distances : (L, L) float
        Distances between the motions of scenelets, metres.
    settings : Settings
        Constants of these stages.
    """

    path: StaticPath
    frames: FrameTable
    camera: CameraPrior
    problem: Problem
    fits: Fits
    charness: NDArray[np.float64]
    distances: NDArray[np.float64]
    settings: Settings

    __repr__ = brief


def fit_clip(
    clip: Clip,
    library: Library,
    *,
    settings: Settings | None = None,
    camera: CameraPrior | None = None,
    progress: Progress | None = None,
) -> Fitted:
    """Run the first stages: static path, camera, independent fits.

    Parameters
    ----------
    clip, library, settings, camera, progress
        See :func:`solve`.

    Returns
    -------
    Fitted
    """
    settings = settings or Settings()
    path, frames = METHODS[settings.model.energy].examine(
        clip, settings=settings.path, detector=settings.detector
    )
    own = own_detections(clip, settings.detector)
    camera = camera or estimate_camera(
        own, path, settings=settings.camera, detector=settings.detector
    )
    if progress is not None:
        progress("static path", 1.0)
    distances = motion_distances(library)
    characteristic = charness(library, distances)
    if progress is not None:
        progress("comparing motions", 1.0)
    weights = characteristic + _LEAST_CHARNESS
    problem = pack_problem(
        own,
        path,
        camera,
        library,
        settings=settings.model,
        detections=DetectionModel.of(settings.detector),
        weights=weights,
    )
    stays = find_stays(own.tracks[0], path, camera, fps=clip.fps, settings=settings.model)
    problem = with_stays(problem, stays)
    fits = method_of(problem).fit_windows(
        problem,
        path,
        fps=clip.fps,
        device=settings.device,
        progress=progress,
    )
    if settings.model.energy == "default":
        problem = problem._replace(free_cost=free_pose_cost(problem, fits))
    if progress is not None:
        progress("judging free poses", 1.0)
    return Fitted(path, frames, camera, problem, fits, characteristic, distances, settings)


def solve_fitted(
    clip: Clip, library: Library, fitted: Fitted, *, progress: Progress | None = None
) -> Solution:
    """Run the stages after the fits: charness, candidates, combinations, refinement.

    Parameters
    ----------
    clip, library
        See :func:`solve`.
    fitted : Fitted
    progress : callable, optional
        See :func:`solve`.

    Returns
    -------
    Solution
    """
    chosen = method_of(fitted.problem).choose(clip, fitted, progress=progress)
    return Solution(
        clip,
        library,
        fitted.path,
        fitted.frames,
        fitted.camera,
        fitted.problem,
        chosen.curve,
        chosen.candidates,
        chosen.shortlists,
        chosen.combinations,
        fitted.distances,
        fitted.fits,
        fitted.settings,
    )


def _choose(clip: Clip, fitted: Fitted, *, progress: Progress | None = None) -> Chosen:
    """Select candidates at maxima of charness, and combine them, under the log-posterior."""
    problem = fitted.problem
    candidates = screen(problem, fitted.fits, progress=progress)
    curve = charness_curve(fitted.fits, fitted.charness, fps=clip.fps)
    combinations = combine(problem, candidates, curve, progress=progress)
    tables = shortlist(problem, fitted.fits, candidates, curve, combinations.pool)
    return Chosen(candidates, curve, tables, combinations)


def solve_published(clip: Clip, fitted: Fitted, *, progress: Progress | None = None) -> Chosen:
    """Run the stages after the fits as in the paper: T', the filter, all combinations.

    Parameters
    ----------
    clip : Clip
    fitted : Fitted
    progress : callable, optional
        See :func:`solve`.

    Returns
    -------
    Chosen
    """
    problem = fitted.problem
    bare = ~fitted.path.posed
    curve = charness_curve(
        fitted.fits, fitted.charness, fps=clip.fps, settings=_PUBLISHED, bare=bare
    )
    tables = filter_published(problem, fitted.fits, curve, progress=progress)
    return Chosen(
        tuple(row.candidate for table in tables for row in table.rows),
        curve,
        tables,
        combine_published(problem, tables, fps=clip.fps, progress=progress),
    )


# ------------------------------------------------------------------------------------------------
# The default method and the published one.


@dataclass(frozen=True)
class Method:
    """The stages that depend on the choice of log-posterior.

    Parameters
    ----------
    examine : callable
        Estimates static path and frame table, such as `examine_frames`.
    fit_windows : callable
        Fits every scenelet in every window, see `imapper_prob.solver.fits.fit_windows`.
    best_fits : callable
        Excess cost of the best scenelets, as `imapper_prob.solver.fits.best_fits`.
    choose : callable
        Runs the stages after the fits, such as `solve_published`.
    diverse : bool
        Whether scenes are diverse and sorted by log-posterior; otherwise they are those that
        ``choose`` lists, in its order.
    objects : callable
        Selects the furniture of a state to report, such as `selected_objects`.
    """

    examine: Callable[..., tuple[StaticPath, FrameTable]]
    fit_windows: Callable[..., Fits]
    best_fits: Callable[[Problem, Fits], NDArray[np.float64]]
    choose: Callable[..., Chosen]
    diverse: bool
    objects: Callable[[Problem, Library, State], tuple[SceneObject, ...]]


def _unknown_fits(problem: Problem, fits: Fits) -> NDArray[np.float64]:
    """NaN: for squared residuals the expected cost of the right motion is unknown."""
    return np.full(problem.n_frames, np.nan)


METHODS: Final[Mapping[str, Method]] = MappingProxyType(
    {
        "default": Method(
            examine_frames,
            fit_windows,
            best_fits,
            _choose,
            True,
            selected_objects,
        ),
        "paper": Method(
            examine_published,
            partial(fit_windows, squared=True),
            _unknown_fits,
            solve_published,
            False,  # sorted by the published energy, without priors
            published_objects,
        ),
    }
)
"""Methods by ``ModelSettings.energy``."""


def method_of(problem: Problem) -> Method:
    """The method for the log-posterior that a problem was packed for.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Method
    """
    return METHODS["paper" if problem.of_paper else "default"]
