"""``info --energy``: why the scene of a run is what it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from imapper_prob.cli.progress import progress_bars
from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from imapper_prob.models.scene import Clip

__all__ = ["show_energy"]

_DOTS_PER_INCH = 120


def show_energy(folder: Path, clip: Clip | None) -> None:
    """Print what the first scene of a run costs; write ``energy.png`` and ``energy.json``.

    Parameters
    ----------
    folder : Path
        Of the run.
    clip : Clip, optional
        The clip of the run, which its folder does not keep. That of the demo is made again.

    Raises
    ------
    InputError
        If clip or library are not those of the run, or the disk refuses.
    """
    from rich.console import Console

    from imapper_prob.config import read_config
    from imapper_prob.files import written_whole
    from imapper_prob.results.energy import explain
    from imapper_prob.results.energy_figure import energy_figure
    from imapper_prob.results.energy_report import (
        object_worth_table,
        scenelet_table,
        term_table,
        write_energy,
    )
    from imapper_prob.results.rebuild import rebuild
    from imapper_prob.results.tree import read_attributes
    from imapper_prob.scenelets.library import load_library

    attributes = read_attributes(folder / "posterior.nc")
    if clip is None:
        clip = _demo_clip(folder, attributes["clip"])
    config = read_config(folder / "config.toml")
    library = load_library(config.library)
    with progress_bars() as progress:
        run = rebuild(folder, clip, library, config, progress=progress)
        explanation = explain(run.problem, run.state, library, frame_ids=clip.frame_ids)
        progress("explaining the scene", 1.0)
    console = Console(highlight=False)
    for table in (term_table, scenelet_table, object_worth_table):
        console.print(table(explanation))
    console.print(
        "Layout 1 on the mean path between its scenelets, "
        f"{explanation.log_posterior:.1f} nat; the draw had a path of its own and "
        f"{run.drawn_log_posterior:.1f} nat."
    )
    figure, document = folder / "energy.png", folder / "energy.json"
    try:
        with written_whole(figure) as beside:
            energy_figure(explanation, title=clip.name).savefig(beside, dpi=_DOTS_PER_INCH)
        write_energy(
            document, explanation, clip=clip.name, library_digest=attributes["library_digest"]
        )
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from error
    console.print(f"Written: {figure}, {document}")


def _demo_clip(folder: Path, name: str) -> Clip:
    """That of the demo, which anybody can make again."""
    from imapper_prob.demo import demo_clip

    if name == "demo":
        return demo_clip()
    raise InputError(f"{folder}: name the clip {name} of this run with --clip")
