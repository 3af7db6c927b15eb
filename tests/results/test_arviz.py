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
from imapper_prob.sampling.ensembles import QUANTITIES
from imapper_prob.uncertainty.clusters import names_of, object_clusters
from imapper_prob.uncertainty.furniture import object_draws
from imapper_prob.uncertainty.tree import clip_digest, read_attributes, seconds_of, write_tree
from tests.runs import posterior
from tests.uncertainty.pieces import piece


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
    for name in ("posterior", "furniture", "counts", "sample_stats", "motion", "draws", "latent"):
        assert dict(tree[name].sizes)["chain"] == 2
        assert dict(tree[name].sizes)["draw"] == 40
    for variable in tree["posterior"].data_vars.values():
        assert variable.dims == ("chain", "draw")


def test_furniture_is_in_the_tree_by_name(tree: xr.DataTree) -> None:
    run = posterior()
    drawn, clusters = tree["furniture"], run.clusters()
    assert drawn["object"].values.tolist() == list(names_of(clusters))
    for variable in drawn.data_vars.values():
        assert variable.dims == ("chain", "draw", "object")
        assert variable.shape == (2, 40, len(clusters))
        assert variable.attrs["units"] in ("1", "m", "rad")
    for k, cluster in enumerate(clusters):
        own = drawn.to_dataset().isel(object=k)
        there = own["presence"].values.ravel() == 1
        assert there.mean() == cluster.presence
        assert np.flatnonzero(there).tolist() == sorted(cluster.members[:, 0].tolist())
        for name in ("x", "y", "yaw", "width", "depth", "height"):
            values = own[name].values.ravel()
            np.testing.assert_array_equal(np.isfinite(values), there)
        assert own["x"].mean().item() == pytest.approx(cluster.mean[0])
        assert own["y"].mean().item() == pytest.approx(cluster.mean[1])
        assert np.abs(own["yaw"] - cluster.yaw).max() <= np.pi + 1e-12
        n, i = cluster.members[0].tolist()
        low, high = run.samples.objects[n][i].bounds
        size = [own[name].values.ravel()[n] for name in ("width", "depth", "height")]
        np.testing.assert_allclose(size, high - low)


def test_arviz_speaks_of_couches(path: Path) -> None:
    again = im.load_posterior(path)
    for run in (posterior(), again):
        group = run.to_arviz()["posterior"].to_dataset()
        assert group.identical(posterior().to_arviz()["posterior"].to_dataset())
    names = list(names_of(again.clusters()))
    measured = ["presence", "x", "y", "yaw", "width"]
    with np.errstate(invalid="ignore"):  # what is the same in all draws has no R-hat
        table = arviz_stats.summary(
            again.to_arviz(), var_names=measured, skipna=True, round_to="none"
        )
    assert table.index.tolist() == [f"{m}[{name}]" for m in measured for name in names]
    assert np.isfinite(table["mean"]).all()
    told = again.summary().to_dataframe()
    for name in names:
        assert table.loc[f"presence[{name}]", "mean"] == pytest.approx(told.loc[name, "presence"])
        assert table.loc[f"x[{name}]", "mean"] == pytest.approx(told.loc[name, "x"])


def test_arviz_draws_furniture(tmp_path: Path) -> None:
    drawn = arviz_plots.plot_forest(posterior().to_arviz(), var_names=["x"], backend="matplotlib")
    drawn.savefig(tmp_path / "plot.png")
    pyplot.close("all")
    assert (tmp_path / "plot.png").stat().st_size > 5_000


def test_the_table_has_a_row_for_each_object_of_each_draw() -> None:
    run = posterior()
    table = run.to_dataframe()
    assert len(table) == sum(len(c.members) for c in run.clusters())
    assert np.isfinite(table.to_numpy()).all()
    assert table.index.names == ["chain", "draw", "object"]


def test_a_run_without_furniture_has_a_tree_as_well(tmp_path: Path) -> None:
    bare = object_draws((), [()] * 6, (2, 3))
    tree = xr.DataTree.from_dict({"furniture": bare})
    write_tree(tmp_path / "tree.nc", tree)
    with xr.open_datatree(tmp_path / "tree.nc", engine="h5netcdf") as opened:
        assert opened["furniture"]["x"].shape == (2, 3, 0)


def test_turns_are_near_their_mean_whichever_way_round_they_are() -> None:
    yaws = [3.1, -3.1, 3.0, -3.0]
    draws = [[piece("couch", 0.0, 4.0, yaw)] for yaw in yaws]
    (couch,) = object_clusters(draws, np.zeros((2, 2)), radius=0.8)
    drawn = object_draws([couch], draws, (2, 2))["yaw"].values.ravel()
    np.testing.assert_allclose(np.exp(1j * drawn), np.exp(1j * np.array(yaws)))
    assert drawn.std() == pytest.approx(np.std([-0.0416, 0.0416, -0.1416, 0.1416]), abs=1e-4)
    assert drawn.mean() == pytest.approx(couch.yaw)
    # A table is the same from both sides.
    draws = [[piece("table", 0.0, 4.0, yaw)] for yaw in (0.1, 0.1 + np.pi, 0.2, 0.2 - np.pi)]
    (table,) = object_clusters(draws, np.zeros((2, 2)), radius=0.8)
    drawn = object_draws([table], draws, (2, 2))["yaw"].values.ravel()
    np.testing.assert_allclose(drawn - table.yaw, [-0.05, -0.05, 0.05, 0.05], atol=1e-9)


def test_what_ensembles_did_is_an_array_too(tree: xr.DataTree) -> None:
    walked = posterior().samples.walked
    assert walked is not None
    np.testing.assert_array_equal(tree["walked/change"], walked.change)
    assert tree["walked/quantity"].values.tolist() == list(QUANTITIES)
    assert tree["walked"].attrs["walkers"] == walked.walkers


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
