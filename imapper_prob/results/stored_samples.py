"""Draws and what is said of them, in ``posterior.nc``.

Groups, besides those that :mod:`imapper_prob.results.tree` makes for people:

``latent``      normal numbers of each draw's path, single precision
``layouts``     probability, error and founding draw of each layout
``traces``      log-posterior over the whole run, burn-in included
``moves``       how often each move was proposed and accepted
``ensembles``   placements of the most probable layouts, drawn by walkers
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.models.path import CAMERA
from imapper_prob.models.posterior import State
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.valid import check_state
from imapper_prob.results.stored_input import Source
from imapper_prob.results.valid_samples import check_origins, check_samples, require
from imapper_prob.samplers.diagnostics import LayoutProbabilities
from imapper_prob.samplers.ladder import LadderSummary
from imapper_prob.samplers.reversible_jump import AcceptanceTable
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.sampling.agreement import Agreement
from imapper_prob.sampling.layouts import Layouts, placed_objects
from imapper_prob.sampling.placements import PlacementDraws
from imapper_prob.sampling.sample import Samples

__all__ = ["object_origins", "read_samples", "sample_attributes", "sample_groups"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Groups = Mapping[str, xr.Dataset]
"""A tree by the paths of its groups."""

_ACCEPTANCE = "acceptance_"
"""Begins the attributes that hold the accepted share of a move of walkers."""


def sample_groups(samples: Samples) -> dict[str, xr.Dataset]:
    """All that the draws' own groups leave out."""
    found, table = samples.probabilities, samples.acceptance
    latent = np.array([state.latent for state in samples.states], dtype=np.float32)
    moves = sorted(table.proposed)
    groups = {
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
    }
    pairs = zip(samples.placements, samples.agreements, strict=True)
    for layout, (draws, agreement) in enumerate(pairs):
        groups[f"ensembles/{layout}"] = _ensemble(draws, agreement)
    return groups


def _ensemble(draws: PlacementDraws, agreement: Agreement) -> xr.Dataset:
    walked = ("ensemble", "step", "walker")
    rates = {f"{_ACCEPTANCE}{name}": rate for name, rate in draws.acceptance.items()}
    return xr.Dataset(
        {
            "items": (("slot", "entry"), draws.items),
            "camera": ((*walked, "parameter"), draws.camera),
            "placements": ((*walked, "slot", "pose"), draws.placements),
            "sizes": ((*walked, "slot"), draws.sizes),
            "rhat": ("number", draws.rhat),
        },
        attrs={"draws_of_chains": agreement.draws, **rates},
    )


def sample_attributes(samples: Samples) -> dict[str, Any]:
    """What is a single number or word."""
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
    """For each object of each draw the slot of its scenelet, and which of its objects it is."""
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
    """The samples that a run wrote of a source, whose library has their scenelets only.

    Raises
    ------
    InputError
        If they contradict each other, or their source.
    LookupError, TypeError, ValueError
        If something is missing.
    """
    library = source.library
    chosen = groups["/constant_data"]["drawn"].to_numpy()
    draws, stats = groups["/draws"], groups["/sample_stats"]
    values = stats["log_posterior"].to_numpy().astype(np.float64)
    require(len(chosen) == len(library), "draws and library have other scenelets")
    require((np.diff(chosen) > 0).all(), "scenelets of the draws are not in order")
    states = _states(groups, chosen)
    for state in states:
        check_state(source.problem, state)
    origins = np.stack([_flat(draws, "object_slot"), _flat(draws, "object_number")], -1)
    objects = tuple(
        _objects(library, state, rows[rows[:, 0] >= 0])
        for state, rows in zip(states, origins, strict=True)
    )
    placements, agreements = _read_ensembles(groups, chosen)
    said = groups["/"].attrs
    disagreement = tuple(int(n) for n in np.atleast_1d(said["verdict_disagreement"]))
    layouts, moves = groups["/layouts"], groups["/moves"]
    names = moves["move"].to_numpy().astype(str).tolist()
    swapped = groups["/motion"]["sides_swapped"].to_numpy()
    require(swapped.shape == (*values.shape, source.problem.n_frames), "sides are not of the draws")
    require(((swapped >= 0) & (swapped <= 1)).all(), "sides_swapped are no probabilities")
    samples = Samples(
        states=states,
        log_posterior=values,
        traces=groups["/traces"]["log_posterior"].to_numpy(),
        objects=objects,
        layouts=Layouts(
            _flat(groups["/counts"], "layout").astype(np.int64),
            tuple(layouts["leader"].sortby("layout").to_numpy().tolist()),
        ),
        probabilities=_probabilities(layouts, values.shape[1]),
        placements=placements,
        agreements=agreements,
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
    check_samples(source.problem, samples)
    return samples


def _flat(group: xr.Dataset, name: str) -> NDArray[Any]:
    """A variable with its draws numbered chain by chain."""
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
    """Scenelets by their numbers in the library of those that are ``chosen``."""
    own = np.searchsorted(chosen, scenelets)
    there = own < len(chosen)
    require(there.all() and (chosen[own] == scenelets).all(), "a draw has an unknown scenelet")
    return own.astype(np.int64)


def _objects(library: Library, state: State, origins: Ints) -> tuple[SceneObject, ...]:
    placed = placed_objects(state, library)
    counts = np.array([len(library[s].objects) for s in state.items[:, 0]], np.int64)
    check_origins(origins, len(state.items), counts)
    first: dict[int, int] = {}
    for index, (slot, _) in enumerate(placed):
        first.setdefault(slot, index)
    return tuple(placed[first[slot] + number][1] for slot, number in origins.tolist())


def _probabilities(group: xr.Dataset, n_draws: int) -> LayoutProbabilities:
    return LayoutProbabilities(
        layouts=group["layout"].to_numpy(),
        probability=group["probability"].to_numpy(),
        standard_error=group["standard_error"].to_numpy(),
        by_chain=group["by_chain"].to_numpy(),
        by_half=group["by_half"].to_numpy(),
        n_draws=n_draws,
    )


def _read_ensembles(
    groups: Groups, chosen: Ints
) -> tuple[tuple[PlacementDraws, ...], tuple[Agreement, ...]]:
    compared = groups["/agreement"]
    placements, agreements = [], []
    for layout in range(sum(name.startswith("/ensembles/") for name in groups)):
        group = groups[f"/ensembles/{layout}"]
        items = group["items"].to_numpy()
        placements.append(
            PlacementDraws(
                items=np.stack([_own(chosen, items[:, 0]), items[:, 1]], -1),
                camera=group["camera"].to_numpy(),
                placements=group["placements"].to_numpy(),
                sizes=group["sizes"].to_numpy(),
                rhat=group["rhat"].to_numpy(),
                acceptance={
                    str(name).removeprefix(_ACCEPTANCE): float(rate)
                    for name, rate in group.attrs.items()
                    if str(name).startswith(_ACCEPTANCE)
                },
            )
        )
        own = compared["layout"].to_numpy() == layout
        agreements.append(
            Agreement(
                tuple(compared["label"].to_numpy()[own].astype(str).tolist()),
                compared["difference"].to_numpy()[own],
                compared["ratio"].to_numpy()[own],
                int(group.attrs["draws_of_chains"]),
            )
        )
    return tuple(placements), tuple(agreements)
