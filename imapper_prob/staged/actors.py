"""Several people before one camera: each solved by itself, in one world.

A window, a path, a smooth motion belong to one actor, so every actor has a log-posterior of
their own. What they share is the camera: its pose, height and focal length are estimated from
everybody's feet, so that furniture found by one stands in the world of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from imapper_prob.models.camera import Camera
from imapper_prob.models.path import CameraPrior
from imapper_prob.models.scene import Clip
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, Settings
from imapper_prob.staged.calibration import estimate_camera
from imapper_prob.staged.elsewhere import own_detections
from imapper_prob.staged.solver import Solution, solve
from imapper_prob.staged.static_path import estimate_static_path

__all__ = ["share_camera", "solve_actors"]

Progress = Callable[[str, float], None]

_SHARED, _BODY = [0, 1, 2, 4], 3
"""Places in a camera prior of what the camera is, and of what is each actor's own."""


def solve_actors(
    clip: Clip,
    library: Library,
    *,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> tuple[Solution, ...]:
    """Solve every track of a clip, all with the same camera; parameters as of `solve`.

    The solutions are in the order of the tracks; the clip of each has that track only.
    """
    clips = [replace(clip, tracks=(track,)) for track in clip.tracks]
    if len(clips) == 1:
        return (solve(clip, library, settings=settings, progress=progress),)
    settings = settings or Settings()
    own = [
        estimate_camera(
            own_detections(c),
            estimate_static_path(
                c, settings=settings.path, published=settings.model.energy == "paper"
            ),
            settings=settings.camera,
            detector=settings.detector,
        )
        for c in clips
    ]
    cameras = share_camera(
        own,
        nominal=clip.camera,
        focal_spread=clip.focal_spread,
        settings=settings.camera,
    )

    def named(actor: str) -> Progress | None:
        if progress is None:
            return None
        return lambda stage, part: progress(f"{actor}: {stage}", part)

    return tuple(
        solve(c, library, settings=settings, camera=camera, progress=named(c.tracks[0].name))
        for c, camera in zip(clips, cameras, strict=True)
    )


def share_camera(
    own: Sequence[CameraPrior],
    *,
    nominal: Camera,
    focal_spread: float,
    settings: CameraSettings | None = None,
) -> tuple[CameraPrior, ...]:
    """What everybody's feet together say of the camera, and what that says of each body.

    Each actor's estimate is the camera's prior and what their feet saw; the prior counts
    once. With the elevation as a logarithm all of it is Gaussian and precisions add up. A
    body's scale is what its own estimate says, given the camera that all agreed on.

    Parameters
    ----------
    own : sequence of CameraPrior
        Of each actor, as `estimate_camera` gives it.
    nominal : Camera
        The clip's; the prior is about it.
    focal_spread : float
        The clip's, by how much its focal length may be wrong.
    settings : CameraSettings, optional
        Those the estimates were made with.
    """
    settings = settings or CameraSettings()
    prior = np.diag(
        np.array([settings.pitch, settings.log_elevation, focal_spread, settings.roll]) ** -2.0
    )
    centre = np.array([nominal.pitch, np.log(nominal.elevation), 0.0, nominal.roll])
    information, pull = prior.copy(), prior @ centre
    actors = [_with_log_elevation(camera) for camera in own]
    for mean, covariance in actors:
        precision = np.linalg.inv(covariance[np.ix_(_SHARED, _SHARED)])
        information += precision - prior
        pull += precision @ mean[_SHARED] - prior @ centre
    agreed = np.linalg.inv(information)
    camera = agreed @ pull
    return tuple(_given(mean, covariance, camera, agreed) for mean, covariance in actors)


def _with_log_elevation(camera: CameraPrior) -> tuple[np.ndarray, np.ndarray]:
    mean = np.array(camera.mean)
    to_log = np.diag([1.0, 1.0 / mean[1], 1.0, 1.0, 1.0])
    mean[1] = np.log(mean[1])
    return mean, to_log @ camera.covariance @ to_log


def _given(
    mean: np.ndarray, covariance: np.ndarray, camera: np.ndarray, agreed: np.ndarray
) -> CameraPrior:
    """An actor's five numbers once the four shared ones are known better."""
    gain = covariance[_BODY, _SHARED] @ np.linalg.inv(covariance[np.ix_(_SHARED, _SHARED)])
    alone = covariance[_BODY, _BODY] - gain @ covariance[_SHARED, _BODY]
    new_mean, new = np.zeros(5), np.zeros((5, 5))
    new_mean[_SHARED] = camera
    new_mean[_BODY] = mean[_BODY] + gain @ (camera - mean[_SHARED])
    new[np.ix_(_SHARED, _SHARED)] = agreed
    new[_BODY, _SHARED] = new[_SHARED, _BODY] = gain @ agreed
    new[_BODY, _BODY] = alone + gain @ agreed @ gain
    elevation = np.exp(new_mean[1])
    to_metres = np.diag([1.0, elevation, 1.0, 1.0, 1.0])
    new_mean[1] = elevation
    return CameraPrior(new_mean, to_metres @ new @ to_metres)
