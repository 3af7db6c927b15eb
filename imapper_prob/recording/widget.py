"""A recording inside a notebook, without a network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from imapper_prob.models.errors import InputError

if TYPE_CHECKING:
    from rerun_notebook import Viewer

__all__ = ["recording_widget"]

_ASSET = "RERUN_NOTEBOOK_ASSET"


def recording_widget(recording: str | Path, *, width: int = 1200, height: int = 750) -> Viewer:
    """The viewer as a notebook's output, with a recording in it.

    Parameters
    ----------
    recording : path
        An ``.rrd`` file.
    width, height : int
        Pixels.

    Raises
    ------
    InputError
        If there is no such recording, or rerun's notebook package is not installed.
    """
    recording = Path(recording)
    if not recording.is_file():
        raise InputError(f"{recording}: no such recording")
    # Read when the package is imported; otherwise the viewer comes over the network.
    os.environ.setdefault(_ASSET, "serve-local")
    try:
        from rerun_notebook import Viewer
    except ImportError as error:
        raise InputError(
            "a recording inside a notebook needs rerun-notebook; "
            "install it with: pip install -c constraints.txt -e '.[notebook]' in the clone"
        ) from error
    viewer = Viewer(width=width, height=height)
    viewer.send_rrd(recording.read_bytes())
    return viewer
