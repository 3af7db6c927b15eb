"""The folder of a staged solution."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imapper_prob.config import Config, to_toml
from imapper_prob.figure_file import save_figure
from imapper_prob.files import folder_held, folder_published, require_own
from imapper_prob.results.solved import Solved

__all__ = ["solution_folder", "write_solution_folder"]

_FILES = (
    "candidates.png", "charness.png", "config.toml", "evaluation.json", "evaluation.png",
    "solution.json", "solution.npz", "stages.rrd",
)  # fmt: skip
_DOTS_PER_INCH = 120


@contextmanager
def solution_folder(folder: Path, *, overwrite: bool) -> Iterator[None]:
    """Hold the folder of a solution until it is written, and refuse early what would fail then.

    Raises
    ------
    InputError
        If the folder holds something (an earlier solution is replaced with ``overwrite``, other
        files never are), is no folder, cannot be made, or another process writes to it.
    """
    _check_folder(folder, overwrite=overwrite)
    with folder_held(folder):
        _check_folder(folder, overwrite=overwrite)
        yield


def _check_folder(folder: Path, *, overwrite: bool) -> None:
    require_own(folder, _FILES, what="solution", overwrite=overwrite)


def write_solution_folder(folder: Path, solved: Solved, config: Config, *, overwrite: bool) -> None:
    """Write all files of a solution, see :func:`imapper_prob.files.folder_published`.

    Raises
    ------
    InputError
        As :func:`solution_folder`, or if the disk refuses.
    """
    from imapper_prob.recording.stages import write_stages
    from imapper_prob.results.solution_figure import candidate_figure, charness_figure
    from imapper_prob.results.solution_file import write_solution
    from imapper_prob.results.solution_stages import charness_curves, stage_views

    _check_folder(folder, overwrite=overwrite)
    with folder_published(folder, names=_FILES) as beside:
        (beside / "config.toml").write_text(to_toml(config), encoding="utf-8")
        write_solution(beside, solved)
        save_figure(charness_figure(solved), beside / "charness.png", dpi=_DOTS_PER_INCH)
        save_figure(candidate_figure(solved), beside / "candidates.png", dpi=_DOTS_PER_INCH)
        write_stages(
            beside / "stages.rrd",
            clip=solved.clip,
            camera=solved.scenes[0].camera,
            stages=stage_views(solved),
            charness=charness_curves(solved),
        )
