"""The folder of a solution, where there is nothing to show and where there is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.config import Config, read_config
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.log_posterior import log_posterior
from imapper_prob.models.scene import Placement, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.recording.stages import stage_views
from imapper_prob.results.folders import write_solution_folder
from imapper_prob.results.solution import furniture_table, maxima_table, scenes_table, stage_table
from imapper_prob.solver.actors import Solved, solved
from imapper_prob.solver.combinations import combine
from imapper_prob.solver.selection import of_scenelets, selected_objects
from tests.runs import solution


def without_maxima() -> Solved:
    """A clip in which nothing stands out, and no scenelet fits."""
    found = solution()
    curve = replace(found.curve, maxima=np.empty(0, dtype=np.int64))
    nothing = replace(
        found, candidates=(), curve=curve, shortlists=(),
        combinations=combine(found.problem, (), curve),
    )  # fmt: skip
    return solved(nothing.clip, [nothing])


def test_the_best_scene_of_one_actor_is_the_solvers() -> None:
    found = solution()
    scenes = solved(found.clip, [found]).scenes
    best = max(scenes, key=lambda s: s.log_posterior)
    assert scenes[0] is best
    assert best.log_posterior >= log_posterior(found.problem, found.states[0])
    mine = next(s for s in scenes if s.states[0] is found.states[0])
    named = selected_objects(found.problem, found.library, found.states[0])
    assert furniture(mine.objects) == furniture(named)
    np.testing.assert_array_equal(pack_boxes(mine.objects), pack_boxes(named))
    assert set(mine.users) == {(0,)}
    assert len(scenes) > 1


def test_furniture_of_a_scenelet_used_twice_is_judged_apart() -> None:
    """As if the library had the scenelet twice."""
    found = solution()
    problem, best, scenelets = found.problem, found.states[0], tuple(found.library)
    placements = np.stack([best.placements[0], best.placements[0] + [1.5, 0.5, 0.8]])
    judged = 0
    for k, scenelet in enumerate(scenelets):
        starts = [5, 8 + int(problem.lengths[k])]
        if len(scenelet.objects) < 2 or starts[1] + problem.lengths[k] > problem.n_frames:
            continue
        twice = replace(
            best, items=np.array([[k, starts[0]], [k, starts[1]]]), placements=placements,
            sizes=np.zeros(2),
        )  # fmt: skip
        both = Library("both", (scenelet, replace(scenelet, name="the second")))
        copies = replace(twice, items=np.array([[0, starts[0]], [1, starts[1]]]))
        alone = selected_objects(of_scenelets(problem, [k, k]), both, copies)
        assert furniture(selected_objects(problem, found.library, twice)) == furniture(alone)
        judged += len(alone) < 2 * len(scenelet.objects)
    assert judged


def furniture(objects: tuple[SceneObject, ...]) -> list[tuple[str, Placement]]:
    """What identifies objects."""
    return [(o.label, o.placement) for o in objects]


def test_every_stage_has_something_to_show() -> None:
    answer = solved(solution().clip, [solution()])
    views = stage_views(answer)
    assert [v.name for v in views[:6]] == [
        "Static path", "Candidates judged", "Candidates kept", "Best combination", "Exchanges",
        "Best scene, refined",
    ]  # fmt: skip
    gained = sum(e.gain for e in answer.actors[0].combinations.exchanges)
    assert f"{gained:.1f} nat gained" in views[4].text
    assert not views[0].objects
    counts = [len(v.objects) for v in views[1:4]]
    assert counts == sorted(counts, reverse=True)
    assert len(views) == 5 + len(answer.scenes)


def test_without_exchanges_there_is_no_such_stage() -> None:
    found = solution()
    combinations = replace(found.combinations, exchanges=())
    answer = solved(found.clip, [replace(found, combinations=combinations)])
    assert "Exchanges" not in [v.name for v in stage_views(answer)]


def test_an_empty_room_is_an_answer(tmp_path: Path) -> None:
    answer = without_maxima()
    assert [scene.objects for scene in answer.scenes] == [()]
    write_solution_folder(tmp_path / "out", answer, Config(seed=3), overwrite=False)
    document = json.loads((tmp_path / "out" / "solution.json").read_text(encoding="utf-8"))
    assert document["scenes"][0]["objects"] == []
    assert read_config(tmp_path / "out" / "config.toml").seed == 3
    for table in (
        maxima_table(answer), scenes_table(answer), furniture_table(answer),
        stage_table(answer, [("static path", 1.0)]),
    ):  # fmt: skip
        assert table.columns


def test_half_a_solution_is_never_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("imapper_prob.recording.stages.write_stages", fails)
    with pytest.raises(KeyboardInterrupt):
        write_solution_folder(tmp_path / "out", without_maxima(), Config(), overwrite=False)
    assert list(tmp_path.iterdir()) == []
