"""The prior of camera and body: a Laplace approximation given feet and pelvis of the static path.

Five parameters are estimated: pitch, roll and elevation of the camera, and the factors of focal
length and stature. The feet of a person who walks about determine the floor, and so the elevation.
They determine pitch and roll only through the change of the floor's height with depth and across
the view; this is weak, and correlated with the elevation. Where no foot is seen, the height of the
pelvis determines the elevation, less well.
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
"""Window in seconds of the running median of angles and of the running mean of speeds; people do
not sit down and get up within it."""
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
    window = _window(fps)
    angle = median_filter(thigh_angle(level.to_world(path.poses)), size=window, mode="nearest")
    seen = uniform_filter1d(track.confidences[:, _THIGHS].mean(1), window, mode="nearest")
    return angle, np.clip(seen, 0.0, 1.0)


def _window(fps: float) -> int:
    """Frames of a running median or mean over a second; an odd number."""
    return 2 * round(_SECONDS * fps / 2) + 1


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
_TOLERANCE: Final = 1e-9
"""Largest step of a parameter of the camera, radians or log metres, at which the fit ends."""
_WALKING: Final = 0.4
"""Speed across the view in metres a second above which a person walks. In the built-in library 1 %
of the frames above this speed have the pelvis less than .6 m above the lower ankle."""
_UPRIGHT: Final = 0.8
"""Height of the pelvis above the lower ankle of somebody who walks, metres; the median in the
built-in library."""
_PELVIS: Final = (0.69, 0.19)
"""Mean and standard deviation of the height of the pelvis above the floor, metres: of the median
heights of the built-in library's scenelets."""


def estimate_camera(
    clip: Clip,
    path: StaticPath,
    *,
    settings: CameraSettings | None = None,
    detector: DetectorSettings | None = None,
) -> CameraPrior:
    """Gaussian approximation of the posterior of camera and body, given feet and pelvis.

    A body twice as large at twice the distance, or with half the focal length, looks the same. So a
    focal scale f and a body scale b map a point (x, y, z) of the static path to (b x, f b y, b z),
    and the lowest ankle of a frame is at height

        elevation + f b sin(pitch) y + b cos(pitch) (sin(roll) x + cos(roll) z),

    which should be that of an ankle above the floor, up to a constant offset. If both ankles are
    level with the pelvis, the person lies or sits on the floor or on furniture. Such an ankle may
    be anywhere above the floor (a mixture of a Student-t and a uniform density).

    A person who walks is on their feet. If the hips of such a frame are seen better than the ankle,
    the ankle is beneath the pelvis instead of where the path has it. All other frames in which both
    ankles are more probably hidden than seen give one observation: the mean height of their pelvis.

    The mode is found by Gauss-Newton in log elevation, which keeps the camera above the floor, and
    then the Laplace approximation is made.

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
    detections = DetectionModel.of(detector or DetectorSettings())
    feet = _feet(clip, path, settings, detections)
    mode = _mode(feet)
    # The robust weights average 1 / spread^2, but the Fisher information of a Student-t observation
    # about its centre is only (dof + 1) / (dof + 3) of that.
    told = (settings.ankle_dof + 1) / (settings.ankle_dof + 3)
    information = told * feet.information(mode) + feet.prior_information(mode)
    covariance = np.linalg.inv(information)[:5, :5]
    pitch, log_elevation, log_focal, log_body, roll, _ = mode
    elevation = np.exp(log_elevation)
    to_metres = np.diag([1.0, elevation, 1.0, 1.0, 1.0])
    return CameraPrior(
        mean=within_support(np.array([pitch, elevation, log_focal, log_body, roll])),
        covariance=to_metres @ covariance @ to_metres,
    )


@dataclass(frozen=True)
class _Points:
    """Points of the static path (N, 3) in camera coordinates, metres.

    ``ankles`` says whether they are ankles, whose height has the offset of the state.
    """

    places: Array
    ankles: bool

    def errors(self, state: Array, height: Array | float) -> Array:
        """(N,) expected minus observed height, in metres of the reference body.

        ``height`` is expected above the floor, metres. The errors are those of the observation. In
        metres of the scaled body, a smaller body would make all errors smaller and seem to fit
        better.
        """
        right, depth, up = self.places.T
        pitch, _, log_focal, _, roll, _ = state
        level = np.sin(roll) * right + np.cos(roll) * up
        upward = np.sin(pitch) * np.exp(log_focal) * depth + np.cos(pitch) * level
        result: Array = self._expected(state, height) - upward
        return result

    def _expected(self, state: Array, height: Array | float) -> Array | float:
        """Expected height above the camera, in metres of the reference body."""
        _, log_elevation, _, log_body, _, offset = state
        above = height + self.ankles * offset - np.exp(log_elevation)
        result: Array | float = above * np.exp(-log_body)
        return result

    def slopes(self, state: Array, height: Array | float) -> Array:
        """(N, 6) derivative of ``errors``."""
        right, depth, up = self.places.T
        pitch, log_elevation, log_focal, log_body, roll, _ = state
        level = np.sin(roll) * right + np.cos(roll) * up
        across = np.cos(roll) * right - np.sin(roll) * up
        forward = np.exp(log_focal) * depth
        same = np.ones_like(depth)
        columns = (
            np.sin(pitch) * level - np.cos(pitch) * forward,
            -np.exp(log_elevation - log_body) * same,
            -np.sin(pitch) * forward,
            -self._expected(state, height) * same,
            -np.cos(pitch) * across,
            self.ankles * np.exp(-log_body) * same,
        )
        return np.stack(columns, -1)


@dataclass(frozen=True)
class _Pelvis:
    """The mean pelvis of frames without feet, one point.

    ``share`` is the fraction of such frames, by which the observation counts.
    """

    point: _Points
    share: float

    def error(self, state: Array) -> float:
        """Expected minus observed height, in units of its deviation."""
        height, spread = _PELVIS
        return float(np.sqrt(self.share) / spread * self.point.errors(state, height)[0])

    def slope(self, state: Array) -> Array:
        """(6,) derivative of ``error``."""
        height, spread = _PELVIS
        result: Array = np.sqrt(self.share) / spread * self.point.slopes(state, height)[0]
        return result


@dataclass(frozen=True)
class _Feet:
    """Posterior of (6,): pitch, log elevation, log focal, log body, roll and ankle offset.

    ``ankles`` are the lowest ankles of the T frames. ``weight`` (T,) is that of each frame, and
    ``held`` (T,) the probability that the feet are on furniture.
    """

    ankles: _Points
    weight: Array
    held: Array
    pelvis: _Pelvis
    prior_mean: Array
    prior_spread: Array
    settings: CameraSettings

    def errors(self, state: Array) -> Array:
        """(T,) expected minus observed height of ankles, in metres of the reference body."""
        return self.ankles.errors(state, self.settings.ankle)

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
        prior = (((state - self.prior_mean) / self.prior_spread) ** 2).sum()
        prior += self.pelvis.error(state) ** 2
        return float(-(self.weight * np.log(on_floor + on_furniture)).sum() + 0.5 * prior)

    def information(self, state: Array) -> Array:
        """(6, 6) Gauss-Newton Hessian of the feet's evidence, without the prior."""
        slopes = self.ankles.slopes(state, self.settings.ankle)
        result: Array = (slopes * self._robust_weights(state)[:, None]).T @ slopes
        return result

    def prior_information(self, state: Array) -> Array:
        """(6, 6) Gauss-Newton Hessian of the normal terms: the prior and the height of the
        pelvis."""
        slope = self.pelvis.slope(state)
        result: Array = np.diag(self.prior_spread**-2) + np.outer(slope, slope)
        return result

    def step(self, state: Array) -> Array:
        """(6,) Gauss-Newton step towards the mode."""
        slopes = self.ankles.slopes(state, self.settings.ankle)
        pull = -slopes.T @ (self._robust_weights(state) * self.errors(state))
        pull -= self.pelvis.slope(state) * self.pelvis.error(state)
        pull += (self.prior_mean - state) / self.prior_spread**2
        hessian = self.information(state) + self.prior_information(state)
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


