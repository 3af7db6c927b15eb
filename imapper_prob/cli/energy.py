"""``info --energy``: why the scene of a run is what it is."""

from __future__ import annotations

from pathlib import Path

from imapper_prob.models.errors import InputError

__all__ = ["show_energy"]

_DOTS_PER_INCH = 120


def show_energy(folder: Path) -> None:
    """Print what the first scene of a run costs; write ``energy.png`` and ``energy.json``.

    Raises
    ------
    InputError
        If there is no run in the folder, or the disk refuses.
    """
    from imapper_prob.cli.console import console
    from imapper_prob.figure_file import save_figure
    from imapper_prob.files import written_whole
    from imapper_prob.people import in_a_row
    from imapper_prob.results.energy import explain
    from imapper_prob.results.energy_figure import energy_figure
    from imapper_prob.results.energy_report import (
        object_worth_table,
        scenelet_table,
        term_table,
        write_energy,
    )
    from imapper_prob.results.load import load_posterior

    posterior = load_posterior(folder)
    clip, source = posterior.clip, posterior.solution
    state = posterior.samples.states[posterior.scenes(1)[0].draw]
    explanation = explain(source.problem, state, source.library, frame_ids=in_a_row(clip))
    out = console()
    for table in (term_table, scenelet_table, object_worth_table):
        out.print(table(explanation))
    digest = posterior.data.attrs["library_digest"]
    figure, document = folder / "energy.png", folder / "energy.json"
    try:
        with written_whole(figure) as beside:
            save_figure(energy_figure(explanation, title=clip.name), beside, dpi=_DOTS_PER_INCH)
        write_energy(document, explanation, clip=clip.name, library_digest=digest)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from error
    out.print(f"Written: {figure}, {document}")
