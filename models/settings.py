"""Limits of the input, and the constants of the model with their units and sources.

Constants that were estimated from data are read from ``calibrated.toml``, which states the source
and spread of each one (``docs/research/calibration.md``). The others are chosen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from imapper_prob.models.calibrated import Number, from_data, values_without, with_values
from imapper_prob.models.detector import DetectorSettings
from imapper_prob.models.errors import InputError, require_number
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = [
    "FARTHEST_KEYPOINT",
    "HIGHEST_CAMERA",
    "LARGEST_IMAGE",
    "LEVEL",
    "LONGEST_CLIP",
    "LONGEST_FOCAL",
    "LOWEST_CAMERA",
    "MOST_PEOPLE",
    "NEAREST",
    "NEAR_SIGHT",
    "NOTHING_IN_SIGHT",
    "OPAQUE",
    "QUICKEST_FILM",
    "SHORTEST_CLIP",
    "SHORTEST_FOCAL",
    "SIDE_SPREAD",
    "STEEPEST_CAMERA",
    "TOUCH_REACH",
    "CameraSettings",
    "ModelSettings",
    "PaperWeights",
    "Settings",
    "StaticPathSettings",
]

NEAREST: Final = 0.1
"""Least depth in metres; points nearer to the camera or behind it are treated as at this depth."""
SIDE_SPREAD: Final = 0.23
"""Standard deviation of the log of a true piece's width, depth or height about that of its
scenelet's: the log ratio of two pieces of the built-in library with one label, root mean square
over labels and sides."""
NEAR_SIGHT: Final = 0.05
"""Distance from the camera in metres below which bearing and slope of a line of sight are not
used."""
LEVEL: Final = 0.02
"""Overlap in height, metres, below which two boxes do not count as at the same level."""
NOTHING_IN_SIGHT: Final = 0.2
"""Cap of the clearance, metres: a line of sight farther than this from all boxes is clear."""
OPAQUE: Final = 0.1
"""A line of sight through the middle of a box thinner than twice this has this depth of cut,
metres, so that a table top hides as much as a chest."""
TOUCH_REACH: Final = 0.25
"""Distance in metres from a joint within which it touches an object; joints are inside the body."""
LOWEST_CAMERA: Final = 0.2
"""Least elevation of the camera, metres above the floor; the prior's support begins here."""
STEEPEST_CAMERA: Final = 1.0
"""Largest absolute pitch or roll of the camera, radians; the prior's support ends here."""
HIGHEST_CAMERA: Final = 100.0
"""Largest elevation of the camera, metres above the floor; people there are a few pixels high."""
LARGEST_IMAGE: Final = 65_536
"""Largest side of an image, pixels: sixteen times that of the largest video formats."""
SHORTEST_FOCAL: Final = 0.005
LONGEST_FOCAL: Final = 100.0
"""Limits of the focal length in units of the longer image side: fields of view of 179 and 0.5
degrees."""
FARTHEST_KEYPOINT: Final = 1e4
"""Largest coordinate of a keypoint in units of the longer image side. Detectors place joints a
little outside the image; draws of the detection model, whose tails have two degrees of freedom, lie
up to some hundred image sides away."""
QUICKEST_FILM: Final = 1_000.0
"""Largest frame rate, frames per second: that of high-speed cameras. The least one depends on the
library, see `imapper_prob.models.problem.require_rate`."""
LONGEST_CLIP: Final = 36_000
"""Most frames of a clip: an hour at ten per second. More indicate a damaged frame number."""
SHORTEST_CLIP: Final = 8
"""Least number of frames; in under a second no motion is informative about furniture."""
MOST_PEOPLE: Final = 64
"""Most people in one clip."""


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the five terms of :mod:`~imapper_prob.models.published_energy`.

    The paper prints no weights. The defaults are those of the command files that the authors
    released with i3DB, for terms in normalised image coordinates and metres on clips of 10 frames
    per second. One scene (Scene10) has ``occlusion`` 10, the others 1. The files have one weight
    for intersections, which the released program halves where joints meet objects.

    Parameters
    ----------
    reprojection : float
        Per unit of squared normalised image coordinates.
    occlusion : float
        Per square metre.
    smoothness : float
        Per square metre.
    collision : float
        Per cubic metre: depth in the other object, integrated over the floor.
    motion : float
        Per metre.

    Raises
    ------
    InputError
        A weight is negative or not finite.
    """

    reprojection: float = 1.0
    occlusion: float = 1.0
    smoothness: float = 0.05
    collision: float = 1.0
    motion: float = 0.5

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"weight {name} = {value} must be finite and at least 0")


def _share(seconds: Number) -> Number:
    """One over the number of frames, at 10 per second, in a correlation time."""
    if isinstance(seconds, tuple):
        raise TypeError("a time is one number")
    return 1 / (10 * seconds)


@dataclass(frozen=True)
class ModelSettings:
    """Constants of the log-posterior.

    Parameters
    ----------
    frame_weight : float
        Factor on every frame's log-likelihood at 10 frames per second, because errors are
        correlated between joints and frames: one over the number of frames that together count as
        one.
    side_flip_rate : float
        Rate per second at which left-right flips of the detector begin.
    side_flip_length : float
        Mean duration of a flip, seconds.
    pose_tolerance : tuple of 16 float
        Metres, for a body of the reference stature; standard deviation of each joint about the
        scenelet's, the same on both sides. No library contains exactly the motion of
        this person; wrists and ankles differ most.
    sight_width : float
        Metres; width of the transition from hidden to visible as a function of clearance. It
        accounts for errors of the furniture's shape and position.
    visibility_error : float
        Probability that a joint is hidden although no known furniture is in the way, or visible
        although some is.
    correlation_time_bearing, correlation_time_depth : float
        Seconds; half the integrated autocorrelation of the static path's errors in bearing and in
        log depth.
    smoothing_time_bearing, smoothing_time_depth : float
        Seconds of the correlation time over which such an error is smooth, at most half of it: 0
        for errors that are rough from frame to frame, half for the smoothest.
    stay_change : float
        Seconds at the start of a stay in which the error along the view still changes as elsewhere;
        for the rest of the stay it is constant.
    walk_bearing, walk_log_depth : float
        Standard deviation of one frame's step of the pelvis at 10 frames per second, in bearing
        (tangent) and log depth; for the prior path of a person without observations.
    start_bearing, start_log_depth : float
        Standard deviations of the position of that person, in bearing (tangent) and log depth.
    start_depth : float
        Metres; median depth of that person.
    size_spread : float
        Standard deviation of the log size of one scenelet (person and furniture) about the body
        scale: how well a fitted motion of 2 s determines its own distance (estimated on i3DB).
    facing_spread : float
        Radians; scale of the wrapped Cauchy error between the facing direction of the static path
        and that of the right scenelet, both averaged over its frames.
    joint_step : float
        Metres per axis, for a body of the reference stature; scale of a joint's step, relative to
        the pelvis, into the first frame of a scenelet and out of its last one. Most of it is the
        difference between scenelet and lifted pose (i3DB), so it does not depend on the frame rate.
    smoothness_cost : float
        Factor on the nats of those steps, because errors are correlated between joints; it equals
        that of the frames in the time over which their errors repeat.
    furniture_aside : float
        Standard deviation of the sideways displacement of furniture from its position in the
        scenelet, as a share of its width. Like ``furniture_ahead`` it applies to the furniture of
        drawn scenes, because the detections do not determine it (``docs/explanation/model.md``).
    furniture_ahead : float
        Metres; the same to front and back, and the distance furniture may move out of a person's
        path.
    furniture_yaw : float
        Radians; standard deviation of the yaw of measured furniture about that in the scenelet.
    seat_confusion : float
        Probability that the label of a seat is independent of the scenelet: it then has the shares
        of the library's seats. Motion hardly distinguishes kinds of seats.
    collision_cost : float
        Nats per metre of horizontal overlap of two objects.
    motion_cost : float
        Nats per metre and frame of penetration of the person into an object or below the floor,
        before ``frame_weight``.
    merge_angle : float
        Radians; two overlapping objects of the same label are one object seen twice if their yaws
        differ by less than this, or at any yaw if the label has no front.
    support_angle : float
        Radians; angle of the thighs to the vertical at which a pose is equally likely to be
        supported as to stand on its feet.
    support_slope : float
        Nats per radian by which a greater angle is evidence for being supported.
    support_time : float
        Seconds over which the evidence of frames counts once.
    scenelet_rate : float
        Prior odds that a scenelet starts at a given frame rather than none, at 10 frames a second
        (in proportion to the time between frames at other rates), shared among the library's
        scenelets.
    likelihood : float
        Factor on all terms that depend on data: 1, or 0 to sample the prior.
    energy : str
        ``"default"``, or ``"paper"`` to use the published energy instead of the likelihood.
    paper_nats : float
        Nats per unit of the published energy, which has no scale of its own. At 700 a joint that is
        15 px off (the scale of i3DB's errors, at its focal length of 1955) would cost as much as a
        normal error of that size. At .3 an undetected joint one metre outside any occlusion would
        cost as much as in the default energy. No value does both; this one is between them.
    """

    frame_weight: float = from_data("scores.repeat_time", _share)
    side_flip_rate: float = from_data("side_flips.rate")
    side_flip_length: float = from_data("side_flips.length")
    pose_tolerance: tuple[float, ...] = from_data("pose.tolerance")
    sight_width: float = from_data("sight.width")
    visibility_error: float = 0.02
    correlation_time_bearing: float = from_data("bias.correlation_time_across")
    correlation_time_depth: float = from_data("bias.correlation_time_along")
    smoothing_time_bearing: float = from_data("bias.smoothing_time_across")
    smoothing_time_depth: float = from_data("bias.smoothing_time_along")
    stay_change: float = from_data("bias.stay_change")
    walk_bearing: float = from_data("walk.bearing")
    walk_log_depth: float = from_data("walk.log_depth")
    start_bearing: float = 0.25
    start_log_depth: float = 0.4
    start_depth: float = 4.0
    size_spread: float = from_data("scenelet.log_size")
    facing_spread: float = from_data("facing.spread")
    joint_step: float = from_data("joints.jump_scale")
    smoothness_cost: float = from_data("frames.correlation_time", _share)
    furniture_aside: float = from_data("furniture.aside")
    furniture_ahead: float = from_data("furniture.ahead")
    furniture_yaw: float = from_data("furniture.yaw")
    seat_confusion: float = from_data("seats.confusion")
    collision_cost: float = 100.0
    motion_cost: float = 50.0
    merge_angle: float = 0.6
    support_angle: float = from_data("support.angle")
    support_slope: float = from_data("support.slope")
    support_time: float = from_data("frames.correlation_time")
    scenelet_rate: float = 0.02
    likelihood: float = 1.0
    energy: str = "default"
    paper_nats: float = 30.0

    def __post_init__(self) -> None:
        for name in (
            "frame_weight", "side_flip_rate", "side_flip_length", "sight_width",
            "walk_bearing", "walk_log_depth", "correlation_time_bearing", "correlation_time_depth",
            "start_bearing", "start_log_depth", "start_depth", "scenelet_rate", "size_spread",
            "facing_spread", "joint_step", "paper_nats", "furniture_aside", "furniture_ahead",
            "furniture_yaw", "support_angle", "support_slope", "support_time", "merge_angle",
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(f"model setting {name} = {getattr(self, name)} must be positive")
        for name in ("likelihood", "collision_cost", "motion_cost", "smoothness_cost"):
            if not getattr(self, name) >= 0:
                raise InputError(
                    f"model setting {name} = {getattr(self, name)} must not be negative"
                )
        if len(self.pose_tolerance) != N_JOINTS or not all(s > 0 for s in self.pose_tolerance):
            raise InputError(
                f"model setting pose_tolerance = {self.pose_tolerance} must be {N_JOINTS} positive "
                f"numbers, of {', '.join(JOINTS)}"
            )
        for name in ("bearing", "depth"):
            smoothing = getattr(self, f"smoothing_time_{name}")
            correlation = getattr(self, f"correlation_time_{name}")
            if not 0 <= smoothing <= correlation / 2:
                raise InputError(
                    f"model setting smoothing_time_{name} = {smoothing} must be from 0 to half of "
                    f"correlation_time_{name} = {correlation}"
                )
        if self.energy not in ("default", "paper"):
            raise InputError(f"model setting energy = {self.energy!r} must be default or paper")
        if not 0 < self.visibility_error < 0.5:
            raise InputError(
                f"model setting visibility_error = {self.visibility_error} must be in (0, 0.5)"
            )
        if not 0 <= self.seat_confusion <= 1:
            raise InputError(
                f"model setting seat_confusion = {self.seat_confusion} must be between 0 and 1"
            )


@dataclass(frozen=True)
class StaticPathSettings:
    """Constants of the static path, calibrated (``docs/research/calibration.md``) but for three.

    Parameters
    ----------
    pixel_scale, dof : float
        Scale (pixels in an image of 1080 lines) and degrees of freedom of a detection's pixel
        error.
    correlation_time : float
        Seconds over which errors of detections and of lifted poses are correlated.
    walk_bearing, walk_log_depth, walk_bone : float
        Standard deviation of one step at 10 frames per second, of bearing and lift (tangents), log
        depth (log metres) and bones (metres).
    walk_time : float
        Seconds over which a person keeps about the same velocity.
    length_tolerance : float
        Factor on the published standard deviations of bone lengths.
    lifted_across, lifted_along : float
        Standard deviation of a lifted bone across and along the viewing direction, divided by its
        length.
    filled_tolerance : float
        Factor on these two for interpolated poses; chosen.
    implausible : float
        Median pixel error of confident joints (in an image of 1080 lines) above which a lifted pose
        is rejected even at its best fit; chosen.
    bias_factor_along, bias_factor_across : float
        Standard deviations of the slow errors of log depth and bearing, as factors on those that
        the fit states of each frame.
    """

    pixel_scale: float = from_data("path.pixel_scale")
    dof: float = from_data("path.pixel_dof")
    correlation_time: float = from_data("frames.correlation_time")
    walk_bearing: float = from_data("walk.bearing")
    walk_log_depth: float = from_data("walk.log_depth")
    walk_bone: float = from_data("walk.bone")
    walk_time: float = from_data("walk.time")
    length_tolerance: float = 1.0
    lifted_across: float = from_data("bones.lifted_across")
    lifted_along: float = from_data("bones.lifted_along")
    filled_tolerance: float = 2.0
    implausible: float = 60.0
    bias_factor_along: float = from_data("bias.along")
    bias_factor_across: float = from_data("bias.across")

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            require_number(f"path setting {name}", getattr(self, name), above=0)

    def frame_weight(self, fps: float) -> float:
        """Weight of a frame: one over the number of frames in a correlation time, at most 1.

        Parameters
        ----------
        fps : float
            Frames per second.

        Returns
        -------
        float
            At most 1.
        """
        return min(1.0, 1.0 / (self.correlation_time * fps))


@dataclass(frozen=True)
class CameraSettings:
    """Constants of the camera prior, calibrated or kept for a stated reason.

    See ``docs/research/calibration.md``.

    Parameters
    ----------
    pitch : float
        Radians; standard deviation about the clip's nominal pitch.
    roll : float
        Radians; standard deviation about the clip's nominal roll.
    log_elevation : float
        Standard deviation of the log elevation about the clip's nominal one.
    log_body : float
        Standard deviation of log stature about that of the reference body.
    ankle : float
        Mean height of the static path's lower ankle above the floor, metres; a true ankle's is .09.
    ankle_offset : float
        Metres; standard deviation between clips of that height.
    ankle_spread : float
        Metres; scale of the error of one independent observation of the lowest ankle.
    ankle_dof : float
        Degrees of freedom of its Student-t error, because feet are lifted, hidden or put on chairs.
    correlation_time : float
        Seconds between independent observations.
    """

    pitch: float = from_data("camera.pitch")
    roll: float = from_data("camera.roll")
    log_elevation: float = from_data("camera.log_elevation")
    log_body: float = from_data("body.log_scale")
    ankle: float = from_data("ankle.height")
    ankle_offset: float = from_data("ankle.offset")
    ankle_spread: float = from_data("ankle.spread")
    ankle_dof: float = from_data("ankle.dof")
    correlation_time: float = from_data("frames.correlation_time")

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            require_number(f"camera setting {name}", getattr(self, name), above=0)


@dataclass(frozen=True)
class Settings:
    """All constants of the model and of the estimates made before sampling.

    Parameters
    ----------
    model : ModelSettings
    path : StaticPathSettings
    camera : CameraSettings
    detector : DetectorSettings
    device : str
        The torch device on which scenelets are fitted to windows.
    """

    model: ModelSettings = field(default_factory=ModelSettings)
    path: StaticPathSettings = field(default_factory=StaticPathSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    device: str = "cpu"

    def differences(self, other: Settings) -> tuple[str, ...]:
        """Names of the constants that have another value in other settings.

        Parameters
        ----------
        other : Settings

        Returns
        -------
        tuple of str
            Such as ``"path.walk_time"``. The device is no constant of the model.
        """
        tables = ((f.name, getattr(self, f.name)) for f in fields(self) if f.name != "device")
        return tuple(
            f"{name}.{constant.name}"
            for name, own in tables
            for constant in fields(own)
            if getattr(own, constant.name) != getattr(getattr(other, name), constant.name)
        )

    def without(self, scene: str) -> Settings:
        """The settings with estimated constants that leave out one scene, for cross-validation.

        The tails of joint jumps (``joints.jump_dof``) are unchanged: they are part of compiled
        code.

        Parameters
        ----------
        scene : str
            Name of a scene of i3DB, such as ``"Scene04"``.

        Returns
        -------
        Settings
        """
        values = values_without(scene)
        return Settings(
            model=with_values(self.model, values),
            path=with_values(self.path, values),
            camera=with_values(self.camera, values),
            detector=with_values(self.detector, values),
            device=self.device,
        )
