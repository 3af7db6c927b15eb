"""The parts of ``posterior.nc`` from which a run is opened again, and their validation.

Clip, scenelets and the packed log-posterior are stored, so that a run can be opened without its
clip and library, and without repeating the stages before sampling. Only the library's scenelets
that occur in a draw are stored. Groups, in addition to those of
:mod:`imapper_prob.uncertainty.tree`:

``clip``        the arrays of a clip file (:mod:`imapper_prob.clips.clip_file`)
``library``     the arrays of a library file (:mod:`imapper_prob.scenelets.library`)
``problem``     the fields of :class:`imapper_prob.models.problem.Problem`, for these scenelets
``latent``      latent normal variables of each draw's path, single precision
``layouts``     probability, error and first draw of each layout, by its number from 1
``traces``      log-posterior over the whole run, including burn-in
``moves``       how often each move was proposed and accepted
``walked``      effect of the ensembles on the draws: change of means in standard deviations, its
               error, effective draws before and after, and R-hat; empty if there were no ensembles
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.clips.clip_file import clip_of, pack_clip
from imapper_prob.layouts import Layouts, placed_objects
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import State
from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.problem import Problem, labels_of, resample
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.text import brief, readable
from imapper_prob.models.valid import check_problem, check_state
from imapper_prob.samplers.diagnostics import LayoutProbabilities
from imapper_prob.samplers.ladder import LadderSummary
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.sampling.ensembles import QUANTITIES, EnsembleRefinement
from imapper_prob.sampling.sample import Samples
from imapper_prob.scenelets.library import library_of, pack_library
from imapper_prob.solver.selection import of_scenelets

__all__ = [
    "Source",
    "StoredSource",
    "categories_of",
    "library_digest",
    "object_origins",
    "read_samples",
    "read_source",
    "sample_attributes",
    "sample_groups",
    "source_groups",
]

_LARGEST = 1e12
"""Largest absolute log-posterior, nats."""


def _require(holds: bool | np.bool_, what: str) -> None:
    """Raise an `InputError` with a message unless ``holds`` is true."""
    if not holds:
        raise InputError(what)


def _check_origins(origins: NDArray[np.int64], slots: int, counts: NDArray[np.int64]) -> None:
    """Check that objects (n, 2) refer to slots of a draw whose scenelets have ``counts``
    objects."""
    slot, number = origins.T
    _require(((slot >= 0) & (slot < slots)).all(), "an object of a draw is of no scenelet of it")
    inside = (number >= 0) & (number < counts[slot])
    _require(inside.all(), "an object of a draw is none of its scenelet")


def _check_samples(problem: Problem, samples: Samples) -> None:
    """Refuse samples that are inconsistent with each other or with their problem.

    Raises
    ------
    InputError
        The message says what is wrong.
    """
    chains, draws = samples.shape
    count = chains * draws
    _require(count > 0 and len(samples.states) == count, "draws and their log-posterior differ")
    _require(_finite(samples.log_posterior, most=_LARGEST), "log_posterior is not finite")
    traces = samples.traces
    _require(traces.ndim == 2 and len(traces) == chains, "traces are not those of the chains")
    _require(traces.shape[1] > 0 and not np.isinf(traces).any(), "traces are not finite")
    for state in samples.states:
        check_state(problem, state)
    layouts = samples.layouts
    number = len(layouts.leaders)
    _require(layouts.indicator.shape == (count,), "layouts are not those of the draws")
    seen = np.unique(layouts.indicator)
    _require(np.array_equal(seen, np.arange(number)), "layouts and their leaders differ")
    _require(all(0 <= leader < count for leader in layouts.leaders), "a leader is no draw")
    _check_probabilities(samples.probabilities, chains, number)
    pair = samples.verdict.disagreement or ()
    _require(all(1 <= layout <= number for layout in pair), "the verdict speaks of no layout")
    _require(len(samples.ladders) == chains, "ladders are not those of the chains")
    table = samples.acceptance
    rates = zip(table.proposed.values(), table.accepted.values(), strict=True)
    _require(all(0 <= a <= p for p, a in rates), "more moves were accepted than proposed")


def _check_probabilities(found: LayoutProbabilities, chains: int, number: int) -> None:
    numbers = np.sort(found.layouts)
    _require(np.array_equal(numbers, 1 + np.arange(number)), "layouts have other numbers")
    _require(found.probability.shape == (number,), "a layout has no probability")
    _require(found.standard_error.shape == (number,), "a layout has no error")
    _require(found.by_chain.shape == (chains, number), "layouts are not by chain")
    _require(found.by_half.shape == (chains, 2, number), "layouts are not by half")
    for values in (found.probability, found.by_chain, found.by_half):
        _require(_finite(values, most=1 + 1e-9) and (values >= 0).all(), "a probability is none")


def _finite(values: NDArray[np.float64], *, most: float) -> bool:
    return bool((np.abs(values) <= most).all())


# ------------------------------------------------------------------------------------------------
# Clip, scenelets and log-posterior.

Ints = NDArray[np.int64]
_FROM_LIBRARY: Final = "joints"
"""The largest field of a problem, which is not stored but resampled from the library's motions."""
_READ_ONLY: Final = "read_only"
_BY_COLUMN: Final = "by_column"
"""Attributes of read-only arrays, and of arrays in column-major order. They are restored, because
numba compiles a kernel for each kind of array."""


