"""Bars where somebody looks on, a callable as it is, and silence if asked for."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable

import pytest
from rich.console import Console

from imapper_prob import api
from imapper_prob.api import demo_clip, solve
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.progress import Bars, progress_bars, shown
from imapper_prob.scenelets.library import load_library


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def somebody_looks_on(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard error, as somebody has it who types."""
    made = Terminal()
    monkeypatch.setattr(sys, "stderr", made)
    monkeypatch.setenv("TERM", "xterm")
    return made


def test_every_stage_has_a_line_and_those_before_are_over() -> None:
    drawn = Terminal()
    with progress_bars(Console(file=drawn, force_terminal=True, width=100)) as bars:
        bars("solving", 0.2)
        bars("sam\x1b[31mpling", 0.4)
        bars.say("[b]half")
    text = drawn.getvalue()
    assert "100%" in text
    assert "40%" in text
    assert "[b]half" in text
    assert "\x1b[31mpling" not in text


def test_bars_are_shown_to_who_looks_on(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = somebody_looks_on(monkeypatch)
    with shown(True) as report:
        assert isinstance(report, Bars)
        report("solving", 1.0)
    assert "solving" in terminal.getvalue()


def test_nothing_is_shown_to_files_or_where_it_is_switched_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    terminal = somebody_looks_on(monkeypatch)
    for off in (False, None):
        with shown(off) as report:
            assert report is None
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with shown(True) as report:
        assert report is None
    assert terminal.getvalue() == ""


def test_a_callable_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = somebody_looks_on(monkeypatch)
    heard: list[str] = []

    def hear(stage: str, part: float) -> None:
        heard.append(f"{stage} {part}")

    with shown(hear) as report:
        assert report is hear
    assert terminal.getvalue() == ""


def test_what_people_type_shows_bars(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    terminal = somebody_looks_on(monkeypatch)

    def solved(clip: object, library: object, *, settings: object, progress: Callable[..., None]):
        if progress is not None:
            progress("static path", 0.5)
        return ()

    monkeypatch.setattr(api, "solve_actors", solved)
    monkeypatch.setattr(api, "solved", lambda clip, actors, count: actors)
    clip, library = first_part(demo_clip(), 0.1), Library("part", tuple(load_library())[::200])
    solve(clip, library)
    assert "static path" in terminal.getvalue()
    before = terminal.getvalue()
    solve(clip, library, progress=False)
    assert terminal.getvalue() == before
    assert capsys.readouterr().out == ""
