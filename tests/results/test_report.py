"""The report stands alone, says what the posterior says, and warns where it should."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scene import MEASURED_FOCAL, Clip
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.results.report import report
from imapper_prob.results.report_moments import moments_of
from imapper_prob.results.report_parts import table
from imapper_prob.results.report_plots import chains_plot, hiding_plot
from imapper_prob.results.report_text import (
    answer,
    listed,
    runner_up,
    sides_of,
    trust,
    warnings_of,
)
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.sampling.schedule import burn_in_of, draws_of, trace_of
from imapper_prob.uncertainty.checks import Check
from imapper_prob.uncertainty.clusters import cells_of_object
from imapper_prob.uncertainty.parameters import cells_of_parameter
from tests.runs import posterior

VOID = {"meta", "input"}
LARGEST = 4_000_000
"""Bytes that the page may have."""


class Page(HTMLParser):
    """Whether tags are closed, what pictures there are, and what is said."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.said: list[str] = []
        self.text = text
        self.data: dict[str, Any] = {}
        self._read = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(f"{tag} {name}", value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)
        named = dict(attrs)
        self._read = str(named["id"]) if named.get("type") == "application/json" else ""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            if self._read:
                self.data[self._read] = json.loads(data)
        else:
            self.said.append(data)


@pytest.fixture(scope="module")
def text() -> str:
    return report(posterior())


def test_the_page_is_whole_and_asks_nobody(text: str) -> None:
    page = Page(text)
    assert page.open == []
    # Of what can fetch there is nothing; that the scripts do not, a browser shows.
    fetching = {"src", "href", "srcset", "data", "action", "poster", "background"}
    assert not {name for name, _ in page.attributes if name.split()[1] in fetching}
    assert {name.split()[0] for name, _ in page.attributes}.isdisjoint({"link", "iframe", "object"})
    policy = dict(page.attributes)["meta content"]
    assert policy.startswith("default-src 'none'")
    assert not re.search(r"@import|url\(", text.partition("<body>")[0])
    assert len(text.encode()) < LARGEST


def test_plots_show_every_scene_and_object(text: str) -> None:
    run = posterior()
    page = Page(text)
    data = page.data
    scenes = {
        trace["meta"]["scene"]
        for trace in data["floor-data"]["data"]
        if "scene" in trace.get("meta", {})
    }
    assert scenes == set(range(len(run.scenes())))
    for name in ("floor", "view", "map", "hiding", "chains"):
        layout = data[f"{name}-data"]["layout"]
        titles = [layout[axis]["title"].get("text") for axis in layout if axis[1:5] == "axis"]
        assert all("[" in title or title == "frame" for title in titles if title)
        assert sum(bool(title) for title in titles) == 2
    told = json.dumps(data["map-data"], ensure_ascii=False)
    for cluster in run.certainty.clusters:
        said = with_error(cluster.presence, cluster.presence_error)
        assert f"there with {said}" in told
        for label, share in cluster.labels.items():
            assert share == 1 or escape(f"{label} {as_probability(share)}") in told


def test_the_slider_moves_what_the_scenes_have(text: str) -> None:
    run, moved = posterior(), Page(text).data["moments"]
    clip, hidden = run.clip, run.certainty.hidden
    assert moved["frames"] == clip.frame_ids.tolist()
    for weighted, own in zip(run.scenes(), moved["scenes"], strict=True):
        joints = np.array(own["joints"], float).reshape(weighted.scene.joints.shape) / 100
        np.testing.assert_allclose(joints, weighted.scene.joints, atol=0.0051)
        pixels = np.array(own["pixels"], float).reshape(*joints.shape[:2], 2)
        seen = weighted.scene.camera.project(weighted.scene.joints)
        np.testing.assert_allclose(pixels, seen, atol=0.51)
    shares = np.array(moved["hidden"]).reshape(hidden.probability.shape)
    np.testing.assert_allclose(shares, 100 * hidden.probability, atol=0.51)


def test_long_clips_have_fewer_moments() -> None:
    clip = posterior().clip
    (alone,) = clip.tracks
    people = replace(clip, tracks=tuple(replace(alone, name=name) for name in "abcdef"))
    kept = moments_of(people)
    assert len(kept) == 60
    assert kept[0] == 0
    assert kept[-1] == clip.n_frames - 1


def test_trust_is_said_in_plain_words() -> None:
    samples = posterior().samples
    good = replace(samples, verdict=Verdict(True, 0, None, "Good."))
    apart = replace(samples, verdict=Verdict(False, 0, (1, 2), "Apart."))
    short = replace(samples, verdict=Verdict(False, 100, None, "Short."))
    assert "came to the same answer" in trust(good, alarmed=0, checked=7)
    assert "Nothing else speaks against" in trust(good, alarmed=0, checked=7)
    assert "different answers" in trust(apart, alarmed=0, checked=7)
    assert "preliminary" in trust(short, alarmed=0, checked=7)
    assert "2 of 7 checks speak against" in trust(good, alarmed=2, checked=7)


