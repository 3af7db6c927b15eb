"""The path of a person in frames that no scenelet covers, and what is known of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.brief import brief
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import read_only
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["CAMERA", "CameraPrior", "StaticPath"]

Array = NDArray[np.float64]

CAMERA: Final = ("pitch", "elevation", "log_focal_scale", "log_body_scale", "roll")
"""The numbers of φ in their order: radians, metres, 1, 1, radians."""


@dataclass(frozen=True)
class StaticPath:
    """Where each frame alone puts the person, before any scenelet.

    The pelvis is described as the camera sees it, ``(bearing, log depth)`` with
    ``bearing = x / depth``, because nearly all uncertainty lies along the viewing ray and
    is relative: a walk of log depth treats near and far alike.

    Parameters
    ----------
    estimate : (T, 2) float
        Smoothed maximum a posteriori bearing (tangent) and log depth (depth in metres).
    lift : (T,) float
        Height of the pelvis above the optical axis over its depth (tangent), smoothed.
    deviation : (T, 2) float
        By how much bearing and log depth may be off, standard deviations; slow errors, about
        the same for seconds.
    poses : (T, 16, 3) float
        Joints relative to the pelvis in camera axes, metres, for a body of the reference
        stature; frames without a trustworthy pose are filled in.
    posed : (T,) bool
        Frames whose pose is their own.
    """

    estimate: Array
    lift: Array
    deviation: Array
    poses: Array
    posed: NDArray[np.bool_]

    __repr__ = brief

    def __post_init__(self) -> None:
        n = len(self.lift)
        for name, shape in (
            ("estimate", (n, 2)),
            ("lift", (n,)),
            ("deviation", (n, 2)),
            ("poses", (n, N_JOINTS, 3)),
        ):
            array = read_only(getattr(self, name), shape=shape, name=f"static path {name}")
            if not np.isfinite(array).all():
                raise InputError(f"static path: {name} is not finite")
            object.__setattr__(self, name, array)
        if np.any(self.deviation <= 0):
            raise InputError("static path: a deviation is not positive")

    @property
    def pelvis(self) -> Array:
        """(T, 3) pelvis in the camera frame, metres."""
        bearing, depth = self.estimate[:, 0], np.exp(self.estimate[:, 1])
        return np.stack([bearing * depth, depth, self.lift * depth], -1)

    @property
    def joints(self) -> Array:
        """(T, 16, 3) joints in the camera frame, metres."""
        return self.pelvis[:, None] + self.poses


@dataclass(frozen=True)
class CameraPrior:
    """Gaussian over the nuisance parameters φ of a clip.

    In the order of :data:`CAMERA`. The scales multiply the clip's nominal focal length and the
    reference stature.
    """

    mean: Array
    covariance: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        mean = read_only(self.mean, shape=(5,), name="camera prior mean")
        covariance = read_only(self.covariance, shape=(5, 5), name="camera prior covariance")
        if not np.all(np.linalg.eigvalsh(covariance) > 0):
            raise InputError("camera prior: covariance must be positive definite")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    @property
    def standard_deviations(self) -> Array:
        """(5,) standard deviations, units of ``mean``."""
        return np.sqrt(np.diag(self.covariance))
