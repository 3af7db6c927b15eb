"""How much memory and time does a long clip take, and is it refused if there is too little?

    python -m lab.long_clips [FRAMES ...] [--minutes 60]

repeats the demo's motion until the clip has FRAMES frames (default: 1000, 2000, 5000, 20000), and
solves, samples and writes it in a process of its own. Memory grows with frames, scenelets and
draws, which are those of a usual run. Steps and temperatures are few, so that visited scenes take
little: the command does not measure their share. A clip is stopped after the given minutes, or
refused by the program because of its size. The command prints each stage that it reaches, and
writes a table of ``docs/reference/robustness.md``: the memory that the program asks for beforehand,
and the peak and time of each stage.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import numpy as np

import imapper_prob as im
from imapper_prob.api import demo_clip
from imapper_prob.config import Config, SampleSettings
from imapper_prob.memory import MOST_FRAMES, memory_needed
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip
from imapper_prob.models.text import in_markdown
from imapper_prob.results.folders import write_run
from imapper_prob.scenelets.library import load_library
from lab.robustness import write_section

__all__ = ["Taken", "long_clip", "long_clips_section", "measured"]

FRAMES: Final = (1000, MOST_FRAMES, 5000, 20000)
SETTINGS: Final = replace(
    SampleSettings(), steps=900, temperatures=2, swap_every=1, burn_in=0.1, ensemble_steps=2
)
"""As many chains and draws as usual, of few steps."""
GIGABYTE: Final = 1e9


def long_clip(n_frames: int) -> Clip:
    """The demo, whose person does the same again and again.

    Parameters
    ----------
    n_frames : int

    Returns
    -------
    Clip
    """
    clip = demo_clip()
    (track,) = clip.tracks
    again = np.arange(n_frames) % clip.n_frames
    long = replace(
        track,
        keypoints=track.keypoints[again],
        confidences=track.confidences[again],
        poses=track.poses[again],
        interpolated=track.interpolated[again],
    )
    return replace(clip, frame_ids=np.arange(n_frames), tracks=(long,), truth=None)


@dataclass
class Taken:
    """What a clip took.

    Parameters
    ----------
    frames : int
    asked : float
        Bytes that the program asks for before it begins.
    stages : dict of str to (float, float)
        Seconds, and peak of memory in bytes at its end, of each stage that was reached.
    end : str
        How it ended: ``finished``, ``stopped``, or the words by which it was refused.
    """

    frames: int
    asked: float
    stages: dict[str, tuple[float, float]] = field(default_factory=dict)
    end: str = "stopped"


def measured(n_frames: int, *, minutes: float, settings: SampleSettings = SETTINGS) -> Taken:
    """Solve, sample and write a long clip in a process of its own.

    Parameters
    ----------
    n_frames : int
    minutes : float
        After which it is stopped.
    settings : SampleSettings

    Returns
    -------
    Taken
    """
    taken = Taken(n_frames, memory_needed(n_frames, len(load_library()), settings))
    spawned = multiprocessing.get_context("spawn")
    source, sink = spawned.Pipe(duplex=False)
    process = spawned.Process(target=_run, args=(n_frames, settings, sink))
    process.start()
    sink.close()
    deadline = time.monotonic() + 60 * minutes
    try:
        while source.poll(max(0.0, deadline - time.monotonic())):
            stage, seconds, peak = source.recv()
            if stage is None:
                taken.end = seconds
                break
            if stage not in taken.stages:
                print(f"{n_frames} frames: {stage}", file=sys.stderr, flush=True)
            taken.stages[stage] = (taken.stages.get(stage, (0.0, 0.0))[0] + seconds, peak)
    except EOFError:
        taken.end = "killed"
    finally:
        process.terminate()
        process.join()
    return taken


def _peak_memory() -> float:
    """Largest memory of this program so far, bytes; that of ``getrusage`` is its parent's too."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return 1024.0 * float(kilobytes)


def _run(n_frames: int, settings: SampleSettings, sink: Connection) -> None:
    """Send each stage with its seconds and the peak of memory, and finally how the run ended."""
    begun = time.monotonic()

    def report(stage: str, part: float) -> None:
        nonlocal begun
        now = time.monotonic()
        peak = _peak_memory()
        sink.send((stage, now - begun, peak))
        begun = now

    clip = long_clip(n_frames)
    report("reading", 1.0)
    try:
        posterior = im.sample(clip, config=Config(sample=settings), progress=report)
        with tempfile.TemporaryDirectory() as folder:
            write_run(Path(folder) / "out", posterior, overwrite=False)
        report("writing", 1.0)
        end = "finished"
    except InputError as error:
        end = str(error)
    sink.send((None, end, 0.0))


def long_clips_section(found: Sequence[Taken]) -> str:
    """A paragraph and a table of what clips took.

    Parameters
    ----------
    found : sequence of Taken

    Returns
    -------
    str
    """
    stages = list(dict.fromkeys(stage for taken in found for stage in taken.stages))
    lines = [
        f"| | {' | '.join(f'{taken.frames:,} frames' for taken in found)} |",
        "|---" * (len(found) + 1) + "|",
        _row("asked for, GB", [f"{taken.asked / GIGABYTE:.1f}" for taken in found]),
        _row("largest peak, GB", [f"{_peak(taken) / GIGABYTE:.1f}" for taken in found]),
    ]
    for stage in stages:
        cells = [taken.stages.get(stage) for taken in found]
        lines.append(
            _row(
                f"{stage}: s, GB",
                ["–" if c is None else f"{c[0]:.0f}, {c[1] / GIGABYTE:.1f}" for c in cells],
            )
        )
    lines.append(_row("end", [in_markdown(taken.end) for taken in found]))
    return "\n".join(lines)


def _row(name: str, cells: Sequence[str]) -> str:
    return f"| {name} | {' | '.join(cells)} |"


def _peak(taken: Taken) -> float:
    return max((peak for _, peak in taken.stages.values()), default=0.0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the clips, write the table, and return whether all took what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("frames", type=int, nargs="*", default=FRAMES)
    parser.add_argument("--minutes", type=float, default=60.0, help="for each clip")
    options = parser.parse_args(arguments)
    found = []
    for n_frames in options.frames:
        found.append(measured(n_frames, minutes=options.minutes))
        print(found[-1], flush=True)
    numbers = " ".join(str(n_frames) for n_frames in options.frames)
    text = (
        f"`python -m lab.long_clips {numbers}` writes this section. Chains have {SETTINGS.steps} "
        f"steps at {SETTINGS.temperatures} temperatures instead of {SampleSettings().steps:,} at "
        f"up to {SampleSettings().temperatures}, so that jumping between scenes takes far less "
        "than in a usual run; all other stages take as long as there.\n\n"
    )
    write_section("Long clips, measured", text + long_clips_section(found))
    return int(any(_peak(taken) > taken.asked or taken.end == "killed" for taken in found))


if __name__ == "__main__":
    sys.exit(main())
