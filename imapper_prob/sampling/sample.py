"""Sample the posterior of a solved clip: reversible-jump chains, ensembles, layouts, verdict."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.layouts import Layouts, group_layouts, merged_objects, through_one_lens
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.text import Listed, brief
from imapper_prob.progress import Progress
from imapper_prob.samplers.chains import ChainError, Workers, run_chains
from imapper_prob.samplers.checkpoint import CheckpointError, checkpoint_of, run_resumable_chains
from imapper_prob.samplers.diagnostics import (
    LayoutProbabilities,
    ShortChainWarning,
    equilibrated,
    layout_probabilities,
)
from imapper_prob.samplers.ladder import LadderSummary
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.samplers.verdict import Measures, Verdict, judge, measure
from imapper_prob.sampling.actors import JointProblem, join_actors
from imapper_prob.sampling.blocks import Block, Clock, Limits, OnBlock
from imapper_prob.sampling.chain import (
    Chain,
    Setup,
    first_used,
    learnt_from,
    run_chain,
    starts_of,
    temperatures_of,
)
from imapper_prob.sampling.checkpoints import ChainProgress, identity_of, rounds_done
from imapper_prob.sampling.cluster import Cluster, SameProgram, executor_of
from imapper_prob.sampling.ensembles import EnsembleRefinement, refine_draws
from imapper_prob.sampling.gains import gains_of
from imapper_prob.sampling.schedule import (
    block_end,
    burn_in_of,
    draws_of,
    end_of,
    learning_of,
    trace_of,
)
from imapper_prob.scenelets.charness import similarity
from imapper_prob.solver.solver import Solution

__all__ = ["Progress", "Samples", "functionals", "judge_draws", "sample_scenes", "setup_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Draws from the posterior of a clip, with their layouts and the verdict.

    Draws are numbered chain by chain: draw n of chain c is c N + n.

    Parameters
    ----------
    states : tuple of C N State
    log_posterior : (C, N) float
        Nats, up to the constant of the clip.
    traces : (C, M) float
        Log-posterior over the whole run, including burn-in.
    objects : tuple of C N tuples of SceneObject
        Merged furniture of each draw, in its world frame.
    layouts : Layouts
        The layout of each draw.
    probabilities : LayoutProbabilities
        Probabilities of layouts, which are numbered from 1 as in texts for people.
    walked : EnsembleRefinement or None
        Effect of the ensembles on the draws; None if there were none.
    acceptance : AcceptanceTable
        Acceptance over all chains.
    ladders : tuple of C LadderSummary
        Temperatures of each chain, and how its states travelled between them.
    verdict : Verdict
    finished : bool
        Whether every chain and every ensemble completed its steps.
    """

    states: tuple[State, ...]
    log_posterior: Array
    traces: Array
    objects: tuple[tuple[SceneObject, ...], ...]
    layouts: Layouts
    probabilities: LayoutProbabilities
    walked: EnsembleRefinement | None
    acceptance: AcceptanceTable
    ladders: tuple[LadderSummary, ...]
    verdict: Verdict
    finished: bool

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "states", Listed(self.states))
        object.__setattr__(self, "objects", Listed(self.objects))

    def end(self, settings: SampleSettings) -> int:
        """Round at which the block of these draws ends; ``settings`` are those of the run.

        Parameters
        ----------
        settings : SampleSettings

        Returns
        -------
        int
            Rounds.
        """
        kept = max(ladder.rounds for ladder in self.ladders)
        done = burn_in_of(settings) + kept
        return done if self.finished else block_end(settings, done - 1)

    def unused(self, settings: SampleSettings, *, weighted: bool = False) -> int:
        """Number of values of each trace from before the first draw: burn-in and draws left out.

        Parameters
        ----------
        settings : SampleSettings
            Those of the run.
        weighted : bool
            Whether the draws were chosen by weight, so that missing ones are not the first.

        Returns
        -------
        int
            All values if the run was interrupted in the burn-in.
        """
        rounds = burn_in_of(settings) + min(ladder.rounds for ladder in self.ladders)
        draws, trace = draws_of(settings), trace_of(settings)
        left_out = 0 if weighted else max(draws.kept(rounds) - self.shape[1], 0)
        first = draws.at(left_out * draws.stride(rounds))
        before: int = min(-(-trace.count(first) // trace.stride(rounds)), self.traces.shape[1])
        return before

    @cached_property
    def seen(self) -> tuple[tuple[SceneObject, ...], ...]:
        """Furniture of each draw converted to the nominal focal length, for comparisons."""
        focal = [float(state.camera[2]) for state in self.states]
        return Listed(through_one_lens(self.objects, focal))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of chains C, and of draws N per chain."""
        chains, draws = self.log_posterior.shape
        return chains, draws


def sample_scenes(
    solution: Solution | JointProblem,
    settings: SampleSettings,
    *,
    seed: np.random.SeedSequence,
    workers: int = 1,
    cluster: Cluster | None = None,
    checkpoints: Path | None = None,
    anew: bool = False,
    starts: Sequence[Sequence[State]] | None = None,
    progress: Progress | None = None,
    limits: Limits | None = None,
    on_block: OnBlock | None = None,
) -> Samples:
    """Sample the posterior from the solver's solution of one actor or of several joined actors.

    The result depends on ``seed`` and the number of steps, not on ``workers`` or ``cluster``. An
    interrupt (Ctrl-C) ends chains or ensembles early; the draws so far are used.

    Parameters
    ----------
    solution, settings, seed, workers
    cluster : Cluster, optional
        Where the chains run instead of this machine, see `imapper_prob.sampling.cluster`. They
        report no progress from there.
    checkpoints : Path, optional
        Folder for checkpoints, which chains write every few seconds and resume from: a run that was
        killed and is repeated gives the same draws. Finished chains continue from there as well if
        more rounds are wanted.
    anew : bool
        Delete checkpoints that are damaged or of another run, instead of raising an error.
    starts : sequence of sequence of State, optional
        For each chain its starts by temperature, the coldest first; by default those of
        :func:`imapper_prob.sampling.chain.starts_of`.
    progress : callable, optional
        Called with the name of the stage and its completed share.
    limits : Limits, optional
        Sample in blocks until a limit is reached, whatever end the settings have.
    on_block : callable, optional
        Called with the state of the run after each block; a run without limits has one block.

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        Checkpoints are damaged, of another run or cannot be written, a process died, or there are
        limits and a cluster but no folder for checkpoints that its workers see.
    """
    limits = limits or Limits()
    if limits.any and checkpoints is None:
        if cluster is not None:
            raise InputError(
                "a cluster's chains go on in blocks from checkpoints: name a folder for these "
                "that its workers see"
            )
        with TemporaryDirectory(prefix="imapper-prob-") as folder:
            return sample_scenes(
                solution, settings, seed=seed, workers=workers, checkpoints=Path(folder),
                starts=starts, progress=progress, limits=limits, on_block=on_block,
            )  # fmt: skip
    chain_seed, layout_seed, ensemble_seed = seed.spawn(3)
    source = solution if isinstance(solution, JointProblem) else join_actors([solution])
    setup = setup_of(source, settings)
    starts = starts_of(source, settings.chains) if starts is None else starts
    with (
        _told_plainly(checkpoints),
        executor_of(cluster) as executor,
        Workers(workers) as processes,
    ):
        run = _ChainRun(
            setup=setup,
            starts=starts,
            seed=chain_seed,
            workers=processes,
            executor=executor,
            folder=None if checkpoints is None else checkpoints.resolve(),
            identity=identity_of(source.problem, [*starts, setup.staged], settings, chain_seed),
            anew=anew,
        )
        drawn = _in_blocks(run, source, settings, layout_seed, limits, progress, on_block)
        walked = None
        if settings.ensemble_steps:
            drawn, walked = _walked(
                drawn,
                source,
                settings,
                layout_seed,
                ensemble_seed,
                processes,
                checkpoints,
                progress,
            )
    chains = drawn.chains
    return Samples(
        states=drawn.states,
        log_posterior=drawn.values,
        traces=_aligned([chain.trace for chain in chains]),
        objects=drawn.objects,
        layouts=drawn.layouts,
        probabilities=drawn.probabilities,
        walked=walked,
        acceptance=sum((chain.acceptance for chain in chains), AcceptanceTable()),
        ladders=tuple(chain.ladder for chain in chains),
        verdict=drawn.verdict,
        finished=all(chain.finished for chain in chains)
        and (walked is None or not walked.walkers or walked.steps == settings.ensemble_steps),
    )


@dataclass(frozen=True)
class _ChainRun:
    """All chains of a run, which can be continued to any round."""

    setup: Setup
    starts: Sequence[Sequence[State]]
    seed: np.random.SeedSequence
    workers: Workers
    executor: SameProgram | None
    folder: Path | None
    identity: str
    anew: bool

    def rounds(self) -> Array:
        """(C,) number of rounds in each chain's checkpoint."""
        done = np.zeros(len(self.starts))
        for chain in range(len(done) if self.folder is not None else 0):
            assert self.folder is not None
            try:
                done[chain] = rounds_done(checkpoint_of(self.folder, chain), identity=self.identity)
            except CheckpointError:
                if not self.anew:
                    raise
        return done

    def to(self, end: int, on_progress: Callable[[int, object], None]) -> list[Chain]:
        """Continue all chains to round ``end``.

        Chains wait for each other before a reference is learnt, once for all of them and from the
        visits of all of them.
        """
        setup, at = self.setup, list[Sequence[State] | ChainProgress](self.starts)
        learning = learning_of(setup.settings)
        marks = learning.ends
        for stop in (*(mark for mark in marks if mark < end), end):

            def report(chain: int, part: object, share: float = stop / end) -> None:
                on_progress(chain, part * share if isinstance(part, float) else part)

            if stop == 0 or min(self.rounds()) < stop:
                setup = replace(setup, learnt=learnt_from(setup))
            chains = self._all_to(stop, setup, at, report)
            if not all(chain.finished for chain in chains):
                break
            if stop in marks:
                at = [chain.progress for chain in chains]
                noted = tuple(chain.progress.visits[len(setup.known)] for chain in chains)
                known = (*setup.known, noted)
                unused = ((),) * (first_used(len(known)) - 1)
                known = (*known[:1], *unused, *known[1 + len(unused) :])
                setup = replace(setup, known=known, learnt=None)
            if stop and stop == learning.last_of_burn_in:
                barriers = [chain.progress.barrier for chain in chains]
                setup = replace(setup, temperatures=temperatures_of(setup.settings, barriers))
        return chains

    def _all_to(
        self,
        end: int,
        setup: Setup,
        at: Sequence[Sequence[State] | ChainProgress],
        on_progress: Callable[[int, object], None],
    ) -> list[Chain]:
        # What is learnt from visits is known, so that chains need no more than their number.
        setup = replace(setup, known=((),) * len(setup.known))
        # Spawning changes a seed sequence, so each block uses a copy.
        options: dict[str, Any] = {
            "seed": deepcopy(self.seed),
            "workers": self.workers,
            "executor": self.executor,
            "on_progress": on_progress if self.executor is None else None,
        }
        task = partial(run_chain, end=end)
        shared = setup if self.executor is None else self.executor.scatter(setup)
        if self.folder is None:
            return run_chains(task, shared, at, **options)
        return run_resumable_chains(
            task, shared, at, folder=self.folder, identity=self.identity, anew=self.anew, **options
        )


@dataclass(frozen=True)
class _Drawn:
    """Draws of chains so far, with layouts and verdict.

    ``dropped`` draws of each chain are from before its equilibrium and not among them.
    """

    chains: Sequence[Chain]
    states: tuple[State, ...]
    values: Array
    objects: tuple[tuple[SceneObject, ...], ...]
    layouts: Layouts
    probabilities: LayoutProbabilities
    measures: Measures
    verdict: Verdict
    dropped: int


def _in_blocks(
    run: _ChainRun,
    source: JointProblem,
    settings: SampleSettings,
    layout_seed: np.random.SeedSequence,
    limits: Limits,
    progress: Progress | None,
    on_block: OnBlock | None,
) -> _Drawn:
    """Sample block after block until a limit is reached; without limits, a single block.

    If chains were stopped inside a block, or have more rounds than asked for, they first continue
    to the end of the block that the furthest chain is in.
    """
    clock = Clock(limits)
    begun = run.rounds()
    furthest = int(begun.max())
    end = 0 if limits.any else end_of(settings)
    if limits.any or furthest > end:
        end = max(end, block_end(settings, furthest - 1))
    while True:
        clock.begin()
        chains = run.to(end, _reporter(progress, clock, limits, begun, end))
        finished = all(chain.finished for chain in chains)
        if finished:
            clock.end(float(np.mean(end - begun)))
        drawn = _drawn(source, settings, chains, layout_seed)
        following = block_end(settings, end)
        goes_on = finished and clock.allows(following - end, drawn.verdict)
        if on_block is not None:
            on_block(_block(settings, drawn, clock, end, goes_on=goes_on))
        if not goes_on:
            return drawn
        begun, end = np.full(len(chains), float(end)), following


def _reporter(
    progress: Progress | None, clock: Clock, limits: Limits, begun: Array, end: int
) -> Callable[[int, object], None]:
    """Make the progress callback of a block, which chains begin after ``begun`` rounds each."""
    done = begun.copy()

    def report(chain: int, part: object) -> None:
        done[chain] = end * part if isinstance(part, float) else 0.0
        if progress is not None:
            of_block = float((done - begun).mean() / max(1.0, float((end - begun).mean())))
            part_done = clock.part(of_block) if limits.any else float(done.mean()) / end
            progress("jumping between scenes", part_done)

    return report


def _block(
    settings: SampleSettings, drawn: _Drawn, clock: Clock, end: int, *, goes_on: bool
) -> Block:
    kept, draws = end - burn_in_of(settings), drawn.dropped + drawn.values.shape[1]
    to_good = clock.takes(kept * drawn.verdict.more_draws / draws)
    if drawn.verdict.good or drawn.verdict.disagreement is not None:
        to_good = 0.0 if drawn.verdict.good else math.nan
    return Block(
        steps=end * settings.swap_every,
        draws=draws,
        finished=all(chain.finished for chain in drawn.chains),
        measures=drawn.measures,
        verdict=drawn.verdict,
        seconds=clock.seconds,
        seconds_to_good=to_good,
        seconds_left=clock.left(to_good) if goes_on else 0.0,
    )


def _drawn(
    source: JointProblem,
    settings: SampleSettings,
    chains: Sequence[Chain],
    layout_seed: np.random.SeedSequence,
) -> _Drawn:
    n = min(len(chain.states) for chain in chains)
    values = np.stack([chain.log_posterior[-n:] for chain in chains])
    dropped = equilibrated(values)
    left = n - dropped
    states = tuple(state for chain in chains for state in chain.states[-left:])
    return _said_by(source, settings, chains, states, values[:, dropped:], dropped, layout_seed)


def _said_by(
    source: JointProblem,
    settings: SampleSettings,
    chains: Sequence[Chain],
    states: tuple[State, ...],
    values: Array,
    dropped: int,
    layout_seed: np.random.SeedSequence,
    before: Measures | None = None,
) -> _Drawn:
    """Layouts, probabilities and verdict of draws; ``before`` are measures before ensembles."""
    objects = tuple(merged_objects(source.problem, source.library, state) for state in states)
    layouts, probabilities, measures, verdict = judge_draws(
        states,
        values,
        objects,
        radius=settings.layout_radius,
        rng=np.random.default_rng(layout_seed),
        ladders=tuple(chain.ladder for chain in chains),
        before=before,
    )
    if dropped:
        verdict = verdict._replace(
            text=f"{verdict.text} All chains found a better scene late: the first {dropped} draws "
            "of each, from before, are left out."
        )
    return _Drawn(
        chains, states, values, objects, layouts, probabilities, measures, verdict, dropped
    )  # fmt: skip


def _walked(
    drawn: _Drawn,
    source: JointProblem,
    settings: SampleSettings,
    layout_seed: np.random.SeedSequence,
    seed: np.random.SeedSequence,
    workers: Workers,
    scratch: Path | None,
    progress: Progress | None,
) -> tuple[_Drawn, EnsembleRefinement]:
    """Draws after the ensembles, with layouts and verdict."""

    def report(part: float) -> None:
        if progress is not None:
            progress("walking the draws", part)

    states, values, walked = refine_draws(
        source.problem, drawn.states, drawn.values, settings.ensemble_steps,
        seed=seed, workers=workers, scratch=scratch, on_progress=report,
    )  # fmt: skip
    again = _said_by(
        source, settings, drawn.chains, states, values, drawn.dropped, layout_seed, drawn.measures
    )  # fmt: skip
    return again, walked


@contextmanager
def _told_plainly(checkpoints: Path | None) -> Iterator[None]:
    """Convert errors of processes and files to `InputError`."""
    try:
        yield
    except (ChainError, CheckpointError) as error:
        raise InputError(str(error)) from error
    except OSError as error:
        reason = error.strerror or error
        if checkpoints is None:
            raise InputError(f"a temporary file cannot be written ({reason})") from error
        raise InputError(f"{checkpoints}: checkpoints cannot be written ({reason})") from error


def setup_of(solution: Solution | JointProblem, settings: SampleSettings) -> Setup:
    """Collect what the chains of a solved clip need.

    Parameters
    ----------
    solution : Solution or JointProblem
    settings : SampleSettings

    Returns
    -------
    Setup
    """
    source = solution if isinstance(solution, JointProblem) else join_actors([solution])
    return Setup(
        source.problem, gains_of(source.problem), similarity(source.distances), settings,
        source.states,
    )  # fmt: skip


class Judged(NamedTuple):
    """What draws say about layouts, and whether they have converged.

    Parameters
    ----------
    layouts : Layouts
        The layout of each draw.
    probabilities : LayoutProbabilities
        Probabilities of layouts, which are numbered from 1.
    measures : Measures
        Convergence measures of these draws.
    verdict : Verdict
    """

    layouts: Layouts
    probabilities: LayoutProbabilities
    measures: Measures
    verdict: Verdict


def judge_draws(
    states: Sequence[State],
    values: Array,
    objects: Sequence[Sequence[SceneObject]],
    *,
    radius: float,
    rng: np.random.Generator,
    ladders: Sequence[LadderSummary] = (),
    before: Measures | None = None,
) -> Judged:
    """Group draws into layouts, and judge their convergence.

    Parameters
    ----------
    states : sequence of C N State
    values : (C, N) float
        Log-posterior, nats.
    objects : sequence of C N sequence of SceneObject
        Merged furniture of each draw, in its world frame.
    radius : float
        Distance in metres within which objects of two draws count as the same.
    rng : numpy.random.Generator
    ladders : sequence of LadderSummary
        Summaries of tempered chains, for the text of the verdict.
    before : Measures, optional
        Measures of the draws before they were moved by ensembles.

    Returns
    -------
    Judged
    """
    seen = through_one_lens(objects, [state.camera[2] for state in states])
    layouts = group_layouts(seen, values.ravel(), radius=radius)
    with warnings.catch_warnings():
        # The verdict reports chains that are too short.
        warnings.simplefilter("ignore", ShortChainWarning)
        probabilities = layout_probabilities(1 + layouts.indicator.reshape(values.shape), rng=rng)
        common = functionals(values, states, objects)
        measures = measure(probabilities, common)
        verdict = judge(probabilities, common, ladders=ladders, before=before)
    return Judged(layouts, probabilities, measures, verdict)


def functionals(
    values: Array, states: Sequence[State], objects: Sequence[Sequence[SceneObject]]
) -> dict[str, Array]:
    """Scalar functions that every draw has, whatever its dimension.

    Parameters
    ----------
    values : (C, n) float
        Log-posterior, nats.
    states : sequence of C n State
    objects : sequence of C n sequence of SceneObject

    Returns
    -------
    dict of str to (C, n) float
        By name.
    """
    return {
        "log posterior": values,
        "number of objects": np.reshape([len(o) for o in objects], values.shape).astype(float),
        "body scale": np.reshape([s.camera[3] for s in states], values.shape),
    }


def _aligned(traces: Sequence[Array]) -> Array:
    """Traces padded to equal length with NaN, for interrupted chains."""
    longest = max(len(trace) for trace in traces)
    result = np.full((len(traces), longest), np.nan)
    for row, trace in zip(result, traces, strict=True):
        row[: len(trace)] = trace
    return result
