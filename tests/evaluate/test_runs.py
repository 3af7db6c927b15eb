"""A sampled run held against the truth of its clip."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imapper_prob.cli import main
from imapper_prob.evaluate.claims import claims_of, draws_of
from imapper_prob.evaluate.prediction import (
    SOLVER,
    read_solution_folder,
    write_prediction,
)
from imapper_prob.evaluate.probability import (
    LIKELY,
    MOST_PROBABLE,
    posterior_predictions,
    score_posterior,
)
from imapper_prob.evaluate.regions import at_true_size, draws_inside, joint_ranks
from imapper_prob.evaluate.score import known_clip
from imapper_prob.evaluate.suite import posterior_coverage
from imapper_prob.evaluate.tables import posterior_rows
from imapper_prob.evaluate.truth import outline_of
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import state_camera
from imapper_prob.models.skeleton import PELV
from imapper_prob.results.solution import write_solution
from imapper_prob.solver.actors import solved
from lab.ablation import prediction_of_state
from tests.runs import posterior
from tests.runs import solution as solve_one


@pytest.fixture(scope="module")
def folder(run_of_demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evaluate") / "run"
    shutil.copytree(run_of_demo, folder)
    return folder


def test_draws_are_in_the_axes_of_the_camera() -> None:
    draws, run = draws_of(posterior()), posterior()
    scene = run.scenes(1)[0].scene
    assert draws.joints.shape[1:] == (run.clip.n_frames, 16, 3)
    assert len(draws) == len(draws.objects) == draws.joints.shape[0]
    shown, likely = posterior_predictions(run)
    assert (shown.name, likely.name) == (MOST_PROBABLE, LIKELY)
    np.testing.assert_allclose(shown.joints, scene.camera.to_camera(scene.joints))
    assert np.linalg.norm(likely.joints - draws.joints.mean(0), axis=-1).max() < 0.3


def test_claims_are_the_clusters_that_are_shown() -> None:
    claims = claims_of(posterior())
    clusters = posterior().clusters(least=0.005)
    assert [c.probability for c in claims] == [c.presence for c in clusters]
    assert [len(c.members) for c in claims] == [len(c.members) for c in clusters]


def test_scores_of_a_posterior_fit_together() -> None:
    known = known_clip(posterior().clip)
    found = score_posterior(posterior(), known.truth, name="demo")
    assert found.best <= found.first
    assert 0 <= found.energy <= found.expected
    assert 0 < found.joint_energy < found.joint_expected
    assert found.claimed == len(found.object_ranks) <= found.true == len(known.truth.used)
    for ranks in (found.object_ranks, found.joint_ranks, found.hidden_ranks):
        assert ((ranks >= 0) & (ranks <= 1)).all()


def test_scores_of_a_posterior_are_of_the_joints_that_they_name() -> None:
    truth = known_clip(posterior().clip).truth
    found = score_posterior(posterior(), truth, name="demo")
    draws = draws_of(posterior(), rows=len(truth.joints))
    sized = at_true_size(draws, truth)
    for ranks, inside, direct, held in (
        (found.pelvis_ranks, "pelvis_ranks", joint_ranks(draws, truth, joints=(PELV,)),
         draws_inside(draws, truth, joints=(PELV,))),
        (found.joint_ranks, "joint_ranks", joint_ranks(draws, truth), draws_inside(draws, truth)),
        (found.hidden_ranks, "hidden_ranks", joint_ranks(draws, truth, hidden=True),
         draws_inside(draws, truth, hidden=True)),
        (found.sized_ranks, "sized_ranks", joint_ranks(sized, truth), draws_inside(sized, truth)),
    ):  # fmt: skip
        np.testing.assert_array_equal(ranks, direct)
        np.testing.assert_array_equal(found.inside[inside], held)
    assert 0 < len(found.hidden_ranks) < len(found.joint_ranks)
    shares = posterior_coverage([found])
    for name, ranks in (
        ("object centres", found.object_ranks),
        ("pelvis", found.pelvis_ranks),
        ("joints", found.joint_ranks),
        ("hidden joints", found.hidden_ranks),
        ("joints, given the clip's size", found.sized_ranks),
    ):
        half, most = shares[name]
        assert (half.count, most.count) == (len(ranks), len(ranks)), name
        assert half.share == pytest.approx(np.mean(ranks < 0.5)), name
        assert most.share == pytest.approx(np.mean(ranks < 0.9)), name
    header, row = posterior_rows([found])
    said = dict(zip(header, row, strict=True))
    assert (row[0], row[1], row[2]) == ("demo", truth.name, str(len(draws)))
    assert row[3] == f"{found.first:.0f} / {found.best:.0f}", said
    assert row[4] == f"{found.expected:.0f} / {found.energy:.0f}", said
    assert row[5] == f"{found.joint_expected:.0f} / {found.joint_energy:.0f}", said
    assert row[7] == f"{found.claimed} of {found.true}", said


def test_every_draw_is_seen_by_its_own_camera() -> None:
    run = posterior()
    claims, clusters = claims_of(run), run.clusters(least=0.005)
    for claim, cluster in zip(claims[:2], clusters[:2], strict=True):
        for member, (n, k) in list(zip(claim.members, cluster.members, strict=True))[:20]:
            camera = state_camera(run.clip.camera, run.samples.states[n])
            own = outline_of(run.furniture[n][k], camera)
            np.testing.assert_array_equal(member.centre, own.centre)


def test_another_clip_is_refused() -> None:
    truth = known_clip(posterior().clip).truth
    with pytest.raises(InputError, match="name the truth of its clip"):
        score_posterior(posterior(), replace(truth, name="Scene04"), name="demo")


def test_the_command_writes_scores_and_pictures(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.json"
    _, likely = posterior_predictions(posterior())
    write_prediction(other, replace(likely, name="same again"), posterior().clip)
    assert main(["evaluate", str(folder)]) == 0
    text = capsys.readouterr().out
    for title in ("Furniture", "Joints", "Posterior", "Do regions hold the truth?"):
        assert title in text
    document = json.loads((folder / "evaluation.json").read_text())
    names = [m["name"] for m in document["methods"]]
    assert names == [MOST_PROBABLE, LIKELY, "couch on static path"]
    assert document["posteriors"][0]["clip"] == "demo"
    assert (folder / "evaluation.png").is_file()
    assert (folder / "coverage.png").is_file()


def test_a_staged_solution_is_read_from_its_folder(tmp_path: Path) -> None:
    solution = solve_one()
    answer = solved(solution.clip, (solution,), count=2)
    write_solution(tmp_path, answer)
    found = read_solution_folder(tmp_path, solution.clip)
    # What was meant to be an alternative may be the best.
    best = prediction_of_state(solution, answer.scenes[0].states[0], name=SOLVER)
    np.testing.assert_allclose(found.joints, best.joints, atol=1e-4)
    assert [o.label for o in found.objects] == [o.label for o in best.objects]
    with pytest.raises(InputError, match="is of the clip 'demo', not of other"):
        read_solution_folder(tmp_path, replace(solution.clip, name="other"))
    (tmp_path / "solution.npz").write_bytes(b"not an archive")
    with pytest.raises(InputError, match="damaged solution"):
        read_solution_folder(tmp_path, solution.clip)


def test_faults_are_named(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = tmp_path / "other.json"
    clip.write_text("{}")
    for arguments, message in (
        ([], "name either results, or a folder"),
        ([str(folder), "--suite", str(tmp_path)], "name either results, or a folder"),
        (["--suite", str(tmp_path)], "needs a folder for its results"),
        ([str(clip), "-o", str(tmp_path)], "name the scene that it is of"),
        ([str(clip)], "name a folder for evaluation.json"),
        (
            [str(folder), "--predictions", str(tmp_path)],
            "--predictions works with --suite DIR only",
        ),
        ([str(folder), "--solver-only"], "--solver-only works with --suite DIR only"),
        (
            ["--suite", str(tmp_path), "-o", str(tmp_path / "out"), "--truth", str(tmp_path)],
            "--truth works with results only",
        ),
        ([str(tmp_path / "none")], "no such file"),
    ):
        assert main(["evaluate", *arguments]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.slow
def test_runs_of_one_name_are_told_apart(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    others = [tmp_path / name / "run" for name in ("a", "b")]
    for other in others:
        shutil.copytree(folder, other)
    out = tmp_path / "out"
    out.mkdir()
    assert main(["evaluate", *map(str, others), "-o", str(out)]) == 0
    document = json.loads((out / "evaluation.json").read_text())
    names = [method["name"] for method in document["methods"]]
    assert len(set(names)) == len(names)
    assert all(any(name.startswith(f"{other}: ") for name in names) for other in others)


def test_a_result_that_is_named_twice_is_refused_before_it_is_read(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def read(*_: object) -> None:
        raise AssertionError("work was begun")

    monkeypatch.setattr("imapper_prob.cli.evaluate.load_posterior", read)
    monkeypatch.setattr("imapper_prob.cli.evaluate.known_scene", read)
    (tmp_path / "link").symlink_to(folder)
    for again in (folder, folder / "posterior.nc", tmp_path / "link"):
        arguments = ["evaluate", str(folder), str(again), "--truth", str(tmp_path)]
        assert main([*arguments, "-o", str(tmp_path / "out")]) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert f"{folder}: is named twice; name each result once" in said
    assert not (tmp_path / "out").exists()
