"""Whether a clip fits into the memory that there is, asked before the work."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import SHORTEST_CLIP

__all__ = ["memory_there", "require_memory"]

_GIGABYTE: Final = 1e9
_PROGRAM: Final = 1.0 * _GIGABYTE
"""Bytes of the program with its libraries and compiled kernels, a little more than they take."""
_EACH_PLACEMENT: Final = 100
"""Bytes for a scenelet at a frame while the solver looks for candidates: three coordinates, a cost
and what these are made of."""
_EACH_POSE: Final = 200
"""Bytes for a frame of a draw: its normal numbers, its pelvis, its sides, and copies in the file
that is made."""
_WALKER_COPIES: Final = 4
"""Times that ensembles have the normal numbers of their walkers in memory."""

_AVAILABLE: Final = Path("/proc/meminfo")
_GROUPS: Final = (
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
    (
        Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ),
)
"""Limit and use of a container, in either version."""


def _memory_needed(rows: int, scenelets: int, settings: SampleSettings | None) -> float:
    """Bytes, by and large, that solving and sampling take.

    Parameters
    ----------
    rows : int
        Frames of everybody.
    scenelets : int
        Of the library.
    settings : SampleSettings, optional
        None where nothing is sampled.
    """
    needed = _PROGRAM + rows * scenelets * _EACH_PLACEMENT
    if settings is None:
        return needed
    # A chain that goes on keeps up to twice as many draws.
    draws = settings.chains * settings.draws * (2 if settings.last_step > settings.steps else 1)
    walkers = _WALKER_COPIES * draws * 2 * rows * 8 * bool(settings.ensemble_steps)
    return needed + draws * rows * _EACH_POSE + walkers


def memory_there() -> float:
    """Memory that this process may still take.

    Returns
    -------
    float
        Bytes; infinity where the system does not say.
    """
    there = []
    try:
        for line in _AVAILABLE.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                there.append(1024.0 * int(line.split()[1]))
    except (OSError, ValueError, IndexError):
        pass
    for limit, used in _GROUPS:
        try:
            there.append(float(int(limit.read_text()) - int(used.read_text())))
        except (OSError, ValueError):  # no such group, or "max"
            continue
    return min(there, default=float("inf"))


def require_memory(clip: Clip, library: Library, settings: SampleSettings | None = None) -> None:
    """Refuse a clip for which there is not enough memory.

    Parameters
    ----------
    clip : Clip
    library : Library
    settings : SampleSettings, optional
        Of the sampling; without, what the solver needs.

    Raises
    ------
    InputError
        With what is needed, what there is, and how many frames would fit.
    """
    people, there = len(clip.tracks), memory_there()
    needed = _memory_needed(people * clip.n_frames, len(library), settings)
    if needed <= there:
        return
    fits = clip.n_frames
    while fits > 1 and _memory_needed(people * fits, len(library), settings) > there:
        fits = int(0.9 * fits)
    first = int(clip.frame_ids[0])
    if fits < SHORTEST_CLIP:
        cure = "end other programs, or take a machine that has more"
    else:
        last = first + fits - 1
        cure = f"take parts of up to {fits} frames, such as --frames {first}:{last}, or fewer draws"
    raise InputError(
        f"clip {clip.name}: {clip.n_frames} frames of {people} need about "
        f"{needed / _GIGABYTE:.1f} GB of memory, {there / _GIGABYTE:.1f} GB are there; {cure}"
    )
