"""The prior of camera and body: a Laplace approximation given the feet of the static path.

Five parameters are estimated: pitch, roll and elevation of the camera, and the factors of focal
length and stature. The feet of a person who walks about determine the floor, and so the elevation.
They determine pitch and roll only through the change of the floor's height with depth and across
the view; this is weak, and correlated with the elevation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.special import beta, ndtr

from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel, DetectorSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.path_prior import CameraPrior, StaticPath, within_support
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.settings import CameraSettings, ModelSettings
from imapper_prob.models.skeleton import LANK, LHIP, LKNE, RANK, RHIP, RKNE, thigh_angle

__all__ = ["estimate_camera", "find_stays", "thigh_signs"]

Array = NDArray[np.float64]
_SECONDS: Final = 1.0
"""Window in seconds of the running median of angles; people do not sit down and get up within
it."""
_THIGHS: Final = [RHIP, RKNE, LHIP, LKNE]


def thigh_signs(
    track: Track, path: StaticPath, camera: CameraPrior, *, fps: float
) -> tuple[Array, Array]:
    """Angle of the thighs to the vertical, and the confidence of their joints.

    Nobody walks, stands or reaches with both thighs horizontal. The angle is the mean of both legs
    and a running median over a second; its evidence is calibrated on i3DB (``support.angle`` and
    ``support.slope`` in ``docs/research/calibration.md``).

    Parameters
    ----------
    track : Track
    path : StaticPath
    camera : CameraPrior
    fps : float
        Frames per second.

    Returns
    -------
    angle : (T,) float
        Radians from the vertical, in the world of the mean camera.
    seen : (T,) float
        Mean confidence of hips and knees, in [0, 1].
    """
    pitch, roll = float(camera.mean[0]), float(camera.mean[4])
    level = Camera(1, 1, 1.0, 1.0, 0.0, 0.0, pitch=pitch, roll=roll)
    window = 2 * round(_SECONDS * fps / 2) + 1
    angle = median_filter(thigh_angle(level.to_world(path.poses)), size=window, mode="nearest")
    seen = uniform_filter1d(track.confidences[:, _THIGHS].mean(1), window, mode="nearest")
    return angle, np.clip(seen, 0.0, 1.0)


def find_stays(
    track: Track,
    path: StaticPath,
    camera: CameraPrior,
    *,
    fps: float,
    settings: ModelSettings | None = None,
) -> Array:
    """Find the stays of a person, see :func:`imapper_prob.models.kernels.stays.unsupported`.

    Parameters
    ----------
    track : Track
    path : StaticPath
    camera : CameraPrior
    fps : float
        Frames per second.
    settings : ModelSettings, optional

    Returns
    -------
    (K, 3) float
        First frame, frame after the last, and evidence in nats for being supported.
    """
    settings = settings or ModelSettings()
    angle, seen = thigh_signs(track, path, camera, fps=fps)
    weight = min(1.0, 1.0 / (settings.support_time * fps))
    nats = weight * seen * settings.support_slope * (angle - settings.support_angle)
    low = np.concatenate([[False], angle > settings.support_angle, [False]])
    edges = np.flatnonzero(low[1:] != low[:-1]).reshape(-1, 2)
    stays = [(first, end, nats[first:end].sum()) for first, end in edges.tolist()]
    result = np.array([stay for stay in stays if stay[2] > 0.0], dtype=np.float64)
    return result.reshape(-1, 3)


# ------------------------------------------------------------------------------------------------
# The prior.

_LEVEL: Final = 0.175
"""Height of the pelvis above the lower ankle in metres, below which the person lies or sits
cross-legged. In the built-in library those have at most .15, and people on their feet, on a seat or
on their knees at least .2; on i3DB nobody has less than .33."""
_LEVEL_ERROR: Final = 0.10
"""Standard deviation of that height in a fitted pose, metres: of pelvis and ankle with the
error ``pose.tolerance`` each."""
_EITHER: Final = 0.5
"""Probability that such a person is on furniture: .57 of such frames in the built-in library."""
_HIGHEST: Final = 1.0
"""Largest height in metres of feet on furniture: above any seat, bed or table."""
_SOME: Final = 0.1
"""Probability of being on furniture above which a second mode is searched for."""
_STARTS: Final = (0.05, 0.5, 0.95)
"""Quantiles of ankle heights; each is taken for the floor in one search of the mode."""


def estimate_camera(
    clip: Clip,
    path: StaticPath,
    *,
    settings: CameraSettings | None = None,
    detector: DetectorSettings | None = None,
) -> CameraPrior:
    """Gaussian approximation of the posterior of camera and body, given the feet.

    A body twice as large at twice the distance, or with half the focal length, looks the same. So a
    focal scale f and a body scale b map a point (x, y, z) of the static path to (b x, f b y, b z),
    and the lowest ankle of a frame is at height

        elevation + f b sin(pitch) y + b cos(pitch) (sin(roll) x + cos(roll) z),

    which should be that of an ankle above the floor, up to a constant offset. If both ankles are
    level with the pelvis, the person lies or sits on the floor or on furniture. Such an ankle may
    be anywhere above the floor (a mixture of a Student-t and a uniform density). The mode is found
    by Gauss-Newton in log elevation, which keeps the camera above the floor, and then the Laplace
    approximation is made.

    Parameters
    ----------
    clip : Clip
        The pose of its camera is the mean of the prior; it also gives the error of the focal
        length. Its first track is that of the person.
    path : StaticPath
        Static path of that person.
    settings : CameraSettings, optional
    detector : DetectorSettings, optional
        Determines below which confidence a foot counts as hidden.

    Returns
    -------
    CameraPrior
        Includes the correlation of pitch and elevation.

    Raises
    ------
    InputError
        The path is of another clip.
    """
    settings = settings or CameraSettings()
    if len(path.lift) != clip.n_frames:
        raise InputError(
            f"clip {clip.name} has {clip.n_frames} frames, the static path {len(path.lift)}; "
            "estimate the path from this clip"
        )
    feet = _feet(clip, path, settings, DetectionModel.of(detector or DetectorSettings()))
    mode = _mode(feet)
    # The robust weights average 1 / spread^2, but the Fisher information of a Student-t observation
    # about its centre is only (dof + 1) / (dof + 3) of that.
    told = (settings.ankle_dof + 1) / (settings.ankle_dof + 3)
    information = told * feet.information(mode) + np.diag(feet.prior_spread**-2)
    covariance = np.linalg.inv(information)[:5, :5]
    pitch, log_elevation, log_focal, log_body, roll, _ = mode
    elevation = np.exp(log_elevation)
    to_metres = np.diag([1.0, elevation, 1.0, 1.0, 1.0])
    return CameraPrior(
        mean=within_support(np.array([pitch, elevation, log_focal, log_body, roll])),
        covariance=to_metres @ covariance @ to_metres,
    )


@dataclass(frozen=True)
class _Feet:
    """Posterior of (6,): pitch, log elevation, log focal, log body, roll and ankle offset.

    ``right``, ``depth`` and ``up`` (T,) are camera coordinates of the lowest ankle in metres of the
    static path. ``weight`` is that of each frame, and ``held`` the probability that the feet are on
    furniture.
    """

    right: Array
    depth: Array
    up: Array
    weight: Array
    held: Array
    prior_mean: Array
    prior_spread: Array
    settings: CameraSettings

    def errors(self, state: Array) -> Array:
        """(T,) expected minus observed height, in metres of the reference body.

        The errors are those of the observation. In metres of the scaled body, a smaller body would
        make all errors smaller and seem to fit better.
        """
        pitch, _, log_focal, _, roll, _ = state
        level = np.sin(roll) * self.right + np.cos(roll) * self.up
        upward = np.sin(pitch) * np.exp(log_focal) * self.depth + np.cos(pitch) * level
        result: Array = self._floor(state) - upward
        return result

    def _floor(self, state: Array) -> float:
        """Height of a standing ankle above the camera, in metres of the reference body."""
        _, log_elevation, _, log_body, _, offset = state
        return float((self.settings.ankle + offset - np.exp(log_elevation)) * np.exp(-log_body))

    def slopes(self, state: Array) -> Array:
        """(T, 6) derivative of ``errors``."""
        pitch, log_elevation, log_focal, log_body, roll, _ = state
        level = np.sin(roll) * self.right + np.cos(roll) * self.up
        across = np.cos(roll) * self.right - np.sin(roll) * self.up
        forward = np.exp(log_focal) * self.depth
        same = np.ones_like(self.depth)
        columns = (
            np.sin(pitch) * level - np.cos(pitch) * forward,
            -np.exp(log_elevation - log_body) * same,
            -np.sin(pitch) * forward,
            -self._floor(state) * same,
            -np.cos(pitch) * across,
            np.exp(-log_body) * same,
        )
        return np.stack(columns, -1)

    def _densities(self, state: Array) -> tuple[Array, Array]:
        """(T,) densities, 1/m, of the errors of feet on the floor and of feet on furniture."""
        dof, spread, errors = (
            self.settings.ankle_dof,
            self.settings.ankle_spread,
            self.errors(state),
        )
        peak = 1 / (spread * np.sqrt(dof) * beta(dof / 2, 0.5))
        on_floor = (1 - self.held) * peak * (1 + (errors / spread) ** 2 / dof) ** (-(dof + 1) / 2)
        on_furniture = self.held * ((errors > -_HIGHEST) & (errors < 0)) / _HIGHEST
        return on_floor, on_furniture

    def _robust_weights(self, state: Array) -> Array:
        dof, spread = self.settings.ankle_dof, self.settings.ankle_spread
        on_floor, on_furniture = self._densities(state)
        weight = self.weight * on_floor / (on_floor + on_furniture)
        result: Array = weight * (dof + 1) / (dof * spread**2 + self.errors(state) ** 2)
        return result

    def cost(self, state: Array) -> float:
        """Negative log-posterior up to a constant, nats."""
        on_floor, on_furniture = self._densities(state)
        prior = ((state - self.prior_mean) / self.prior_spread) ** 2
        return float(-(self.weight * np.log(on_floor + on_furniture)).sum() + 0.5 * prior.sum())

    def information(self, state: Array) -> Array:
        """(6, 6) Gauss-Newton Hessian of the feet's evidence, without the prior."""
        slopes = self.slopes(state)
        result: Array = (slopes * self._robust_weights(state)[:, None]).T @ slopes
        return result

    def step(self, state: Array) -> Array:
        """(6,) Gauss-Newton step towards the mode."""
        pull = -self.slopes(state).T @ (self._robust_weights(state) * self.errors(state))
        pull += (self.prior_mean - state) / self.prior_spread**2
        hessian = self.information(state) + np.diag(self.prior_spread**-2)
        return np.asarray(np.linalg.solve(hessian, pull), np.float64)


