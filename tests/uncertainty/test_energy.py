"""A scene taken apart: the parts add up, and leaving one out costs what is said."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console

from imapper_prob.layouts import merged_objects
from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.visibility import visibility_probability
from imapper_prob.models.log_posterior import State, empty_state, log_posterior, side_flips, terms
from imapper_prob.models.problem import TERMS, Problem, pack_problem
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import NOTHING_IN_SIGHT
from imapper_prob.models.skeleton import MIRROR
from imapper_prob.results.figures import energy_figure
from imapper_prob.uncertainty.energy import (
    Explanation,
    explain,
    object_worth_table,
    scenelet_table,
    term_table,
    write_energy,
)
from tests.models.worlds import camera_prior, clip_of, couch, library, path_of, problem, walk
from tests.pictures import png_size

N_FRAMES = 40
FRAME_IDS = np.arange(7, 7 + N_FRAMES)
WALK = replace(clip_of(walk(N_FRAMES), np.random.default_rng(5)), frame_ids=FRAME_IDS)


@pytest.fixture(scope="module")
def scenelets() -> Library:
    return library()


def packed(scenelets: Library) -> Problem:
    """Somebody crosses the view; in ten frames the detector swaps sides, in two it sees nothing."""
    made = problem(N_FRAMES, seed=4, scenelets=scenelets)
    keypoints, used = made.keypoints.copy(), made.used.copy()
    keypoints[25:35] = keypoints[25:35][:, list(MIRROR)]
    used[12:14] = False
    rng = np.random.default_rng(2)
    return made._replace(
        keypoints=keypoints,
        used=used,
        free_cost=rng.uniform(0, 30, made.n_frames),
        # The couch holds one of two stays, nothing the other.
        stays=np.array([[2.0, 8.0, 4.0], [32.0, 38.0, 3.0]]),
        lowered=np.tile(np.array([[1, 4]]), (len(made.lengths), 1)),
        frame_weight=1 / 12,  # Ten frames must be enough to tell which side is which.
    )


def busy_state(made: Problem) -> State:
    """A couch seen twice, a chair that stands in it, and a camera so low that feet sink."""
    low = made.camera_mean - np.array([0.0, 0.2, 0.0, 0.0, 0.0])
    state = replace(empty_state(made), camera=low)
    state = state.with_item(0, 3, np.array([-0.6, 4.0, 0.05]))
    state = state.with_item(0, 12, np.array([-0.5, 4.0, 0.0]))
    state = state.with_item(2, 24, np.array([0.2, 3.6, 0.1]))
    return replace(state, latent=0.3 * np.random.default_rng(1).standard_normal((N_FRAMES, 2)))


@pytest.fixture(scope="module")
def made(scenelets: Library) -> Problem:
    return packed(scenelets)


@pytest.fixture(scope="module")
def explained(made: Problem, scenelets: Library) -> Explanation:
    return explain(made, busy_state(made), scenelets, clip=WALK)


def test_the_world_is_worth_explaining(explained: Explanation) -> None:
    for name in TERMS:
        if name not in ("camera", "given"):
            assert abs(explained.terms[name] - explained.bare_terms[name]) > 0.1, name


def test_terms_add_up_to_the_log_posterior(made: Problem, explained: Explanation) -> None:
    assert explained.log_posterior == pytest.approx(log_posterior(made, busy_state(made)))
    busy = busy_state(made)
    bare = replace(empty_state(made), camera=busy.camera, latent=busy.latent)
    assert dict(explained.bare_terms) == terms(made, bare)
    assert sum(explained.terms.values()) - sum(explained.bare_terms.values()) == pytest.approx(
        log_posterior(made, busy_state(made)) - log_posterior(made, bare)
    )


def test_frames_add_up_to_their_terms(explained: Explanation) -> None:
    names = ("detections", "free_pose", "smoothness", "motion", "ground", "support")
    for name in names:
        assert_allclose(explained.frames.terms[name].sum(), explained.terms[name], rtol=1e-10)
        assert_allclose(
            explained.bare_frames.terms[name].sum(), explained.bare_terms[name], rtol=1e-10
        )
    assert_allclose(
        explained.frames.total.sum(),
        sum(explained.terms[n] for n in names),
    )


def test_the_published_energy_is_explained_too(made: Problem, scenelets: Library) -> None:
    paper = made._replace(paper_nats=np.array([700.0, 700.0, 35.0, 14000.0, 7000.0]))
    explained = explain(paper, busy_state(made), scenelets)
    assert dict(explained.terms) == terms(paper, busy_state(made))
    assert set(explained.frames.terms) == {"reprojection", "occlusion", "smoothness", "motion"}
    for name, nats in explained.frames.terms.items():
        assert nats.sum() == pytest.approx(explained.terms[name])
    console = Console(file=io.StringIO(), width=80)
    console.print(term_table(explained))
    assert "occlusion" in console.file.getvalue()
    assert energy_figure(explained, title="a walk").axes


def test_a_frame_without_detections_adds_nothing_of_its_own(explained: Explanation) -> None:
    assert_allclose(explained.frames.terms["detections"][12:14], 0, atol=1e-12)
    assert (explained.frames.terms["motion"][12:14] == 0).all()
    assert (explained.frames.terms["free_pose"][12:14] == 0).all()  # covered


def test_swapped_sides_and_hidden_joints(made: Problem, explained: Explanation) -> None:
    assert_allclose(explained.frames.flipped, side_flips(made, busy_state(made)))
    assert explained.frames.flipped[26:30].min() > 0.5
    free = 1 - visibility_probability(NOTHING_IN_SIGHT, made.sight_width, made.visibility_error)
    assert_allclose(explained.bare_frames.hidden, free)
    assert explained.frames.hidden.max() > free + 0.1


def test_the_worth_of_a_scenelet_is_what_is_lost_without_it(
    made: Problem, explained: Explanation
) -> None:
    state = busy_state(made)
    whole = log_posterior(made, state)
    assert [w.frames for w in explained.scenelets] == [((3, 8),), ((12, 17),), ((24, 29),)]
    assert [w.name for w in explained.scenelets] == ["stand-0", "stand-0", "stand-2"]
    for index, worth in enumerate(explained.scenelets):
        assert worth.total == pytest.approx(whole - log_posterior(made, state.without_item(index)))


def test_the_worth_of_an_object_is_what_is_lost_in_a_library_without_it(
    made: Problem, explained: Explanation, scenelets: Library
) -> None:
    state = busy_state(made)
    for label, slot in (("couch", 0), ("chair", 2)):
        bare = [replace(s, objects=()) if i == slot else s for i, s in enumerate(scenelets)]
        joints = walk(N_FRAMES)
        clip = clip_of(joints, np.random.default_rng(4))
        without = pack_problem(clip, path_of(joints), camera_prior(), Library("test", tuple(bare)))
        changed = without._replace(
            keypoints=made.keypoints,
            used=made.used,
            free_cost=made.free_cost,
            stays=made.stays,
            lowered=made.lowered,
            frame_weight=made.frame_weight,
        )
        (worth,) = [w for w in explained.objects if w.name == label]
        lost = log_posterior(made, state) - log_posterior(changed, state)
        assert worth.total == pytest.approx(lost)
        assert abs(lost) > 1


def test_objects_are_merged_as_in_draws(
    made: Problem, explained: Explanation, scenelets: Library
) -> None:
    merged = merged_objects(made, scenelets, busy_state(made))
    assert sorted(w.name for w in explained.objects) == sorted(o.label for o in merged)
    (seat,) = [w for w in explained.objects if w.name == "couch"]
    assert seat.frames == ((3, 8), (12, 17))


@pytest.mark.parametrize("slot", [0, 1])
def test_one_of_two_objects_of_a_scenelet_is_taken_away_alone(slot: int) -> None:
    base = library()[0]
    pair = (couch(0.0, -0.6), couch(1.0, -1.1, label="table"))
    both = Library("test", (Scenelet("both", "stand", base.joints, pair), *library()))
    other = pair[1 - slot]
    one = Library("test", (Scenelet("one", "stand", base.joints, (other,)), *library()))
    state = empty_state(problem(20, scenelets=both)).with_item(0, 4, np.array([-0.2, 4.0, 0.0]))
    explained = explain(problem(20, scenelets=both), state, both)
    (worth,) = [w for w in explained.objects if w.name == pair[slot].label]
    lost = log_posterior(problem(20, scenelets=both), state) - log_posterior(
        problem(20, scenelets=one), state
    )
    assert worth.total == pytest.approx(lost)
    assert abs(lost) > 0.02


def test_no_scenelet_at_all(made: Problem, scenelets: Library) -> None:
    explained = explain(made, empty_state(made), scenelets)
    assert explained.scenelets == explained.objects == ()
    assert explained.terms == explained.bare_terms
    assert min(png_size(energy_figure(explained, title="nobody"))) > 300


def test_a_scene_outside_the_support_is_refused(made: Problem, scenelets: Library) -> None:
    state = busy_state(made).with_item(1, 5, np.zeros(3))
    with pytest.raises(InputError, match="overlap"):
        explain(made, state, scenelets)


def test_the_figure_shows_frames_scenelets_and_objects(explained: Explanation) -> None:
    figure = energy_figure(explained, title="a walk")
    width, height = png_size(figure)
    assert width > 500
    assert height > 300
    covers, gain, so_far, *_ = figure.axes
    assert_allclose(covers.get_xlim(), (FRAME_IDS[0] - 0.5, FRAME_IDS[-1] + 0.5))
    bars = [(p.get_x(), p.get_x() + p.get_width()) for p in covers.patches if p.get_height() < 0.5]
    assert_allclose(bars, [(9.5, 15.5), (18.5, 24.5), (30.5, 36.5)])
    drawn = sum(p.get_height() for p in gain.patches if p.get_width() == 1.0)
    expected = explained.frames.total.sum() - explained.bare_frames.total.sum()
    assert drawn == pytest.approx(expected)
    assert so_far.lines[0].get_ydata()[-1] == pytest.approx(expected)
    said = " ".join(t.get_text() for axes in figure.axes for t in axes.texts)
    for worth in (*explained.scenelets, *explained.objects):
        assert f"{worth.total:+.1f}" in said


def test_tables_fit_a_terminal(explained: Explanation) -> None:
    console = Console(file=io.StringIO(), width=80)
    for table in (term_table, scenelet_table, object_worth_table):
        console.print(table(explained))
    text = console.file.getvalue()
    assert "…" not in text
    for worth in (*explained.scenelets, *explained.objects):
        assert f"{worth.total:+.1f}" in text
    assert f"{explained.log_posterior:.1f}" in text
    assert "10-15, 19-24" in text


def test_the_file_holds_every_number(explained: Explanation, tmp_path: Path) -> None:
    path = tmp_path / "energy.json"
    write_energy(path, explained, clip="a walk")
    document = json.loads(path.read_text())
    assert document["format"] == "imapper-prob energy"
    assert document["clip"] == "a walk"
    assert document["terms"] == dict(explained.terms)
    assert document["frame"] == FRAME_IDS.tolist()
    assert document["frames"]["detections"] == explained.frames.terms["detections"].tolist()
    assert document["scenelets"][0]["frames"] == [[10, 15]]
    assert [o["lost"] for o in document["objects"]] == [w.total for w in explained.objects]
    assert [p.name for p in tmp_path.iterdir()] == ["energy.json"]


def test_frames_of_several_people_are_the_clips_own_with_their_names(
    made: Problem, scenelets: Library, tmp_path: Path
) -> None:
    """The rows of the second person follow those of the first; their frames are the same."""
    count = N_FRAMES // 2
    alone = clip_of(walk(count), np.random.default_rng(5))
    (track,) = alone.tracks
    tracks = (replace(track, name="Ann"), replace(track, name="Bob"))
    clip = replace(alone, frame_ids=FRAME_IDS[:count], tracks=tracks)
    explained = explain(made, busy_state(made), scenelets, clip=clip)
    write_energy(tmp_path / "energy.json", explained)
    document = json.loads((tmp_path / "energy.json").read_text())
    assert document["version"] == 2
    assert document["frame"] == FRAME_IDS[:count].tolist() * 2
    assert document["actor"] == ["Ann"] * count + ["Bob"] * count
    who = [(part["frames"], part["actors"]) for part in document["scenelets"]]
    assert who == [([[10, 15]], ["Ann"]), ([[19, 24]], ["Ann"]), ([[11, 16]], ["Bob"])]
    assert document["objects"][0]["frames"] == [[10, 15], [19, 24]]
    assert document["objects"][0]["actors"] == ["Ann", "Ann"]
    console = Console(file=io.StringIO(), width=80)
    for table in (scenelet_table, object_worth_table):
        console.print(table(explained))
    text = console.file.getvalue()
    for told in ("10 Ann", "11 Bob", "10-15 Ann, 19-24 Ann", "11-16 Bob"):
        assert told in text
    figure = energy_figure(explained, title="a walk")
    covers, *_, chances, worths = figure.axes
    assert chances.get_xlabel() == "frame, of Ann, then Bob"
    assert_allclose(covers.get_xlim(), (FRAME_IDS[0] - 0.5, FRAME_IDS[-1] + 0.5))
    assert any("(11-16 Bob)" in label.get_text() for label in worths.get_yticklabels())
