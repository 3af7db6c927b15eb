"""What do the notebooks show? Runs them and stores their outputs, for readers who run nothing.

    python -m lab.notebooks [NOTEBOOK ...]

runs notebooks, all in ``notebooks/`` in order if none is named, each in its own folder, and writes
them back with texts, tables and pictures. Widgets are left out: a recording has megabytes, and a
static page cannot display it. Nothing is written if a cell fails. It takes some minutes for all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import nbformat
from nbclient import NotebookClient

from imapper_prob.files import written_whole

__all__ = ["main"]

FOLDER: Final = Path(__file__).parents[1] / "notebooks"
_WIDGET: Final = "application/vnd.jupyter.widget-view+json"
_SERVER: Final = ("Starting asset server", "Loading assets", "Serving rerun")
"""Beginnings of lines that the recording's widget prints, whose port varies."""
_LONGEST: Final = 600
"""Greatest number of seconds for a cell."""


def _run(path: Path) -> None:
    """Run a notebook and store it with its outputs.

    Parameters
    ----------
    path : Path
    """
    notebook: Any = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    metadata = dict(notebook.metadata)
    resources = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=_LONGEST, resources=resources).execute()
    notebook.metadata = metadata
    for cell in notebook.cells:
        # Times of execution differ between runs.
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [o for o in cell.outputs if _kept(o)]
    with written_whole(path) as beside:
        nbformat.write(notebook, beside)  # type: ignore[no-untyped-call]


def _kept(output: Any) -> bool:
    """Whether an output is from the notebook itself and can be displayed on a page."""
    if output.output_type != "stream":
        return _WIDGET not in output.get("data", {})
    lines = output.text.splitlines(keepends=True)
    output.text = "".join(line for line in lines if not line.startswith(_SERVER))
    return output.name == "stdout" and bool(output.text.strip())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run notebooks in order."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("notebooks", type=Path, nargs="*")
    for path in parser.parse_args(arguments).notebooks or sorted(FOLDER.glob("*.ipynb")):
        _run(path)
        sys.stdout.write(f"{path.name}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
