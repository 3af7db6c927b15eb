"""Every name that the program exports has an example, and the examples are true."""

from __future__ import annotations

import doctest
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

import imapper_prob as im
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scene import Scene, SceneObject
from imapper_prob.results.folders import write_run
from imapper_prob.results.solution import plot_charness
from imapper_prob.uncertainty.clusters import ObjectCluster
from imapper_prob.uncertainty.occupancy import Occupancy
from imapper_prob.uncertainty.scenes import WeightedScene
from tests.test_docstrings import top_level_names

DRAWN = (
    ObjectCluster.plot, Occupancy.plot, Scene.plot, SceneObject.plot, WeightedScene.plot,
    plot_charness,
)  # fmt: skip
"""What draws results that the program does not export by name."""
_OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def _names(folder: Path) -> dict[str, Any]:
    """What examples may use besides what they make: half the demo, a twentieth of the library."""
    clip, library = first_part(im.demo_clip(), 0.5), im.load_library()
    library = im.Library("few", tuple(library)[::20])
    config = im.Config()
    sample = replace(
        config.sample, chains=2, steps=100, draws=10, temperatures=2, ensemble_steps=2,
    )  # fmt: skip
    config = replace(config, sample=sample)
    solved = im.solve(clip, library)
    posterior = im.sample(clip, library, start=solved, config=config)
    write_run(folder / "run", posterior, overwrite=False)
    return {
        "im": im, "clip": clip, "library": library, "config": config, "solved": solved,
        "posterior": posterior,
    }  # fmt: skip


def test_examples_of_what_is_exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names, wrong = _names(tmp_path), []
    monkeypatch.chdir(tmp_path)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=_OPTIONS)
    for name, entry in top_level_names():
        example = parser.get_doctest(entry.__doc__ or "", dict(names), name, None, 0)
        if not example.examples:
            wrong.append(f"{name} has no example")
        runner.run(example, out=wrong.append, clear_globs=False)
    for entry in DRAWN:
        drawn = {**names, entry.__name__: entry}
        example = parser.get_doctest(entry.__doc__ or "", drawn, entry.__qualname__, None, 0)
        runner.run(example, out=wrong.append, clear_globs=False)
    plt.close("all")
    assert wrong == [], "\n".join(wrong)
