"""Progress of long computations: bars in a terminal or notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from imapper_prob.models.text import readable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

__all__ = ["Bars", "Progress", "progress_bars", "shown"]

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done, 0 to 1."""


class Bars:
    """One bar for each stage, and lines of text above them.

    Parameters
    ----------
    bars : rich.progress.Progress
    """

    def __init__(self, bars: RichProgress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, stage: str, part: float) -> None:
        """Set the progress of a stage; earlier stages are complete."""
        if stage not in self._tasks:
            for earlier in self._tasks.values():
                self._bars.update(earlier, completed=1.0)
            self._tasks[stage] = self._bars.add_task(readable(stage), total=1.0)
        self._bars.update(self._tasks[stage], completed=part)

    def say(self, text: str) -> None:
        """Print a line above the bars.

        Parameters
        ----------
        text : str
        """
        self._bars.console.print(text, markup=False, highlight=False)


@contextmanager
def progress_bars(console: Console) -> Iterator[Bars]:
    """Show one line a stage: name, progress, elapsed and remaining time.

    Parameters
    ----------
    console : rich.console.Console
        Console on which they are drawn.

    Yields
    ------
    bars : Bars
    """
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    bars = Progress(
        TextColumn("{task.description:<24}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%", markup=False),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    )
    with bars:
        yield Bars(bars)


@contextmanager
def shown(progress: Progress | bool | None) -> Iterator[Progress | None]:
    """Yield the progress callback of a computation.

    Parameters
    ----------
    progress : callable, bool or None
        A callable is yielded unchanged. ``True`` shows bars on standard error if it is a terminal,
        or in a notebook with ipywidgets.

    Yields
    ------
    progress : callable or None
    """
    if callable(progress) or not progress:
        yield progress if callable(progress) else None
        return
    from rich.console import Console

    console = Console(stderr=True, markup=False, emoji=False, highlight=False)
    if console.is_jupyter:
        watched = find_spec("ipywidgets") is not None
    else:
        watched = console.is_terminal and not console.is_dumb_terminal
    if not watched:
        yield None
        return
    with progress_bars(console) as bars:
        yield bars
