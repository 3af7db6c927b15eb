"""Clips of motions that a library lacks: how they are simulated and how answers are scored."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Cuboid, Placement, SceneObject
from imapper_prob.models.skeleton import LANK, PELV, RANK
from imapper_prob.scenelets.library import built_in_library
from lab.unseen import __main__ as command
from lab.unseen.__main__ import Task, outcomes, page, tasks_of
from lab.unseen.clips import (
    CARRIED,
    DISTANCES,
    FPS,
    FRAMES,
    UNCARRIED,
    performed_scenelets,
    searched_library,
    simulate_performance,
    thinned,
)
from lab.unseen.families import FAMILIES, family_of
from lab.unseen.scores import Answer, Outcome, Share, score

TERMS = {"detections": -10.0, "assignment": -2.0}


def piece(label: str, x: float = 0.0, y: float = 4.0) -> SceneObject:
    seat = Cuboid("seat", np.array([0.0, 0.0, 0.2]), np.array([0.4, 0.4, 0.4]))
    return SceneObject(label, Placement(x, y, 0.3), (seat,))


def outcome(family: str, *, share: float, unseen: bool = True, index: int = 0) -> Outcome:
    answer = Answer((("sit-stool-004", 30),), TERMS)
    found = Share(share, share, share)
    rival = Answer((), TERMS | {"assignment": 1.0})
    return Outcome(
        family, unseen, index, "performed-001", (30, 60), 0.2, ((28, 60, 9.0),), found, found,
        answer, answer, rival,
    )  # fmt: skip


def test_families_are_of_the_library_and_are_carried_by_seats_or_by_nothing() -> None:
    assert set(CARRIED) | set(UNCARRIED) <= set(FAMILIES)
    for family in CARRIED:
        assert all(s.objects for s in performed_scenelets(family))
    for family in UNCARRIED:
        assert not any(s.objects for s in performed_scenelets(family))
    # Who leans on a table is half on their feet.
    assert not any(s.name.startswith("perch-table") for s in performed_scenelets("perch"))
    with pytest.raises(InputError, match="not of 'walk'"):
        performed_scenelets("walk")


def test_a_third_of_each_line_is_kept_in_order(rng: np.random.Generator) -> None:
    library = built_in_library()
    small = thinned(library, rng)
    names = [s.name for s in library]
    kept = [names.index(s.name) for s in small]
    assert kept == sorted(set(kept))

    def lines(own: list[str]) -> dict[str, int]:
        stems = [name.rpartition("-")[0] for name in own]
        return {stem: stems.count(stem) for stem in stems}

    whole = lines(names)
    for line, count in lines([s.name for s in small]).items():
        assert count == max(1, round(whole[line] / 3))
    assert lines([s.name for s in small]).keys() == whole.keys()


def test_the_searched_library_lacks_the_family_and_nothing_else() -> None:
    whole, without = searched_library(0), searched_library(0, "perch")
    lacking = [s.name for s in whole if family_of(s.name) == "perch"]
    assert lacking
    assert [s.name for s in without] == [s.name for s in whole if s.name not in lacking]


@pytest.mark.parametrize("family", [*CARRIED, *UNCARRIED])
def test_somebody_walks_there_and_does_it(family: str) -> None:
    performance = simulate_performance(family, 0)
    clip, (first, end) = performance.clip, performance.stay
    truth = clip.truth
    assert truth is not None
    assert FRAMES[0] <= clip.n_frames <= FRAMES[1]
    assert end == clip.n_frames
    assert end - first >= 2.0 * FPS
    assert family_of(performance.scenelet.name) == family
    away = np.linalg.norm(truth.joints[first, PELV, :2])
    assert DISTANCES[0] <= away <= DISTANCES[1]
    assert truth.joints[0, PELV, 2] > 0.7  # they come on their feet
    assert bool(truth.objects) == (family in CARRIED)
    assert score(truth.objects, performance.pelvis[:2], performance.pelvis[:2])[0] == (
        family in CARRIED
    )
    assert truth.joints[:first, [RANK, LANK], 2].min() > -0.05
    # What is known of the camera is no more than its nominal pose.
    assert clip.camera != truth.camera


def test_clips_are_repeatable_and_differ() -> None:
    one, again = (simulate_performance("slouch", 1) for _ in range(2))
    np.testing.assert_array_equal(one.clip.tracks[0].keypoints, again.clip.tracks[0].keypoints)
    other = simulate_performance("slouch", 1, seed=1)
    assert not np.array_equal(one.pelvis, other.pelvis)
    assert not np.array_equal(one.pelvis, simulate_performance("slouch", 2).pelvis)


def test_what_carries_somebody_is_a_seat_under_them_and_not_far_from_the_truth() -> None:
    here, right, back = np.array([0.0, 4.0]), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    assert score([piece("stool")], here, here) == (True, True)
    assert score([piece("table"), piece("shelf")], here, here) == (False, False)
    assert score([], here, here) == (False, False)
    # Under the answer's person, who is a metre from the true one.
    assert score([piece("bed")], here, here + back) == (True, False)
    assert score([piece("bed")], here, here + 0.6 * back) == (True, True)
    # Near the true person, and the answer's is elsewhere.
    assert score([piece("chair")], here + 0.6 * right, here) == (False, False)
    # Two pieces do not add up.
    apart = [piece("chair"), piece("chair", x=1.0)]
    assert score(apart, here, here - 1.2 * right) == (True, False)


def test_right_is_more_than_half_for_a_seat_and_at_most_half_against_anything() -> None:
    assert not outcome("sit", share=0.5).right(Share(1.0, 0.5, 1.0))
    assert outcome("sit", share=0.5).right(Share(0.6, 0.6, 1.0))
    assert outcome("squat", share=0.5).right(Share(0.0, 0.0, 0.5))
    assert not outcome("squat", share=0.5).right(Share(0.0, 0.0, 0.6))


def test_outcomes_come_back_from_files() -> None:
    one = outcome("sit", share=0.25)
    for kept in (one, replace(one, rival=None, signs=())):
        assert Outcome.from_json(json.loads(json.dumps(kept.as_json()))) == kept


def test_tasks_go_through_all_families_before_the_next_clip() -> None:
    tasks = tasks_of(2)
    assert len(tasks) == 2 * (len(CARRIED) + 2 * len(UNCARRIED))
    half = len(tasks) // 2
    assert {t.index for t in tasks[:half]} == {0}
    assert len(set(tasks)) == len({t.path(Path()) for t in tasks}) == len(tasks)
    assert {t.unseen for t in tasks if t.family in CARRIED} == {True}
    assert [t.unseen for t in tasks_of(1, "kneel")] == [True, False]


def test_a_run_goes_on_where_it_was_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []

    def simulated(family: str, index: int, *, unseen: bool, seed: int) -> Outcome:
        made.append(index)
        if index == 2 and len(made) == 3:
            raise KeyboardInterrupt
        return outcome(family, share=1.0, unseen=unseen, index=index)

    monkeypatch.setattr(command, "outcome_of", simulated)
    tasks = [Task("sit", index, True) for index in range(3)]
    with pytest.raises(KeyboardInterrupt):
        list(outcomes(tasks, tmp_path, 0))
    assert [o.index for o in outcomes(tasks, tmp_path, 0)] == [0, 1, 2]
    assert made == [0, 1, 2, 2]
    assert {path.name for path in tmp_path.iterdir()} == {t.path(tmp_path).name for t in tasks}


def test_the_page_counts_and_says_why() -> None:
    text = page(
        [
            outcome("sit", share=1.0),
            outcome("sit", share=0.25, index=1),
            outcome("perch", share=1.0),
            outcome("squat", share=1.0, unseen=False),
            outcome("squat", share=0.0),
        ]
    )
    lines = text.splitlines()
    assert "| sit | 2 | 1 | 1 | 0.62 | 1 |" in lines
    assert "| all | 3 | 2 | 2 | 0.75 | 2 |" in lines
    assert "| squat | with it | 1 | 1 | 1 | 1.00 |" in lines
    assert "| squat | without it | 1 | 0 | 0 | 0.00 |" in lines
    wrong = [line for line in lines if "assignment +3.0" in line]
    assert [line.split(" | ")[0] for line in wrong] == ["| sit 1, without it", "| squat 0, with it"]
    assert all("28–60: 9.0 | sit-stool-004 30 | nothing | +3.0" in line for line in wrong)
