"""TRC tables of marker positions, as OpenSim and Pose2Sim write them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.json_fields import load_lines
from imapper_prob.inputs.sightings import FARTHEST
from imapper_prob.models.errors import InputError
from imapper_prob.models.limits import LONGEST_CLIP

__all__ = ["MAGIC", "TrcTable", "read_trc_table"]

Array = NDArray[np.float64]

MAGIC: Final = "PathFileType"
"""First word of every such file."""
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True)
class TrcTable:
    """Markers over time.

    Parameters
    ----------
    names : tuple of J str
    positions : (T, J, 3) float
        Metres, in the file's axes; NaN where missing.
    first : int
        Number of the first frame.
    fps : float
    """

    names: tuple[str, ...]
    positions: Array
    first: int
    fps: float


def read_trc_table(path: Path) -> TrcTable:
    """Read the table; empty cells and 0, 0, 0 are missing markers.

    Raises
    ------
    InputError
        The file is damaged, or frames are missing or out of order.
    """
    lines = load_lines(path)
    if len(lines) < 6 or not lines[0].startswith(MAGIC):
        raise InputError(f"{path}: no TRC file, or cut off in its header")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = dict(zip((key.strip() for key in keys), (v.strip() for v in values), strict=False))
    fps = _number(path, 3, header.get("DataRate", ""))
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"{path}, line 3: data rate {fps} must be positive")
    unit = header.get("Units", "m")
    if unit not in _METRES:
        raise InputError(f"{path}, line 3: unit {unit!r}, expected {', '.join(_METRES)}")
    cells = [cell.strip() for cell in lines[3].rstrip("\r\n").split("\t")]
    names = tuple(cell for cell in cells[2:] if cell)
    if not names:
        raise InputError(f"{path}, line 4: no marker names")
    rows = [(i, line) for i, line in enumerate(lines[5:], start=6) if line.strip()]
    if not 0 < len(rows) <= LONGEST_CLIP:
        raise InputError(f"{path}: {len(rows)} frames, expected 1 to {LONGEST_CLIP}")
    announced = _number(path, 3, header.get("NumFrames", "nan"))
    if announced != len(rows) and np.isfinite(announced):
        raise InputError(
            f"{path}: {len(rows)} frames, the header says {announced:.0f}; it may be cut off"
        )
    table = np.full((len(rows), len(names), 3), np.nan)
    frames = []
    for row, (number, line) in zip(table, rows, strict=True):
        parts = [part.strip() for part in line.rstrip("\r\n").split("\t")]
        frames.append(_number(path, number, parts[0]))
        parts = parts[2 : 2 + row.size]
        if len(parts) < row.size:
            parts += [""] * (row.size - len(parts))  # trailing empty cells are often dropped
        values_of_row = [_number(path, number, part) if part else np.nan for part in parts]
        row[:] = np.reshape(values_of_row, row.shape)
    first = frames[0]
    if not (np.isfinite(first) and float(first).is_integer()):
        raise InputError(f"{path}, line {rows[0][0]}: frame {first} is no whole number")
    out_of_order = np.flatnonzero(np.array(frames) != first + np.arange(len(frames)))
    if len(out_of_order):
        raise InputError(
            f"{path}, line {rows[out_of_order[0]][0]}: frame {frames[out_of_order[0]]:g} does not "
            "follow the one before; frames must be consecutive"
        )
    if (np.abs(table) > FARTHEST).any():
        raise InputError(f"{path}: a coordinate is infinite, or too large to be one")
    table[(table == 0).all(-1) | ~np.isfinite(table).all(-1)] = np.nan
    return TrcTable(names, table * _METRES[unit], int(first), fps)


def _number(path: Path, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}, line {line}: {text[:40]!r} is not a number") from None
