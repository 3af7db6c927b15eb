"""Folders of runs and of staged solutions: checked in advance, and written atomically."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from imapper_prob.config import Config, from_toml, to_toml
from imapper_prob.files import (
    disk_errors_named,
    folder_held,
    folder_published,
    require_intact,
    require_own,
    written_whole,
)
from imapper_prob.models.errors import InputError
from imapper_prob.plotting import save_figure
from imapper_prob.recording.video import Video
from imapper_prob.results.changes import changes, write_changes
from imapper_prob.results.glb import write_glb
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.report import write_report
from imapper_prob.results.scenes_file import write_scenes
from imapper_prob.samplers.checkpoint import checkpoint_of
from imapper_prob.solver.actors import Solved
from imapper_prob.uncertainty.summary import object_rows
from imapper_prob.uncertainty.tree import FORMAT, GIVEN, read_attributes, write_tree

__all__ = [
    "CHECKPOINTS",
    "Earlier",
    "earlier_run",
    "restore_chains",
    "run_folder",
    "solution_folder",
    "write_run",
    "write_solution_folder",
]

CHECKPOINTS = "checkpoints"
"""Subfolder of checkpoints, which exists while a run is unfinished."""
_CHAINS = "chains"
"""Subfolder of a finished run with the checkpoints from which its chains can be continued."""
_RUN_FILES = (
    "chains", "changes.json", "config.toml", "coverage.png", "energy.json", "energy.png",
    "evaluation.json", "evaluation.png", "posterior.nc", "recording.rrd", "report.html", "scenes",
    "scenes.json",
)  # fmt: skip


@dataclass(frozen=True)
class Earlier:
    """A finished or interrupted run in a folder.

    Parameters
    ----------
    folder : Path
    config : Config
    clip, clip_digest, library_digest : str
        Input of the run.
    finished : bool
        Whether the run is complete.
    good : bool
        Whether the run has converged.
    verdict : str
    given : str
        Statements that it was given, in the format of `imapper_prob.models.statements.to_json`;
        empty if none.
    """

    folder: Path
    config: Config
    clip: str
    clip_digest: str
    library_digest: str
    finished: bool
    good: bool
    verdict: str
    given: str


def earlier_run(folder: Path) -> Earlier | None:
    """Read which run is in a folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    Earlier or None
        None if there is no run, or nothing of it was written yet.

    Raises
    ------
    InputError
        The run is damaged or of another version.
    """
    path = folder / "posterior.nc"
    if not path.is_file():
        return None
    said = read_attributes(path)
    program = f"imapper-prob {version('imapper-prob')}"
    if said.get("format") != FORMAT or said["program"] != program:
        raise InputError(
            f"{folder}: holds a run of {said['program']}, which {program} cannot go on with; name "
            "another folder or add --overwrite"
        )
    try:
        return Earlier(
            folder=folder,
            config=from_toml(str(said["config"]), where=str(path)),
            clip=said["clip"],
            clip_digest=str(said["clip_digest"]),
            library_digest=str(said["library_digest"]),
            finished=bool(said["finished"]) and not (folder / CHECKPOINTS).is_dir(),
            good=bool(said["verdict_good"]),
            verdict=said["verdict"],
            given=str(said.get(GIVEN, "")),
        )
    except LookupError as error:
        raise InputError(
            f"{path}: has no {error}; name another folder or add --overwrite"
        ) from error


def restore_chains(folder: Path, *, chains: int) -> None:
    """Restore the checkpoints of a finished run, so that its chains can be continued.

    Checkpoints of chains that were already continued are kept.

    Parameters
    ----------
    folder : Path
    chains : int
        Number of chains.

    Raises
    ------
    InputError
        A checkpoint is missing or damaged, or the disk refuses.
    """
    kept, place = folder / _CHAINS, folder / CHECKPOINTS
    if not kept.is_dir():
        return
    for chain in range(chains):
        path, target = checkpoint_of(kept, chain), checkpoint_of(place, chain)
        if target.exists():
            continue
        if not path.is_file():
            raise InputError(
                f"{path}: is not there, and its chain cannot go on; copy it again, or sample all "
                "anew with --overwrite"
            )
        require_intact(path, below=folder)
        with disk_errors_named(target):
            place.mkdir(exist_ok=True)
            with written_whole(target) as beside:
                shutil.copyfile(path, beside)


@contextmanager
def run_folder(
    folder: Path, *, overwrite: bool, goes_on: bool = False, resumes: bool = False
) -> Iterator[None]:
    """Lock the folder of a run until it is written, and check in advance that writing is possible.

    Nothing in it is changed yet, in particular not its checkpoints.

    Parameters
    ----------
    folder : Path
    overwrite : bool
        Replace an earlier run.
    goes_on : bool
        Continue an earlier run, finished or not.
    resumes : bool
        Continue an unfinished run.

    Yields
    ------
    None

    Raises
    ------
    InputError
        The folder has other contents (an earlier run is replaced with ``overwrite``, and continued
        with ``goes_on`` if it has its chains; other files are never replaced), is not a folder,
        cannot be created, or another process is writing to it.
    """
    resumes = resumes or goes_on
    _require_run_folder(folder, overwrite=overwrite, goes_on=goes_on, resumes=resumes)
    with folder_held(folder):
        _require_run_folder(folder, overwrite=overwrite, goes_on=goes_on, resumes=resumes)
        yield


def _require_run_folder(
    folder: Path, *, overwrite: bool, goes_on: bool = False, resumes: bool
) -> None:
    whole = (folder / _CHAINS).is_dir() and (folder / "posterior.nc").is_file()
    require_own(
        folder,
        _RUN_FILES,
        what="run",
        overwrite=overwrite or (goes_on and whole),
        unfinished=CHECKPOINTS,
        resumes=resumes,
    )


def write_run(
    folder: Path,
    posterior: Posterior,
    *,
    overwrite: bool,
    resumed: bool = False,
    video: Path | Video | None = None,
    before: Posterior | None = None,
) -> None:
    """Write all files of a run, see :func:`imapper_prob.files.folder_published`.

    A run's own checkpoints are kept: of a finished run as its chains, from which it can be
    continued; of an interrupted run as checkpoints.

    Parameters
    ----------
    folder : Path
    posterior : Posterior
    overwrite : bool
        Replace an earlier run.
    resumed : bool
        Whether the checkpoints in the folder are those of the posterior's chains.
    video : Path or Video, optional
        Images of the clip, shown in the recording.
    before : Posterior, optional
        The posterior before conditioning on statements; the changes are then written too.

    Raises
    ------
    InputError
        As :func:`run_folder`, or the disk refuses.
    """
    _require_run_folder(folder, overwrite=overwrite, resumes=resumed)
    with folder_published(folder, names=_RUN_FILES) as beside:
        (beside / "config.toml").write_text(to_toml(posterior.config), encoding="utf-8")
        write_scenes(
            beside / "scenes.json",
            posterior.scenes(),
            clip=posterior.clip,
            checks=posterior.checks,
            objects=object_rows(posterior.summary()),
        )
        _write_models(beside / "scenes", posterior)
        write_tree(beside / "posterior.nc", posterior.data)
        posterior.record(beside / "recording.rrd", video=video)
        write_report(beside / "report.html", posterior)
        if before is not None:
            write_changes(beside / "changes.json", changes(before, posterior), posterior.told)
        if resumed and posterior.samples.finished:
            _keep_chains(folder, beside / _CHAINS, chains=posterior.samples.shape[0])
    if posterior.samples.finished or not resumed:
        shutil.rmtree(folder / CHECKPOINTS, ignore_errors=True)


def _keep_chains(folder: Path, kept: Path, *, chains: int) -> None:
    """Keep the chains' checkpoints if all exist."""
    paths = [checkpoint_of(folder / CHECKPOINTS, chain) for chain in range(chains)]
    if all(path.is_file() for path in paths):
        kept.mkdir()
        for path in paths:
            shutil.copyfile(path, kept / path.name)


