"""When somebody is off their feet, by the pose of the static path.

Of all signs of sitting the angle of the thighs to the vertical is the plainest: nobody walks,
stands or reaches with both thighs level. It is the mean of both legs', the median over a second,
and counts as far as the legs are seen; how much each angle says is measured on i3DB
(``support.angle`` and ``support.slope`` in ``docs/calibration.md``).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from imapper_prob.models.camera import Camera
from imapper_prob.models.path import CameraPrior, StaticPath
from imapper_prob.models.pose import thigh_angle
from imapper_prob.models.scene import Track
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import LHIP, LKNE, RHIP, RKNE

__all__ = ["find_stays", "thigh_signs"]

Array = NDArray[np.float64]

_SECONDS: Final = 1.0
"""Over which angles are a running median: people do not get up and sit down within it."""
_THIGHS: Final = [RHIP, RKNE, LHIP, LKNE]


def thigh_signs(
    track: Track, path: StaticPath, camera: CameraPrior, *, fps: float
) -> tuple[Array, Array]:
    """Angle of the thighs, and how far they are seen.

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
    """(K, 3) stays of a person: first frame, frame after the last, and nats that they speak of it.

    See :func:`imapper_prob.models.energy.support.unsupported`.
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
