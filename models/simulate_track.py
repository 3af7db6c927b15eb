"""What a detector and a lifter say of a motion, drawn from the model."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.camera import Camera
from imapper_prob.models.energy.detections import DetectionModel
from imapper_prob.models.energy.swaps import draw_swaps
from imapper_prob.models.scene import Track
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.simulate_room import in_image
from imapper_prob.models.skeleton import DETECTED, HEAD, LHIP, MIRROR, NECK, PELV, RHIP, THRX

__all__ = ["simulate_track"]

Array = NDArray[np.float64]

LIFT_SCALE: Final = 1 / 1.06
LIFT_SCALE_SPREAD: Final = 0.03
"""Lifted skeletons are 6 % too small (measured on i3DB)."""

LIFT_NOISE_SEEN: Final = 0.04
LIFT_NOISE_HIDDEN: Final = 0.12
"""Metres a joint and axis by which a lifter errs: seen joints as MediaPipe's 8 cm in space,
hidden ones three times that."""

LIFT_MEMORY: Final = 1.0
"""Seconds over which a lifter's errors forget themselves (residuals on i3DB: 11-13 frames)."""

LOSS_STARTS: Final = 0.10
LOSS_STARTS_HIDDEN: Final = 1.0
LOSS_ENDS: Final = 3.0
"""Rates a second at which a detector loses the person in full view, loses somebody of whom
most joints are hidden, and finds them again."""


def simulate_track(
    rng: np.random.Generator,
    joints: Array,
    hidden: NDArray[np.bool_],
    *,
    camera: Camera,
    fps: float,
    name: str = "actor",
    detections: DetectionModel | None = None,
    settings: ModelSettings | None = None,
) -> Track:
    """What a detector and a lifter say of a motion.

    Detections are drawn from the detection model where the joint falls into the image;
    elsewhere there are none. PELV and NECK are synthesised from the detections, with
    confidence 0. In runs of frames the person is lost altogether, in others left and right
    are swapped, as the model says.

    Parameters
    ----------
    rng : numpy.random.Generator
    joints : (T, 16, 3) float
        True joints in the world, metres.
    hidden : (T, 16) bool
        Which of them furniture hides.
    camera : Camera
        The true one.
    fps : float
        Frames a second.
    name : str
        Of the track.
    detections : DetectionModel, optional
        The tables; those measured on i3DB if not given.
    settings : ModelSettings, optional
        How often and how long left and right are swapped.
    """
    model = detections or DetectionModel()
    keypoints, confidences = model.draw(
        rng, camera.project(joints), hidden, image_height=camera.height
    )
    poses = _lifted(rng, joints, hidden, camera=camera, fps=fps)
    missing = ~in_image(camera, joints)
    missing[_lost(rng, hidden | missing, fps=fps)] = True
    missing[:, [PELV, NECK]] = True
    confidences = np.where(missing, 0.0, confidences)
    keypoints = np.where(missing[..., None], np.nan, keypoints)
    keypoints[:, PELV] = (keypoints[:, RHIP] + keypoints[:, LHIP]) / 2
    keypoints[:, NECK] = (keypoints[:, THRX] + keypoints[:, HEAD]) / 2
    poses[missing.all(1)] = np.nan
    constants = settings or ModelSettings()
    swapped = draw_swaps(
        rng,
        len(joints),
        begins=constants.swap_rate / fps,
        ends=1 / (constants.swap_length * fps),
    )
    for values in (keypoints, confidences, poses):
        values[swapped] = values[swapped][:, list(MIRROR)]
    return Track(name, keypoints, confidences, poses, np.zeros(len(joints), bool))


def _lost(rng: np.random.Generator, hidden: NDArray[np.bool_], *, fps: float) -> NDArray[np.bool_]:
    """(T,) frames in which the detector has lost the person: a chain of two states."""
    share = hidden[:, list(DETECTED)].mean(1)
    starts = (LOSS_STARTS + LOSS_STARTS_HIDDEN * (share > 0.5)) / fps
    uniform = rng.random(len(hidden))
    lost = np.zeros(len(hidden), bool)
    for t in range(1, len(hidden)):
        lost[t] = uniform[t] < starts[t] or (lost[t - 1] and uniform[t] > LOSS_ENDS / fps)
    return lost


def _lifted(
    rng: np.random.Generator,
    joints: Array,
    hidden: NDArray[np.bool_],
    *,
    camera: Camera,
    fps: float,
) -> Array:
    """(T, 16, 3) poses of a lifter: camera axes, about the pelvis, too small, and noisy."""
    true = camera.to_camera(joints)
    relative = true - true[:, PELV : PELV + 1]
    keep = np.exp(-1 / (LIFT_MEMORY * fps))
    shocks = rng.standard_normal(relative.shape)
    noise = np.empty_like(shocks)
    noise[0] = shocks[0]
    for t in range(1, len(noise)):
        noise[t] = keep * noise[t - 1] + np.sqrt(1 - keep**2) * shocks[t]
    spread = np.where(hidden, LIFT_NOISE_HIDDEN, LIFT_NOISE_SEEN)[..., None]
    poses: Array = LIFT_SCALE * np.exp(rng.normal(0.0, LIFT_SCALE_SPREAD)) * relative
    poses += spread * noise
    poses[:, NECK] = (poses[:, THRX] + poses[:, HEAD]) / 2
    return poses - poses[:, PELV : PELV + 1]
