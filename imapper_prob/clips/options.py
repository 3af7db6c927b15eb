"""What a user states about camera and clip in addition to the files."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.clips.identity import Marks
from imapper_prob.clips.parsing import load_json, numbers
from imapper_prob.files import read_toml
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError, require_kind, require_whole
from imapper_prob.models.scene import MEASURED_FOCAL
from imapper_prob.models.settings import MOST_PEOPLE

__all__ = [
    "NOMINAL_ELEVATION",
    "CameraFile",
    "ClipOptions",
    "camera_of",
    "check_matrix",
    "check_rotation",
    "read_camera",
    "undistorted",
]

Array = NDArray[np.float64]

_log = logging.getLogger(__name__)

NOMINAL_ELEVATION: Final = 1.5
"""Camera height in metres: on a tripod, on a shelf, or held at chest height."""
_ASSUMED: Final = 0.2
"""Standard deviation of the log focal length of an unknown camera. The focal length is then taken
to be the longer side of the image; one standard deviation covers horizontal fields of view of 44 to
63 degrees. It is the error for nine webcams and phones whose field of view in videos is published
or was measured (``docs/explanation/decisions.md``)."""
_WRITTEN_DOWN: Final = 0.1
"""Standard deviation of the log focal length that phones record. That value holds for the whole
sensor, of which videos crop up to a fifth for stabilisation."""
_KEYS: Final = {
    "size": (2,), "matrix": (3, 3), "distortion": None, "rotation": (3, 3), "translation": (3,),
    "pitch_degrees": (), "roll_degrees": (), "height": (),
}  # fmt: skip
_DISTORTION_LENGTHS: Final = (4, 5, 8)
"""Numbers of coefficients of the lens models of OpenCV that are known here."""
_LARGEST: Final = 1e6
"""Pixels of focal length or principal point beyond which a value counts as damaged."""
_SKEW: Final = 1e-3
"""Largest skew over focal length that counts as none; the model has no skew."""
_STEPS: Final = 50
"""Iterations of undistortion; where more are needed, the lens model is unreliable anyway."""
_STRAIGHT: Final = 1e-6
"""Accuracy of undistortion as a tangent, a few thousandths of a pixel."""


@dataclass(frozen=True)
class CameraFile:
    """A camera calibrated by the user.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels.
    matrix : (3, 3) float
        Intrinsics in pixels, OpenCV's convention.
    distortion : (4,), (5,), (8,) or (0,) float
        OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]]; empty for none.
    rotation, translation : (3, 3), (3,) float, optional
        World to camera in OpenCV's convention (x right, y down, z forward; metres). Used only for
        3D joints in a world frame.
    pitch, roll : float, optional
        Radians, as in :class:`~imapper_prob.models.camera.Camera`.
    height : float, optional
        Metres above the floor.
    """

    size: tuple[int, int]
    matrix: Array
    distortion: Array
    rotation: Array | None = None
    translation: Array | None = None
    pitch: float | None = None
    roll: float | None = None
    height: float | None = None


@dataclass(frozen=True)
class ClipOptions:
    """Everything that a user may state about a clip besides its path.

    Parameters
    ----------
    format : str, optional
        Name of the reader, if the content is ambiguous.
    camera : CameraFile, optional
    focal : float, optional
        Focal length in pixels, if there is no camera file.
    focal_spread : float, optional
        Standard deviation of the log focal length. If not given, it depends on where the focal
        length comes from.
    pitch : float, optional
        Camera pitch in degrees above the horizon; looking down is negative. It is the mean of the
        prior, not a fixed value.
    height : float, optional
        Height of the camera above the floor in metres; also the mean of the prior.
    size : (int, int), optional
        Width and height of the image in pixels.
    fps : float, optional
        Frames a second.
    confidence : str, optional
        Map of :mod:`imapper_prob.clips.assemble` that replaces the format's default.
    people : int, optional
        Number of actors, if the files do not identify them.
    marks : Marks, optional
        Who is who in some frames. Track numbers in the files are then ignored.
    tracker : str
        Cost function of the tracking: ``"default"``, or ``"paper"`` for the printed one.

    Examples
    --------
    >>> options = im.ClipOptions(size=(1920, 1080), fps=30.0)
    >>> options.size, options.camera is None
    ((1920, 1080), True)
    """

    format: str | None = None
    camera: CameraFile | None = None
    focal: float | None = None
    focal_spread: float | None = None
    pitch: float | None = None
    height: float | None = None
    size: tuple[int, int] | None = None
    fps: float | None = None
    confidence: str | None = None
    people: int | None = None
    marks: Marks | None = None
    tracker: str = "default"

    def __post_init__(self) -> None:
        if self.tracker not in ("default", "paper"):
            raise InputError(f"tracker {self.tracker!r} must be default or paper")
        for name, kind, wanted in (
            ("format", str, "the name of a format"),
            ("camera", CameraFile, "a CameraFile, see read_camera"),
            ("confidence", str, "the name of a confidence map"),
            ("marks", Marks, "Marks, see read_marks"),
        ):
            require_kind(name, getattr(self, name), (kind, type(None)), wanted)
        for name in ("focal", "focal_spread", "pitch", "height", "fps"):
            require_kind(name, getattr(self, name), (Real, type(None)), "a number")
        for name in ("focal", "height", "fps"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} = {value} must be finite and positive")
        if self.focal_spread is not None and not 0 < self.focal_spread < 1:
            raise InputError(f"focal spread {self.focal_spread} must be between 0 and 1")
        if self.pitch is not None and not -90 < self.pitch < 90:
            raise InputError(f"pitch = {self.pitch} must be between -90 and 90 degrees")
        if self.size is not None:
            if np.shape(self.size) != (2,):
                raise InputError(f"size = {self.size!r:.60} must be (width, height) in pixels")
            for side in self.size:
                require_whole("side of the image size", side, least=1)
        if self.people is not None:
            require_whole("people", self.people, least=1, most=MOST_PEOPLE)
        if self.camera is not None and self.focal is not None:
            raise InputError("give a camera file or a focal length, not both")


def read_camera(path: str | Path) -> CameraFile:
    """Read a camera from TOML or JSON.

    ``size = [width, height]`` and ``matrix`` (3 x 3) are required; ``distortion``, ``rotation``,
    ``translation``, ``pitch_degrees``, ``roll_degrees`` and ``height`` are optional.

    Parameters
    ----------
    path : path
        Ends in ``.toml`` for TOML; anything else is read as JSON.

    Returns
    -------
    CameraFile

    Raises
    ------
    InputError
        The file is damaged, or an entry is missing, unknown or of the wrong shape.

    Examples
    --------
    >>> from pathlib import Path
    >>> text = "size = [1920, 1080]; matrix = [[1500, 0, 960], [0, 1500, 540], [0, 0, 1]]"
    >>> _ = Path("camera.toml").write_text(text.replace("; ", chr(10)))
    >>> im.read_camera("camera.toml").size
    (1920, 1080)
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file; name the file of a camera")
    data = read_toml(path) if path.suffix == ".toml" else load_json(path)
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected a table of camera entries")
    unknown = sorted(set(map(str, data)) - set(_KEYS))
    if unknown:
        raise InputError(f"{path}: unknown entry {unknown[0]!r}; known are {', '.join(_KEYS)}")
    for key in ("size", "matrix"):
        if key not in data:
            raise InputError(f"{path}: no entry {key!r}")
    values = {k: _value(path, k, v) for k, v in data.items()}
    width, height = values["size"]
    if not (width.is_integer() and height.is_integer() and min(width, height) >= 1):
        raise InputError(f"{path}: size must be two whole numbers of pixels")
    rotation = values.get("rotation")
    try:
        check_matrix(values["matrix"])
        if rotation is not None:
            check_rotation(rotation)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if (rotation is None) != ("translation" not in values):
        raise InputError(f"{path}: rotation and translation go together")
    if "height" in values and not values["height"] > 0:
        raise InputError(f"{path}: height must be positive, in metres above the floor")
    return CameraFile(
        size=(int(width), int(height)),
        matrix=values["matrix"],
        distortion=values.get("distortion", np.zeros(0)),
        rotation=rotation,
        translation=values.get("translation"),
        pitch=_radians(values.get("pitch_degrees")),
        roll=_radians(values.get("roll_degrees")),
        height=None if "height" not in values else float(values["height"]),
    )