class Source(Protocol):
    """Clip, library and problem of draws; a staged solution is an example.

    Parameters
    ----------
    *args, **kwargs : Of whatever class it is.
    """

    @property
    def clip(self) -> Clip:
        """The input clip."""

    @property
    def library(self) -> Library:
        """The library whose scenelets the states refer to."""

    @property
    def problem(self) -> Problem:
        """The log-posterior of the clip with that library."""

    @property
    def best_fits(self) -> NDArray[np.float64]:
        """(T,) excess cost of the best scenelet over each frame, see `imapper_prob.solver.fits`."""


@dataclass(frozen=True)
class StoredSource:
    """A source that was read from the folder of a run.

    Parameters
    ----------
    clip : Clip
    library : Library
        Only the scenelets that occur in a draw.
    problem : Problem
        For these scenelets.
    best_fits : (T,) float
        Fit of the best scenelet of the whole library; NaN if unknown.
    library_digest : str
        Digest of the whole library.
    categories : tuple of C str
        Furniture labels of the whole library, by category number.
    """

    clip: Clip
    library: Library
    problem: Problem
    best_fits: NDArray[np.float64]
    library_digest: str
    categories: tuple[str, ...]

    __repr__ = brief


def library_digest(source: Source) -> str:
    """The digest of the whole library of a source.

    Parameters
    ----------
    source : Source

    Returns
    -------
    str
    """
    return source.library_digest if isinstance(source, StoredSource) else source.library.digest


def categories_of(source: Source) -> tuple[str, ...]:
    """Furniture labels of the whole library of a source, by category number.

    Parameters
    ----------
    source : Source

    Returns
    -------
    tuple of C str
    """
    if isinstance(source, StoredSource):
        return source.categories
    return tuple(labels_of(source.library))


def source_groups(source: Source, chosen: Ints) -> dict[str, xr.Dataset]:
    """The groups that store a source with a part of its library.

    Parameters
    ----------
    source : Source
    chosen : (k,) int
        Indices of the scenelets to store.

    Returns
    -------
    dict of str to Dataset
    """
    library = Library(source.library.name, tuple(source.library[i] for i in chosen))
    fields = of_scenelets(source.problem, chosen)._asdict()
    fields.pop(_FROM_LIBRARY)
    return {
        "clip": _dataset(pack_clip(source.clip)),
        "library": _dataset(pack_library(library)),
        "problem": _dataset(fields),
    }


