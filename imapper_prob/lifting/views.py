"""Looking straight at a person: each frame as a camera turned towards them would see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera

__all__ = ["Views", "views_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Views:
    """Frames of one track, seen along the ray to the person.

    Parameters
    ----------
    tangents : (T, 16, 2) float
        Detections right of and above that ray, tangents; 0 where there is none.
    weights : (T, 16) float
        How much each counts: its squared confidence, 0 where there is none.
    elevation : (T,) float
        Angle of the ray above the horizon, radians.
    axes : (T, 3, 3) float
        From view axes (x right and level, y along the ray's own direction on the floor,
        z up) to camera axes.
    """

    tangents: Array
    weights: Array
    elevation: Array
    axes: Array


def views_of(camera: Camera, keypoints: Array, confidences: Array) -> Views:
    """Turn the camera towards the person, frame by frame.

    Parameters
    ----------
    camera : Camera
        Its pitch and roll say where the horizon is.
    keypoints : (T, 16, 2) float
        Pixels; NaN where missing.
    confidences : (T, 16) float
        0 where missing.
    """
    weights = np.where(np.isfinite(keypoints).all(-1), confidences, 0.0) ** 2
    filled = np.where(weights[..., None] > 0, keypoints, (camera.cx, camera.cy))
    rays = camera.rays(filled) @ camera.rotation.T
    total = np.maximum(weights.sum(1), 1e-12)[:, None]
    forward = (weights[..., None] * rays).sum(1) / total
    forward = np.where((weights.max(1) > 0)[:, None], forward, camera.rotation[:, 1])
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    azimuth = np.arctan2(forward[:, 0], forward[:, 1])
    elevation = np.arcsin(np.clip(forward[:, 2], -1, 1))
    cos, sin, zero = np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)
    right = np.stack([cos, -sin, zero], -1)
    level = np.stack([sin, cos, zero], -1)
    up = np.cross(right, forward)
    depth = np.maximum(np.einsum("tjc,tc->tj", rays, forward), 1e-6)
    across = np.einsum("tjc,tc->tj", rays, right) / depth
    above = np.einsum("tjc,tc->tj", rays, up) / depth
    there = weights > 0
    vertical = np.broadcast_to([0.0, 0.0, 1.0], right.shape)
    axes = camera.rotation.T @ np.stack([right, level, vertical], -1)
    return Views(
        tangents=np.where(there[..., None], np.stack([across, above], -1), 0.0),
        weights=weights,
        elevation=elevation,
        axes=axes,
    )
