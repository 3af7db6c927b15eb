"""A run on a dask cluster: a real scheduler and two real worker processes on this machine."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from imapper_prob.api import demo_clip
from imapper_prob.cli.main import main
from imapper_prob.clips.load import write_clip
from imapper_prob.models.scenelet import Library
from imapper_prob.scenelets.library import load_library, save_library

distributed = pytest.importorskip(
    "distributed", reason="dask's distributed is not installed: install the extra `cluster`"
)

BRIEF = (
    "[sample]\nsteps = 60\ndraws = 6\nchains = 2\ntemperatures = 2\n"
    "ensemble_layouts = 1\nensembles = 2\nensemble_steps = 2\n"
)


def run(folder: Path, out: str, *more: str) -> bytes:
    arguments = ["run", str(folder / "clip.npz"), "--library", str(folder / "part.npz")]
    settings = ["--config", str(folder / "brief.toml"), "--workers", "1"]
    assert main([*arguments, *settings, "-o", str(folder / out), *more]) == 0
    return (folder / out / "scenes.json").read_bytes()


@pytest.mark.slow
def test_a_run_on_a_cluster_draws_what_a_run_here_does(tmp_path: Path) -> None:
    write_clip(tmp_path / "clip.npz", demo_clip())
    save_library(Library("part", tuple(load_library())[::8]), tmp_path / "part.npz")
    (tmp_path / "brief.toml").write_text(BRIEF)
    with distributed.LocalCluster(
        processes=True,
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        there = run(tmp_path, "there", "--cluster", cluster.scheduler_address)
    assert there == run(tmp_path, "here")


def test_nobody_at_the_address_is_said_plainly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("imapper_prob.sampling.sample._PATIENCE", "200ms")
    write_clip(tmp_path / "clip.npz", demo_clip())
    arguments = ["run", str(tmp_path / "clip.npz"), "-o", str(tmp_path / "out")]
    assert main([*arguments, "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "tcp://127.0.0.1:9: no dask scheduler answers there" in capsys.readouterr().err