def read_source(path: Path, groups: Mapping[str, xr.Dataset]) -> StoredSource:
    """Restore the source from the groups of :func:`source_groups`.

    Parameters
    ----------
    path : Path
        Path of the file, for messages.
    groups : mapping of str to Dataset

    Returns
    -------
    StoredSource
    """
    clip = clip_of(_arrays(groups["/clip"]), path)
    library = library_of(_arrays(groups["/library"]))
    fields: dict[str, Any] = _arrays(groups["/problem"])
    for name, values in fields.items():
        said = groups["/problem"][name].attrs
        if values.ndim == 0:
            fields[name] = values.item()
            continue
        if said.get(_BY_COLUMN):
            fields[name] = values = np.asfortranarray(values)
        if said.get(_READ_ONLY):
            values.setflags(write=False)
    other = set(Problem._fields) ^ {*fields, _FROM_LIBRARY}
    _require(not other, f"another version wrote it, which differs in {', '.join(sorted(other))}")
    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    fields[_FROM_LIBRARY] = np.concatenate(motions)
    problem, motion = Problem(**fields), groups["/motion"]
    check_problem(problem)
    _require(len(problem.log_rate) == len(library), "problem and library have other scenelets")
    everybody = clip.n_frames * len(clip.tracks)
    _require(problem.n_frames == everybody, "problem and clip have other frames")
    fits = (
        motion["best_fit"].to_numpy() if "best_fit" in motion else np.full(problem.n_frames, np.nan)
    )
    _require(fits.shape == (everybody,), "best_fit is not of the clip's frames")
    said = groups["/"].attrs
    digest, categories = str(said["library_digest"]), _categories(said["categories"])
    boxes = [o.label for s in library for o in s.objects for _ in o.cuboids]
    fit = len(categories) == len(problem.label_chance) and len(boxes) == len(problem.box_label)
    _require(
        fit and boxes == [categories[k] for k in problem.box_label.tolist()],
        "problem and library have other categories",
    )
    return StoredSource(clip, library, problem, fits.astype(np.float64), digest, categories)


def _categories(said: object) -> tuple[str, ...]:
    """Labels from an attribute of the file."""
    try:
        labels = json.loads(str(said))
    except (ValueError, RecursionError):
        labels = None
    _require(isinstance(labels, list), "categories are no list")
    return tuple(readable(str(label)) for label in labels)


def _dataset(arrays: Mapping[str, Any]) -> xr.Dataset:
    """A dataset of arrays, each with its own dimensions."""
    variables = {}
    for name, values in arrays.items():
        values = np.asarray(values)
        dims = [f"{name}_{axis}" for axis in range(values.ndim)]
        kept = {_READ_ONLY: not values.flags.writeable, _BY_COLUMN: values.flags.fnc}
        said = {key: 1 for key, holds in kept.items() if holds and values.ndim}
        variables[name] = (dims, values, said)
    return xr.Dataset(variables)


def _arrays(group: xr.Dataset) -> dict[str, NDArray[Any]]:
    """Copies of a dataset's arrays, with text as unicode arrays."""
    arrays = {}
    for name, variable in group.data_vars.items():
        values = variable.to_numpy()
        arrays[str(name)] = values.astype(str) if values.dtype.kind in "OT" else values.copy()
    return arrays


# ------------------------------------------------------------------------------------------------
# Draws and their summaries.

Groups = Mapping[str, xr.Dataset]
"""The groups of a tree by path."""
_ACCEPTANCE = "acceptance_"
"""Prefix of the attributes with acceptance rates of ensemble moves."""
_WALKED = ("change", "error", "before", "after", "rhat")
"""Fields of :class:`imapper_prob.sampling.ensembles.EnsembleRefinement` that are arrays by
quantity."""


def sample_groups(samples: Samples) -> dict[str, xr.Dataset]:
    """The groups that store what the groups of draws leave out.

    Parameters
    ----------
    samples : Samples

    Returns
    -------
    dict of str to Dataset
    """
    found, table = samples.probabilities, samples.acceptance
    latent = np.array([state.latent for state in samples.states], dtype=np.float32)
    moves = sorted(table.proposed)
    return {
        "latent": xr.Dataset(
            {
                "latent": (
                    ("chain", "draw", "frame", "ray"),
                    latent.reshape(*samples.shape, *latent.shape[1:]),
                )
            },
            {"ray": ["bearing", "log depth"]},
        ),
        "layouts": xr.Dataset(
            {
                "probability": ("layout", found.probability),
                "standard_error": ("layout", found.standard_error),
                "by_chain": (("chain", "layout"), found.by_chain),
                "by_half": (("chain", "half", "layout"), found.by_half),
                "leader": ("layout", np.array(samples.layouts.leaders)[found.layouts - 1]),
            },
            {"layout": found.layouts},
        ),
        "traces": xr.Dataset({"log_posterior": (("chain", "step"), samples.traces)}),
        "moves": xr.Dataset(
            {
                "proposed": ("move", np.array([table.proposed[m] for m in moves], np.int64)),
                "accepted": ("move", np.array([table.accepted[m] for m in moves], np.int64)),
            },
            {"move": np.array(moves, dtype=np.str_)},
        ),
        "walked": _walked(samples.walked),
    }


