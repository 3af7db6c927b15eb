"""The folder of a run."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imapper_prob.config import to_toml
from imapper_prob.files import folder_held, folder_published, require_own
from imapper_prob.results.export import write_scenes
from imapper_prob.results.export_glb import write_glb
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report.write import write_report
from imapper_prob.results.tree import write_tree

__all__ = ["CHECKPOINTS", "run_folder", "write_run"]

CHECKPOINTS = "checkpoints"
"""Folder in a run's folder that is there while the run is not finished."""

_FILES = (
    "config.toml", "coverage.png", "energy.json", "energy.png", "evaluation.json",
    "evaluation.png", "posterior.nc", "recording.rrd", "report.html", "scenes", "scenes.json",
)  # fmt: skip


@contextmanager
def run_folder(folder: Path, *, overwrite: bool) -> Iterator[None]:
    """Hold the folder of a run until it is written, and refuse early what would fail then.

    Nothing in it is touched yet, its checkpoints least of all.

    Raises
    ------
    InputError
        If the folder holds something (a finished run is replaced with ``overwrite``, other
        files never are), is no folder, cannot be made, or another process writes to it.
    """
    _check_folder(folder, overwrite=overwrite)
    with folder_held(folder):
        _check_folder(folder, overwrite=overwrite)
        yield


def _check_folder(folder: Path, *, overwrite: bool) -> None:
    require_own(folder, _FILES, what="run", overwrite=overwrite, unfinished=CHECKPOINTS)


def write_run(
    folder: Path, posterior: Posterior, *, overwrite: bool, video: Path | None = None
) -> None:
    """Write all files of a run, see :func:`imapper_prob.files.folder_published`.

    Checkpoints are dropped once they are in place, unless the run was interrupted and can go
    on. The pictures of ``video``, if given, are shown in the recording.

    Raises
    ------
    InputError
        As :func:`run_folder`, or if the disk refuses.
    """
    _check_folder(folder, overwrite=overwrite)
    with folder_published(folder, names=_FILES) as beside:
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
    if posterior.samples.finished:
        shutil.rmtree(folder / CHECKPOINTS, ignore_errors=True)


def _write_models(folder: Path, posterior: Posterior) -> None:
    folder.mkdir()
    for number, weighted in enumerate(posterior.scenes(), 1):
        path = folder / f"scene_{number}.glb"
        write_glb(path, weighted.scene, posterior.clip)