def check_matrix(matrix: Array) -> None:
    """Check that a (3, 3) array is a matrix of intrinsics in pixels.

    Parameters
    ----------
    matrix : (3, 3) float

    Raises
    ------
    InputError
        It is not; the message lacks the file's name, which the caller adds.
    """
    usual = matrix[2].tolist() == [0, 0, 1] and min(matrix[0, 0], matrix[1, 1]) > 0
    usual &= abs(matrix[0, 1]) <= _SKEW * matrix[0, 0] and matrix[1, 0] == 0
    if not (usual and (np.abs(matrix) <= _LARGEST).all()):
        raise InputError(
            "matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, fx and fy positive"
        )


def check_rotation(rotation: Array) -> None:
    """Check that a (3, 3) array is a rotation, without stretching or mirroring.

    Parameters
    ----------
    rotation : (3, 3) float

    Raises
    ------
    InputError
        It is not; the message lacks the file's name, which the caller adds.
    """
    bounded = (np.abs(rotation) <= 1.01).all()
    if not (
        bounded
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        and np.linalg.det(rotation) > 0
    ):
        raise InputError("rotation is no rotation matrix")


def camera_of(
    name: str,
    options: ClipOptions,
    *,
    size: tuple[int, int],
    likely_focal: float | None = None,
) -> tuple[Camera, float]:
    """The nominal camera of a clip, and the standard deviation of its log focal length.

    If the user states no focal length it is ``likely_focal``, or else the longer side of the image,
    which is a field of view of 53 degrees.

    Parameters
    ----------
    name : str
        Name of the clip, for messages.
    options : ClipOptions
    size : (int, int)
        Width and height of the image in pixels.
    likely_focal : float, optional
        Pixels.

    Returns
    -------
    camera : Camera
    spread : float
    """
    file, spread = options.camera, MEASURED_FOCAL
    if file is not None:
        camera = Camera(
            *file.size,
            fx=float(file.matrix[0, 0]),
            fy=float(file.matrix[1, 1]),
            cx=float(file.matrix[0, 2]),
            cy=float(file.matrix[1, 2]),
            pitch=file.pitch or 0.0,
            roll=file.roll or 0.0,
            elevation=NOMINAL_ELEVATION if file.height is None else file.height,
        )
    else:
        focal = options.focal
        if focal is None:
            focal = likely_focal or float(max(size))
            spread = _WRITTEN_DOWN if likely_focal else _ASSUMED
            _log.warning(
                "%s: focal length assumed to be %.0f pixels, give or take %.0f %%; all depths "
                "scale with it", name, focal, 100 * (options.focal_spread or spread),
            )  # fmt: skip
        camera = Camera(
            *size, fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, elevation=NOMINAL_ELEVATION
        )
    if options.pitch is not None:
        camera = replace(camera, pitch=float(np.deg2rad(options.pitch)))
    if options.height is not None:
        camera = replace(camera, elevation=options.height)
    return camera, options.focal_spread or spread


