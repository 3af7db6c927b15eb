"""A run that is opened again from its folder is the run that was written."""

from __future__ import annotations

import shutil
from dataclasses import astuple
from pathlib import Path

import numba
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import imapper_prob as im
from imapper_prob.models.errors import InputError
from imapper_prob.models.log_posterior import log_posterior, motion
from imapper_prob.models.scene import SceneObject
from imapper_prob.results.folders import write_run
from imapper_prob.results.posterior import Posterior
from imapper_prob.solver.selection import of_scenelets
from tests.machine import timed
from tests.runs import posterior

SINGLE = 1e-5
"""Metres; paths are kept in single precision."""


@pytest.fixture(scope="module")
def folder(run_of_demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    shutil.copytree(run_of_demo, folder)
    return folder


@pytest.fixture(scope="module")
def opened(folder: Path) -> Posterior:
    return im.load_posterior(folder)


def same_objects(first: tuple[SceneObject, ...], second: tuple[SceneObject, ...]) -> bool:
    def plain(o: SceneObject) -> tuple[object, ...]:
        boxes = [(c.part, c.centre.tolist(), c.size.tolist()) for c in o.cuboids]
        return o.label, o.placement, boxes

    return [plain(o) for o in first] == [plain(o) for o in second]


def test_scenes_are_the_same(opened: Posterior) -> None:
    run = posterior()
    assert len(opened.scenes(10)) == len(run.scenes(10)) > 0
    for one, other in zip(opened.scenes(10), run.scenes(10), strict=True):
        assert (one.probability, one.error) == (other.probability, other.error)
        assert one.scene.assignment == other.scene.assignment
        assert one.scene.camera == other.scene.camera
        assert one.scene.log_posterior == other.scene.log_posterior
        assert same_objects(one.scene.objects, other.scene.objects)
        assert_array_equal(one.covariances, other.covariances)
        assert_allclose(one.scene.joints, other.scene.joints, atol=SINGLE)
        assert_allclose(one.ghosts, other.ghosts, atol=SINGLE)


def test_draws_and_their_objects_are_the_same(opened: Posterior) -> None:
    mine, theirs = opened.samples, posterior().samples
    assert mine.shape == theirs.shape
    for one, other in zip(mine.states, theirs.states, strict=True):
        assert_array_equal(one.camera, other.camera)
        assert_array_equal(one.placements, other.placements)
        assert_array_equal(one.sizes, other.sizes)
        assert_array_equal(one.items[:, 1], other.items[:, 1])
        names = [opened.solution.library[i].name for i in one.items[:, 0]]
        assert names == [posterior().solution.library[i].name for i in other.items[:, 0]]
        assert_allclose(one.latent, other.latent, atol=1e-6)
    for first, second in zip(mine.objects, theirs.objects, strict=True):
        assert same_objects(first, second)


def test_what_is_said_of_the_draws_is_the_same(opened: Posterior) -> None:
    mine, theirs = opened.samples, posterior().samples
    assert_array_equal(mine.log_posterior, theirs.log_posterior)
    assert_array_equal(mine.traces, theirs.traces)
    assert_array_equal(mine.layouts.indicator, theirs.layouts.indicator)
    assert mine.layouts.leaders == theirs.layouts.leaders
    for one, other in zip(mine.probabilities, theirs.probabilities, strict=True):
        assert_array_equal(one, other)
    assert mine.verdict == theirs.verdict
    assert [c.sentence for c in opened.checks] == [c.sentence for c in posterior().checks]
    assert opened.verdict == posterior().verdict
    assert mine.ladders == theirs.ladders
    assert mine.acceptance == theirs.acceptance
    assert mine.finished is theirs.finished
    assert mine.walked is not None
    assert theirs.walked is not None
    for one, other in zip(astuple(mine.walked), astuple(theirs.walked), strict=True):
        if isinstance(one, dict):
            assert one == pytest.approx(other, nan_ok=True)
        else:
            assert_array_equal(one, other)
    assert opened.config == posterior().config


LONGEST = 60.0
"""Units of ``tests.machine`` in which a small run is opened, 2 s on a common machine, which
takes a tenth of that."""


def test_opening_is_quick(folder: Path) -> None:
    # Once of three times: the machine may be busy, the program is not at fault then.
    assert any(timed(lambda: im.load_posterior(folder))[1] < LONGEST for _ in range(3))


def test_what_was_opened_is_said_in_a_line(opened: Posterior) -> None:
    assert len(repr(opened)) < 2000
    assert len(repr(opened.solution)) < 2000


def test_the_clip_is_the_same_without_its_file(opened: Posterior) -> None:
    mine, theirs = opened.clip, posterior().clip
    assert (mine.name, mine.camera, mine.fps) == (theirs.name, theirs.camera, theirs.fps)
    assert_array_equal(mine.tracks[0].keypoints, theirs.tracks[0].keypoints)
    assert mine.truth is not None
    assert theirs.truth is not None
    assert same_objects(mine.truth.objects, theirs.truth.objects)
    assert_array_equal(mine.truth.joints, theirs.truth.joints)


def test_the_log_posterior_is_the_same_to_the_last_bit(opened: Posterior) -> None:
    solution = posterior().solution
    chosen = opened.data["constant_data"]["drawn"].to_numpy()
    assert [s.name for s in opened.solution.library] == [solution.library[i].name for i in chosen]
    theirs = of_scenelets(solution.problem, chosen)
    for name, value in opened.solution.problem._asdict().items():
        assert_array_equal(value, getattr(theirs, name), err_msg=name)
        # Another type, and all kernels would be compiled once more.
        known = getattr(solution.problem, name)
        assert numba.typeof(value) == numba.typeof(known), name
    for n in (0, 77):
        state = opened.samples.states[n]
        assert log_posterior(opened.solution.problem, state) == pytest.approx(
            opened.samples.log_posterior.flat[n], abs=0.01
        )
        whole = motion(solution.problem, posterior().samples.states[n])
        assert_allclose(motion(opened.solution.problem, state), whole, atol=SINGLE)


def test_an_opened_run_is_written_again_as_it_was(
    opened: Posterior, folder: Path, tmp_path: Path
) -> None:
    write_run(tmp_path / "copy", opened, overwrite=False)
    for name in ("scenes.json", "config.toml"):
        assert (tmp_path / "copy" / name).read_bytes() == (folder / name).read_bytes()
    again = im.load_posterior(tmp_path / "copy")
    assert_array_equal(again.samples.log_posterior, opened.samples.log_posterior)


def test_an_unfinished_run_is_not_replaced_by_another(opened: Posterior, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    chain = folder / "checkpoints" / "chain-0.npz"
    chain.parent.mkdir(parents=True)
    chain.write_bytes(b"of another run")
    with pytest.raises(InputError, match=r"holds an earlier run; .* --overwrite"):
        opened.save(folder)
    assert [path.name for path in folder.iterdir()] == ["checkpoints"]
    opened.save(folder, overwrite=True)
    assert not chain.parent.exists()
    assert not (folder / "chains").exists()


@pytest.mark.parametrize("kept", [0, 100, 20_000])
def test_a_truncated_file_is_one_clear_error(folder: Path, tmp_path: Path, kept: int) -> None:
    content = (folder / "posterior.nc").read_bytes()
    (tmp_path / "posterior.nc").write_bytes(content[:kept])
    with pytest.raises(InputError, match=r"posterior\.nc: damaged"):
        im.load_posterior(tmp_path)


def test_foreign_and_missing_files_are_refused(folder: Path, tmp_path: Path) -> None:
    import xarray as xr

    with pytest.raises(InputError, match="no such file"):
        im.load_posterior(tmp_path)
    xr.Dataset({"weather": ("day", [1.0, 2.0])}).to_netcdf(
        tmp_path / "posterior.nc", engine="h5netcdf"
    )
    with pytest.raises(InputError, match="of this version"):
        im.load_posterior(tmp_path)
    shutil.copy(folder / "posterior.nc", tmp_path / "posterior.nc")
    import h5py

    with h5py.File(tmp_path / "posterior.nc", "a") as file:
        del file["draws"]["scenelet"]
    with pytest.raises(InputError, match="scenelet"):
        im.load_posterior(tmp_path)
