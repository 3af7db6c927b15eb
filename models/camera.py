"""A pinhole camera above the floor.

Three frames, all in metres and radians:

*World*: z up, floor at z = 0, origin on the floor below the camera, y the horizontal
viewing direction.  *Camera*: origin at the optical centre, x right, y forward along the
optical axis, z up in the image.  *Image*: pixels as OpenCV counts them, u right, v down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError

__all__ = ["Camera", "floor_edges"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: intrinsics, and the part of its pose that is not a choice of axes.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels.
    pitch : float
        Angle of the optical axis above the horizon in radians; negative looks down.
    roll : float
        Rotation about the optical axis in radians; positive tilts the camera's right side up.
    elevation : float
        Height of the optical centre above the floor in metres.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    pitch: float = 0.0
    roll: float = 0.0
    elevation: float = 1.5

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise InputError(f"image size {self.width} x {self.height} must be positive")
        for name in ("fx", "fy"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(
                    f"focal length {name} = {getattr(self, name)} must be finite and positive"
                )
        for name in ("cx", "cy", "pitch", "roll", "elevation"):
            if not np.isfinite(getattr(self, name)):
                raise InputError(f"camera {name} = {getattr(self, name)} must be finite")

    @property
    def short_side(self) -> int:
        """Shorter side of the image in pixels, to which errors of detectors are in proportion."""
        return min(self.width, self.height)

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation from camera to world axes."""
        cp, sp = np.cos(self.pitch), np.sin(self.pitch)
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        pitch = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
        roll = np.array([[cr, 0.0, -sr], [0.0, 1.0, 0.0], [sr, 0.0, cr]])
        rotation: Array = pitch @ roll
        return rotation

    @property
    def centre(self) -> Array:
        """(3,) optical centre in the world, metres."""
        return np.array([0.0, 0.0, self.elevation])

    def to_world(self, points: ArrayLike) -> Array:
        """Camera frame (..., 3) to world (..., 3), metres.

        Parameters
        ----------
        points : (..., 3) float
            Camera frame, metres.

        Returns
        -------
        (..., 3) float
        """
        result: Array = np.asarray(points, float) @ self.rotation.T + self.centre
        return result

    def to_camera(self, points: ArrayLike) -> Array:
        """World (..., 3) to camera frame (..., 3), metres.

        Parameters
        ----------
        points : (..., 3) float
            World, metres.

        Returns
        -------
        (..., 3) float
        """
        result: Array = (np.asarray(points, float) - self.centre) @ self.rotation
        return result

    def project_camera(self, points: ArrayLike) -> Array:
        """Camera frame (..., 3) to pixels (..., 2); NaN at or behind the image plane.

        Parameters
        ----------
        points : (..., 3) float
            Camera frame, metres.

        Returns
        -------
        (..., 2) float
            Pixels.
        """
        x, depth, z = np.moveaxis(np.asarray(points, float), -1, 0)
        depth = np.where(depth > 1e-6, depth, np.nan)
        return np.stack([self.cx + self.fx * x / depth, self.cy - self.fy * z / depth], -1)

    def project(self, points: ArrayLike) -> Array:
        """World (..., 3) to pixels (..., 2); NaN at or behind the image plane.

        Parameters
        ----------
        points : (..., 3) float
            World, metres.

        Returns
        -------
        (..., 2) float
            Pixels.
        """
        return self.project_camera(self.to_camera(points))

    def rays(self, pixels: ArrayLike) -> Array:
        """Pixels (..., 2) to camera-frame directions (..., 3) with unit forward component.

        Parameters
        ----------
        pixels : (..., 2) float

        Returns
        -------
        (..., 3) float
        """
        u, v = np.moveaxis(np.asarray(pixels, float), -1, 0)
        return np.stack([(u - self.cx) / self.fx, np.ones_like(u), (self.cy - v) / self.fy], -1)

    def posed(
        self, *, pitch: float, roll: float, elevation: float, focal_scale: float = 1.0
    ) -> Camera:
        """The same camera in another pose, and with another focal length.

        Parameters
        ----------
        pitch, roll : float
            Radians.
        elevation : float
            Metres above the floor.
        focal_scale : float
            Factor on both focal lengths.

        Returns
        -------
        Camera
        """
        return replace(
            self,
            pitch=pitch,
            roll=roll,
            elevation=elevation,
            fx=self.fx * focal_scale,
            fy=self.fy * focal_scale,
        )


def floor_edges(camera: Camera, *, reach: float) -> list[Array]:
    """Where the edges of the image meet the floor, as straight lines.

    Parameters
    ----------
    camera : Camera
    reach : float
        Metres; what is farther may be left out.

    Returns
    -------
    list of (2, 2) float
        Ends of a line for each edge with floor in it, metres.
    """
    u, v = float(camera.width), float(camera.height)
    rays = camera.rays([(0.0, 0.0), (u, 0.0), (u, v), (0.0, v)]) @ camera.rotation.T
    least = camera.elevation / reach
    edges = []
    for first, last in zip(rays, np.roll(rays, -1, axis=0), strict=True):
        # Where a ray descends by ``least`` a metre, it meets the floor at ``reach`` or beyond.
        down = -first[2], -last[2]
        if max(down) <= least:
            continue
        middle = first
        if min(down) < least:
            middle = first + (last - first) * (least - down[0]) / (down[1] - down[0])
        ends = np.stack([middle if down[0] < least else first, middle if down[1] < least else last])
        edges.append(ends[:, :2] * (camera.elevation / -ends[:, 2:]))
    return edges
