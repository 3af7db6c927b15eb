"""Check before the work whether a clip suits library, time and memory of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.problem import require_rate
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import SHORTEST_CLIP

__all__ = [
    "MOST_FRAMES",
    "memory_needed",
    "memory_there",
    "require_feasible",
    "require_film",
]

MOST_FRAMES: Final = 2000
"""Largest number of frames of a run, summed over people; about five times the longest clip of
i3DB. The time of the staged solver grows faster than in proportion to it."""
_GIGABYTE: Final = 1e9
_PROGRAM: Final = 1.0 * _GIGABYTE
"""Bytes of the program with its libraries and compiled kernels, slightly overestimated."""
_EACH_PLACEMENT: Final = 100
"""Bytes for a scenelet at a frame during the solver's candidate search: three coordinates, a cost
and intermediate values."""
_EACH_PAIR: Final = 48
"""Bytes for a pair of scenelets while their similarity is computed: their distance and five
numbers more."""
_EACH_POSE: Final = 200
"""Bytes for a frame of a draw: its latent normal variables, pelvis and sides, and copies for the
output file."""
_WALKER_COPIES: Final = 4
"""Number of copies of the walkers' latent variables that ensembles hold in memory."""
_VISITED: Final = 15_000
"""Largest number of rounds whose visits a reference is learnt from, in runs of default length."""
_COLD: Final = 0.4
"""Share of the temperatures whose states are recorded; of the public scenes, rounded up."""
_FRAMES_EACH: Final = 100
"""Frames of a clip for each scenelet of a state; as in the longest public scene."""
_EACH_VISIT: Final = 400
"""Bytes for a visited scenelet while a reference is learnt; estimated: in that scene 445,000
of them take 0.34 GB, about half of it for arrays of the library alone."""

_AVAILABLE: Final = Path("/proc/meminfo")
_GROUPS: Final = (
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
    (
        Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
        Path("/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ),
)
"""Files with limit and use of a container, for both versions of cgroups."""


def memory_needed(rows: int, scenelets: int, settings: SampleSettings | None) -> float:
    """Approximate memory for solving and sampling.

    Parameters
    ----------
    rows : int
        Number of frames, summed over people.
    scenelets : int
        Number of scenelets in the library.
    settings : SampleSettings, optional
        None if nothing is sampled.

    Returns
    -------
    float
        Bytes.
    """
    needed = _PROGRAM + rows * scenelets * _EACH_PLACEMENT + _EACH_PAIR * scenelets**2
    if settings is None:
        return needed
    # A continued chain keeps up to twice as many draws.
    draws = settings.chains * settings.draws * (2 if settings.last_step > settings.steps else 1)
    walkers = _WALKER_COPIES * draws * 2 * rows * 8 * bool(settings.ensemble_steps)
    recorded = settings.chains * settings.temperatures * _COLD * min(settings.rounds, _VISITED)
    visits = recorded * rows / _FRAMES_EACH * _EACH_VISIT
    return needed + draws * rows * _EACH_POSE + walkers + visits


def memory_there() -> float:
    """Memory that is available to this process.

    Returns
    -------
    float
        Bytes; infinite if the system does not report it.
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
            left = int(limit.read_text()) - int(used.read_text())
        except (OSError, ValueError):  # no such group, or "max"
            continue
        there.append(float(left + _cached(used.with_name("memory.stat"))))
    return min(there, default=float("inf"))


def _cached(statistics: Path) -> int:
    """Bytes of files that the system holds in a container's memory, and drops when it is needed."""
    try:
        lines = statistics.read_text(encoding="ascii").splitlines()
        numbers = {name: int(number) for name, number in map(str.split, lines)}
    except (OSError, ValueError):
        return 0
    return numbers.get("total_inactive_file", numbers.get("inactive_file", 0))


def require_feasible(clip: Clip, library: Library, settings: SampleSettings | None = None) -> None:
    """Refuse a clip that is too slow for the library, or too long for a run or for the memory.

    Parameters
    ----------
    clip : Clip
    library : Library
    settings : SampleSettings, optional
        Settings of the sampling; without them, only the solver's memory is required.

    Raises
    ------
    InputError
        Says which frame rate the library needs, or how much memory is needed and available and how
        many frames would fit.
    """
    require_rate(clip.name, clip.fps, library)
    _require_short(clip.name, clip.n_frames, len(clip.tracks), clip.frame_ids[0])
    _require_memory(clip, library, settings)


def require_film(name: str, fps: float, n_frames: int, library: Library) -> None:
    """Refuse a video of one person that is too slow for the library, or too long for a run.

    Parameters
    ----------
    name : str
        Of the clip.
    fps : float
        Frames a second of the clip.
    n_frames : int
        Number of frames of the clip; 0 if it is not known.
    library : Library

    Raises
    ------
    InputError
        See :func:`require_feasible`.
    """
    require_rate(name, fps, library)
    _require_short(name, n_frames, 1, 0)


def _require_short(name: str, n_frames: int, people: int, first: int) -> None:
    if people * n_frames <= MOST_FRAMES:
        return
    fits = MOST_FRAMES // people
    raise InputError(
        f"clip {name}: {n_frames} frames of {people} are too many: a run has at most "
        f"{MOST_FRAMES:,}, because its time grows faster than they do; take parts of up to {fits} "
        f"frames, such as --frames {first}:{first + fits - 1}"
    )


_SHORTER: Final = 0.9
"""Factor between lengths of a clip that are tried when the whole does not fit; chosen."""


def _require_memory(clip: Clip, library: Library, settings: SampleSettings | None) -> None:
    people, there = len(clip.tracks), memory_there()
    needed = memory_needed(people * clip.n_frames, len(library), settings)
    if needed <= there:
        return
    fits = clip.n_frames
    while fits > 1 and memory_needed(people * fits, len(library), settings) > there:
        fits = int(_SHORTER * fits)
    cure = "end other programs, or take a machine that has more"
    if fits >= SHORTEST_CLIP:
        part = _first_frames(clip, fits)
        cure = f"take parts of up to {fits} frames, such as {part}, or fewer draws"
    raise InputError(
        f"clip {clip.name}: {clip.n_frames} frames of {people} need about "
        f"{needed / _GIGABYTE:.1f} GB of memory, {there / _GIGABYTE:.1f} GB are there; {cure}"
    )


def _first_frames(clip: Clip, count: int) -> str:
    """The option that selects the first frames of a clip."""
    return f"--frames {clip.frame_ids[0]}:{clip.frame_ids[count - 1]}"