def _walked(walked: EnsembleRefinement | None) -> xr.Dataset:
    """Effect of the ensembles by quantity; empty if there were none."""
    if walked is None:
        return xr.Dataset(coords={"quantity": np.array([], dtype=np.str_)})
    rates = {f"{_ACCEPTANCE}{name}": rate for name, rate in walked.acceptance.items()}
    return xr.Dataset(
        {name: ("quantity", getattr(walked, name)) for name in _WALKED},
        {"quantity": np.array(QUANTITIES)},
        attrs={"walkers": walked.walkers, "steps": walked.steps, **rates},
    )


def sample_attributes(samples: Samples) -> dict[str, Any]:
    """The scalar attributes of samples.

    Parameters
    ----------
    samples : Samples

    Returns
    -------
    dict of str to object
    """
    verdict = samples.verdict
    return {
        "verdict": verdict.text,
        "verdict_good": int(verdict.good),
        "verdict_more_draws": verdict.more_draws,
        "verdict_disagreement": list(verdict.disagreement or ()),
        "finished": int(samples.finished),
    }


def object_origins(
    library: Library, states: Sequence[State], objects: Sequence[Sequence[SceneObject]]
) -> list[list[tuple[int, int]]]:
    """For each object of each draw, the scenelet that it comes from.

    Parameters
    ----------
    library : Library
    states : sequence of N State
    objects : sequence of N sequence of SceneObject
        Merged furniture of each draw.

    Returns
    -------
    list of N list of (int, int)
        Slot of the scenelet in the draw, and index of the object in the scenelet.
    """
    result = []
    for state, furniture in zip(states, objects, strict=True):
        placed = placed_objects(state, library)
        slots = [slot for slot, _ in placed]
        found = {
            (o.label, o.placement): (slot, index - slots.index(slot))
            for index, (slot, o) in reversed(list(enumerate(placed)))
        }
        result.append([found[o.label, o.placement] for o in furniture])
    return result


def read_samples(groups: Groups, source: Source) -> Samples:
    """Restore samples from the groups of a run; the library has only their scenelets.

    Parameters
    ----------
    groups : mapping of str to Dataset
    source : Source

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        They are inconsistent with each other or with their source.
    LookupError, TypeError, ValueError
        Something is missing.
    """
    library = source.library
    chosen = groups["/constant_data"]["drawn"].to_numpy()
    draws, stats = groups["/draws"], groups["/sample_stats"]
    values = stats["log_posterior"].to_numpy().astype(np.float64)
    _require(len(chosen) == len(library), "draws and library have other scenelets")
    _require((np.diff(chosen) > 0).all(), "scenelets of the draws are not in order")
    states = _states(groups, chosen)
    for state in states:
        check_state(source.problem, state)
    origins = np.stack([_flat(draws, "object_slot"), _flat(draws, "object_number")], -1)
    objects = tuple(
        _objects(library, state, rows[rows[:, 0] >= 0])
        for state, rows in zip(states, origins, strict=True)
    )
    said = groups["/"].attrs
    disagreement = tuple(int(n) for n in np.atleast_1d(said["verdict_disagreement"]))
    layouts, moves = groups["/layouts"], groups["/moves"]
    names = moves["move"].to_numpy().astype(str).tolist()
    flipped = groups["/motion"]["sides_flipped"].to_numpy()
    _require(
        flipped.shape == (*values.shape, source.problem.n_frames), "sides are not of the draws"
    )
    _require(((flipped >= 0) & (flipped <= 1)).all(), "sides_flipped are no probabilities")
    samples = Samples(
        states=states,
        log_posterior=values,
        traces=groups["/traces"]["log_posterior"].to_numpy(),
        objects=objects,
        layouts=Layouts(
            _flat(groups["/counts"], "layout").astype(np.int64) - 1,
            tuple(layouts["leader"].sortby("layout").to_numpy().tolist()),
        ),
        probabilities=_probabilities(layouts, values.shape[1]),
        walked=_read_walked(groups["/walked"]),
        acceptance=AcceptanceTable(
            Counter(dict(zip(names, moves["proposed"].to_numpy().tolist(), strict=True))),
            Counter(dict(zip(names, moves["accepted"].to_numpy().tolist(), strict=True))),
        ),
        ladders=tuple(
            LadderSummary(tuple(powers), tuple(rates), trips, rounds)
            for powers, rates, trips, rounds in zip(
                stats["power"].to_numpy().tolist(),
                stats["swap_rate"].to_numpy().tolist(),
                stats["round_trips"].to_numpy().tolist(),
                stats["rounds"].to_numpy().tolist(),
                strict=True,
            )
        ),
        verdict=Verdict(
            bool(said["verdict_good"]),
            int(said["verdict_more_draws"]),
            (disagreement[0], disagreement[1]) if disagreement else None,
            str(said["verdict"]),
        ),
        finished=bool(said["finished"]),
    )
    _check_samples(source.problem, samples)
    return samples