def test_the_page_says_what_the_posterior_says(text: str) -> None:
    run = posterior()
    said = " ".join(Page(text).said)
    assert answer(run.scenes()) in said
    assert run.samples.verdict.text in said
    for weighted in run.scenes():
        assert with_error(weighted.probability, weighted.error) in said
        assert weighted.difference in said
    for cluster in run.certainty.clusters:
        for cell in cells_of_object(cluster):
            assert cell in said
    for one in run.certainty.nuisances.values():
        for cell in cells_of_parameter(one):
            assert cell in said
    assert "from the feet alone" in said
    assert "before the clip" not in said
    for name, rate in run.samples.acceptance.rates().items():
        assert name in said
        assert f"{100 * rate:.1f} %" in said
    for name in ("clip_digest", "config_digest", "library_digest"):
        assert run.data.attrs[name][:16] in said
    assert "seed 3" in said


def test_the_page_says_alarms_before_its_answer() -> None:
    run = replace(posterior())
    run.__dict__["checks"] = (Check("height", 1.0, 0.2, True, "People float."),)
    said = " ".join(Page(report(run)).said)
    assert said.index("People float.") < said.index(answer(run.scenes()))


def test_names_cannot_break_the_page() -> None:
    run = posterior()
    (person,) = run.clip.tracks
    evil = "</main></script><script>&"
    clip = replace(run.clip, name=evil, tracks=(replace(person, name=evil),))
    text = report(replace(run, solution=replace(run.solution, clip=clip)))
    page = Page(text)
    assert page.open == []
    assert page.data["moments"]["frames"]
    assert text.count("<script") == Page(report(run)).text.count("<script")
    assert "&lt;b&gt;" in table(["<b>"], [["a & b"]])


def test_quotes_in_names_are_shown_in_plots_as_they_are() -> None:
    """Plotly decodes few entities: not those of quotes."""
    run = posterior()
    (person,) = run.clip.tracks
    names = 'A "B"', "C's <b>"
    clip = replace(run.clip, tracks=tuple(replace(person, name=name) for name in names))
    hidden = run.certainty.hidden
    twice = replace(
        hidden, probability=np.tile(hidden.probability, (2, 1)),
        by_object=np.tile(hidden.by_object, (1, 2, 1)),
    )  # fmt: skip
    plot = hiding_plot(clip, twice, moments_of(clip))
    rows = set(plot.data[0].y)
    assert 'A "B": head' in rows
    assert "C's &lt;b&gt;: head" in rows


def grey(figure: dict[str, Any]) -> float:
    """Share of the width that is grey."""
    (shape,) = figure["layout"]["shapes"]
    assert shape["x0"] == 0
    return float(shape["x1"])


def test_the_trace_is_grey_up_to_the_first_draw() -> None:
    run = posterior()
    samples, settings = run.samples, run.config.sample
    marks = trace_of(settings)
    rounds = [marks.at(k) for k in range(samples.traces.shape[1])]
    burn_in = burn_in_of(settings)
    unused = samples.unused(settings)
    assert unused == sum(r < burn_in for r in rounds)
    # Draws that are chosen by weight are fewer, but not the last ones.
    fewer = replace(samples, log_posterior=samples.log_posterior[:, :5])
    assert fewer.unused(settings, weighted=True) == unused < fewer.unused(settings)

    # The trace of an interrupted run ends early, and its burn-in is as long as planned.
    left = 10
    draws = draws_of(settings)
    kept = draws.at(left) - burn_in
    ladders = tuple(ladder._replace(rounds=kept) for ladder in samples.ladders)
    traced = sum(r < burn_in + kept for r in rounds)
    stopped = replace(
        samples, ladders=ladders, traces=samples.traces[:, :traced], finished=False,
        log_posterior=samples.log_posterior[:, :left],
        states=tuple(samples.states[c * samples.shape[1] + n] for c in (0, 1) for n in range(left)),
    )  # fmt: skip
    assert stopped.unused(settings) == unused < traced
    plot = chains_plot(stopped.traces, unused=unused).to_dict()
    assert grey(plot) == pytest.approx(unused / (traced - 1))
    early = replace(
        stopped, ladders=tuple(ladder._replace(rounds=0) for ladder in ladders),
        traces=samples.traces[:, :5], log_posterior=samples.log_posterior[:, :1],
    )  # fmt: skip
    assert early.unused(settings) == 5
    assert grey(chains_plot(early.traces, unused=5).to_dict()) == 1

    # Draws from before equilibrium are left out of the draws, and not of the trace.
    dropped = 8
    later = replace(samples, log_posterior=samples.log_posterior[:, dropped:])
    assert later.unused(settings) == sum(r < draws.at(dropped) for r in rounds) > unused


