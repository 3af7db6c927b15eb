"""A posterior given statements: weighted or gone on with, saved, opened, and asked again."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import imapper_prob as im
from imapper_prob.models.skeleton import REFERENCE_STATURE
from imapper_prob.results.changes import _objects, change_table, changes, write_changes
from imapper_prob.results.conditioned import _renumbered
from imapper_prob.results.folders import write_run
from imapper_prob.sampling.conditioning import Evidence, Told, denied
from imapper_prob.uncertainty.clusters import ObjectCluster, object_clusters
from imapper_prob.uncertainty.stored import categories_of
from tests.runs import small_posterior
from tests.uncertainty.pieces import piece

MILD = im.Measured("height", 1.5, 1.0)


def far_off() -> im.Measured:
    """A camera higher than in any draw."""
    heights = [state.camera[1] for state in small_posterior().samples.states]
    return im.Measured("height", max(heights) + 0.3, 0.05)


@cache
def higher() -> im.Posterior:
    return small_posterior().given([far_off()], steps=40)


def test_a_mild_statement_weighs_the_draws_that_there_are() -> None:
    before = small_posterior()
    after = before.given([MILD])
    assert after.told is not None
    assert after.told.evidence is not None
    assert after.told.evidence.method == "reweighted"
    assert after.told.statements == (MILD,)
    known = {id(state) for state in before.samples.states}
    assert all(id(state) in known for state in after.samples.states)
    heights = np.array([state.camera[1] for state in before.samples.states])
    densities = np.exp(-0.5 * (heights - 1.5) ** 2) / np.sqrt(2 * np.pi)
    assert after.told.evidence.log_ratio == pytest.approx(np.log(densities.mean()))
    assert after.told.text.startswith("Given: height 1.5 ± 1 m. Log evidence ratio -0.")
    assert "chosen by weight" in after.verdict
    assert not after.converged


def test_chains_go_on_where_hardly_a_draw_agrees() -> None:
    said, after = far_off(), higher()
    assert after.told is not None
    assert after.told.evidence is not None
    assert after.told.evidence.method == "resampled"
    before = [state.camera[1] for state in small_posterior().samples.states]
    heights = [state.camera[1] for state in after.samples.states]
    assert np.mean(heights) > np.mean(before) + 0.3 * (said.value - np.mean(before))
    assert after.config.sample.steps == 40
    assert after.told.steps == small_posterior().config.sample.steps
    rows = {row.what: row for row in changes(small_posterior(), after)}
    assert rows["camera height"].after == pytest.approx(np.mean(heights))
    assert rows["camera height"].before == pytest.approx(np.mean(before))
    assert change_table(tuple(rows.values())).row_count == len(rows)


def test_what_no_scene_can_be_is_said_to_be_so() -> None:
    nowhere = im.ObjectAt("shelf", place=(0.0, 60.0), place_std=0.1)
    after = small_posterior().given([nowhere, im.Measured("height", 1.5, 1.0)], steps=20)
    assert after.told is not None
    assert after.told.evidence is not None
    chance = np.log(0.0005 / 100)
    said = f"shelf: place 0, 60 (log density {chance:.1f}, as by chance)"
    assert after.told.denied == (said,)
    assert f"No scene was found with {said}." in after.told.text
    assert after.told.evidence.effective == 0
    again = after.given([im.Measured("stature", 1.7, 1.0)])
    assert again.told is not None
    assert again.told.denied == after.told.denied
    # What was said by chance is as improbable as that: .001 / 2 on 100 m^2.
    assert after.told.evidence.log_ratio < chance + 1


@pytest.mark.parametrize("doubt", [0.001, 0.5, 0.7, 0.9, 0.99])
def test_a_doubtful_statement_that_is_true_is_not_denied(doubt: float) -> None:
    run = small_posterior()
    known = categories_of(run.solution)
    anything = im.Presence(known, doubt=doubt)
    full = [n for n, own in enumerate(run.samples.objects) if own]
    args = run.solution.problem, [run.samples.states[n] for n in full]
    of = {"clip": run.clip, "labels": known}
    assert denied(*args, statements=[anything], **of) == ()
    (said,) = denied(*args, statements=[replace(anything, there=False)], **of)
    assert "as by chance" in said


def test_changes_match_objects_by_kind_and_place() -> None:
    def cluster(label: str, x: float, presence: float) -> ObjectCluster:
        draws = [[piece(label, x, 4.0)]] * 4
        (found,) = object_clusters(draws, np.zeros((1, 4)), radius=0.5)
        return replace(found, presence=presence, presence_error=presence / 10)

    before = [cluster("couch", 0.0, 0.9), cluster("table", 1.0, 0.4), cluster("shelf", 3.0, 0.2)]
    after = [cluster("chair", 0.3, 0.8), cluster("table", 6.0, 0.5)]
    rows = {(row.what, row.after): row for row in _objects(before, after)}
    moved, new = rows["chair", 0.8], rows["table", 0.5]
    assert (moved.before, moved.before_error) == (0.9, 0.09)
    assert moved.after_error == pytest.approx(0.08)
    assert moved.moved == pytest.approx(0.3)
    assert (new.before, np.isnan(new.moved)) == (0.0, True)
    assert (rows["table", 0.0].before, rows["shelf", 0.0].before) == (0.4, 0.2)
    assert len(rows) == 4


def test_changes_tell_how_unlikely_objects_were_and_become() -> None:
    def cluster(label: str, x: float, presence: float) -> ObjectCluster:
        (found,) = object_clusters([[piece(label, x, 4.0)]] * 4, np.zeros((1, 4)), radius=0.5)
        return replace(found, presence=presence, presence_error=presence / 10)

    before = [cluster("couch", 0.0, 0.9), cluster("shelf", 3.0, 0.6), cluster("table", 1.0, 0.04)]
    after = [
        cluster("table", 1.2, 0.7), cluster("couch", 0.4, 0.6), cluster("couch", 0.1, 0.03),
        cluster("shelf", 3.1, 0.02), cluster("bed", -2.0, 0.01),
    ]  # fmt: skip
    rows = {row.what: row for row in _objects(before, after)}
    assert list(rows) == ["table", "couch", "shelf"]
    assert (rows["table"].before, rows["table"].after) == (0.04, 0.7)
    assert rows["table"].moved == pytest.approx(0.2)
    # A couch that is hardly there does not stand for the likely one, though it is nearer.
    assert (rows["couch"].before, rows["couch"].after) == (0.9, 0.6)
    assert (rows["shelf"].before, rows["shelf"].after) == (0.6, 0.02)
    assert rows["shelf"].after_error == pytest.approx(0.002)
    told = changes(small_posterior(), higher())
    for row in told[:-4]:
        for presence, error in ((row.before, row.before_error), (row.after, row.after_error)):
            assert (presence == 0.0) == np.isnan(error)
        assert max(row.before, row.after) >= 0.05


def test_changes_of_camera_and_person_are_in_their_units() -> None:
    before, after = small_posterior(), higher()
    rows = {row.what: row for row in changes(before, after)}
    for run, side in ((before, "before"), (after, "after")):
        pitch, height, focal, body, _ = np.transpose([s.camera for s in run.samples.states])
        for what, values in (
            ("camera pitch", np.degrees(pitch)),
            ("camera height", height),
            ("focal length", run.clip.camera.fx * np.exp(focal)),
            ("stature", REFERENCE_STATURE * np.exp(body)),
        ):
            assert getattr(rows[what], side) == pytest.approx(values.mean()), what
            assert getattr(rows[what], f"{side}_error") == pytest.approx(values.std()), what


def test_chains_of_an_opened_run_go_on_with_its_scenelets(tmp_path: Path) -> None:
    run, library = small_posterior(), small_posterior().solution.library
    run.save(tmp_path / "run")
    opened = im.load_posterior(tmp_path / "run")
    part = opened.solution.library
    assert len(part) < len(library)
    whole = _renumbered(opened.samples.states, part, library)
    for state, of_part, own in zip(whole, opened.samples.states, run.samples.states, strict=True):
        np.testing.assert_array_equal(state.items, own.items)
        names = [part[int(n)].name for n in of_part.items[:, 0]]
        assert [library[int(n)].name for n in state.items[:, 0]] == names
    after = opened.given([far_off()], library=library, steps=40)
    assert after.told is not None
    assert after.told.evidence is not None
    assert after.told.evidence.method == "resampled"


def test_chains_go_on_with_a_fourth_of_the_first_runs_steps() -> None:
    """Also where chains were continued before, with fewer steps."""
    assert higher().told is not None
    longer = replace(higher(), told=replace(higher().told, steps=200))
    nowhere = im.Presence("couch", region=((-9.0, 9.0), (-8.0, 9.0), (-8.0, 9.5)))
    again = longer.given([nowhere])
    assert again.told is not None
    assert again.config.sample.steps == 50
    assert again.told.steps == 200


def test_evidence_of_unknown_error_is_written(tmp_path: Path) -> None:
    evidence = Evidence(-40.0, np.nan, 0.0, 20, "resampled")
    write_changes(tmp_path / "changes.json", (), Told((MILD,), evidence))

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = (tmp_path / "changes.json").read_text(encoding="utf-8")
    document = json.loads(text, parse_constant=refuse)
    assert document["evidence"]["error"] is None


def test_what_was_given_is_saved_and_added_to(tmp_path: Path) -> None:
    first = small_posterior().given([MILD])
    write_run(tmp_path / "told", first, overwrite=False, before=small_posterior())
    document = json.loads((tmp_path / "told" / "changes.json").read_text())
    assert document["given"] == first.told.text
    assert [row["what"] for row in document["changes"]][-4:] == [
        "camera pitch", "camera height", "focal length", "stature",
    ]  # fmt: skip
    opened = im.load_posterior(tmp_path / "told")
    assert opened.told == first.told
    library = small_posterior().solution.library
    with pytest.raises(im.InputError, match="is not the one that clip demo was sampled with"):
        opened.given([im.Presence("couch")])
    both = opened.given([im.Measured("stature", 1.7, 0.5)], library=library)
    assert both.told is not None
    assert both.told.statements == (MILD, im.Measured("stature", 1.7, 0.5))
    assert len(both.solution.problem.given) == 2
    # Saved again, it still knows which library it is of.
    both.save(tmp_path / "both")
    again = im.load_posterior(tmp_path / "both")
    assert again.given([im.Presence("shelf", doubt=0.9)], library=library).told is not None


def test_chains_know_it_from_the_beginning() -> None:
    before = small_posterior()
    said = im.Measured("height", 2.4, 0.01)
    nowhere = im.ObjectAt("shelf", place=(0.0, 60.0))
    drawn = im.sample(
        before.clip, before.solution.library, start=before.solution, given=[said, nowhere],
        config=before.config,
    )  # fmt: skip
    assert drawn.told is not None
    assert drawn.told.statements == (said, nowhere)
    assert drawn.told.text.endswith(
        "No scene was found with shelf: place 0, 60 (log density -12.2, as by chance)."
    )
    assert drawn.told.evidence is None
    heights = [state.camera[1] for state in drawn.samples.states]
    assert np.median(heights) > np.median([s.camera[1] for s in before.samples.states])


def test_nonsense_is_refused_before_anything_is_sampled() -> None:
    before = small_posterior()
    for bad, words in (
        ([], "no statement"),
        ([im.Presence("piano")], "no 'piano'"),
        ([im.Measured("height", 1.0, 0.01), im.Measured("height", 2.0, 0.01)], "contradict"),
    ):
        with pytest.raises(im.InputError, match=words):
            before.given(bad)
    with pytest.raises(im.InputError, match="no frame 100000"):
        im.sample(before.clip, given=[im.JointAt("PELV", 100000, (0, 3, 1), 0.1)])
