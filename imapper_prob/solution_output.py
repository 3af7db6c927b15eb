"""The folder of a staged solution: all of it or nothing."""

from __future__ import annotations

from pathlib import Path

from imapper_prob.config import Config, to_toml
from imapper_prob.files import folder_written_whole, require_writable
from imapper_prob.models.errors import InputError
from imapper_prob.results.solved import Solved

__all__ = ["prepare_solution_folder", "write_solution_folder"]

_FILES = (
    "candidates.png", "charness.png", "config.toml", "evaluation.json", "evaluation.png",
    "solution.json", "solution.npz", "stages.rrd",
)  # fmt: skip
_DOTS_PER_INCH = 120


def prepare_solution_folder(folder: Path, *, overwrite: bool) -> None:
    """Refuse early what would fail or destroy something after the work is done.

    Raises
    ------
    InputError
        If the folder holds something (an earlier solution is replaced with ``overwrite``, other
        files never are), is no folder, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the output")
    present = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
    strange = [name for name in present if name not in _FILES]
    if strange:
        raise InputError(
            f"{folder}: holds {strange[0]}, which is not of a solution; name another folder"
        )
    if present and not overwrite:
        raise InputError(
            f"{folder}: holds an earlier solution; name another folder or add --overwrite"
        )
    require_writable(folder)


def write_solution_folder(folder: Path, solved: Solved, config: Config, *, overwrite: bool) -> None:
    """Write all files beside, then put the folder in its place.

    Raises
    ------
    InputError
        As :func:`prepare_solution_folder`, or if the disk refuses.
    """
    from imapper_prob.recording.stages import write_stages
    from imapper_prob.results.solution_figure import candidate_figure, charness_figure
    from imapper_prob.results.solution_file import write_solution
    from imapper_prob.results.solution_stages import charness_curves, stage_views

    prepare_solution_folder(folder, overwrite=overwrite)
    with folder_written_whole(folder) as beside:
        (beside / "config.toml").write_text(to_toml(config), encoding="utf-8")
        write_solution(beside, solved)
        charness_figure(solved).savefig(beside / "charness.png", dpi=_DOTS_PER_INCH)
        candidate_figure(solved).savefig(beside / "candidates.png", dpi=_DOTS_PER_INCH)
        write_stages(
            beside / "stages.rrd",
            clip=solved.clip,
            camera=solved.scenes[0].camera,
            stages=stage_views(solved),
            charness=charness_curves(solved),
        )
