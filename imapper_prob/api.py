"""The main functions: load a clip, solve it, sample it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from imapper_prob.clips.load import ClipOptions, read_frames, require_people
from imapper_prob.clips.takes import same_room
from imapper_prob.config import Config, SampleSettings
from imapper_prob.lifting import lift_clip
from imapper_prob.memory import require_feasible
from imapper_prob.models.errors import InputError, require_kind, require_whole
from imapper_prob.models.problem import labels_of
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.statement_rows import check_statements, tell
from imapper_prob.models.statements import Statement
from imapper_prob.models.text import shortened
from imapper_prob.progress import Progress, shown
from imapper_prob.results.posterior import Posterior
from imapper_prob.samplers.interrupts import interruptible
from imapper_prob.sampling.actors import join_actors
from imapper_prob.sampling.blocks import Limits, OnBlock
from imapper_prob.sampling.cluster import Cluster
from imapper_prob.sampling.conditioning import Told, denied, with_statements
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.sampling.schedule import end_of, stopped_at
from imapper_prob.sampling.warm_up import kernels_compiled_meanwhile
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip
from imapper_prob.solver.actors import Solved, solve_actors, solved
from imapper_prob.solver.solver import Solution
from imapper_prob.uncertainty.tree import clip_digest

__all__ = ["demo_clip", "load_clip", "sample", "solve"]

_STORY = ("sit-couch-table-003", "reach-shelf-001")
"""Scenelets of the demo: sitting on a couch at a low table, then reaching into a shelf."""


def demo_clip(seed: int = 4) -> Clip:
    """Simulate 13 s at 10 frames a second: a person enters, sits down and goes to a shelf.

    The table hides the feet of the sitting person. The scenelets performed are in the built-in
    library, so the scene can be recovered; camera, body and detections are drawn from the model.

    Parameters
    ----------
    seed : int
        Equal seeds give equal clips.

    Returns
    -------
    Clip
        Includes its ground truth.

    Examples
    --------
    >>> clip = im.demo_clip()
    >>> [o.label for o in clip.truth.objects]
    ['couch', 'table', 'shelf']
    """
    rng = np.random.default_rng(seed)
    return simulate_clip(
        rng, load_library(), n_frames=130, script=_STORY, n_bystanders=0, name="demo"
    )


def load_clip(
    path: str | Path,
    *,
    options: ClipOptions | None = None,
    frames: tuple[int, int] | None = None,
) -> Clip:
    """Read a clip; clips without poses are lifted with the built-in library.

    Parameters
    ----------
    path : path
        Keypoints, 3D joints, an i3DB scene or a clip file; see ``docs/reference/inputs.md``. A
        video needs ``imapper-prob detect`` first.
    options : ClipOptions, optional
        Camera, image size, frame rate, and whatever else the files do not state.
    frames : (int, int), optional
        First and last frame to read, by the clip's own numbers; all if not given.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        The content of ``path`` is not a clip, or the clip is too short or has no usable person.

    Examples
    --------
    >>> im.write_clip("clip.npz", im.demo_clip())
    >>> im.load_clip("clip.npz").name
    'demo'
    """
    clip = read_frames(path, options=options, frames=frames)
    if not all(track.has_pose.any() for track in clip.tracks):
        clip = lift_clip(clip)
    require_people(clip, path)
    return clip


def solve(
    clip: Clip | Sequence[Clip],
    library: Library | None = None,
    *,
    config: Config | None = None,
    scenes: int = 5,
    progress: Progress | bool | None = True,
) -> Solved:
    """Find the best scenes of a clip for all its people, by the deterministic staged solver.

    Parameters
    ----------
    clip : Clip or sequence of Clip
        The observed clip, see `load_clip`; several takes of one room are combined, see `same_room`.
    library : Library, optional
        Library of scenelets, see `load_library`; the built-in one if not given.
    config : Config, optional
    scenes : int
        Number of scenes; no two of them have the same scenelet at nearby times.
    progress : callable or bool
        ``True`` shows bars in a terminal or notebook, ``False`` shows nothing; a callable is called
        with the name of a stage and the fraction of it that is done.

    Returns
    -------
    Solved
        ``scenes``, the best first, and intermediate results of the solver by person (``actors``).

    Raises
    ------
    InputError
        An argument is of another type, the clip is too slow for the library, too long or needs more
        memory than is available, or its content cannot be used.

    Examples
    --------
    >>> solved = im.solve(clip, library, scenes=2)
    >>> [o.label for o in solved.scenes[0].objects]
    ['couch']
    """
    require_whole("scenes", scenes, least=1)
    config, known, clip = _config(config), _library(library), _one(clip)
    require_feasible(clip, known)
    with interruptible(), shown(progress) as report:
        actors = solve_actors(clip, known, settings=config.settings, progress=report)
    return solved(clip, actors, count=scenes)


def sample(
    clip: Clip | Sequence[Clip],
    library: Library | None = None,
    *,
    start: Solved | Solution | Sequence[Solution] | None = None,
    given: Sequence[Statement] = (),
    rng: int | None = None,
    chains: int | None = None,
    workers: int = 1,
    cluster: Cluster | None = None,
    config: Config | None = None,
    checkpoints: str | Path | None = None,
    anew: bool = False,
    minutes: float | None = None,
    until: Literal["good"] | None = None,
    progress: Progress | bool | None = True,
    on_block: OnBlock | None = None,
) -> Posterior:
    """Sample scenes from the posterior of a clip, for all its people.

    With ``minutes`` or ``until``, chains continue in blocks of steps and are assessed after each
    block. The clock determines only the number of blocks: the same seed and number of steps give
    the same draws.

    Parameters
    ----------
    clip, library
        See `solve`.
    start : Solved, Solution or sequence of Solution, optional
        Starting point: the result of `solve` for this clip, library and settings, or the solutions
        by actor. If not given, all actors are solved first.
    given : sequence of Statement
        Statements known besides the clip, such as `ObjectAt`; each is a term of the target density.
    rng : int, optional
        Seed of all randomness. That of ``config`` if not given.
    chains : int, optional
        Number of chains. That of ``config`` if not given.
    workers : int
        Number of processes; the draws do not depend on it. With more than one, the first run of an
        installation compiles the moves of chains while it solves.
    cluster : Cluster, optional
        Runs the chains on other machines, such as a `distributed.Client`.
    config : Config, optional
    checkpoints : path, optional
        Folder in which the chains store their state every few seconds. After a kill, the same call
        continues from there and gives the same draws. The folder is kept after the run, and a call
        with ``minutes``, ``until`` or a larger ``last_step`` in its settings continues from the
        end.
    anew : bool
        Delete checkpoints of another run, or damaged ones, instead of raising an error.
    minutes : float, optional
        Minutes of sampling, after solving. Apart from the first, no block is begun that would end
        later.
    until : "good", optional
        Stop when the verdict is good; at the latest after ``minutes``, or after an hour.
    progress : callable or bool
        See `solve`.
    on_block : callable, optional
        Called after each block with its assessment.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        An argument is invalid, ``start`` is of another clip, library or settings, the clip is
        too slow for the library, too long or needs more memory than is available, its content
        cannot be used, or no scene of clip and library can fulfil ``given``.

    Examples
    --------
    >>> posterior = im.sample(clip, library, start=solved, config=config)
    >>> posterior.samples.shape
    (2, 10)
    """
    config = _config(config)
    config = replace(
        config,
        seed=config.seed if rng is None else rng,
        sample=replace(config.sample, chains=config.sample.chains if chains is None else chains),
    )
    limits = Limits(minutes, until)
    require_whole("workers", workers, least=1)
    if isinstance(cluster, str):
        raise InputError(f"cluster = {cluster!r:.60} must be a distributed.Client; make it of that")
    clip = _one(clip)
    begun_from = None if start is None else _solutions(start, clip, library, config)
    known = _library(library) if begun_from is None else begun_from[0].library
    require_feasible(clip, known, _most(config.sample) if limits.any else config.sample)
    labels = labels_of(known)
    check_statements(given, clip, labels)
    begun = time.perf_counter()
    with interruptible(), shown(progress) as report:
        if begun_from is not None:
            solutions = begun_from
        else:
            spare = workers > 1 and cluster is None and config.model.energy == "default"
            with kernels_compiled_meanwhile(wanted=spare, progress=report):
                solutions = solve_actors(clip, known, settings=config.settings, progress=report)
        source = solutions[0] if len(solutions) == 1 else join_actors(solutions)
        bare = source.problem
        if given:
            source = with_statements(source, tell(bare, given, source.clip, labels))
        ready = time.perf_counter()
        samples = sample_scenes(
            source,
            config.sample,
            seed=np.random.SeedSequence(config.seed),
            workers=workers,
            cluster=cluster,
            checkpoints=None if checkpoints is None else Path(checkpoints),
            anew=anew,
            progress=report,
            limits=limits,
            on_block=on_block,
        )
    told = None
    if given:
        told = Told(
            tuple(given),
            denied=denied(bare, samples.states, statements=given, clip=source.clip, labels=labels),
        )
    seconds = {"solving": ready - begun, "sampling": time.perf_counter() - ready}
    end = samples.end(config.sample)
    if limits.any or (samples.finished and end > end_of(config.sample)):
        config = replace(config, sample=stopped_at(config.sample, end))
    return Posterior(source, samples, config, seconds=seconds, told=told)


def _config(config: Config | None) -> Config:
    config = Config() if config is None else config
    require_kind("config", config, Config, "a Config, see read_config")
    return config


def _library(library: Library | None) -> Library:
    known = load_library() if library is None else library
    require_kind("library", known, Library, "a Library, see load_library")
    return known


def _solutions(
    start: Solved | Solution | Sequence[Solution],
    clip: Clip,
    library: Library | None,
    config: Config,
) -> tuple[Solution, ...]:
    """The solutions of a starting point, one for each actor of the clip.

    Raises
    ------
    InputError
        They are not solutions, or are of another clip, library or settings.
    """
    found: Any = start.actors if isinstance(start, Solved) else start
    found = (found,) if isinstance(found, Solution) else found
    found = tuple(found) if isinstance(found, Iterable) else ()
    if not found:
        raise InputError(f"start = {start!r:.60} must be the result of solve")
    for solution in found:
        require_kind("start", solution, Solution, "the result of solve")
    clips = [replace(clip, tracks=(track,)) for track in clip.tracks]
    if [clip_digest(s.clip) for s in found] != [clip_digest(c) for c in clips]:
        raise InputError(
            f"start is of another clip ({found[0].clip.name}) than {clip.name}; solve this one"
        )
    if library is not None and _library(library).digest != found[0].library.digest:
        raise InputError(f"start is of another library, {found[0].library.name}; solve with this")
    names = dict.fromkeys(n for s in found for n in s.settings.differences(config.settings))
    if names:
        raise InputError(
            f"start is of other settings than config ({shortened(names, most=5)}); solve with "
            "config"
        )
    return tuple(found)


def _one(clip: Clip | Sequence[Clip]) -> Clip:
    return clip if isinstance(clip, Clip) else same_room(clip)


def _most(settings: SampleSettings) -> SampleSettings:
    """Settings for which chains keep the greatest number of draws."""
    return replace(settings, last_step=settings.steps + 1)
