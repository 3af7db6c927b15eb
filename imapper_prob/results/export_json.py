"""One JSON of a scene, and of posterior draws, in the camera frame of the benchmark.

For programs that know neither our world nor our model: metres, x right, y down, z forward, the
camera at the origin. The fields are described in ``docs/results.md``.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from imapper_prob.files import written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import JOINTS
from imapper_prob.people import by_person
from imapper_prob.results.benchmark_axes import (
    intrinsics,
    object_axes,
    to_benchmark,
    yaw_in_camera,
)
from imapper_prob.results.drawn_motion import drawn_motion
from imapper_prob.results.posterior import Posterior

__all__ = ["evenly_spaced", "scene_document", "write_json"]

_FORMAT: Final = "imapper-prob scene 1"
_DECIMALS: Final = 5
"""A hundredth of a millimetre: less than a thousandth of a pixel."""


def write_json(
    path: Path, posterior: Posterior, *, scene: int | None = None, samples: int = 0
) -> None:
    """Write a scene, and draws beside it, as one JSON file.

    Parameters
    ----------
    path : path
        Written beside and renamed.
    posterior : Posterior
    scene : int, optional
        Which scene, 1 being the most probable; that of least expected loss if left out.
    samples : int
        How many draws, evenly spaced over the chains; their limbs and furniture differ from
        the scenelets' as far as the model says (:mod:`imapper_prob.results.drawn_motion`,
        :mod:`imapper_prob.results.drawn_objects`).

    Raises
    ------
    InputError
        If there are not so many scenes or draws.
    """
    document = scene_document(posterior, scene=scene, samples=samples)
    with written_whole(path) as beside:
        beside.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def scene_document(
    posterior: Posterior, *, scene: int | None = None, samples: int = 0
) -> dict[str, Any]:
    """What :func:`write_json` writes."""
    shown = None if scene is None else posterior.scene(scene)
    clip = posterior.clip
    document = {
        "format": _FORMAT,
        "frame": "camera: metres, x right, y down, z forward, the camera at the origin",
        "clip": clip.name,
        "fps": clip.fps,
        "image_size": [clip.camera.width, clip.camera.height],
        "joint_names": list(JOINTS),
        "scene": scene,
        "probability": None if shown is None else shown.probability,
        "probability_error": None if shown is None else _known(shown.error),
        **_body(posterior.estimate if shown is None else shown.scene, clip),
    }
    if samples:
        rng, problem = np.random.default_rng(posterior.config.seed), posterior.solution.problem
        document["samples"] = [
            _body(
                replace(
                    draw,
                    objects=posterior.furniture[n],
                    joints=drawn_motion(rng, problem, posterior.samples.states[n], draw.camera),
                ),
                clip,
            )
            for n in evenly_spaced(posterior, samples)
            for draw in [posterior.draw(n)]
        ]
    return document


def evenly_spaced(posterior: Posterior, count: int) -> list[int]:
    """Numbers of ``count`` draws, chain by chain as far apart as can be.

    Raises
    ------
    InputError
        If there are not so many.
    """
    total = posterior.samples.log_posterior.size
    if not 1 <= count <= total:
        raise InputError(f"{count} samples: the run has {total} draws; ask for 1 to {total}")
    numbers: list[int] = np.floor((np.arange(count) + 0.5) * total / count).astype(int).tolist()
    return numbers


def _body(scene: Scene, clip: Clip) -> dict[str, Any]:
    """Objects, joints and camera of one draw; of several people the joints of each by name."""
    camera = scene.camera
    people = {
        track.name: {
            str(frame): _listed(pose)
            for frame, pose in zip(clip.frame_ids.tolist(), joints, strict=True)
        }
        for track, joints in zip(
            clip.tracks, by_person(clip, to_benchmark(camera, scene.joints)), strict=True
        )
    }
    up = to_benchmark(camera, camera.centre + np.array([0.0, 0.0, 1.0]))
    return {
        "log_prob": _known(scene.log_posterior),
        "camera_matrix": _listed(intrinsics(camera)),
        "floor": {"up": _listed(up), "camera_height": round(camera.elevation, _DECIMALS)},
        "objects": [_object(scene, o) for o in scene.objects],
        "joints3d": people[clip.tracks[0].name],
        **({"actors": people} if len(people) > 1 else {}),
    }


def _object(scene: Scene, o: SceneObject) -> dict[str, Any]:
    camera, place = scene.camera, o.placement.apply
    low, high = o.bounds
    width, depth, height = (high - low).tolist()
    return {
        "label": o.label,
        "center": _listed(to_benchmark(camera, o.centre)),
        "size": _listed([width, height, depth]),
        "yaw": round(yaw_in_camera(camera, o), _DECIMALS),
        "axes": _listed(object_axes(camera, o)),
        "parts": [
            {
                "part": c.part,
                "center": _listed(to_benchmark(camera, place(c.centre))),
                "size": _listed(c.size[[0, 2, 1]]),
            }
            for c in o.cuboids
        ],
    }


def _listed(values: ArrayLike) -> Any:
    return np.round(np.asarray(values, float), _DECIMALS).tolist()


def _known(value: float) -> float | None:
    """JSON has no NaN."""
    return float(value) if np.isfinite(value) else None