def _descend(feet: _Feet, state: Array) -> Array:
    """Gauss-Newton with step halving while the cost increases."""
    for _ in range(50):
        step = feet.step(state)
        before = feet.cost(state)
        while np.abs(step).max() > _TOLERANCE and feet.cost(state + step) > before:
            step = step / 2
        state = state + step
        if np.abs(step).max() < _TOLERANCE:
            break
    return state


def _feet(
    clip: Clip,
    path: StaticPath,
    settings: CameraSettings,
    detections: DetectionModel,
) -> _Feet:
    """The lower visible ankle of every frame in the nominal camera, the pelvis, and the prior.

    For a hidden foot a detector invents a position, which is often the lower one. So a hidden ankle
    is used only if both ankles of the frame are more probably hidden than seen.
    """
    track = clip.tracks[0]
    ankles = path.joints[:, [RANK, LANK]]
    confidences = track.confidences[:, [RANK, LANK]]
    height = clip.camera.to_world(ankles)[..., 2]
    guessed = detections.confidence_density(confidences).argmax(-1) == 0
    lower = np.where(guessed & ~guessed.all(1, keepdims=True), np.inf, height).argmin(1)
    frames = np.arange(clip.n_frames)
    hips = track.confidences[:, [RHIP, LHIP]].mean(1)
    walking = _walks(path, fps=clip.fps)
    beneath = walking & (hips > confidences[frames, lower])
    down = np.array([0.0, 0.0, _UPRIGHT]) @ clip.camera.rotation
    used = np.where(beneath[:, None], path.pelvis - down, ankles[frames, lower])
    confidence = np.where(beneath, hips, confidences[frames, lower])
    drop = (clip.camera.to_world(path.pelvis) - clip.camera.to_world(used))[:, 2]
    return _Feet(
        ankles=_Points(used, ankles=True),
        weight=confidence * min(1.0, 1.0 / (settings.correlation_time * clip.fps)),
        held=_EITHER * ndtr((_LEVEL - drop) / _LEVEL_ERROR),
        pelvis=_pelvis(path, np.where(guessed.all(1) & ~walking, hips, 0.0)),
        prior_mean=np.array(
            [clip.camera.pitch, np.log(clip.camera.elevation), 0.0, 0.0, clip.camera.roll, 0.0]
        ),
        prior_spread=np.array(
            [settings.pitch, settings.log_elevation, clip.focal_spread, settings.log_body,
             settings.roll, settings.ankle_offset]
        ),
        settings=settings,
    )  # fmt: skip


def _walks(path: StaticPath, *, fps: float) -> NDArray[np.bool_]:
    """(T,) whether the person moves across the view as only people on their feet do."""
    window = _window(fps)
    speed = fps * np.gradient(path.pelvis[:, 0]) if len(path.pelvis) > 1 else np.zeros(1)
    across = uniform_filter1d(speed, window, mode="nearest")
    result: NDArray[np.bool_] = np.abs(across) > _WALKING
    return result


def _pelvis(path: StaticPath, weight: Array) -> _Pelvis:
    """The mean pelvis of frames without feet, each of which counts by its weight (T,)."""
    total = float(weight.sum())
    part = weight / total if total > 0 else np.full(len(weight), 1.0 / len(weight))
    return _Pelvis(_Points((part @ path.pelvis)[None], ankles=False), total / len(weight))
