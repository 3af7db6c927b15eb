"""Several people in one posterior: who is who, what is shared, and one table that is one."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import imapper_prob as im
from imapper_prob.cli import main
from imapper_prob.cli.run import _show
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.probability import posterior_predictions, score_posterior
from imapper_prob.evaluate.score import known_clip, pose_scores
from imapper_prob.layouts import merged_objects
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import (
    empty_state,
    frame_log_likelihood,
    log_posterior,
    motion,
    terms,
)
from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.scene import Placement
from imapper_prob.models.settings import CameraSettings, Settings
from imapper_prob.models.skeleton import PELV
from imapper_prob.people import by_person
from imapper_prob.results.exports import scene_document, to_benchmark, write_i3db
from imapper_prob.results.folders import write_run
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.scenes_file import read_scenes
from imapper_prob.sampling.actors import JointProblem, join_actors
from imapper_prob.sampling.gains import static_pelvis_on_floor
from imapper_prob.sampling.sample import sample_scenes
from imapper_prob.solver.actors import solve_actors
from imapper_prob.solver.solver import Solution
from imapper_prob.uncertainty.summary import distances_to_truth
from lab.couple import N_FRAMES, at_one_table, chairs_and_tables
from tests.recording.reading import read
from tests.results.test_report import Page

MEASURED = CameraSettings(log_elevation=0.02)
"""The camera's height is known to 2 %: nobody's feet are seen, and nobody walks."""
SHORT = SampleSettings(chains=2, steps=4000, draws=100, temperatures=3, ensemble_steps=8)


@cache
def solutions() -> tuple[Solution, ...]:
    return solve_actors(at_one_table(1), chairs_and_tables(12), settings=Settings(camera=MEASURED))


@cache
def source() -> JointProblem:
    return join_actors(solutions())


@cache
def posterior() -> Posterior:
    samples = sample_scenes(source(), SHORT, seed=np.random.SeedSequence(1))
    return Posterior(source(), samples, Config(camera=MEASURED, sample=SHORT))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("couple") / "run"
    write_run(path, posterior(), overwrite=False)
    return path


def taller(solution: Solution, by: float) -> Solution:
    """The same person, taken to be larger by a log scale, in the same world."""
    mean = np.array(solution.camera.mean)
    mean[3] += by
    return replace(
        solution,
        camera=CameraPrior(mean, solution.camera.covariance),
        problem=solution.problem._replace(camera_mean=mean),
    )


def test_one_actor_stays_as_it_was() -> None:
    one = solutions()[0]
    alone = join_actors([one])
    assert alone.problem is one.problem
    assert alone.states is one.states
    assert alone.clip is one.clip


def test_frames_follow_each_other_and_the_camera_counts_once() -> None:
    # Of one stature: scenelets of all actors have the mean stature.
    alike = [taller(s, -float(s.camera.mean[3])) for s in solutions()]
    together, own = join_actors(alike), [s.problem for s in alike]
    assert_array_equal(np.flatnonzero(together.problem.path_starts), [0, N_FRAMES])
    bare = int(np.flatnonzero(np.diff(together.problem.box_first) == 0)[0])
    mine, place = 20, np.array([0.1, 3.5, 0.4])
    for starts in ((), (0,), (mine,)):  # of a scenelet, also where nothing goes before it
        states = [empty_state(problem) for problem in (together.problem, *own)]
        for start in starts:
            states[0] = states[0].with_item(bare, start, place)
            states[0] = states[0].with_item(bare, N_FRAMES + start, place)
            states[1:] = [state.with_item(bare, start, place) for state in states[1:]]
        nats = terms(together.problem, states[0])
        alone = [terms(p, state) for p, state in zip(own, states[1:], strict=True)]
        for name in set(nats) - {"camera"}:
            assert nats[name] == pytest.approx(sum(n[name] for n in alone), abs=1e-6), name
        assert nats["camera"] == pytest.approx(alone[0]["camera"], abs=0.2)


def test_every_frame_knows_its_own_stay() -> None:
    problem = source().problem
    inside = np.flatnonzero(problem.path_stay >= 0)
    first, end = problem.stays[problem.path_stay[inside], :2].T
    assert ((first <= inside) & (inside < end)).all()
    assert set(inside >= N_FRAMES) == {False, True}


def test_everybody_keeps_their_stature_and_place() -> None:
    large, small = taller(solutions()[0], 0.06), taller(solutions()[1], -0.04)
    together = join_actors([large, small])
    assert together.problem.camera_mean[3] == pytest.approx(
        (large.camera.mean[3] + small.camera.mean[3]) / 2
    )
    moved = motion(together.problem, empty_state(together.problem))
    for own, part in zip((large, small), (moved[:N_FRAMES], moved[N_FRAMES:]), strict=True):
        assert_allclose(part, motion(own.problem, empty_state(own.problem)), atol=1e-6)
    # Scenelets are tried where each of them is.
    own = np.concatenate([static_pelvis_on_floor(solution.problem) for solution in (large, small)])
    assert_allclose(static_pelvis_on_floor(together.problem), own, atol=1e-6)


def test_actors_of_other_worlds_are_refused() -> None:
    first, second = solutions()
    mean = np.array(second.camera.mean)
    mean[1] += 0.2
    stranger = replace(second, camera=CameraPrior(mean, second.camera.covariance))
    with pytest.raises(InputError, match="solve them together"):
        join_actors([first, stranger])


def test_actors_of_other_settings_are_refused_by_name() -> None:
    first, second = solutions()
    camera = replace(second.settings.camera, pitch=0.2)
    stranger = replace(second, settings=replace(second.settings, camera=camera))
    with pytest.raises(InputError, match=r"different settings \(camera.pitch\)"):
        join_actors([first, stranger])


def test_no_scenelet_reaches_from_one_actor_to_the_next() -> None:
    problem = source().problem
    empty, length = empty_state(problem), int(problem.lengths[0])
    for start in range(2 * N_FRAMES - length + 1):
        state = empty.with_item(0, start, np.array([0.0, 3.0, 0.0]))
        fits = start + length <= N_FRAMES or start >= N_FRAMES
        assert np.isfinite(log_posterior(problem, state)) == fits
    for state in (*source().states, *posterior().samples.states):
        first, last = state.items[:, 1], state.items[:, 1] + problem.lengths[state.items[:, 0]] - 1
        assert_array_equal(first // N_FRAMES, last // N_FRAMES)


def test_both_tracks_and_their_table_are_found_and_the_table_is_one() -> None:
    clip = at_one_table(1)
    assert clip.truth is not None
    run = posterior()
    best = run.scenes(1)[0]
    assert best.probability > 0.5
    assert sorted(o.label for o in best.scene.objects) == ["chair", "chair", "table"]
    assert np.all(distances_to_truth(best.scene.objects, clip.truth.objects) < 0.4)
    tables = [sum(o.label == "table" for o in objects) for objects in run.samples.objects]
    assert np.mean(np.array(tables) == 1) > 0.8
    # Both bring it: there would be two if nobody saw that they are one.
    kinds = [run.solution.library[s].labels for s in run.samples.states[best.draw].items[:, 0]]
    assert sum("table" in kind for kind in kinds) > 1
    found = by_person(run.clip, run.joints().mean[:, PELV])
    true = by_person(clip, clip.truth.joints[:, PELV])
    error = np.linalg.norm((found - true)[..., :2], axis=-1)
    assert error.mean(1).max() < 0.35


def test_furniture_of_one_hides_the_other() -> None:
    """What A sits at is in the way of B's legs, though no scenelet of B's brings anything."""
    problem, clip = source().problem, source().clip
    assert clip.truth is not None
    at_table = [s.name for s in source().library].index("sit-table-016")
    pelvis = by_person(clip, clip.truth.joints[:, PELV])[1, 0]
    # The table of A, who is to the left of B, stands a metre in front of B.
    place = np.array([pelvis[0] - 1.0, pelvis[1] - 1.0, -np.pi / 2])
    before = frame_log_likelihood(problem, empty_state(problem))[N_FRAMES:]
    with_a = empty_state(problem).with_item(at_table, 0, place)
    assert np.abs(frame_log_likelihood(problem, with_a)[N_FRAMES:] - before).max() > 0.1


def test_every_file_has_everybody(folder: Path, tmp_path: Path) -> None:
    run = im.load_posterior(folder)
    motions = run.data["motion"]
    assert motions["pelvis"].shape == (*run.samples.shape, 2 * N_FRAMES, 3)
    assert motions["actor"].to_numpy().tolist() == ["A"] * N_FRAMES + ["B"] * N_FRAMES
    frames = run.clip.frame_ids
    assert_array_equal(motions["frame"], np.tile(frames, 2))
    assert run.data["observed_data"]["keypoints"].shape[0] == 2 * N_FRAMES

    document = scene_document(run, scene=1, samples=1)
    for body in (document, *document["samples"]):
        assert list(body["actors"]) == ["A", "B"]
        assert body["joints3d"] == body["actors"]["A"] != body["actors"]["B"]
        assert len(body["actors"]["B"]) == N_FRAMES

    scene = run.scene(1).scene
    told = json.loads((folder / "scenes.json").read_text(encoding="utf-8"))["scenes"][0][
        "assignment"
    ]
    assert {part["actor"] for part in told} == {"A", "B"}
    assert max(part["start"] for part in told) < N_FRAMES
    assert read_scenes(folder / "scenes.json")[0].scene.assignment == scene.assignment
    write_i3db(tmp_path / "i3db", scene, run.clip)
    second = json.loads((tmp_path / "i3db" / "skel_output_2.json").read_text(encoding="utf-8"))
    assert second["frame_ids"] == frames.tolist()
    first_pose = second["3d"][f"{frames[0]:05d}"]["6"]
    assert_allclose(first_pose, to_benchmark(scene.camera, scene.joints[N_FRAMES, PELV]))

    columns = read(folder / "recording.rrd")
    names = ("1\\ A", "2\\ B")
    for name in names:
        poses = columns[f"/world/scene_1/{name}/person", "Points3D:positions"]
        assert set(frames.tolist()) <= set(poses)
        assert (f"/world/camera/image/reprojection/{name}", "Points2D:positions") in columns
        assert (f"/fit/distance/scene_1/{name}", "Scalars:scalars") in columns
        assert set(frames.tolist()) <= set(
            columns[f"/world/truth/{name}/person", "Points3D:positions"]
        )
    first, second_place = (
        np.array(columns[f"/world/scene_1/{n}/person", "Points3D:positions"][0])[PELV]
        for n in names
    )
    assert first[0] < -0.3 < 0.3 < second_place[0]


def test_the_report_and_the_models_show_everybody(folder: Path) -> None:
    run = im.load_posterior(folder)
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    said = " ".join(page.said)
    for told in ("2 people", "A, person in this scene", "B, person in this scene"):
        assert told in said
    moved = page.data["moments"]
    assert (moved["people"], moved["names"]) == (2, ["A", "B"])
    scene = run.scene(1).scene
    joints = np.reshape(moved["scenes"][0]["joints"], (N_FRAMES, 2, 16, 3))
    assert_allclose(0.01 * joints.swapaxes(0, 1), by_person(run.clip, scene.joints), atol=0.0051)
    hidden = np.reshape(moved["hidden"], (N_FRAMES, 2, 16)).swapaxes(0, 1)
    shares = by_person(run.clip, run.certainty.hidden.probability)
    assert_allclose(0.01 * hidden, shares, atol=0.0051)
    assert np.abs(shares[0] - shares[1]).max() > 0.5
    model = trimesh.load(folder / "scenes" / "scene_1.glb")
    for number, name in enumerate("AB"):
        matrix, _ = model.graph[f"person {name} THRX-PELV"]
        pelvis = by_person(run.clip, scene.joints)[number][0, PELV]
        assert_allclose(matrix[:3, 3], pelvis[[0, 2, 1]] * (1, 1, -1), atol=1e-5)


@pytest.mark.parametrize(("label", "paid"), [("table", False), ("chair", True)])
def test_who_sits_opposite_has_the_same_table_and_another_chair(label: str, paid: bool) -> None:
    """A table turned by half is the same table; two chairs back to front are in each other."""
    problem, library = source().problem, source().library
    number = next(i for i, s in enumerate(library) if label in s.labels)
    piece = next(o for o in library[number].objects if o.label == label)
    state = empty_state(problem)
    for start, yaw in ((0, 0.3), (N_FRAMES, 0.3 + 3.0)):
        turn = Placement(0.0, 0.0, yaw)
        x, y = turn.rotation @ piece.centre[:2]
        state = state.with_item(number, start, np.array([-x, 4.0 - y, yaw]))
    labels = [o.label for o in merged_objects(problem, library, state)]
    assert labels.count(label) == 1
    cost = terms(problem, state)["collision"]
    assert (cost < -1.0) == paid
    assert (cost == 0.0) != paid


def test_scenes_are_drawn_with_a_path_for_each_person() -> None:
    run = posterior()
    for shown in (run[0], run[0].scene, run.draw(3), run.estimate):
        axes = shown.plot(Figure().subplots())
        ways = [line for line in axes.lines if str(line.get_label()).startswith("pelvis, person")]
        assert [len(np.asarray(line.get_xdata())) for line in ways] == [N_FRAMES] * 2
        assert all(len(np.asarray(line.get_xdata())) == N_FRAMES for line in axes.lines)


def test_the_energy_is_told_by_frames_and_people(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path(shutil.copytree(folder, tmp_path / "run"))
    assert main(["info", "--energy", str(out)]) == 0
    document = json.loads((out / "energy.json").read_text(encoding="utf-8"))
    frames = posterior().clip.frame_ids
    assert document["frame"] == np.tile(frames, 2).tolist()
    assert {name for part in document["scenelets"] for name in part["actors"]} == {"A", "B"}
    told = [span for part in document["scenelets"] for span in part["frames"]]
    assert all(frames[0] <= first <= last <= frames[-1] for first, last in told)


def test_everybody_is_scored(folder: Path) -> None:
    known = known_clip(posterior().clip)
    both = score_posterior(posterior(), known.truth, name="couple")
    first = replace(
        known.truth,
        joints=known.truth.joints[:N_FRAMES],
        pixels=known.truth.pixels[:N_FRAMES],
        hidden=known.truth.hidden[:N_FRAMES],
    )
    one = score_posterior(posterior(), first, name="couple")
    assert len(both.pelvis_ranks) == 2 * N_FRAMES
    assert_array_equal(one.pelvis_ranks, both.pelvis_ranks[:N_FRAMES])
    for answer in posterior_predictions(posterior()):
        of_both, of_first = (pose_scores(answer, t)["all frames"] for t in (known.truth, first))
        assert of_both.joints == 2 * of_first.joints
        assert 0 < of_both.world < 40
    assert main(["evaluate", str(folder)]) == 0
    assert (folder / "evaluation.png").is_file()


def test_several_people_are_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    _show(posterior(), tmp_path)
    shown = capsys.readouterr().out
    for track in posterior().clip.tracks:
        assert f"left for right of {track.name} in" in shown.replace("\n", " ")
