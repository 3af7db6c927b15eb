"""Sample the posterior of a solved clip: jump chains, layouts, ensembles of placements."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imapper_prob.config import SampleSettings
from imapper_prob.models.brief import brief
from imapper_prob.models.errors import InputError
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import SceneObject
from imapper_prob.samplers.chains import ChainError, run_chains
from imapper_prob.samplers.checkpoint import CheckpointError
from imapper_prob.samplers.diagnostics import (
    LayoutProbabilities,
    ShortChainWarning,
    layout_probabilities,
)
from imapper_prob.samplers.ladder import LadderSummary
from imapper_prob.samplers.resumable import run_resumable_chains
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.samplers.verdict import Verdict, judge
from imapper_prob.sampling.agreement import Agreement, compare
from imapper_prob.sampling.cast import Cast, cast_of
from imapper_prob.sampling.chain import Setup, run_chain
from imapper_prob.sampling.checkpoints import identity_of
from imapper_prob.sampling.cluster import Cluster, executor_of
from imapper_prob.sampling.layouts import (
    Layouts,
    group_layouts,
    merged_objects,
    through_one_lens,
)
from imapper_prob.sampling.nodes import find_nodes
from imapper_prob.sampling.placements import PlacementDraws, is_complete, sample_placements
from imapper_prob.sampling.starts import starts_of
from imapper_prob.scenelets.charness import similarity
from imapper_prob.staged.solver import Solution

__all__ = ["Samples", "sample_scenes", "setup_of"]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Samples:
    """Draws from the posterior, and what they say of layouts.

    Draws are numbered chain by chain: draw n of chain c is c N + n.

    Parameters
    ----------
    states : tuple of C N State
    log_posterior : (C, N) float
        Nats, up to the constant of the clip.
    traces : (C, M) float
        Log-posterior over the whole run, burn-in included.
    objects : tuple of C N tuples of SceneObject
        Merged furniture of each draw, in its world.
    layouts : Layouts
        Which draws say the same.
    probabilities : LayoutProbabilities
        Of layouts counted from 1, as people do and the verdict does.
    placements : tuple of PlacementDraws
        Ensembles of the most probable layouts, in their order.
    agreements : tuple of Agreement
        Each of these held against the chains' own draws.
    acceptance : AcceptanceTable
        Over all chains.
    ladders : tuple of C LadderSummary
        Temperatures of each chain, and how its states travelled between them.
    verdict : Verdict
    finished : bool
        Whether every chain and every ensemble ran all its steps.
    """

    states: tuple[State, ...]
    log_posterior: Array
    traces: Array
    objects: tuple[tuple[SceneObject, ...], ...]
    layouts: Layouts
    probabilities: LayoutProbabilities
    placements: tuple[PlacementDraws, ...]
    agreements: tuple[Agreement, ...]
    acceptance: AcceptanceTable
    ladders: tuple[LadderSummary, ...]
    verdict: Verdict
    finished: bool

    __repr__ = brief

    @property
    def shape(self) -> tuple[int, int]:
        """Chains C and draws N of each."""
        chains, draws = self.log_posterior.shape
        return chains, draws


def sample_scenes(
    solution: Solution | Cast,
    settings: SampleSettings,
    *,
    seed: np.random.SeedSequence,
    workers: int = 1,
    cluster: Cluster | None = None,
    checkpoints: Path | None = None,
    anew: bool = False,
    progress: Progress | None = None,
) -> Samples:
    """Sample from where the staged solver arrived, with one actor or with a cast.

    The result depends on ``seed`` but not on ``workers`` or ``cluster``. An interrupt (Ctrl-C)
    ends chains or ensembles early; what they have is used.

    Parameters
    ----------
    solution, settings, seed, workers
    cluster : Cluster, optional
        Where the chains run instead of here, see `imapper_prob.sampling.cluster`. They report
        no progress from there.
    checkpoints : Path, optional
        Folder in which the chains leave what they have every few seconds, and from which
        they go on: run again after a kill, the draws are the same.
    anew : bool
        Delete checkpoints that are damaged or of another run, instead of refusing them.
    progress : callable, optional
        Called with the name of the stage and the part of it that is done.

    Raises
    ------
    InputError
        Checkpoints are damaged, of another run or cannot be written, or processes died.
    """
    chain_seed, layout_seed, ensemble_seed = seed.spawn(3)
    cast = solution if isinstance(solution, Cast) else cast_of([solution])
    problem = cast.problem
    setup = setup_of(cast, settings)
    done = np.zeros(settings.chains)

    def report(chain: int, part: object) -> None:
        done[chain] = part if isinstance(part, float) else 0.0
        if progress is not None:
            progress("jumping between scenes", float(done.mean()))

    starts = starts_of(cast, settings.chains)
    shared = setup if cluster is None else cluster.scatter(setup, broadcast=True)
    with _told_plainly(checkpoints), executor_of(cluster) as executor:
        options: dict[str, Any] = {
            "seed": chain_seed,
            "workers": workers,
            "executor": executor,
            "on_progress": report if executor is None else None,
        }
        if checkpoints is None:
            chains = run_chains(run_chain, shared, starts, **options)
        else:
            chains = run_resumable_chains(
                run_chain,
                shared,
                starts,
                folder=checkpoints.resolve(),
                identity=identity_of(problem, setup.candidates, starts, settings, chain_seed),
                anew=anew,
                **options,
            )
    n = min(len(chain.states) for chain in chains)
    states = tuple(state for chain in chains for state in chain.states[-n:])
    values = np.stack([chain.log_posterior[-n:] for chain in chains])
    objects = tuple(merged_objects(problem, cast.library, state) for state in states)
    seen = through_one_lens(objects, [state.camera[2] for state in states])
    layouts = group_layouts(seen, values.ravel(), radius=settings.layout_radius)
    with warnings.catch_warnings():
        # The verdict says in words what a short chain cannot tell.
        warnings.simplefilter("ignore", ShortChainWarning)
        probabilities = layout_probabilities(
            1 + layouts.indicator.reshape(values.shape), rng=np.random.default_rng(layout_seed)
        )
        ladders = tuple(chain.ladder for chain in chains)
        verdict = judge(probabilities, _functionals(values, states, objects), ladders=ladders)
        with _told_plainly(checkpoints):
            placements = _ensembles(
                problem, states, values.ravel(), layouts, settings, ensemble_seed, workers,
                checkpoints, progress,
            )  # fmt: skip
    return Samples(
        states=states,
        log_posterior=values,
        traces=_aligned([chain.trace for chain in chains]),
        objects=objects,
        layouts=layouts,
        probabilities=probabilities,
        placements=placements,
        agreements=tuple(compare(cast.library, draws, states) for draws in placements),
        acceptance=sum((chain.acceptance for chain in chains), AcceptanceTable()),
        ladders=ladders,
        verdict=verdict,
        finished=all(chain.finished for chain in chains)
        and len(placements) == min(settings.ensemble_layouts, len(layouts.leaders))
        and all(is_complete(draws, settings) for draws in placements),
    )


@contextmanager
def _told_plainly(checkpoints: Path | None) -> Iterator[None]:
    """What can go wrong with processes and files, as the error that people are shown."""
    try:
        yield
    except (ChainError, CheckpointError) as error:
        raise InputError(str(error)) from error
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{checkpoints}: checkpoints cannot be written ({reason})") from error


def setup_of(solution: Solution | Cast, settings: SampleSettings) -> Setup:
    """What the chains need of a solved clip."""
    cast = solution if isinstance(solution, Cast) else cast_of([solution])
    nodes = None if cast.problem.of_paper else find_nodes(cast.problem, cast.candidates)
    return Setup(cast.problem, cast.candidates, similarity(cast.distances), settings, nodes)


def _functionals(
    values: Array, states: Sequence[State], objects: Sequence[Sequence[SceneObject]]
) -> dict[str, Array]:
    """What every draw has, whatever its dimension."""
    return {
        "log posterior": values,
        "number of objects": np.reshape([len(o) for o in objects], values.shape).astype(float),
        "body scale": np.reshape([s.camera[3] for s in states], values.shape),
    }


def _ensembles(
    problem: Problem,
    states: Sequence[State],
    values: Array,
    layouts: Layouts,
    settings: SampleSettings,
    seed: np.random.SeedSequence,
    workers: int,
    scratch: Path | None,
    progress: Progress | None,
) -> tuple[PlacementDraws, ...]:
    """Ensembles on the most visited assignment of each of the most probable layouts.

    None follow upon those that were interrupted.
    """
    count = min(settings.ensemble_layouts, len(layouts.leaders))
    results = []
    for layout, child in enumerate(seed.spawn(count)):
        members = np.flatnonzero(layouts.indicator == layout).tolist()
        keys = [states[m].items.tobytes() for m in members]
        common = Counter(keys).most_common(1)[0][0]
        own = [m for m, key in zip(members, keys, strict=True) if key == common]
        best = states[max(own, key=lambda m: values[m])]
        results.append(
            sample_placements(problem, best, settings, seed=child, workers=workers, scratch=scratch)
        )
        if not is_complete(results[-1], settings):
            break
        if progress is not None:
            progress("walking placements", (layout + 1) / count)
    return tuple(results)


def _aligned(traces: Sequence[Array]) -> Array:
    """Traces of equal length, those of interrupted chains filled with NaN."""
    longest = max(len(trace) for trace in traces)
    result = np.full((len(traces), longest), np.nan)
    for row, trace in zip(result, traces, strict=True):
        row[: len(trace)] = trace
    return result