def _mode(feet: _Feet) -> Array:
    """The best mode found from the prior mean and from several heights of the floor.

    If feet are on furniture, there is a second mode in which they are on the floor.
    """
    upward = feet.settings.ankle - np.exp(feet.prior_mean[1]) - feet.errors(feet.prior_mean)
    starts = [feet.prior_mean]
    heights = feet.settings.ankle - np.quantile(upward, _STARTS if feet.held.max() > _SOME else ())
    for height in heights[heights > 0]:
        start = feet.prior_mean.copy()
        start[1] = np.log(height)
        starts.append(start)
    return min((_descend(feet, start) for start in starts), key=feet.cost)


def _descend(feet: _Feet, state: Array, *, tolerance: float = 1e-9) -> Array:
    """Gauss-Newton with step halving while the cost increases."""
    for _ in range(50):
        step = feet.step(state)
        before = feet.cost(state)
        while np.abs(step).max() > tolerance and feet.cost(state + step) > before:
            step = step / 2
        state = state + step
        if np.abs(step).max() < tolerance:
            break
    return state


def _feet(
    clip: Clip,
    path: StaticPath,
    settings: CameraSettings,
    detections: DetectionModel,
) -> _Feet:
    """The lower visible ankle of every frame in the nominal camera, and the prior.

    For a hidden foot a detector invents a position, which is often the lower one. So a hidden ankle
    is used only if both ankles of the frame are more probably hidden than seen.
    """
    ankles = path.joints[:, [RANK, LANK]]
    confidences = clip.tracks[0].confidences[:, [RANK, LANK]]
    height = clip.camera.to_world(ankles)[..., 2]
    guessed = detections.confidence_density(confidences).argmax(-1) == 0
    lower = np.where(guessed & ~guessed.all(1, keepdims=True), np.inf, height).argmin(1)
    frames = np.arange(clip.n_frames)
    pelvis = clip.camera.to_world(path.pelvis)[:, 2]
    drop = pelvis - height[frames, lower]
    right, depth, up = ankles[frames, lower].T
    confidence = confidences[frames, lower]
    return _Feet(
        right=right,
        depth=depth,
        up=up,
        weight=confidence * min(1.0, 1.0 / (settings.correlation_time * clip.fps)),
        held=_EITHER * ndtr((_LEVEL - drop) / _LEVEL_ERROR),
        prior_mean=np.array(
            [clip.camera.pitch, np.log(clip.camera.elevation), 0.0, 0.0, clip.camera.roll, 0.0]
        ),
        prior_spread=np.array(
            [settings.pitch, settings.log_elevation, clip.focal_spread, settings.log_body,
             settings.roll, settings.ankle_offset]
        ),
        settings=settings,
    )  # fmt: skip