def _flat(group: xr.Dataset, name: str) -> NDArray[Any]:
    """A variable with chains and draws flattened to one axis."""
    values = group[name].to_numpy()
    return values.reshape(-1, *values.shape[2:])


def _states(groups: Groups, chosen: Ints) -> tuple[State, ...]:
    posterior, draws = groups["/posterior"], groups["/draws"]
    camera = np.stack([_flat(posterior, name) for name in CAMERA], -1).astype(np.float64)
    scenelets, starts = _flat(draws, "scenelet"), _flat(draws, "start")
    placements, sizes = _flat(draws, "scenelet_placement"), _flat(draws, "scenelet_log_size")
    latent = _flat(groups["/latent"], "latent").astype(np.float64)
    states = []
    for n in range(len(camera)):
        used = scenelets[n] >= 0
        items = np.stack([_own(chosen, scenelets[n][used]), starts[n][used]], -1)
        states.append(
            State(
                camera=camera[n].copy(),
                items=items.astype(np.int64),
                placements=placements[n][used],
                sizes=sizes[n][used],
                latent=latent[n],
            )
        )
    return tuple(states)


def _own(chosen: Ints, scenelets: Ints) -> Ints:
    """Indices of scenelets in the stored part of the library."""
    own = np.searchsorted(chosen, scenelets)
    there = own < len(chosen)
    _require(there.all() and (chosen[own] == scenelets).all(), "a draw has an unknown scenelet")
    return own.astype(np.int64)


def _objects(library: Library, state: State, origins: Ints) -> tuple[SceneObject, ...]:
    counts = np.array([len(library[s].objects) for s in state.items[:, 0]], np.int64)
    _check_origins(origins, len(state.items), counts)
    return tuple(o for _, o in placed_objects(state, library, only=origins.tolist()))


def _probabilities(group: xr.Dataset, n_draws: int) -> LayoutProbabilities:
    return LayoutProbabilities(
        layouts=group["layout"].to_numpy(),
        probability=group["probability"].to_numpy(),
        standard_error=group["standard_error"].to_numpy(),
        by_chain=group["by_chain"].to_numpy(),
        by_half=group["by_half"].to_numpy(),
        n_draws=n_draws,
    )


def _read_walked(group: xr.Dataset) -> EnsembleRefinement | None:
    if not group.sizes["quantity"]:
        return None
    numbers = {name: group[name].to_numpy() for name in _WALKED}
    for values in numbers.values():
        _require(values.shape == (len(QUANTITIES),), "ensembles have other quantities")
    return EnsembleRefinement(
        walkers=int(group.attrs["walkers"]),
        steps=int(group.attrs["steps"]),
        acceptance={
            str(name).removeprefix(_ACCEPTANCE): float(rate)
            for name, rate in group.attrs.items()
            if str(name).startswith(_ACCEPTANCE)
        },
        **numbers,
    )