def undistorted(pixels: ArrayLike, file: CameraFile) -> Array:
    """Pixels with the lens distortion removed.

    Parameters
    ----------
    pixels : (..., 2) float
    file : CameraFile

    Returns
    -------
    (..., 2) float
        Pixels; NaN where the iteration does not converge.
    """
    pixels = np.asarray(pixels, float)
    if not file.distortion.any():
        return pixels.copy()
    focal, centre = file.matrix[[0, 1], [0, 1]], file.matrix[:2, 2]
    seen = (pixels - centre) / focal
    straight = seen.copy()
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            radial, tangential = _distortion(straight, file.distortion)
            straight = (seen - tangential) / radial
        radial, tangential = _distortion(straight, file.distortion)
        settled = np.abs(straight * radial + tangential - seen).max(-1) < _STRAIGHT
    return np.where((settled & (radial[..., 0] > 0))[..., None], straight * focal + centre, np.nan)


def _distortion(points: Array, coefficients: Array) -> tuple[Array, Array]:
    """Radial factor (..., 1) and tangential shift (..., 2) of points (..., 2) given as tangents."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(coefficients, (0, 8 - len(coefficients)))
    x, y = points[..., 0], points[..., 1]
    r2 = x**2 + y**2
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    shift = np.stack(
        [2 * p1 * x * y + p2 * (r2 + 2 * x**2), p1 * (r2 + 2 * y**2) + 2 * p2 * x * y], -1
    )
    return radial[..., None], shift


def _value(path: Path, key: str, value: Any) -> Array:
    shape = _KEYS[key]
    if shape is None:
        count = len(value) if isinstance(value, list) else -1
        if count not in (0, *_DISTORTION_LENGTHS):
            raise InputError(f"{path}: distortion has 4, 5 or 8 numbers: k1 k2 p1 p2 k3 k4 k5 k6")
        return numbers(value, shape=(count,), place=f"{path}: {key}") if count else np.zeros(0)
    return numbers(value, shape=shape, place=f"{path}: {key}")


def _radians(degrees: Array | None) -> float | None:
    return None if degrees is None else float(np.deg2rad(degrees))
