"""The folder of ``imapper-prob solve`` as a prediction."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imapper_prob.evaluate.prediction import Prediction, prediction_of_scene
from imapper_prob.inputs.archives import load_archive
from imapper_prob.inputs.json_fields import field, load_json
from imapper_prob.inputs.sightings import FARTHEST
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Cuboid, Placement, Scene, SceneObject
from imapper_prob.results.solution_file import FORMAT, VERSION

__all__ = ["SOLVER", "is_solution", "read_solution_folder"]

SOLVER = "staged solver"
"""Heads the row of the deterministic solution."""


def is_solution(folder: Path) -> bool:
    """Whether a folder holds a staged solution."""
    return (folder / "solution.json").is_file()


def read_solution_folder(folder: Path, clip: Clip) -> Prediction:
    """The best scene of the staged solver, with the motion of the first actor.

    Raises
    ------
    InputError
        If the files are damaged, or of another clip.
    """
    path = folder / "solution.json"
    data = load_json(path)
    if (
        not isinstance(data, Mapping)
        or data.get("format") != FORMAT
        or data.get("version") != VERSION
    ):
        raise InputError(f"{path}: is no solution of this version; solve the clip again")
    if data.get("clip") != clip.name:
        raise InputError(f"{path}: is of the clip {data.get('clip')!r}, not of {clip.name}")
    scenes = field(path, data, "scenes")
    try:
        joints = load_archive(folder / "solution.npz", what="solution")["actor0/joints"][0]
        if np.isinf(joints).any() or (np.abs(joints) > FARTHEST).any():
            raise ValueError("joints are no metres")
        best = scenes[0]
        objects = tuple(_object(o) for o in best["objects"])
        scene = Scene(Camera(**best["camera"]), objects, joints, (), float(best["log_posterior"]))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: damaged solution ({error}); solve the clip again") from error
    return prediction_of_scene(scene, name=SOLVER)


def _object(values: Mapping[str, Any]) -> SceneObject:
    x, y = values["position"]
    cuboids = tuple(
        Cuboid(c["part"], np.array(c["centre"]), np.array(c["size"])) for c in values["cuboids"]
    )
    return SceneObject(values["label"], Placement(x, y, values["yaw"]), cuboids)
