"""The folder of a run: all of it or nothing."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from imapper_prob.config import to_toml
from imapper_prob.files import folder_written_whole, require_writable
from imapper_prob.models.errors import InputError
from imapper_prob.results.export import write_scenes
from imapper_prob.results.export_glb import write_glb
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report.write import write_report
from imapper_prob.results.tree import write_tree

__all__ = ["CHECKPOINTS", "prepare_folder", "write_run"]

CHECKPOINTS = "checkpoints"
"""Folder in a run's folder that is there while the run is not finished."""

_FILES = (
    "config.toml", "coverage.png", "energy.json", "energy.png", "evaluation.json",
    "evaluation.png", "posterior.nc", "recording.rrd", "report.html", "scenes", "scenes.json",
)  # fmt: skip


def prepare_folder(folder: Path, *, overwrite: bool) -> None:
    """Refuse early what would fail or destroy something after minutes of work.

    An unfinished run goes on; with ``overwrite`` its checkpoints are deleted.

    Raises
    ------
    InputError
        If the folder holds something (a finished run is replaced with ``overwrite``, other
        files never are), is no folder, or cannot be made.
    """
    _check_folder(folder, overwrite=overwrite)
    if overwrite:
        shutil.rmtree(folder / CHECKPOINTS, ignore_errors=True)


def _check_folder(folder: Path, *, overwrite: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the output")
    present = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
    strange = [name for name in present if name not in (*_FILES, CHECKPOINTS)]
    if strange:
        raise InputError(
            f"{folder}: holds {strange[0]}, which is not of a run; name another folder"
        )
    if present and CHECKPOINTS not in present and not overwrite:
        raise InputError(f"{folder}: holds an earlier run; name another folder or add --overwrite")
    require_writable(folder)


def write_run(
    folder: Path, posterior: Posterior, *, overwrite: bool, video: Path | None = None
) -> None:
    """Write all files beside, then put the folder in its place.

    Checkpoints are dropped, unless the run was interrupted and can go on. The pictures of
    ``video``, if given, are shown in the recording.

    Raises
    ------
    InputError
        As :func:`prepare_folder`, or if the disk refuses.
    """
    _check_folder(folder, overwrite=overwrite)
    with folder_written_whole(folder) as beside:
        (beside / "config.toml").write_text(to_toml(posterior.config), encoding="utf-8")
        write_scenes(
            beside / "scenes.json",
            posterior.scenes(),
            clip=posterior.clip,
            checks=posterior.checks,
        )
        _write_models(beside / "scenes", posterior)
        write_tree(beside / "posterior.nc", posterior.data)
        posterior.record(beside / "recording.rrd", video=video)
        write_report(beside / "report.html", posterior)
        if not posterior.samples.finished and (folder / CHECKPOINTS).exists():
            os.replace(folder / CHECKPOINTS, beside / CHECKPOINTS)


def _write_models(folder: Path, posterior: Posterior) -> None:
    folder.mkdir()
    for number, weighted in enumerate(posterior.scenes(), 1):
        path = folder / f"scene_{number}.glb"
        write_glb(path, weighted.scene, posterior.clip)
