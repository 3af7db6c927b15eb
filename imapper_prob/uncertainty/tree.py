"""Draws as labelled arrays: the xarray tree of ``posterior.nc``, with provenance.

Groups, with ArviZ's names where it has one:

``posterior``      camera, body and mean depth of each draw: continuous quantities that every draw
                  has whatever its dimension, for plots of ArviZ
``furniture``      matched objects by name (:mod:`imapper_prob.uncertainty.furniture`): presence,
                  position and size in each draw, NaN in a draw without the object
``counts``         numbers of scenelets and objects, and the number of the layout, from 1; even
                  in a good run they may be constant
``motion``         by frame: pelvis, probability of a left-right flip, and excess cost of the
                  best scenelet; for several people all frames of the first, then of the next, see
                  ``actor``
``draws``          scenelets and merged objects of each draw, padded, with their indices
``sample_stats``   log-posterior; temperatures of each chain, their swap rates, and round trips of
                  states; acceptance rates of moves in the attributes
``observed_data``  detections
``constant_data``  names and numbers that the other groups refer to

and those of :mod:`imapper_prob.uncertainty.stored`, from which a run is opened again.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.clips.clip_file import pack_clip
from imapper_prob.config import Config, to_toml
from imapper_prob.files import require_intact
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import motion, side_flips
from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.scene import Clip
from imapper_prob.models.skeleton import JOINTS, PELV
from imapper_prob.models.statements import from_json as statements_from_json
from imapper_prob.models.statements import to_json as statements_to_json
from imapper_prob.people import everybody, names_of_rows
from imapper_prob.sampling.conditioning import Evidence, Told
from imapper_prob.sampling.ensembles import describe_refinement
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.checks import Check, to_json
from imapper_prob.uncertainty.parameters import CAMERA_UNITS
from imapper_prob.uncertainty.stored import (
    Source,
    categories_of,
    library_digest,
    object_origins,
    sample_attributes,
    sample_groups,
    source_groups,
)

__all__ = [
    "FORMAT",
    "GIVEN",
    "SECONDS",
    "arviz_tree",
    "clip_digest",
    "posterior_tree",
    "provenance",
    "read_attributes",
    "seconds_of",
    "told_of",
    "write_tree",
]

SECONDS: Final = "seconds_"
"""Prefix of the attributes with the durations of parts of the run."""


def provenance(source: Source, config: Config, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Provenance of a run, as attributes of its file.

    Parameters
    ----------
    source : Source
    config : Config
    seconds : mapping of str to float
        Wall-clock duration of each part.

    Returns
    -------
    dict of str to object
    """
    settings = to_toml(config)
    return {
        "program": f"imapper-prob {version('imapper-prob')}",
        "clip": source.clip.name,
        "clip_digest": clip_digest(source.clip),
        "library": source.library.name,
        "library_digest": library_digest(source),
        "categories": json.dumps(categories_of(source)),
        "config": settings,
        "config_digest": hashlib.sha256(settings.encode()).hexdigest(),
        "seed": config.seed,
        **{f"{SECONDS}{name}": float(value) for name, value in seconds.items()},
    }


def seconds_of(attributes: Mapping[Any, Any]) -> dict[str, float]:
    """Durations of the parts of a run, from its attributes.

    Parameters
    ----------
    attributes : mapping
        Attributes of the file.

    Returns
    -------
    dict of str to float
    """
    return {
        str(name).removeprefix(SECONDS): float(value)
        for name, value in attributes.items()
        if str(name).startswith(SECONDS)
    }


def clip_digest(clip: Clip) -> str:
    """SHA-256 of a clip without its ground truth, which inference never reads.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    str
    """
    state = hashlib.sha256()
    for name, values in pack_clip(clip).items():
        if not name.startswith(("truth", "object", "cuboid")):
            state.update(f"{name} {values.shape}".encode())
            text = values.dtype.kind == "U"
            state.update(repr(values.tolist()).encode() if text else values.tobytes())
    return state.hexdigest()


# ------------------------------------------------------------------------------------------------
# The tree.

