"""A recording of a run is the run: draws, positions and labels read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.log_posterior import motion
from imapper_prob.models.skeleton import PELV
from tests.recording.reading import Columns, read
from tests.runs import posterior


@pytest.fixture(scope="module")
def columns(tmp_path_factory: pytest.TempPathFactory) -> Columns:
    path = tmp_path_factory.mktemp("run") / "run.rrd"
    posterior().record(path)
    return read(path)


def test_draws_are_the_posterior_s(columns: Columns) -> None:
    run = posterior()
    chains, draws = run.samples.shape
    for c in range(chains):
        entity = f"/world/draws/chain_{c + 1}"
        centres = columns[f"{entity}/furniture", "Boxes3D:centers"]
        labels = columns[f"{entity}/names", "Points3D:labels"]
        paths = columns[f"{entity}/path", "LineStrips3D:strips"]
        assert list(centres) == list(labels) == list(paths) == list(range(draws))
        for n in range(draws):
            objects = run.samples.objects[c * draws + n]
            expected = pack_boxes(objects)[:, :3].astype(np.float32)
            assert np.array_equal(np.reshape(centres[n], (-1, 3)), expected)
            assert labels[n] == [o.label for o in objects]
    path = paths[draws - 1][0]
    last = motion(run.solution.problem, run.samples.states[-1])[:, PELV]
    assert np.array_equal(path, last.astype(np.float32))


def test_scenes_and_traces_are_the_posterior_s(columns: Columns) -> None:
    run = posterior()
    for i, weighted in enumerate(run.scenes(), 1):
        centres = columns[f"/world/scene_{i}/furniture", "Boxes3D:centers"][None]
        expected = pack_boxes(weighted.scene.objects)[:, :3].astype(np.float32)
        assert np.array_equal(np.reshape(centres, (-1, 3)), expected)
    for c, chain in enumerate(run.samples.log_posterior, 1):
        values = columns[f"/traces/log\\ posterior/chain_{c}", "Scalars:scalars"]
        assert np.array_equal(np.ravel(list(values.values())), chain)


def test_many_draws_are_thinned_evenly(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from imapper_prob.recording import posterior as module

    monkeypatch.setattr(module, "_MOST", 12)
    run = posterior()
    chains, draws = run.samples.shape
    run.record(tmp_path / "run.rrd")
    kept = list(read(tmp_path / "run.rrd")["/world/draws/chain_1/path", "LineStrips3D:strips"])
    assert len(kept) == 12 // chains
    assert (kept[0], kept[-1]) == (0, draws - 1)
