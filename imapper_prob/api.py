"""The functions most people need: load a clip, solve it, sample it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from imapper_prob.clips.load import ClipOptions, read_frames, require_people
from imapper_prob.clips.takes import same_room
from imapper_prob.config import Config, SampleSettings
from imapper_prob.lifting import lift_clip
from imapper_prob.memory import require_memory
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.statement_rows import check_statements, tell
from imapper_prob.models.statements import Statement
from imapper_prob.progress import Progress, shown
from imapper_prob.results.posterior import Posterior
from imapper_prob.sampling.actors import join_actors
from imapper_prob.sampling.blocks import Limits, OnBlock
from imapper_prob.sampling.conditioning import Told, with_statements
from imapper_prob.sampling.sample import Cluster, sample_scenes
from imapper_prob.sampling.schedule import end_of, stopped_at
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip
from imapper_prob.solver.actors import Solved, solve_actors, solved
from imapper_prob.solver.solver import Solution

__all__ = ["demo_clip", "load_clip", "sample", "solve"]

_STORY = ("sit-couch-table-003", "reach-shelf-001")
"""Scenelets performed: sitting on a couch at a low table, then reaching into a shelf."""


def demo_clip(seed: int = 4) -> Clip:
    """Thirteen seconds at 10 frames a second: somebody comes in, sits down and goes to a shelf.

    The table hides the feet of whoever sits there. The built-in library holds what
    is performed, so the scene can be recovered; camera, body and detections are drawn from
    the model.

    Parameters
    ----------
    seed : int
        The same seed gives the same clip.

    Returns
    -------
    Clip
        With its truth.

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
    """Read a clip of any known format; 2D joints get poses from the built-in library.

    Parameters
    ----------
    path : path
        See ``docs/reference/inputs.md``.
    options : ClipOptions, optional
        Camera, image size, frame rate, and whatever else the files do not say.
    frames : (int, int), optional
        First and last frame to take, by the clip's own numbers; all if not given.

    Returns
    -------
    Clip

    Raises
    ------
    InputError
        What is at ``path`` is no clip, or one too short or too empty to say anything.

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
    """The best scenes of a clip with everybody in it, by the deterministic staged solver.

    Parameters
    ----------
    clip : Clip or sequence of Clip
        What was seen, see `load_clip`; several takes of one room are put together, see `same_room`.
    library : Library, optional
        What people do near furniture, see `load_library`; the built-in one if not given.
    config : Config, optional
    scenes : int
        How many, of which no two have the same scenelet at nearby times.
    progress : callable or bool
        Bars in a terminal or notebook if ``True``, nothing if ``False``; a callable is called with
        the name of a stage and the part of it that is done.

    Returns
    -------
    Solved
        ``scenes``, the best first, and by person (``actors``) what the solver found on the way.

    Examples
    --------
    >>> solved = im.solve(clip, library, scenes=2)
    >>> [o.label for o in solved.scenes[0].objects]
    ['couch']
    """
    settings = config.settings if config is not None else None
    known = load_library() if library is None else library
    clip = _one(clip)
    with shown(progress) as report:
        actors = solve_actors(clip, known, settings=settings, progress=report)
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
    """Sample scenes from the posterior of a clip, with everybody in it.

    With ``minutes`` or ``until`` chains go on in blocks of steps, after each of which they are
    judged. The clock decides how many blocks there are, and nothing else: the same seed and
    number of steps give the same draws.

    Parameters
    ----------
    clip, library
        See `solve`.
    start : Solved, Solution or sequence of Solution, optional
        Where to start from: what `solve` returns, or the solutions by actor. All actors are
        solved first if not given.
    given : sequence of Statement
        What is known besides the clip, such as `ObjectAt`; a term of what the chains sample.
    rng : int, optional
        Seed; all randomness comes from it. That of ``config`` if not given.
    chains : int, optional
        How many chains. As ``config`` says if not given.
    workers : int
        Processes; the draws do not depend on it.
    cluster : Cluster, optional
        Runs the chains elsewhere, such as a `distributed.Client`.
    config : Config, optional
    checkpoints : path, optional
        Folder in which the chains leave what they have every few seconds. The same call goes
        on from there after a kill, to the same draws. It stays when the run is done, and a call
        with ``minutes``, ``until`` or a larger ``last_step`` in its settings goes on from the end.
    anew : bool
        Delete checkpoints of another run, or damaged ones, instead of refusing them.
    minutes : float, optional
        Of sampling, after solving: no block is begun that would not end in time, but the first.
    until : "good", optional
        Stop as soon as the verdict is good; at the latest after ``minutes``, or an hour.
    progress : callable or bool
        See `solve`.
    on_block : callable, optional
        Called with what is known after each block.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        ``minutes`` or ``until`` make no sense, the clip does not fit into the memory that there
        is, or what it holds cannot be used; or no scene of the clip can be as ``given`` says.

    Examples
    --------
    >>> posterior = im.sample(clip, library, start=solved, config=config)
    >>> posterior.samples.shape
    (2, 10)
    """
    config = config or Config()
    config = replace(
        config,
        seed=config.seed if rng is None else rng,
        sample=replace(config.sample, chains=chains or config.sample.chains),
    )
    limits = Limits(minutes, until)
    clip = _one(clip)
    known = load_library() if library is None else library
    require_memory(clip, known, _most(config.sample) if limits.any else config.sample)
    check_statements(given, clip, known)
    begun = time.perf_counter()
    with shown(progress) as report:
        if start is None:
            solutions = solve_actors(clip, known, settings=config.settings, progress=report)
        elif isinstance(start, Solved):
            solutions = start.actors
        else:
            solutions = (start,) if isinstance(start, Solution) else tuple(start)
        source = solutions[0] if len(solutions) == 1 else join_actors(solutions)
        told = None
        if given:
            source = with_statements(source, tell(source.problem, given, clip, known))
            told = Told(tuple(given))
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
    seconds = {"solving": ready - begun, "sampling": time.perf_counter() - ready}
    end = samples.end(config.sample)
    if limits.any or (samples.finished and end > end_of(config.sample)):
        config = replace(config, sample=stopped_at(config.sample, end))
    return Posterior(source, samples, config, seconds=seconds, told=told)


def _one(clip: Clip | Sequence[Clip]) -> Clip:
    return clip if isinstance(clip, Clip) else same_room(clip)


def _most(settings: SampleSettings) -> SampleSettings:
    """Settings under which as many draws are kept as ever are."""
    return replace(settings, last_step=settings.steps + 1)
