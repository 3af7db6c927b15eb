"""Figures of a library: what they show is what was computed."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.skeleton import THRX
from imapper_prob.scenelets.charness import (
    charness,
    charness_maps,
    motion_distances,
    object_histograms,
)
from imapper_prob.scenelets.figures import (
    charness_figure,
    embed,
    embedding_figure,
    furniture_figure,
    typical,
)
from tests.pictures import png_size
from tests.scenelets.motions import box, standing


@pytest.fixture(scope="module")
def library() -> Library:
    """Three people before a chair, who stoop more or less, and one who stands without any."""
    scenelets = []
    for i, (action, stoop) in enumerate(
        [("stoop", 0.30), ("stoop", 0.32), ("stoop", 0.36), ("idle", 0.0)]
    ):
        joints = standing()
        joints[:, THRX:, 1] += stoop  # and all that hangs on the chest
        joints[:, :, 0] += np.linspace(0, 0.1, len(joints))[:, None]
        objects = (box("chair", y=0.5 + 0.3 * i),) if action == "stoop" else ()
        scenelets.append(Scenelet(f"{action}-{i}", action, joints, objects))
    return Library("few", tuple(scenelets))


def dots(figure: Figure, axes: int) -> list[PathCollection]:
    return [c for c in figure.axes[axes].collections if isinstance(c, PathCollection)]


def test_the_embedding_is_drawn_by_charness_and_by_action(library: Library) -> None:
    distances = motion_distances(library)
    values = np.array([0.8, 0.9, 0.7, 0.1])
    figure = embedding_figure(library, distances, values)
    points = embed(distances)
    (left,) = dots(figure, 0)
    order = np.argsort(values)
    assert_allclose(left.get_offsets(), points[order])
    assert_allclose(left.get_array(), values[order])
    by_action = {c.get_label(): np.array(c.get_offsets()) for c in dots(figure, 1)}
    assert_allclose(by_action["stoop (3)"], points[:3])
    assert_allclose(by_action["idle (1)"], points[3:])
    assert png_size(figure)[0] == 600


def test_the_furniture_of_similar_motions(library: Library) -> None:
    distances = motion_distances(library)
    figure = furniture_figure(library, distances, ["stoop-0", "idle-3"])
    view, cells = figure.axes[0], figure.axes[1]
    assert cells.get_title() == "chair"
    assert view.get_ylabel() == "stoop-0"
    colours, squares = cells.collections[:2]
    histograms = object_histograms(library.scenelets, ("chair",))
    around = charness_maps(distances[:1], histograms, np.ones(4))
    assert_allclose(np.ravel(colours.get_array()), around.ravel())
    own = histograms[0].ravel()
    assert_allclose(np.array(squares.get_sizes()) / squares.get_sizes().max(), own / own.max())
    assert not np.allclose(around, histograms[0])
    assert len(figure.axes) == 4
    assert min(png_size(figure)) > 100


def test_a_library_without_furniture_has_no_cells(library: Library) -> None:
    bare = Library("bare", tuple(s for s in library if not s.objects))
    figure = furniture_figure(bare, np.zeros((1, 1)))
    assert len(figure.axes) == 1
    assert min(png_size(figure)) > 100


def test_charness_by_action_the_highest_on_top(library: Library) -> None:
    figure = charness_figure(library, np.array([0.8, 0.9, 0.7, 0.1]))
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_yticklabels()] == ["idle (1)", "stoop (3)"]
    values = [np.array(c.get_offsets())[:, 0].tolist() for c in dots(figure, 0)]
    assert values == [[0.1], [0.7, 0.8, 0.9]]
    assert min(png_size(figure)) > 100


def test_typical_is_in_the_middle_of_its_action(library: Library) -> None:
    assert typical(library, motion_distances(library)) == ["stoop-1", "idle-3"]


def test_figures_are_repeatable_and_leave_pyplot_alone(library: Library) -> None:
    from matplotlib import pyplot

    distances = motion_distances(library)
    values = charness(library, distances)

    def picture() -> bytes:
        file = io.BytesIO()
        embedding_figure(library, distances, values).savefig(file, dpi=50)
        return file.getvalue()

    assert picture() == picture()
    assert pyplot.get_fignums() == []
