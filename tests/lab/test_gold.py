"""Tables of long computations, and how far a run is from them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import imapper_prob as im
from imapper_prob.cli import main
from imapper_prob.config import SampleSettings
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from lab import gold
from tests.runs import small_solution


def labelled(*labels: str) -> tuple[SceneObject, ...]:
    box = Cuboid("seat", np.array([0.0, 0.0, 0.25]), np.array([0.5, 0.5, 0.5]))
    return tuple(SceneObject(label, Placement(0.0, 3.0, 0.0), (box,)) for label in labels)


def test_sets_of_objects_are_counted_in_any_order_and_seats_alike() -> None:
    draws = [labelled("chair", "table"), labelled("table", "couch"), labelled(), labelled("stool")]
    assert gold.shares(draws) == {"seat, table": 0.5, "nothing": 0.25, "seat": 0.25}


def test_errors_are_of_runs_and_rare_sets_are_together() -> None:
    runs = [{"chair": 0.6, "bed": 0.399, "shelf": 0.001}, {"chair": 0.8, "bed": 0.2}]
    table = gold.tabled(runs)
    assert table["chair"] == [0.7, 0.1]
    assert list(table) == ["chair", "bed", "all others"]
    assert table["all others"][0] == pytest.approx(0.0005, abs=1e-4)


def test_the_distance_is_half_of_what_differs() -> None:
    table = {"chair": [0.7, 0.0], "bed": [0.2, 0.0], "all others": [0.1, 0.0]}
    assert gold.distance({"chair": 0.7, "bed": 0.2, "shelf": 0.1}, table) == pytest.approx(0.0)
    assert gold.distance({"chair": 0.6, "bed": 0.3, "stool": 0.1}, table) == pytest.approx(0.1)
    assert gold.distance({"nothing": 1.0}, table) == pytest.approx(0.9)


def test_long_runs_start_scattered_and_go_into_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    brief = SampleSettings(chains=2, steps=60, temperatures=2, draws=5, ensemble_steps=0)
    monkeypatch.setattr(gold, "GOLD", tmp_path / "gold.json")
    monkeypatch.setattr(gold, "SampleSettings", lambda **_: brief)
    solved = SimpleNamespace(actors=(small_solution(),))
    monkeypatch.setattr(gold.im, "solve", lambda *_: solved)
    gold.main([str(tmp_path / "runs"), "demo", "--runs", "2", "--workers", "1"])
    (table,) = gold.known().values()
    assert sum(share for share, _ in table.values()) == pytest.approx(1.0, abs=1e-3)
    assert gold.distance({labels: p for labels, (p, _) in table.items()}, table) < 1e-3
    said = capsys.readouterr().out
    gold.main([str(tmp_path / "runs"), "demo", "--runs", "2", "--workers", "1"])
    assert capsys.readouterr().out == said


def test_one_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        gold.main([str(tmp_path), "--runs", "1"])


@pytest.mark.slow
def test_the_demo_says_what_long_runs_say(tmp_path: Path) -> None:
    assert main(["demo", "-o", str(tmp_path / "demo"), "--seed", "1", "--quiet"]) == 0
    found = gold.shares(im.load_posterior(tmp_path / "demo").samples.objects)
    assert gold.distance(found, gold.known()["demo"]) < 0.1