def test_rooms_in_words() -> None:
    assert listed([]) == "no furniture that the motion tells of"
    assert listed(["table"]) == "one table"
    assert listed(["shelf", "couch", "couch", "bench"]) == ("two couches, one bench and one shelf")
    assert listed(["shelf"] * 11) == "11 shelves"
    best = posterior().scenes(1)[0]
    chair = replace(best, probability=0.6, error=0.1, scene=replace(best.scene, objects=()))
    assert answer([chair]) == (
        "Most probably (probability 0.60 ± 0.10) there is no furniture that the motion tells of."
    )
    assert runner_up([chair]) == ""
    other = replace(best, difference="no table")
    assert "unlike the first: no table" in runner_up([chair, other])


def test_frames_with_sides_exchanged_are_named_in_runs_and_by_person() -> None:
    clip = first_part(demo_clip(), 12 / 130)
    ids = clip.frame_ids

    def sides(flipped: NDArray[np.float64]) -> str:
        (sentence,) = sides_of(clip, flipped)
        return sentence

    flipped = np.where((ids >= 3) & (ids <= 7), 0.9, 0.5)
    assert sides(flipped).endswith("left for right in frames 3-7.")
    flipped[[0, -1]] = 0.6
    assert sides(flipped).endswith("in frames 0, 3-7, 11.")
    assert sides(np.where(ids == 2, 1.0, 0.0)).endswith("in frame 2.")
    assert "in no frame" in sides(np.zeros(12))
    (alone,) = clip.tracks
    two = replace(clip, tracks=(replace(alone, name="a"), replace(alone, name="b")))
    first, second = sides_of(two, np.concatenate([np.zeros(12), np.ones(12)]))
    assert first.endswith("right of a in no frame.")
    assert second.endswith("right of b in frames 0-11.")


def surely(clip: Clip) -> Clip:
    """The clip as if nothing were wrong with it."""
    return replace(clip, focal_spread=MEASURED_FOCAL)


def test_it_warns_where_it_should_and_nowhere_else() -> None:
    run = posterior()
    samples = replace(run.samples, verdict=Verdict(True, 0, None, "Good."), finished=True)
    best = replace(run.scenes(1)[0], probability=0.9, error=0.02)
    clip = surely(run.clip)
    assert warnings_of(clip, samples, [best], lost=0.0) == ()

    def said(
        clip: Clip = clip, samples: object = samples, scene: object = best,
        disputed: object = (), lost: float = 0.0,
    ) -> str:  # fmt: skip
        (warning,) = warnings_of(clip, samples, [scene], disputed=disputed, lost=lost)
        return warning

    first, second = run.clusters(least=0.5)[:2]
    couch = replace(first, labels={"couch": 0.95})
    table = replace(second, labels={"table": 1.0})
    doubted = replace(couch, labels={"couch": 0.52, "chair": 0.48})
    (kind,) = warnings_of(clip, samples, [best], lost=0.0, clusters=[table, doubted])
    assert kind.endswith("is right with probability 0.52 (couch), if it is there.")
    sure = [couch, replace(doubted, presence=0.4)]
    assert warnings_of(clip, samples, [best], lost=0.0, clusters=sure) == ()
    focal = f"The focal length was assumed ({clip.camera.fx:.0f} px ± 20 %)"
    assert focal in said(clip=replace(clip, focal_spread=0.2))
    assert "Weak evidence" in said(scene=replace(best, probability=0.3))
    assert "± 0.25" in said(scene=replace(best, error=0.25))
    assert "interrupted" in said(samples=replace(samples, finished=False))
    disagree = Verdict(False, 0, (1, 2), "Chains disagree.")
    rooms = said(samples=replace(samples, verdict=disagree), disputed=(1, 3))
    assert "chains disagree: each prefers a room of its own" in rooms
    details = said(samples=replace(samples, verdict=disagree), disputed=(1,))
    assert "details of scene 1" in details
    short = Verdict(False, 100, None, "Needs more.")
    assert "--until good" in said(samples=replace(samples, verdict=short))
    assert "Few frames" in said(clip=replace(clip, fps=60.0))
    assert "lost the person in 50 %" in said(lost=0.5)


def test_the_report_is_written_again_from_the_folder(
    run_of_demo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(run_of_demo, folder)
    first = (folder / "report.html").read_text(encoding="utf-8")
    (folder / "report.html").unlink()
    assert main(["report", str(folder)]) == 0
    again = (folder / "report.html").read_text(encoding="utf-8")
    assert Page(again).said == Page(first).said
    assert main(["report", str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err
