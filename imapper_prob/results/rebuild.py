"""A run made again from its folder: its log-posterior, and the scene it shows first.

A folder keeps draws and settings, not the packed log-posterior. The stages that lead to it
are deterministic, so clip, library and settings give it back. The latent numbers of the path
are not kept: where no scenelet lies, the scene is rebuilt on the mean path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from imapper_prob.config import Config
from imapper_prob.models.errors import InputError
from imapper_prob.models.path import CAMERA
from imapper_prob.models.posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.results.export import read_scenes
from imapper_prob.results.tree import read_attributes
from imapper_prob.staged.solver import fit_clip

__all__ = ["Rebuilt", "rebuild"]

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Rebuilt:
    """The log-posterior of a run, and the draw that stands for its most probable layout.

    Parameters
    ----------
    problem : Problem
    state : State
        With all latent numbers 0: the mean path between the scenelets.
    drawn_log_posterior : float
        That of the draw, on the path that was drawn with it.
    """

    problem: Problem
    state: State
    drawn_log_posterior: float


def rebuild(
    folder: Path,
    clip: Clip,
    library: Library,
    config: Config,
    *,
    progress: Progress | None = None,
) -> Rebuilt:
    """Make the log-posterior of a run again.

    Parameters
    ----------
    folder : Path
        With ``posterior.nc`` and ``scenes.json``.
    clip, library, config
        What the run was made of.
    progress : callable, optional
        Called with the name of a stage and the part of it that is done.

    Raises
    ------
    InputError
        If clip or library are not those of the run, or its files do not belong together.
    """
    attributes = read_attributes(folder / "posterior.nc")
    if attributes["clip"] != clip.name:
        raise InputError(
            f"{folder}: is a run of the clip {attributes['clip']}, not of {clip.name}; "
            "name that clip"
        )
    if attributes["library_digest"] != library.digest:
        raise InputError(
            f"{folder}: was run with another library {attributes['library']} (digest "
            f"{attributes['library_digest'][:12]}) than the one there is now "
            f"({library.digest[:12]}); run the clip again"
        )
    shown = read_scenes(folder / "scenes.json")[0].scene.log_posterior
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        _check_detections(folder, tree, clip)
        state = _draw(folder, tree, shown, clip.n_frames)
    fitted = fit_clip(clip, library, settings=config.model, progress=progress)
    return Rebuilt(fitted.problem, state, shown)


def _check_detections(folder: Path, tree: xr.DataTree, clip: Clip) -> None:
    """Names can stay while files change: the detections must be the same to the last bit."""
    seen, person = tree["observed_data"], clip.tracks[0]
    same = np.array_equal(seen["frame"], clip.frame_ids) and all(
        np.array_equal(seen[name], values, equal_nan=True)
        for name, values in (("keypoints", person.keypoints), ("confidences", person.confidences))
    )
    if not same:
        raise InputError(
            f"{folder}: the clip {clip.name} has other detections than when it was run; "
            "give the clip as it was, or run it again"
        )


def _draw(folder: Path, tree: xr.DataTree, log_posterior: float, n_frames: int) -> State:
    """The draw with this log-posterior, on the mean path."""
    found = np.argwhere(tree["sample_stats/log_posterior"].to_numpy() == log_posterior)
    if not len(found):
        raise InputError(
            f"{folder}: scenes.json and posterior.nc are not of the same run; run the clip again"
        )
    at = dict(zip(("chain", "draw"), found[0].tolist(), strict=True))
    posterior, draws = tree["posterior"].isel(at), tree["draws"].isel(at)
    used = draws["scenelet"].to_numpy() >= 0
    items = np.stack([draws["scenelet"].to_numpy()[used], draws["start"].to_numpy()[used]], -1)
    return State(
        camera=np.array([float(posterior[name]) for name in CAMERA]),
        items=items.astype(np.int64),
        placements=draws["scenelet_placement"].to_numpy()[used],
        sizes=draws["scenelet_log_size"].to_numpy()[used],
        latent=np.zeros((n_frames, 2)),
    )
