"""What was sampled from, in ``posterior.nc``: clip, scenelets and the packed log-posterior.

With these three a run can be looked at again where its clip and its library are no more, and
without the stages that lead to the first draw. Of the library only those scenelets are kept
that some draw has. Groups:

``clip``      the arrays of a clip file (:mod:`imapper_prob.inputs.clip_file`)
``library``   the arrays of a library file (:mod:`imapper_prob.scenelets.library_file`)
``problem``   the fields of :class:`imapper_prob.models.problem.Problem`, for these scenelets
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from imapper_prob.inputs.clip_file import clip_of, pack_clip
from imapper_prob.models.problem import Problem, resample
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.valid import check_problem
from imapper_prob.results.own_scenelets import of_scenelets
from imapper_prob.results.valid_samples import require
from imapper_prob.scenelets.library_file import library_of, pack_library

__all__ = ["Source", "StoredSource", "read_source", "source_groups"]

Arrays = Mapping[str, NDArray[Any]]
Ints = NDArray[np.int64]

_FROM_LIBRARY: Final = "joints"
"""The largest field of a problem is not stored: it is the library's motions, resampled."""
_READ_ONLY: Final = "read_only"
_BY_COLUMN: Final = "by_column"
"""Attributes of arrays that nobody may write to, and that lie in memory column by column:
compiled code is made anew for others."""


class Source(Protocol):
    """What draws are draws of; a staged solution is one."""

    @property
    def clip(self) -> Clip:
        """The input."""

    @property
    def library(self) -> Library:
        """Scenelets that the states refer to."""

    @property
    def problem(self) -> Problem:
        """The log-posterior of the clip with that library."""

    @property
    def best_fits(self) -> NDArray[np.float64]:
        """(T,) how well the best scenelet over a frame fits."""


@dataclass(frozen=True)
class StoredSource:
    """A source that was read from a run's folder.

    Parameters
    ----------
    clip : Clip
    library : Library
        Only the scenelets that some draw has.
    problem : Problem
        For these scenelets.
    best_fits : (T,) float
        Of all scenelets that there were; NaN where nobody says.
    """

    clip: Clip
    library: Library
    problem: Problem
    best_fits: NDArray[np.float64]


def source_groups(source: Source, chosen: Ints) -> dict[str, xr.Dataset]:
    """The groups of a source with a library of the scenelets ``chosen``."""
    library = Library(source.library.name, tuple(source.library[i] for i in chosen))
    fields = of_scenelets(source.problem, chosen)._asdict()
    fields.pop(_FROM_LIBRARY)
    return {
        "clip": _dataset(pack_clip(source.clip)),
        "library": _dataset(pack_library(library)),
        "problem": _dataset(fields),
    }


def read_source(path: Path, groups: Mapping[str, xr.Dataset]) -> StoredSource:
    """The source that :func:`source_groups` took; ``path`` of the file is for messages."""
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
    motions = [resample(s.joints, fps=s.fps, to_fps=clip.fps) for s in library]
    fields[_FROM_LIBRARY] = np.concatenate(motions)
    problem, motion = Problem(**fields), groups["/motion"]
    check_problem(problem)
    require(len(problem.log_rate) == len(library), "problem and library have other scenelets")
    everybody = clip.n_frames * len(clip.tracks)
    require(problem.n_frames == everybody, "problem and clip have other frames")
    fits = (
        motion["best_fit"].to_numpy() if "best_fit" in motion else np.full(problem.n_frames, np.nan)
    )
    require(fits.shape == (everybody,), "best_fit is not of the clip's frames")
    return StoredSource(clip, library, problem, fits.astype(np.float64))


def _dataset(arrays: Mapping[str, Any]) -> xr.Dataset:
    """Arrays, each with dimensions of its own."""
    variables = {}
    for name, values in arrays.items():
        values = np.asarray(values)
        dims = [f"{name}_{axis}" for axis in range(values.ndim)]
        kept = {_READ_ONLY: not values.flags.writeable, _BY_COLUMN: values.flags.fnc}
        said = {key: 1 for key, holds in kept.items() if holds and values.ndim}
        variables[name] = (dims, values, said)
    return xr.Dataset(variables)


def _arrays(group: xr.Dataset) -> dict[str, NDArray[Any]]:
    """The arrays again, text as text and numbers in arrays of their own."""
    arrays = {}
    for name, variable in group.data_vars.items():
        values = variable.to_numpy()
        arrays[str(name)] = values.astype(str) if values.dtype.kind in "OT" else values.copy()
    return arrays
