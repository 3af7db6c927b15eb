"""Figures of a run: there, and drawn from its numbers."""

from __future__ import annotations

import io

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from imapper_prob.models.skeleton import PELV
from imapper_prob.results import figures
from imapper_prob.uncertainty.clusters import names_of
from tests.runs import posterior


@pytest.mark.parametrize("name", [n for n in figures.__all__ if n != "energy_figure"])
def test_every_figure_can_be_drawn_and_leaves_no_other(name: str) -> None:
    run = posterior()
    figure = getattr(figures, name)(run.clip if name == "clip_figure" else run)
    assert isinstance(figure, Figure)
    out = io.BytesIO()
    figure.savefig(out, dpi=40)
    assert out.tell() > 5000
    assert plt.get_fignums() == []


def test_scenes_stand_side_by_side_with_their_probabilities() -> None:
    run = posterior()
    figure = figures.scenes_figure(run, 3)
    scenes = run.scenes(3)
    assert len(figure.axes) == len(scenes)
    for axes, weighted in zip(figure.axes, scenes, strict=True):
        assert f"{weighted.probability:.2f} ±" in axes.get_title()
        names = sorted(text.get_text() for text in axes.texts)
        assert names == sorted(o.label for o in weighted.scene.objects)


def test_the_person_is_where_the_posterior_has_it() -> None:
    run = posterior()
    depth = figures.person_figure(run).axes[0]
    mean = run.joints().mean[:, PELV, 1]
    np.testing.assert_allclose(depth.lines[0].get_ydata(), mean)


def test_names_of_the_map_are_those_of_the_clusters() -> None:
    run = posterior()
    axes = figures.floor_figure(run).axes[1]
    legend = axes.get_legend()
    assert legend is not None
    written = [text.get_text() for text in axes.texts]
    told = [text.get_text() for text in legend.get_texts()]
    clusters = run.clusters()
    for cluster, name, entry in zip(clusters, names_of(clusters), told, strict=False):
        assert entry.startswith(f"{name}, p = {cluster.presence:.2f}")
        assert (name in written) == (cluster.presence >= 0.2)
