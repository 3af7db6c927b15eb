"""What do the i3DB scenes say of the constants, and do the estimators find what they are told?

    python -m lab.calibrate I3DB_FOLDER [--write] [--clips 60]

prints each constant in use, as measured, with its error and its value without each of the scenes,
and the value estimated from simulated clips beside the one they were drawn with. It then compares
the static path, made with constants estimated from the *other* scenes, with the truth. With
``--write`` the values go to ``models/calibrated.toml`` and the table to
``docs/research/calibration.md``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from imapper_prob.clips.i3db import read_i3db, read_i3db_truth
from imapper_prob.files import written_whole
from imapper_prob.models.calibrated import FOLDS, PATH, Number
from imapper_prob.models.scene import Clip, Truth
from imapper_prob.models.skeleton import PELV, SCORED
from imapper_prob.scenelets.library import load_library
from imapper_prob.solver.static_path import estimate_static_path
from lab.calibrate import as_markdown, as_toml, calibrate, in_use, recover, without
from lab.calibrate.evidence import path_settings
from lab.calibrate.procedure import rounded

DOCUMENT = Path(__file__).parents[2] / "docs" / "research" / "calibration.md"
MARK = "<!-- written by python -m lab.calibrate -->\n"
"""The table in the document is between two of these lines."""
SIMULATED_CLIPS = 60


def path_error(clip: Clip, truth: Truth, values: dict[str, Number]) -> tuple[float, float]:
    """Root mean square errors in cm of the pelvis in top view and of the joints."""
    path = estimate_static_path(clip, settings=path_settings(values))
    known = np.isfinite(truth.joints).all((1, 2))
    gap = 100 * (truth.camera.to_camera(truth.joints[known]) - path.joints[known])
    pelvis = np.sqrt((gap[:, PELV, :2] ** 2).sum(-1).mean())
    joints = np.sqrt((gap[:, list(SCORED)] ** 2).sum(-1).mean())
    return float(pelvis), float(joints)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the constants, and write them if asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", type=Path, help="folder of the four i3DB scenes")
    parser.add_argument("--write", action="store_true", help="the file and the table")
    parser.add_argument("--clips", type=int, default=SIMULATED_CLIPS, help="that are simulated")
    options = parser.parse_args(arguments)
    folder = options.scenes
    names = sorted(p for p in folder.iterdir() if (p / "gt").is_dir())
    if tuple(name.name for name in names) != FOLDS:
        raise SystemExit(f"{folder}: has other scenes than the folds {', '.join(FOLDS)}")
    clips = [read_i3db(name) for name in names]
    scenes = [(clip, read_i3db_truth(name, clip)) for name, clip in zip(names, clips, strict=True)]
    library = load_library()
    found = calibrate(scenes, library)
    rng = np.random.default_rng(0)
    told = recover(rng, library, in_use(found), n_clips=options.clips)
    for name, (known, estimated) in told.items():
        found[name] = replace(found[name], recovered=(rounded(known), rounded(estimated)))
    table = as_markdown(found)
    sys.stdout.write(table + "\nstatic path, constants from the other scenes (from all):\n")
    errors = []
    for k, (clip, truth) in enumerate(scenes):
        own, all_four = (
            path_error(clip, truth, values) for values in (without(found, k), in_use(found))
        )
        errors.append((*own, *all_four))
        sys.stdout.write(line(clip.name, *errors[-1]))
    sys.stdout.write(line("mean", *np.mean(errors, axis=0)))
    if options.write:
        heading = (
            "Written by `python -m lab.calibrate I3DB_FOLDER --write`; see",
            "docs/research/calibration.md. Folds leave out, in this order: "
            + ", ".join(clip.name for clip in clips) + ".",
        )  # fmt: skip
        before, _, after = DOCUMENT.read_text(encoding="utf-8").split(MARK)
        texts = {PATH: as_toml(found, heading=heading), DOCUMENT: MARK.join((before, table, after))}
        for path, text in texts.items():
            with written_whole(path) as beside:
                beside.write_text(text, encoding="utf-8")


def line(name: str, pelvis: float, joints: float, pelvis_all: float, joints_all: float) -> str:
    return (
        f"{name}: pelvis {pelvis:.1f} ({pelvis_all:.1f}) cm, "
        f"joints {joints:.1f} ({joints_all:.1f}) cm\n"
    )


if __name__ == "__main__":
    main()
