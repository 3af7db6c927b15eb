"""``plot`` draws on the axes that it is given, and names axes and colours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from imapper_prob.models.skeleton import PELV
from imapper_prob.results.report_plots import Floor, floor_plot, map_plot
from imapper_prob.results.solution import charness_figure, plot_charness
from imapper_prob.sampling.sample import Samples
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.actors import Solved, solved
from imapper_prob.uncertainty.clusters import ObjectCluster, names_of
from imapper_prob.uncertainty.occupancy import occupancy
from tests.runs import posterior, small_posterior, small_solution
from tests.uncertainty.pieces import piece
from tests.uncertainty.rooms import couch_and_table

Plot = Callable[..., Axes]
PICTURED = ("clip", "scene", "weighted scene", "solved scene", "object", "occupancy", "cluster")
LONGEST = 2000
"""Characters of what a console prints of anything."""


@cache
def solved_scenes() -> Solved:
    """What ``im.solve`` returns of the small clip."""
    return solved(small_solution().clip, (small_solution(),), count=2)


FLOOR = ("x, to the right [m]", "y, away from the camera [m]")
PLOTS: dict[str, tuple[Callable[[], Plot], tuple[str, str]]] = {
    "clip": (lambda: small_posterior().clip.plot, ("u, to the right [px]", "v, down [px]")),
    "scene": (lambda: small_posterior()[0].scene.plot, FLOOR),
    "weighted scene": (lambda: small_posterior()[0].plot, FLOOR),
    "solved scene": (lambda: solved_scenes().scenes[0].plot, FLOOR),
    "posterior": (lambda: small_posterior().plot, FLOOR),
    "occupancy": (lambda: small_posterior().occupancy().plot, FLOOR),
    "cluster": (lambda: small_posterior().clusters()[0].plot, FLOOR),
    "object": (lambda: small_posterior()[0].objects[0].plot, FLOOR),
    "charness": (
        lambda: lambda ax=None: plot_charness(small_posterior().solution, ax),  # type: ignore[arg-type]
        ("frame", "charness [1]"),
    ),
}


def entries(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("name", PLOTS)
def test_axes_go_in_and_come_out_with_names_units_and_a_legend(name: str) -> None:
    make, labels = PLOTS[name]
    given = Figure().subplots()
    axes = make()(given)
    assert axes is given
    assert (axes.get_xlabel(), axes.get_ylabel()) == labels
    assert entries(axes)
    assert axes.figure is not None
    assert plt.get_fignums() == []


@pytest.mark.parametrize("name", PLOTS)
def test_without_axes_there_is_a_new_figure(name: str) -> None:
    axes = PLOTS[name][0]()()
    try:
        assert plt.get_fignums() != []
        axes.figure.canvas.draw()
    finally:
        plt.close("all")


def test_a_scene_is_drawn_where_it_stands() -> None:
    scene = couch_and_table()
    axes = scene.plot(Figure().subplots())
    assert entries(axes) == ["pelvis", "couch", "table"]
    written = {text.get_text(): text.xy for text in axes.texts}  # type: ignore[attr-defined]
    for o in scene.objects:
        np.testing.assert_allclose(written[o.label], o.centre[:2])
        assert axes.get_xlim()[0] < o.footprint[:, 0].min()
        assert axes.get_ylim()[1] > o.footprint[:, 1].max()
    np.testing.assert_allclose(axes.lines[0].get_xydata(), scene.joints[:, PELV, :2])


def test_two_people_have_two_paths() -> None:
    scene = couch_and_table()
    both = replace(scene, joints=np.concatenate([scene.joints, scene.joints + 1.0]), people=2)
    axes = both.plot(Figure().subplots())
    assert entries(axes)[:2] == ["pelvis, person 1", "pelvis, person 2"]
    np.testing.assert_allclose(axes.lines[1].get_xydata(), scene.joints[:, PELV, :2] + 1.0)


def test_an_unknown_spread_is_said_and_has_no_region() -> None:
    run = small_posterior()
    best = run[0]
    covariances = np.tile(0.01 * np.eye(2), (len(best.objects), 1, 1))
    known, unknown = (
        floor_plot(
            Floor(np.array([-5.0, 0.0]), np.array([5.0, 9.0])),
            run.clip,
            [replace(best, covariances=own)],
        )
        for own in (covariances, np.full_like(covariances, np.nan))
    )
    dotted = [sum(t.line.dash == "dot" for t in figure.data) for figure in (known, unknown)]
    assert dotted == [len(best.objects), 0]
    told = [t.text for t in unknown.data if t.hoveron == "fills"]
    assert len(told) == len(best.objects) > 0
    assert all(text.count(" ± unknown m") == 2 for text in told)


def test_the_map_is_white_where_nothing_stands() -> None:
    found = occupancy([[piece("table", 0.0, 3.0)], [], [piece("chair", 2.0, 3.0)], []])
    axes = found.plot(Figure().subplots())
    (picture,) = axes.images
    colours = np.asarray(picture.get_array())
    assert entries(axes) == ["chair, highest p: 0.25", "table, highest p: 0.25"]
    np.testing.assert_allclose(colours[found.anything == 0], 1.0)
    assert (colours[found.anything > 0].min(-1) < 1.0).all()


def test_a_map_of_nothing_has_axes_and_no_legend() -> None:
    axes = occupancy([[]]).plot(Figure().subplots())
    assert axes.get_xlabel() == FLOOR[0]
    assert axes.get_legend() is None


def test_objects_of_one_label_have_names_of_their_own() -> None:
    def cluster(label: str, presence: float) -> ObjectCluster:
        at = np.random.default_rng(0).normal(size=(20, 2))
        members = np.stack([np.arange(20), np.zeros(20, int)], -1)
        return ObjectCluster(
            presence, 0.0, {label: 0.75, "bed": 0.25}, at, 0.0, 0.1, members, piece(label, 0, 3)
        )

    clusters = [cluster("table", 1.0), cluster("couch", 0.9), cluster("table", 0.5)]
    assert names_of(clusters) == ("table", "couch", "table 2")
    axes = clusters[0].plot(Figure().subplots())
    assert entries(axes) == [
        "table, p = 1.00\n(table 0.75, bed 0.25)", "50 % of the draws", "90 % of the draws",
    ]  # fmt: skip


def test_names_of_others_are_no_formulas() -> None:
    axes = piece("$x", 0.0, 3.0).plot(Figure().subplots())
    assert not axes.texts[0].get_parse_math()
    legend: Any = axes.get_legend()
    assert not legend.get_texts()[0].get_parse_math()


def test_charness_has_a_panel_for_each_person() -> None:
    solution: Any = small_posterior().solution
    figure = charness_figure(solved(solution.clip, (solution,), count=1))
    (axes,) = figure.axes
    curve = solution.curve
    smoothed = next(line for line in axes.lines if line.get_label() == "smoothed")
    np.testing.assert_array_equal(smoothed.get_ydata(), curve.values)


@pytest.mark.parametrize("name", PICTURED)
def test_a_notebook_shows_a_picture(name: str) -> None:
    shown: Any = PLOTS[name][0]()
    page = shown.__self__._repr_html_()
    assert page.count("<svg") == 1
    assert page.startswith(f"<p>{type(shown.__self__).__name__}(")
    assert plt.get_fignums() == []


def test_a_solution_is_shown_as_tables_and_its_best_scene() -> None:
    found = solved_scenes()
    page = found._repr_html_()
    assert page.count("<svg") == 1
    for scene in found.scenes:
        assert f"{scene.log_posterior:.1f}" in page
    page = small_solution()._repr_html_()
    for table in small_solution().shortlists:
        assert "".join(f"<td>{n}" for n in table.counts().values()) in page


def everything(value: Any, path: str, *, deeper: int = 4) -> Iterator[tuple[str, Any]]:
    """What a user reaches from a result by fields and by the first of what they hold."""
    yield path, value
    if deeper == 0 or isinstance(value, Samples):
        return
    inside: list[tuple[str, Any]] = []
    if is_dataclass(value):
        parts = [(f".{f.name}", getattr(value, f.name)) for f in fields(value)]
        # Arrays print as NumPy has it.
        inside = [(name, part) for name, part in parts if not isinstance(part, np.ndarray)]
    elif isinstance(value, tuple) and value:
        inside = [("[0]", value[0])]
    for name, part in inside:
        yield from everything(part, path + name, deeper=deeper - 1)


def test_nothing_that_is_reached_prints_pages() -> None:
    run = small_posterior()
    reached = {
        "solved": solved_scenes(), "library": load_library(), "posterior": run,
        "scenes": run.scenes(), "clusters": run.clusters(), "occupancy": run.occupancy(),
        "hidden": run.hidden(), "joints": run.joints(), "furniture": run.furniture,
        "questions": run.questions(), "nuisances": tuple(run.nuisances().values()),
    }  # fmt: skip
    lengths = {
        path: len(repr(part))
        for name, value in reached.items()
        for path, part in everything(value, name)
    }
    assert {path: n for path, n in lengths.items() if n >= LONGEST} == {}


def test_ellipses_are_the_edges_of_the_regions() -> None:
    run = posterior()
    regions = [c.region(share) for c in run.clusters() for share in (0.5, 0.9)]
    # None is a circle, which would look the same if it was mirrored.
    assert any(abs(np.sin(2 * r.angle)) > 0.1 and np.ptp(r.half_axes) > 0.02 for r in regions)
    axes = run.plot()
    back = axes.transData.inverted()
    drawn = [back.transform(p.get_verts()) for p in axes.patches if isinstance(p, Ellipse)]
    plt.close(axes.figure)
    floor, best = Floor.of(run.clip, run.scenes()), [run.scenes(1)[0].scene.joints[:, PELV, :2]]
    figure = map_plot(floor, run.occupancy(), run.clusters(), best)
    edges = [
        np.stack([line.x, line.y], -1)
        for line in figure.data
        if line.type == "scatter" and line.line.dash in ("solid", "dot") and len(line.x) == 49
    ]
    for found in (drawn, edges):
        assert len(found) == len(regions)
        for region, edge in zip(regions, found, strict=True):
            out = np.asarray(edge, float) - region.centre
            assert region.holds(region.centre + 0.98 * out).all()
            assert not region.holds(region.centre + 1.02 * out).any()
