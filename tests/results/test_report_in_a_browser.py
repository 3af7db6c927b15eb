"""The report in a real browser: switched, hovered, moved and played, wide and narrow, offline."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imapper_prob.models.skeleton import HEAD as HEAD_JOINT
from imapper_prob.models.skeleton import PELV
from imapper_prob.models.text import as_probability, with_error
from tests.browser import Browser, browser
from tests.runs import posterior

WIDTHS = {"wide": (1280, False), "narrow": (390, True)}
SHOWN = (
    "[...document.querySelectorAll('div[data-scene]')].filter((n) => !n.hidden)"
    ".map((n) => n.dataset.scene)"
)
"""Whose captions and legends are seen."""
DRAWN = (
    "document.getElementById('{0}').data.filter((t) => t.visible !== false && t.meta"
    " && t.meta.scene !== undefined).map((t) => t.meta.scene)"
)
"""Scenes whose traces a plot shows."""
DRAWN_ALL = (
    "new Promise((done, fail) => { setTimeout(() => fail(new Error('no plots')), 20000);"
    " const look = () => document.getElementById('hiding').data ? done() : setTimeout(look, 20);"
    " look(); })"
)
"""Kept when the last plot is drawn, broken after 20 s."""
HEAD = (
    "document.getElementById('floor').data.filter((t) => t.meta && t.meta.moves === 'joints')"
    ".map((t) => [t.x[0], t.y[0]])[0]"
)
"""Where the head is drawn, metres."""
HOVERED = (
    "[...document.querySelectorAll('#{0} .hoverlayer text')].map((n) => n.textContent).join(' ')"
)
"""What is said at the mouse."""
PLACE = (
    "(() => {{ const node = document.getElementById('{0}');"
    "node.scrollIntoView({{block: 'center'}});"
    "const l = node._fullLayout, b = node.getBoundingClientRect();"
    "return [b.x + l.xaxis._offset + l.xaxis.l2p({1}), b.y + l.yaxis._offset + l.yaxis.l2p({2})];"
    " }})()"
)
"""Where a place of the floor is in the window."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    posterior().report(path)
    return path


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def show(chromium: Browser, page: Path, **options: Any) -> None:
    """Open the page, and wait until its plots are drawn."""
    chromium.open(page, **options)
    chromium.value(DRAWN_ALL)


@pytest.mark.parametrize("size", WIDTHS)
def test_it_opens_without_a_complaint_or_a_request_and_fits(
    page: Path, chromium: Browser, size: str
) -> None:
    width, touch = WIDTHS[size]
    show(chromium, page, width=width, touch=touch)
    chromium.settle()
    assert chromium.value("document.documentElement.scrollWidth") <= width
    for name in ("floor", "view", "map", "hiding"):
        box = chromium.value(
            f"(() => {{ const b = document.querySelector('#{name} .plot-container, #{name} svg')"
            ".getBoundingClientRect(); return [b.width, b.height]; })()"
        )
        assert min(box) > 150
    # What is folded away is drawn when it is unfolded.
    assert chromium.value("document.getElementById('chains').data") is None
    chromium.click("details:has(#chains) > summary")
    assert len(chromium.value("document.getElementById('chains').data.map(t => t.mode)")) == 2
    assert chromium.complaints == []
    assert chromium.requests == [page.resolve().as_uri()]


@pytest.mark.parametrize("size", WIDTHS)
def test_buttons_switch_scenes(page: Path, chromium: Browser, size: str) -> None:
    width, touch = WIDTHS[size]
    show(chromium, page, width=width, touch=touch)
    number = len(posterior().scenes()) - 1
    assert number > 0
    assert set(chromium.value(SHOWN)) == {"0"}
    chromium.click(f"button[data-scene='{number}']")
    assert set(chromium.value(SHOWN)) == {str(number)}
    for name in ("floor", "view"):
        assert set(chromium.value(DRAWN.format(name))) == {number}
    assert chromium.value("document.querySelector('[aria-pressed=true]').dataset.scene") == str(
        number
    )
    assert chromium.complaints == []


def test_the_slider_moves_the_person(page: Path, chromium: Browser) -> None:
    show(chromium, page, width=1280)
    chromium.settle()
    best = posterior().scenes(1)[0].scene.joints
    assert chromium.value(HEAD) == pytest.approx(best[0, HEAD_JOINT, :2].tolist(), abs=0.006)
    chromium.click("#time")
    moment = int(chromium.value("document.getElementById('time').value"))
    assert 0 < moment < len(best) - 1
    chromium.press("ArrowRight", 39)
    assert int(chromium.value("document.getElementById('time').value")) == moment + 1
    assert chromium.value(HEAD) == pytest.approx(
        best[moment + 1, HEAD_JOINT, :2].tolist(), abs=0.006
    )
    said = chromium.value("document.getElementById('now').textContent")
    clip = posterior().clip
    assert said == f"frame {clip.frame_ids[moment + 1]}, {(moment + 1) / clip.fps:.1f} s"
    cursor = chromium.value("document.getElementById('hiding').layout.shapes[0].x0")
    assert cursor == clip.frame_ids[moment + 1]


