"""ArviZ works on ``posterior.nc`` as it is: no names of variables, no reshaping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import arviz_plots
import arviz_stats
import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

import imapper_prob as im
from imapper_prob.models.log_posterior import motion
from imapper_prob.models.path_prior import CAMERA
from imapper_prob.models.skeleton import PELV
from imapper_prob.uncertainty.tree import clip_digest, read_attributes, seconds_of, write_tree
from tests.runs import posterior


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tree") / "posterior.nc"
    write_tree(path, posterior().data)
    return path


@pytest.fixture(scope="module")
def tree(path: Path) -> xr.DataTree:
    with xr.open_datatree(path, engine="h5netcdf") as opened:
        return opened.load()


def test_a_summary_needs_no_help(tree: xr.DataTree) -> None:
    table = arviz_stats.summary(tree, round_to="none")
    assert set(table.index) == {*CAMERA, "mean_depth"}
    heights = [state.camera[1] for state in posterior().samples.states]
    assert table.loc["elevation", "mean"] == pytest.approx(np.mean(heights))
    assert table.loc["elevation", "r_hat"] > 0.9
    depths = [
        motion(posterior().solution.problem, state)[:, PELV, 1].mean()
        for state in posterior().samples.states
    ]
    assert table.loc["mean_depth", "mean"] == pytest.approx(np.mean(depths), rel=1e-5)


@pytest.mark.parametrize("name", ["trace", "rank", "pair", "forest"])
def test_plots_need_no_help(tree: xr.DataTree, name: str, tmp_path: Path) -> None:
    drawn = getattr(arviz_plots, f"plot_{name}")(tree, backend="matplotlib")
    drawn.savefig(tmp_path / "plot.png")
    pyplot.close("all")
    assert (tmp_path / "plot.png").stat().st_size > 5_000


def test_groups_are_those_of_arviz(tree: xr.DataTree) -> None:
    assert {"posterior", "sample_stats", "observed_data", "constant_data"} <= set(tree.children)
    for name in ("posterior", "counts", "sample_stats", "motion", "draws", "latent"):
        assert dict(tree[name].sizes)["chain"] == 2
        assert dict(tree[name].sizes)["draw"] == 40
    for variable in tree["posterior"].data_vars.values():
        assert variable.dims == ("chain", "draw")


def test_dense_draws_of_a_layout_are_arrays_too(tree: xr.DataTree) -> None:
    draws = posterior().samples.placements[0]
    np.testing.assert_array_equal(tree["ensembles/0/placements"], draws.placements)
    assert tree["ensembles/0/placements"].dims == ("ensemble", "step", "walker", "slot", "pose")


def test_where_it_is_from_is_in_the_file(path: Path) -> None:
    said = read_attributes(path)
    assert said["program"] == f"imapper-prob {im.__version__}"
    assert said["seed"] == 3
    assert said["clip_digest"] == clip_digest(posterior().clip)
    assert said["library_digest"] == posterior().solution.library.digest
    assert len(said["config_digest"]) == 64


def test_a_clip_is_known_by_what_was_seen(path: Path) -> None:
    clip = posterior().clip
    assert clip_digest(replace(clip, truth=None)) == clip_digest(clip)
    assert clip_digest(replace(clip, fps=11.0)) != clip_digest(clip)
    track = replace(clip.tracks[0], name="somebody else")
    assert clip_digest(replace(clip, tracks=(track,))) != clip_digest(clip)


def test_how_long_it_took_is_kept(tmp_path: Path) -> None:
    run = replace(posterior(), seconds={"solving": 1.5, "sampling": 60.25})
    write_tree(tmp_path / "posterior.nc", run.data)
    again = im.load_posterior(tmp_path)
    assert dict(again.seconds) == {"solving": 1.5, "sampling": 60.25}
    assert seconds_of(read_attributes(tmp_path / "posterior.nc")) == dict(again.seconds)
