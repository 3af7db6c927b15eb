"""An explanation in tables, and as a file for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from imapper_prob.files import written_whole
from imapper_prob.results.energy import Explanation, FrameShares, Worth

__all__ = [
    "FORMAT",
    "VERSION",
    "object_worth_table",
    "scenelet_table",
    "term_table",
    "write_energy",
]

FORMAT: Final = "imapper-prob energy"
VERSION: Final = 1
"""Raised whenever a reader of an older version would misread the file."""

_HEADS: Final = {
    "layout": "lay-\nout",
    "placement": "pla-\nce-\nment",
    "detections": "de-\ntec-\ntions",
    "free_pose": "free\npose",
    "smoothness": "smo-\noth-\nness",
    "collision": "col-\nli-\nsion",
    "motion": "mo-\ntion",
    "ground": "floor",
    "support": "sup-\nport",
}
"""Heads in a few lines, for terminals of eighty columns."""
_SHOWN: Final = 0.05
"""Nats below which a cell of a table stays empty: it would round to 0.0."""


def term_table(explanation: Explanation) -> Table:
    """The log-posterior by term, beside that of no scenelet at all."""
    table = _table("The scene by term, nats")
    table.add_column("term")
    for name in ("scene", "no scenelet", "gained"):
        table.add_column(name, justify="right")
    rows = [(t, explanation.terms[t], explanation.bare_terms[t]) for t in explanation.terms]
    for name, scene, bare in rows:
        table.add_row(name, f"{scene:.1f}", f"{bare:.1f}", _signed(scene - bare))
    table.add_section()
    bare = sum(explanation.bare_terms.values())
    scene = explanation.log_posterior
    table.add_row("log posterior", f"{scene:.1f}", f"{bare:.1f}", _signed(scene - bare))
    return table


def scenelet_table(explanation: Explanation) -> Table:
    """What each scenelet is worth, by term."""
    return _worth_table("Lost without a scenelet, nats", explanation, False)


def object_worth_table(explanation: Explanation) -> Table:
    """What each object is worth while the person moves as before, by term."""
    return _worth_table("Lost without an object, nats", explanation, True)


def write_energy(path: Path, explanation: Explanation, **provenance: str) -> None:
    """Write an explanation as JSON; a file in the way is replaced as a whole.

    Parameters
    ----------
    path : Path
    explanation : Explanation
    **provenance : str
        What is said at the top of the file, such as the clip's name.
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        **provenance,
        "units": {"terms": "nat", "probability": "1", "frame": "number in the clip"},
        "log_posterior": explanation.log_posterior,
        "terms": dict(explanation.terms),
        "terms_without_scenelets": dict(explanation.bare_terms),
        "scenelets": [_worth(w, explanation.frame_ids) for w in explanation.scenelets],
        "objects": [_worth(w, explanation.frame_ids) for w in explanation.objects],
        "frame": explanation.frame_ids.tolist(),
        "frames": _frames(explanation.frames),
        "frames_without_scenelets": _frames(explanation.bare_frames),
    }
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _worth_table(title: str, explanation: Explanation, of_objects: bool) -> Table:
    parts = explanation.objects if of_objects else explanation.scenelets
    shown = [t for t in explanation.terms if any(abs(w.terms[t]) >= _SHOWN for w in parts)]
    table = _table(title)
    table.add_column("object" if of_objects else "scenelet", no_wrap=True)
    table.add_column("frames" if of_objects else "from")
    for name in (*shown, "all"):
        table.add_column(_HEADS.get(name, name), justify="right")
    for worth in parts:
        cells = [_signed(worth.terms[t]) for t in shown]
        spans = [tuple(explanation.frame_ids[list(span)]) for span in worth.frames]
        when = [f"{first}-{last}" if of_objects else str(first) for first, last in spans]
        table.add_row(worth.name, ", ".join(when), *cells, _signed(worth.total))
    return table


def _table(title: str) -> Table:
    """Narrow enough for a terminal of eighty columns."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0, pad_edge=False)


def _signed(nats: float) -> str:
    return f"{nats:+.1f}" if abs(nats) >= _SHOWN else "·"


def _worth(worth: Worth, ids: NDArray[np.int64]) -> dict[str, Any]:
    return {
        "name": worth.name,
        "frames": [[int(ids[first]), int(ids[last])] for first, last in worth.frames],
        "lost": worth.total,
        "lost_by_term": dict(worth.terms),
    }


def _frames(shares: FrameShares) -> dict[str, list[float]]:
    of_terms = {name: nats.tolist() for name, nats in shares.terms.items()}
    return of_terms | {"swapped": shares.swapped.tolist(), "hidden": shares.hidden.tolist()}
