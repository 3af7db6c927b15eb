"""Scenes, the tree of draws and the tables, of a short run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.text import Text
from rich.console import Console

import imapper_prob as im
from imapper_prob.layouts import match_objects
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import side_flips
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.recording import video
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.samplers.diagnostics import LayoutProbabilities
from imapper_prob.samplers.verdict import Verdict
from imapper_prob.uncertainty.checks import Check, from_json
from imapper_prob.uncertainty.summary import (
    distances_to_truth,
    object_rows,
    object_table,
    scene_table,
)
from imapper_prob.uncertainty.tree import read_attributes, write_tree
from tests.models.worlds import couch
from tests.runs import posterior, small_posterior


def test_scenes_have_probabilities_errors_and_a_motion() -> None:
    run = posterior()
    scenes = run.scenes(5)
    shares = [s.probability for s in scenes]
    assert (np.diff(shares) <= 1e-12).all()
    assert 0 < sum(shares) <= 1 + 1e-12
    for weighted in scenes:
        assert weighted.error >= 0
        assert weighted.scene.joints.shape == (run.clip.n_frames, 16, 3)
        assert np.isfinite(weighted.scene.joints).all()
        assert len(weighted.covariances) == len(weighted.scene.objects)
        drawn = np.isin(run.samples.layouts.indicator + 1, weighted.layouts).sum()
        for covariance in weighted.covariances:
            if drawn > 1:
                assert np.linalg.eigvalsh(covariance).min() > -1e-12
            else:
                assert np.isnan(covariance).all()
        assert weighted.ghosts.shape[1:] == weighted.scene.joints.shape


def test_the_representative_is_a_draw_of_its_layout() -> None:
    run = posterior()
    samples = run.samples
    best = run.scenes(1)[0].scene
    index = int(np.flatnonzero(samples.log_posterior.ravel() == best.log_posterior)[0])
    assert samples.layouts.indicator[index] == 0
    # Covariances are of where furniture stands in the scene's draws, about the place shown.
    shown = run.scenes(1)[0]
    drawn = np.flatnonzero(np.isin(samples.layouts.indicator + 1, shown.layouts)).tolist()
    assert len(drawn) > 2
    # Its partner in a draw is of the same group: a table in front of a chair may be nearer.
    partners = [match_objects(best.objects, samples.objects[n], radius=5.0) for n in drawn]
    for k, (o, covariance) in enumerate(zip(best.objects, shown.covariances, strict=True)):
        there = [run.furniture[n][own[k]] for n, own in zip(drawn, partners, strict=True) if own]
        assert len(there) == len(drawn)
        offset = np.array([(other.centre - o.centre)[:2] for other in there])
        np.testing.assert_allclose(covariance, offset.T @ offset / len(drawn), rtol=1e-6)
    centres = {tuple(o.centre) for o in samples.objects[index]}
    assert {tuple(o.centre) for o in best.objects} == centres


def test_the_tree_holds_the_draws_and_survives_the_disk(tmp_path: Path) -> None:
    run = posterior()
    path = tmp_path / "posterior.nc"
    write_tree(path, run.data)
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        chains, draws = run.samples.shape
        assert dict(tree["posterior"].sizes) == {"chain": chains, "draw": draws}
        assert dict(tree["motion"].sizes) == {
            "chain": chains, "draw": draws, "frame": run.clip.n_frames, "axis": 3,
        }  # fmt: skip
        np.testing.assert_array_equal(
            tree["sample_stats"]["log_posterior"], run.samples.log_posterior
        )
        state = run.samples.states[draws + 5]
        np.testing.assert_allclose(
            tree["motion"]["sides_flipped"][1, 5],
            side_flips(run.solution.problem, state),
            rtol=1e-6,
        )
        items = tree["draws"]["scenelet"][1, 5].values
        np.testing.assert_array_equal(items[: state.n_scenelets], state.items[:, 0])
        assert np.all(items[state.n_scenelets :] == -1)
        objects = run.samples.objects[draws + 5]
        labels = [str(tree["constant_data"]["label"].values[k])
                  for k in tree["draws"]["object_label"][1, 5].values if k >= 0]  # fmt: skip
        assert labels == [o.label for o in objects]
    assert "seed = 3" in read_attributes(path)["config"]


def test_layouts_of_draws_are_numbered_as_their_probabilities() -> None:
    tree = posterior().data
    drawn, layouts = tree["counts"]["layout"], tree["layouts"]
    for number in layouts["layout"].to_numpy():
        own = layouts.to_dataset().sel(layout=number)
        assert float(own["probability"]) == pytest.approx(float((drawn == number).mean()))
        chain, draw = np.unravel_index(int(own["leader"]), drawn.shape)
        assert drawn[chain, draw] == number


def test_a_file_that_is_no_posterior_is_refused(tmp_path: Path) -> None:
    for name, content in (("text.nc", b"not a netCDF file"), ("empty.nc", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=name):
            read_attributes(tmp_path / name)
    with pytest.raises(InputError, match="missing"):
        read_attributes(tmp_path / "missing.nc")


def test_tables_say_what_the_scenes_say() -> None:
    run = posterior()
    console = Console(width=80, record=True, file=StringIO())
    console.print(scene_table(run.scenes()))
    rows = object_rows(run.summary())
    console.print(object_table(rows, run.clip.truth))
    text = console.export_text()
    assert f"{run.scenes()[0].probability:.2f} ±" in text
    for row in rows:
        assert f"{row['x']:.2f} ± {row['x_sd']:.2f}" in text
        assert with_error(row["presence"], row["presence_error"]) in text
        doubtful = row["label_probability"] < 1
        shown = f"{row['label']} {as_probability(row['label_probability'])} "
        assert (shown in text) == doubtful
    assert any(row["label_probability"] < 0.995 for row in rows)
    assert "± 0.00 │" not in text
    assert " seat" in text
    assert text.count("[m]") == 3
    assert "to truth" in text


def test_the_table_of_objects_is_narrow_with_many_digits() -> None:
    row = {
        "label": "armchair", "label_probability": 0.998, "presence": 0.9981,
        "presence_error": 0.0009, "x": -1.71, "x_sd": 0.23, "y": 5.13, "y_sd": 0.4,
        "yaw": -0.001, "yaw_sd": 0.1,
    }  # fmt: skip
    console = Console(width=80, record=True, file=StringIO())
    console.print(object_table([row], posterior().clip.truth))
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= 80
    for shown in ("0.998 ± 0.001", "-1.71 ± 0.23", "5.13 ± 0.40", "0 ± 6", "armchair"):
        assert shown in text


def test_what_is_not_there_is_said() -> None:
    run = posterior()
    with pytest.raises(InputError, match="draw 99999: there are 80"):
        run.draw(99999)
    with pytest.raises(InputError, match="-1 scenes: ask for at least 1"):
        run.scenes(-1)


def test_a_posterior_is_saved_and_opened_again(tmp_path: Path) -> None:
    run = posterior()
    run.save(tmp_path / "run")
    again = load_posterior(tmp_path / "run" / "posterior.nc")
    assert again.summary().equals(run.summary())
    with pytest.raises(InputError, match="overwrite"):
        run.save(tmp_path / "run")
    again.report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text().startswith("<!DOCTYPE html>")


def test_distances_pair_seats_with_seats() -> None:
    true = [couch(0, 4), couch(3, 4, label="table")]
    found = [couch(3.0, 4.3, label="chair"), couch(2.6, 4, label="table"), couch(1, 1, label="bed")]
    distances = distances_to_truth(found, true)
    np.testing.assert_allclose(distances[:2], [np.hypot(3, 0.3), 0.4])
    assert np.isnan(distances[2])
    assert np.isnan(distances_to_truth(found, [])).all()


def test_the_verdict_says_first_what_speaks_against_the_whole() -> None:
    run = posterior()
    assert [check.name for check in run.checks] == [
        "upright", "height", "slope", "camera", "resemblance", "prediction", "elsewhere",
    ]  # fmt: skip
    assert run.verdict == run.chain_verdict
    wrong = replace(run)
    alarm = Check("height", 1.0, 0.2, True, "People float.")
    wrong.__dict__["checks"] = (*run.checks, alarm)
    assert wrong.verdict == f"People float. {run.chain_verdict}"
    assert from_json(wrong.data.attrs["checks"])[-1] == alarm
    assert wrong.data["motion"]["best_fit"].sizes == {"frame": run.clip.n_frames}


def test_the_verdict_says_which_scenes_its_layouts_are() -> None:
    """Scenes are numbered as they are shown, and layouts that look alike are one."""
    run = posterior()
    good = replace(run, samples=replace(run.samples, verdict=Verdict(True, 0, None, "Good.")))
    assert good.disputed == ()
    assert good.verdict == "Good."

    def about(first: int, second: int) -> Posterior:
        verdict = Verdict(False, 0, (first, second), "Chains disagree.")
        return replace(run, samples=replace(run.samples, verdict=verdict))

    shown = {
        layout: rank for rank, scene in enumerate(run.scenes(1000), 1) for layout in scene.layouts
    }
    last = max(shown, key=lambda layout: (shown[layout], layout))
    assert about(1, 1).disputed == (shown[1],)
    assert about(1, 1).verdict.endswith(f"both shown as scene {shown[1]}.")
    expected = tuple(sorted({shown[1], shown[last]}))
    assert about(1, last).disputed == expected
    if len(expected) == 2:
        assert about(1, last).verdict.endswith(f"scenes {expected[0]} and {expected[1]}.")


def test_the_summary_says_of_each_object_what_the_clusters_say() -> None:
    run = posterior()
    table, clusters = run.summary(), run.clusters()
    assert table.sizes["object"] == len(clusters) > 0
    for row, found in enumerate(clusters):
        own = table.isel(object=row)
        assert str(own["label"].item()) == found.label
        assert own["presence"].item() == found.presence
        assert (own["x"].item(), own["y"].item()) == tuple(found.mean)
        assert own["x_sd"].item() ** 2 == pytest.approx(found.covariance[0, 0])
    assert table["x"].attrs["units"] == "m"
    assert run.clusters() is clusters


def test_a_notebook_shows_scenes_and_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    run = posterior()
    page = run._repr_html_()
    assert page.count("<svg") == 1
    assert page.startswith("<p>")
    assert "<script" not in page
    parsed: dict[Text, bool] = {}
    set_parse_math = Text.set_parse_math

    def heard(text: Text, parse: bool) -> None:
        parsed[text] = parse
        set_parse_math(text, parse)

    monkeypatch.setattr(Text, "set_parse_math", heard)
    run._repr_html_()
    # Names between dollar signs are no formulas; numbers at axes may be.
    names = [text for text in parsed if text.get_text().strip(" −.0123456789")]
    assert names
    assert not any(parsed[text] for text in names)
    monkeypatch.setattr(Posterior, "verdict", "<b>no</b>")
    assert "&lt;b&gt;no&lt;/b&gt;" in run._repr_html_()


def test_a_posterior_is_a_sequence_of_scenes() -> None:
    run = posterior()
    count = len(run)
    assert count == len(run.scene_probabilities.layouts) > 1
    everything = list(run)
    assert len(everything) == count
    assert run[0] is everything[0] is run.scene(1)
    assert run[-1] is everything[-1]
    assert run[:2] == tuple(everything[:2]) == run.scenes(2)
    assert run[::-1] == tuple(reversed(everything))
    assert sum(scene.probability for scene in run) == pytest.approx(1.0)
    with pytest.raises(IndexError, match=rf"scene \[{count}\]: the run has {count}"):
        run[count]
    assert repr(run).startswith("Posterior(clip='demo', chains=2, draws=40, layouts=")


def test_a_notebook_turns_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "recording_widget", lambda path: path.read_bytes())
    shown: Any = small_posterior().view()
    assert shown[:4] == b"RRF2"


OF_OTHERS = (np.ndarray, xr.Dataset, xr.DataTree, pd.DataFrame, LayoutProbabilities)
"""Types whose text is made elsewhere."""
ASKED = {"view", "record", "report", "save", "plot", "draw", "scene", "given"}
"""Methods that write, draw, or need to be told which one, or what."""


def said(run: Posterior) -> Iterator[tuple[str, Any]]:
    """Whatever a posterior has to say, by name."""
    for name in sorted({*dir(run)} - ASKED):
        if not name.startswith("_"):
            value = getattr(run, name)
            yield name, value() if callable(value) else value


def test_all_that_is_public_is_short() -> None:
    run = posterior()
    everything = [*said(run), *vars(run.samples).items(),
                  ("draw", run.draw(0)), ("scene", run.scene()),
                  ("object", run[0].objects), ("cluster", run.clusters()[0]),
                  ("config", im.Config()),
                  ("options", im.ClipOptions()), ("library", im.load_library())]  # fmt: skip
    lengths = {n: len(repr(v)) for n, v in everything if not isinstance(v, OF_OTHERS)}
    assert len(lengths) > 20
    assert {name: length for name, length in lengths.items() if length >= 2000} == {}
    assert run[0].objects is run[0].scene.objects


def test_texts_say_what_there_is_and_where() -> None:
    run = posterior()
    best, cluster, o = run[0], run.clusters()[0], run[0].objects[0]
    assert f"p = {with_error(best.probability, best.error)}: {best.names[0]}" in repr(best)
    there = with_error(cluster.presence, cluster.presence_error)
    assert f"{cluster.label!r}, p = {there}" in repr(cluster)
    assert f"{o.label!r} at ({o.placement.x:.2f}, {o.placement.y:.2f}) m" in repr(o)
    assert repr(run.furniture).startswith("80 draws of ")