GIVEN: Final = "given"
"""Attribute with the statements that the run was given."""
DENIED: Final = "given_denied"
"""Attribute with those of them that no draw agrees with."""
STEPS: Final = "given_steps"
"""Attribute with the steps of the chains that continued chains began from."""
EVIDENCE: Final = "given_evidence"
"""Attribute with the evidence of the statements."""
FORMAT: Final = "imapper-prob posterior 8"
"""Format of the file; the number is raised when an older reader would misread it."""
_SAID: Final = ("ensembles", "clip", "program", "verdict")
"""Attributes that can be shown without reading the draws."""
Variable = tuple[tuple[str, ...], NDArray[Any]]
"""Names of dimensions, and values."""
_PER_DRAW: Final = ("chain", "draw")
_UNITS = {
    **CAMERA_UNITS,
    "mean_depth": "m",
    "pelvis": "m",
    "sides_flipped": "1",
    "best_fit": "nat",
    "log_posterior": "nat",
    "keypoints": "px",
    "scenelet_placement": "m, m, rad",
    "scenelet_log_size": "1",
    "object_placement": "m, m, rad",
}


def posterior_tree(
    source: Source,
    samples: Samples,
    config: Config,
    furniture: xr.Dataset,
    *,
    seconds: Mapping[str, float] | None = None,
    checks: Iterable[Check] = (),
    told: Told | None = None,
) -> xr.DataTree:
    """Make the tree of all draws, with provenance and checks as attributes.

    ``seconds`` are durations of the parts of the run.

    Parameters
    ----------
    source : Source
    samples : Samples
    config : Config
    furniture : Dataset
        Result of :func:`imapper_prob.uncertainty.furniture.object_draws`.
    seconds : mapping of str to float, optional
        Wall-clock duration of each part.
    checks : iterable of Check
    told : Told, optional
        Statements that the run was given.

    Returns
    -------
    DataTree
    """
    clip, chosen = source.clip, _drawn_scenelets(samples)
    frames = {
        "frame": np.tile(clip.frame_ids, len(clip.tracks)),
        "actor": ("frame", names_of_rows(clip)),
    }
    moved = _motions(source, samples)
    groups = {
        "posterior": xr.Dataset(_labelled(_continuous(samples, moved["pelvis"][1]))),
        "furniture": furniture,
        "counts": xr.Dataset(_labelled(_counts(samples))),
        "motion": xr.Dataset(_labelled(moved), {**frames, "axis": list("xyz")}),
        "draws": xr.Dataset(_labelled(_padded(source, samples))),
        "sample_stats": xr.Dataset(
            _labelled({"log_posterior": (_PER_DRAW, samples.log_posterior)} | _tempering(samples)),
            attrs={f"acceptance_{k}": v for k, v in samples.acceptance.rates().items()},
        ),
        "observed_data": xr.Dataset(
            _labelled(_detections(clip)), {**frames, "joint": list(JOINTS), "pixel": ["u", "v"]}
        ),
        "constant_data": xr.Dataset(
            {
                "scenelet": ("library", [s.name for s in source.library]),
                "label": ("category", _categories(samples)),
                "drawn": ("stored", chosen),
            }
        ),
        **sample_groups(samples),
        **source_groups(source, chosen),
    }
    chains, draws = samples.shape
    for name in ("posterior", "counts", "motion", "draws", "latent", "sample_stats"):
        groups[name] = groups[name].assign_coords(chain=np.arange(chains), draw=np.arange(draws))
    tree: xr.DataTree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "format": FORMAT,
        **provenance(source, config, seconds or {}),
        **sample_attributes(samples),
        "checks": to_json(checks),
        **_given(told),
        "ensembles": describe_refinement(samples.walked),
        "frame": "world: metres, z up, floor at z = 0, camera above the origin, looking along y",
    }
    return tree


def _given(told: Told | None) -> dict[str, str]:
    if told is None:
        return {}
    said = {GIVEN: statements_to_json(told.statements), DENIED: json.dumps(told.denied)}
    if told.steps is not None:
        said[STEPS] = json.dumps(told.steps)
    if told.evidence is not None:
        said[EVIDENCE] = json.dumps(asdict(told.evidence))
    return said