def test_what_is_hidden_is_said(page: Path, chromium: Browser) -> None:
    show(chromium, page, width=1280)
    chromium.settle()
    hidden = posterior().certainty.hidden.probability
    moment = int((hidden >= 0.5).sum(1).argmax())
    chromium.value(
        f"(() => {{ const t = document.getElementById('time'); t.value = {moment};"
        "t.dispatchEvent(new Event('input')); })()"
    )
    chromium.settle()
    said = chromium.value("document.getElementById('hidden-now').textContent")
    assert said.count(";") + 1 == (hidden[moment] >= 0.5).sum()
    assert said.startswith("Probably hidden now: ")


def test_play_goes_on_and_stops(page: Path, chromium: Browser) -> None:
    show(chromium, page, width=1280)
    chromium.click("#play")
    assert chromium.value("document.getElementById('play').textContent") == "Pause"
    wait = "new Promise((done) => setTimeout(done, 600))"
    chromium.value(wait)
    assert int(chromium.value("document.getElementById('time').value")) > 1
    chromium.click("#play")
    stopped = chromium.value("document.getElementById('time').value")
    chromium.value(wait)
    assert chromium.value("document.getElementById('time').value") == stopped


@pytest.mark.slow
def test_play_keeps_up_with_quick_films(tmp_path: Path, chromium: Browser) -> None:
    run = posterior()
    quick = replace(run, solution=replace(run.solution, clip=replace(run.clip, fps=120.0)))
    quick.report(tmp_path / "quick.html")
    show(chromium, tmp_path / "quick.html", width=1280)
    chromium.settle()
    seconds = chromium.value(
        "new Promise((done) => { const play = document.getElementById('play'); play.click();"
        "const begun = performance.now();"
        "const look = () => play.textContent === 'Play' ? done((performance.now() - begun) / 1000)"
        " : setTimeout(look, 20); look(); })"
    )
    film = (run.clip.n_frames - 1) / 120
    # The last picture may come late; one after the other, 25 a second, they take 5 s.
    assert film <= seconds < film + 2.5
    assert int(chromium.value("document.getElementById('time').max")) == run.clip.n_frames - 1


def test_a_browser_that_cannot_unpack_says_so(page: Path, chromium: Browser) -> None:
    without = "delete window.DecompressionStream"
    made = chromium.call("Page.addScriptToEvaluateOnNewDocument", source=without)
    chromium.open(page, width=1280)
    chromium.settle()
    text = chromium.value("document.querySelector('main').textContent")
    assert text.startswith("This browser is too old for the plots.")
    assert chromium.complaints == []
    chromium.call("Page.removeScriptToEvaluateOnNewDocument", **made)


def test_objects_and_cells_say_what_they_are(page: Path, chromium: Browser) -> None:
    show(chromium, page, width=1280, height=1600)
    chromium.settle()
    cluster = posterior().certainty.clusters[0]
    chromium.hover(*chromium.value(PLACE.format("map", *cluster.mean.tolist())))
    said = chromium.value(HOVERED.format("map"))
    assert f"there with {with_error(cluster.presence, cluster.presence_error)}" in said
    occupancy = posterior().certainty.occupancy
    near = cluster.mean + 0.3
    x = float(occupancy.x[np.abs(occupancy.x - near[0]).argmin()])
    y = float(occupancy.y[np.abs(occupancy.y - near[1]).argmin()])
    chromium.hover(*chromium.value(PLACE.format("map", x, y)))
    assert "something" in chromium.value(HOVERED.format("map"))
    label, share = next(iter(occupancy.at(x, y).items()))
    assert f"{label} {as_probability(share)}" in chromium.value(HOVERED.format("map"))
    o = posterior().scenes(1)[0].objects[0]
    way = posterior().scenes(1)[0].scene.joints[:, PELV, :2]
    corners = 0.8 * o.footprint + 0.2 * o.centre[:2]
    gaps = np.linalg.norm(corners[:, None] - way, axis=-1).min(1)
    chromium.hover(*chromium.value(PLACE.format("floor", *corners[gaps.argmax()].tolist())))
    assert o.label in chromium.value(HOVERED.format("floor"))


def test_a_click_at_a_frame_moves_the_slider(page: Path, chromium: Browser) -> None:
    show(chromium, page, width=1280, height=1200)
    chromium.settle()
    x, y = chromium.place("#hiding .plot-container, #hiding svg")
    chromium.click_at(x, y)
    chosen = int(chromium.value("document.getElementById('time').value"))
    assert 30 < chosen < 100