def _write_models(folder: Path, posterior: Posterior) -> None:
    folder.mkdir()
    for number, weighted in enumerate(posterior.scenes(), 1):
        path = folder / f"scene_{number}.glb"
        write_glb(path, weighted, posterior.clip)


# ------------------------------------------------------------------------------------------------
# Folders of staged solutions.

_SOLUTION_FILES = (
    "candidates.png", "charness.png", "config.toml", "evaluation.json", "evaluation.png",
    "solution.json", "solution.npz", "stages.rrd",
)  # fmt: skip


@contextmanager
def solution_folder(folder: Path, *, overwrite: bool) -> Iterator[None]:
    """Lock the folder of a solution until it is written, and check in advance that it can be.

    Parameters
    ----------
    folder : Path
    overwrite : bool
        Replace an earlier solution.

    Yields
    ------
    None

    Raises
    ------
    InputError
        The folder has other contents (an earlier solution is replaced with ``overwrite``, other
        files never are), is not a folder, cannot be created, or another process is writing to it.
    """
    _require_solution_folder(folder, overwrite=overwrite)
    with folder_held(folder):
        _require_solution_folder(folder, overwrite=overwrite)
        yield


def _require_solution_folder(folder: Path, *, overwrite: bool) -> None:
    require_own(folder, _SOLUTION_FILES, what="solution", overwrite=overwrite)


def write_solution_folder(folder: Path, solved: Solved, config: Config, *, overwrite: bool) -> None:
    """Write all files of a solution, see :func:`imapper_prob.files.folder_published`.

    Parameters
    ----------
    folder : Path
    solved : Solved
    config : Config
    overwrite : bool
        Replace an earlier solution.

    Raises
    ------
    InputError
        As :func:`solution_folder`, or the disk refuses.
    """
    from imapper_prob.recording.stages import charness_curves, stage_views, write_stages
    from imapper_prob.results.solution import candidate_figure, charness_figure, write_solution

    _require_solution_folder(folder, overwrite=overwrite)
    with folder_published(folder, names=_SOLUTION_FILES) as beside:
        (beside / "config.toml").write_text(to_toml(config), encoding="utf-8")
        write_solution(beside, solved)
        save_figure(charness_figure(solved), beside / "charness.png")
        save_figure(candidate_figure(solved), beside / "candidates.png")
        write_stages(
            beside / "stages.rrd",
            clip=solved.clip,
            camera=solved.scenes[0].camera,
            stages=stage_views(solved),
            charness=charness_curves(solved),
        )
