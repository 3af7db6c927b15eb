"""The recording inside a notebook."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from imapper_prob.models.errors import InputError
from imapper_prob.recording.video import recording_widget


def test_the_widget_needs_no_network(tmp_path: Path) -> None:
    pytest.importorskip("rerun_notebook", reason="rerun-notebook is not installed")
    recording = tmp_path / "a.rrd"
    recording.write_bytes(b"RRF2")
    # In a process of its own: where the viewer comes from is settled at the first import.
    program = (
        "import sys; from imapper_prob.recording.video import recording_widget;"
        "viewer = recording_widget(sys.argv[1]);"
        "import urllib.request;"
        "assert '://localhost:' in viewer._esm, viewer._esm;"
        "assert len(urllib.request.urlopen(viewer._esm).read()) > 1000"
    )
    environment = {k: v for k, v in os.environ.items() if k != "RERUN_NOTEBOOK_ASSET"}
    done = subprocess.run(
        [sys.executable, "-c", program, str(recording)],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_what_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"a\.rrd: no such recording"):
        recording_widget(tmp_path / "a.rrd")
    (tmp_path / "a.rrd").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    with pytest.raises(InputError, match="needs rerun-notebook"):
        recording_widget(tmp_path / "a.rrd")