def told_of(attributes: Mapping[Any, Any]) -> Told | None:
    """Read the statements of a run and their evidence from the attributes of its file.

    Parameters
    ----------
    attributes : mapping

    Returns
    -------
    Told or None

    Raises
    ------
    LookupError, TypeError, ValueError
        The attributes are invalid.
    """
    if GIVEN not in attributes:
        return None
    evidence = None
    if EVIDENCE in attributes:
        said = json.loads(str(attributes[EVIDENCE]))
        evidence = Evidence(
            float(said["log_ratio"]),
            float(said["error"]),
            float(said["effective"]),
            int(said["draws"]),
            str(said["method"]),
        )
    denied = tuple(map(str, json.loads(str(attributes[DENIED]))))
    steps = int(json.loads(str(attributes[STEPS]))) if STEPS in attributes else None
    return Told(statements_from_json(str(attributes[GIVEN])), evidence, denied, steps)


def arviz_tree(tree: xr.DataTree, furniture: xr.Dataset) -> xr.DataTree:
    """The part of the tree that is for ArviZ, with the furniture among the quantities.

    Parameters
    ----------
    tree : DataTree
        The result of :func:`posterior_tree`.
    furniture : Dataset
        Objects by draw, see :func:`imapper_prob.uncertainty.furniture.object_draws`.

    Returns
    -------
    DataTree
        Groups ``posterior``, ``sample_stats``, ``observed_data`` and ``constant_data``.
    """
    names = ("posterior", "sample_stats", "observed_data", "constant_data")
    groups = {name: tree[name].to_dataset() for name in names}
    groups["posterior"] = groups["posterior"].merge(furniture)
    chosen: xr.DataTree = xr.DataTree.from_dict(groups)
    chosen.attrs = tree.attrs
    return chosen


def write_tree(path: Path, tree: xr.DataTree) -> None:
    """Write the tree as netCDF with lossless compression.

    The file is made in memory first, because HDF5 does not report disk errors clearly.

    Parameters
    ----------
    path : Path
    tree : DataTree
    """
    encoding = {
        group: {
            str(name): {"zlib": True, "shuffle": True, "complevel": 4}
            for name, values in tree[group].data_vars.items()
            if values.dtype.kind in "fiu" and values.size > 1
        }
        for group in tree.groups
    }
    # If dask is imported, xarray would use its lock, which does not work for files in memory.
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="single-threaded"):
        content: Any = tree.to_netcdf(None, engine="h5netcdf", encoding=encoding)
    path.write_bytes(content)


def _labelled(variables: Mapping[str, Variable]) -> dict[str, Any]:
    """Variables with their units."""
    return {
        name: (dims, values, {"units": _UNITS[name]} if name in _UNITS else {})
        for name, (dims, values) in variables.items()
    }


def _continuous(samples: Samples, pelvis: NDArray[np.float32]) -> dict[str, Variable]:
    """Camera, body and mean depth of each draw; ``pelvis`` is (C, N, T, 3)."""
    camera = np.array([state.camera for state in samples.states]).reshape(*samples.shape, -1)
    return {
        **{name: (_PER_DRAW, camera[..., i]) for i, name in enumerate(CAMERA)},
        "mean_depth": (_PER_DRAW, pelvis[..., 1].mean(-1, dtype=np.float64)),
    }


def _counts(samples: Samples) -> dict[str, Variable]:
    shape = samples.shape
    return {
        "n_scenelets": (_PER_DRAW, np.reshape([s.n_scenelets for s in samples.states], shape)),
        "n_objects": (_PER_DRAW, np.reshape([len(o) for o in samples.objects], shape)),
        "layout": (_PER_DRAW, 1 + samples.layouts.indicator.reshape(shape)),
    }


def _motions(source: Source, samples: Samples) -> dict[str, Variable]:
    """Pelvis and flips of each draw, single precision, and the fit of the best scenelet."""
    problem, states = source.problem, samples.states
    pelvis = np.array([motion(problem, state)[:, PELV].astype(np.float32) for state in states])
    turned = np.array([side_flips(problem, state).astype(np.float32) for state in states])
    return {
        "pelvis": ((*_PER_DRAW, "frame", "axis"), pelvis.reshape(*samples.shape, -1, 3)),
        "sides_flipped": ((*_PER_DRAW, "frame"), turned.reshape(*samples.shape, -1)),
        "best_fit": (("frame",), source.best_fits),
    }


