"""A person who walks about in front of a camera, made so that the truth is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.skeleton import NECK, PELV
from imapper_prob.solver.poses import LENGTHS, TREE, joints_of

Array = NDArray[np.float64]

CAMERA = Camera(1920, 1080, 1955.0, 1953.0, 960.0, 540.0, pitch=np.deg2rad(-4.0), elevation=1.5)
LIFTER_SCALE = 0.9
"""A lifter's body is not of the reference stature."""


@dataclass(frozen=True)
class Walk:
    """A clip, where the pelvis really is (T, 3) and all joints (T, 16, 3), camera frame."""

    clip: Clip
    pelvis: Array
    joints: Array

    @property
    def place(self) -> Array:
        """(T, 2) true bearing and log depth."""
        x, depth, _ = self.pelvis.T
        return np.stack([x / depth, np.log(depth)], -1)


def bones(n_frames: int) -> Array:
    """(T, 14, 3) bone vectors of a body that turns and swings its limbs."""
    t = np.arange(n_frames) / 10.0
    turn = 0.7 * np.sin(0.3 * t)
    side = np.stack([-np.cos(turn), -np.sin(turn), 0 * t], -1)
    ahead = np.stack([np.sin(turn), -np.cos(turn), 0 * t], -1)
    down = np.array([0.0, 0.0, -1.0])

    def limb(phase: float, swing: float) -> Array:
        angle = swing * np.sin(5.0 * t + phase)
        return np.sin(angle)[:, None] * ahead + np.cos(angle)[:, None] * down

    up = -np.broadcast_to(down, ahead.shape)
    by_bone = [
        side, limb(0.0, 0.4), limb(-0.6, 0.3), -side, limb(np.pi, 0.4), limb(np.pi - 0.6, 0.3),
        up, up, side, limb(np.pi, 0.3), limb(np.pi, 0.6), -side, limb(0.0, 0.3), limb(0.0, 0.6),
    ]  # fmt: skip
    assert len(by_bone) == len(TREE)
    return LENGTHS[:, None] * np.stack(by_bone, 1)


def walk(
    rng: np.random.Generator,
    *,
    n_frames: int = 120,
    pixel_error: float = 15.0,
    slow_error: tuple[float, float] = (0.0, 0.0),
    camera: Camera = CAMERA,
) -> Walk:
    """A walker seen by a detector with Gaussian errors.

    ``slow_error`` are the standard deviations (metres across, log metres along the ray) of
    an error that moves the whole body and forgets itself over 12 frames.
    """
    t = np.arange(n_frames) / 10.0
    depth = 4.5 + 1.2 * np.sin(0.35 * t)
    pelvis = np.stack([1.2 * np.sin(0.25 * t + 0.5), depth, -0.6 - 0.03 * depth], -1)
    offsets = joints_of(bones(n_frames))
    moved = pelvis.copy()
    slow = _forgetful(rng, n_frames, 2)
    moved[:, 0] += slow_error[0] * slow[:, 0]
    moved *= np.exp(slow_error[1] * slow[:, 1])[:, None]
    pixels = camera.project_camera(moved[:, None] + offsets)
    pixels = pixels + pixel_error * rng.standard_normal(pixels.shape)
    confidences = np.full(pixels.shape[:2], 0.9)
    confidences[:, [PELV, NECK]] = 0.0
    track = Track("walker", pixels, confidences, LIFTER_SCALE * offsets, np.zeros(n_frames, bool))
    clip = Clip("walk", camera, 10.0, np.arange(n_frames), (track,))
    return Walk(clip, pelvis, pelvis[:, None] + offsets)


def _forgetful(rng: np.random.Generator, n_frames: int, n: int) -> Array:
    """(T, n) stationary unit-variance series with correlation exp(-|s - t| / 12)."""
    keep = np.exp(-1 / 12)
    series = rng.standard_normal((n_frames, n))
    for i in range(1, n_frames):
        series[i] = keep * series[i - 1] + np.sqrt(1 - keep**2) * series[i]
    return series


def with_track(clip: Clip, **changes: object) -> Clip:
    """The clip with some fields of its only track replaced."""
    return replace(clip, tracks=(replace(clip.tracks[0], **changes),))  # type: ignore[arg-type]
