"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# No window is ever opened, and the same examples are tried everywhere.
os.environ.setdefault("MPLBACKEND", "Agg")
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]
CORPUS = ROOT.parent / "shared" / "i3db"
SCENES = ("Scene04", "Scene10", "Scene13", "Scene14")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20190708)


@pytest.fixture(params=SCENES)
def i3db_scene(request: pytest.FixtureRequest) -> Path:
    """The folder of one scene of the benchmark, each in turn."""
    folder = CORPUS / str(request.param)
    if not folder.is_dir():
        pytest.skip(f"the i3DB scenes are not at {CORPUS}")
    return folder