def _detections(clip: Clip) -> dict[str, Variable]:
    seen = everybody(clip)
    return {
        "keypoints": (("frame", "joint", "pixel"), seen.keypoints),
        "confidences": (("frame", "joint"), seen.confidences),
    }


def _tempering(samples: Samples) -> dict[str, Variable]:
    ladders = samples.ladders
    return {
        "power": (("chain", "temperature"), np.array([ladder.betas for ladder in ladders])),
        "swap_rate": (("chain", "gap"), np.array([ladder.swap_rates for ladder in ladders])),
        "round_trips": (("chain",), np.array([ladder.round_trips for ladder in ladders])),
        "rounds": (("chain",), np.array([ladder.rounds for ladder in ladders])),
    }


def _categories(samples: Samples) -> list[str]:
    return sorted({o.label for objects in samples.objects for o in objects}) or [""]


def _drawn_scenelets(samples: Samples) -> NDArray[np.int64]:
    """Indices of scenelets that occur in draws, ascending; one if there are none."""
    items = [state.items[:, 0] for state in samples.states]
    drawn = np.unique(np.concatenate(items)).astype(np.int64)
    return drawn if len(drawn) else np.zeros(1, np.int64)


def _padded(source: Source, samples: Samples) -> dict[str, Variable]:
    """Scenelets and objects of each draw; unused slots are -1 or NaN."""
    count = len(samples.states)
    slots = max(1, *(s.n_scenelets for s in samples.states))
    scenelets = np.full((count, slots, 2), -1)
    placed = np.full((count, slots, 3), np.nan)
    sizes = np.full((count, slots), np.nan)
    most = max(1, *(len(o) for o in samples.objects))
    labels = np.full((count, most), -1)
    objects = np.full((count, most, 3), np.nan)
    origins = np.full((count, most, 2), -1)
    where = object_origins(source.library, samples.states, samples.objects)
    index = {label: i for i, label in enumerate(_categories(samples))}
    for n, (state, furniture) in enumerate(zip(samples.states, samples.objects, strict=True)):
        scenelets[n, : state.n_scenelets] = state.items
        placed[n, : state.n_scenelets] = state.placements
        sizes[n, : state.n_scenelets] = state.sizes
        for k, o in enumerate(furniture):
            labels[n, k] = index[o.label]
            objects[n, k] = (*o.centre[:2], o.placement.yaw)
            origins[n, k] = where[n][k]
    shape = samples.shape
    return {
        "scenelet": (("chain", "draw", "slot"), scenelets[..., 0].reshape(*shape, slots)),
        "start": (("chain", "draw", "slot"), scenelets[..., 1].reshape(*shape, slots)),
        "scenelet_placement": (
            ("chain", "draw", "slot", "pose"),
            placed.reshape(*shape, slots, 3),
        ),
        "scenelet_log_size": (("chain", "draw", "slot"), sizes.reshape(*shape, slots)),
        "object_label": (("chain", "draw", "object"), labels.reshape(*shape, most)),
        "object_placement": (
            ("chain", "draw", "object", "pose"),
            objects.reshape(*shape, most, 3),
        ),
        "object_slot": (("chain", "draw", "object"), origins[..., 0].reshape(*shape, most)),
        "object_number": (("chain", "draw", "object"), origins[..., 1].reshape(*shape, most)),
    }


def read_attributes(path: str | Path) -> dict[str, Any]:
    """Read the attributes of a ``posterior.nc`` without its draws.

    Parameters
    ----------
    path : path

    Returns
    -------
    dict of str to object

    Raises
    ------
    InputError
        The file is missing or not the posterior of a run.
    """
    require_intact(Path(path))
    try:
        with xr.open_dataset(path, engine="h5netcdf") as root:
            attributes = dict(root.attrs)
    except Exception as error:  # the exceptions of xarray, h5netcdf and h5py differ
        raise InputError(f"{path}: not the posterior of a run ({error})") from error
    missing = [name for name in _SAID if name not in attributes]
    if missing:
        raise InputError(f"{path}: not the posterior of a run (no {missing[0]} in it)")
    return attributes | {name: str(attributes[name]) for name in _SAID}
