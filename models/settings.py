"""Bounds of what the program takes, and the constants of the model, each with unit and source.

Constants that were estimated from data are read from ``calibrated.toml``, which states source and
spread of every one (``docs/research/calibration.md``); the others are chosen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from imapper_prob.models.calibrated import Number, from_data, values_without, with_values
from imapper_prob.models.detector import DetectorSettings
from imapper_prob.models.errors import InputError
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = [
    "ANKLE",
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
    "SLOWEST_FILM",
    "STEEPEST_CAMERA",
    "CameraSettings",
    "ModelSettings",
    "PaperWeights",
    "Settings",
    "StaticPathSettings",
]

NEAREST: Final = 0.1
"""Metres; depth at which a point counts that is nearer to the camera or behind it."""
NEAR_SIGHT: Final = 0.05
"""Metres; nearer to the camera than this, bearing and slope of a line of sight say nothing."""
LEVEL: Final = 0.02
"""Metres two things may overlap in height before they count as being level."""
NOTHING_IN_SIGHT: Final = 0.2
"""Metres; cap of the clearance: a line of sight that far from every box is as free as any."""
OPAQUE: Final = 0.1
"""Metres; a line of sight through the middle of a box thinner than twice this counts as this
deep in it: a table top hides as well as a chest does."""
LOWEST_CAMERA: Final = 0.2
"""Metres above the floor: the support of the camera's elevation begins here."""
STEEPEST_CAMERA: Final = 1.0
"""Radians of pitch or roll either way: the support of the camera's pose ends here."""
HIGHEST_CAMERA: Final = 100.0
"""Metres above the floor: people are a few pixels high from there."""
LARGEST_IMAGE: Final = 65_536
"""Pixels a side: sixteen times that of the largest films."""
SHORTEST_FOCAL: Final = 0.005
LONGEST_FOCAL: Final = 100.0
"""Longer sides of the image: fields of view of 179 degrees, and of half a degree."""
FARTHEST_KEYPOINT: Final = 1e4
"""Longer sides of the image from its corner: detectors place joints a little outside of it, and
draws of the detection model, whose tails have two degrees of freedom, some hundred of them away."""
SLOWEST_FILM: Final = 0.1
QUICKEST_FILM: Final = 1_000.0
"""Frames a second: one in ten seconds, and what laboratories film people with."""
LONGEST_CLIP: Final = 36_000
"""Frames: an hour at ten a second. A longer clip is a damaged frame number."""
SHORTEST_CLIP: Final = 8
"""Frames; in less than a second nobody does anything that furniture explains."""
MOST_PEOPLE: Final = 64
"""In one clip: a crowd."""


@dataclass(frozen=True)
class PaperWeights:
    """The factors of the five terms of :mod:`~imapper_prob.models.published_energy`.

    The paper prints none. These are those of the command files that the authors released with
    i3DB, for terms in normalised image coordinates and metres on clips of 10 frames a second. One
    scene (Scene10) has ``occlusion`` 10, the others 1. The files have one weight for
    intersections, which the released program halves where joints meet objects.

    Parameters
    ----------
    reprojection : float
        A unit of squared normalised image coordinates.
    occlusion : float
        A square metre.
    smoothness : float
        A square metre.
    collision : float
        A cubic metre: depth in the other object, over the floor.
    motion : float
        A metre.

    Raises
    ------
    InputError
        If a weight is negative or not finite.
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


ANKLE: Final = 0.09
"""Metres of an ankle joint above the floor under a standing foot (lateral malleolus)."""


def _share(seconds: Number) -> Number:
    """One over the number of frames, at 10 a second, that say the same for so long."""
    if isinstance(seconds, tuple):
        raise TypeError("a time is one number")
    return 1 / (10 * seconds)


@dataclass(frozen=True)
class ModelSettings:
    """What the log-posterior is made with.

    Parameters
    ----------
    frame_weight : float
        Factor on every frame's log-likelihood at 10 frames a second, for joints and frames
        repeat each other's errors: one over the frames in which all of them say one thing.
    side_flip_rate : float
        How often a second the detector begins to take left for right.
    side_flip_length : float
        Seconds that this lasts, on average.
    pose_tolerance : tuple of 16 float
        Metres, of a body of the reference stature; standard deviation of a real joint about
        the scenelet's, by joint, the same on both sides. A library of a few hundred motions never
        holds exactly this person's, and differs most where limbs end.
    sight_width : float
        Metres; width of the step from hidden to seen over the clearance of the ray: furniture
        is neither quite of the scenelet's shape nor quite where it says.
    visibility_error : float
        Probability that a joint is hidden although nothing known is in its way, or seen
        although something is.
    correlation_time_bearing, correlation_time_depth : float
        Seconds; half the integrated autocorrelation of the static path's errors across and along
        the view.
    smoothing_time_bearing, smoothing_time_depth : float
        Seconds of these over which such an error is smooth, at most half of them: 0 for errors
        that are rough from frame to frame, half for the smoothest.
    stay_change : float
        Seconds of a stay in which the error along the view changes as it does elsewhere; after
        them it stands still.
    walk_bearing, walk_log_depth : float
        Standard deviation of one frame's step of the pelvis at 10 frames a second: tangent
        of the bearing, and log metres. Of a person nobody has looked at yet.
    start_bearing, start_log_depth : float
        Standard deviations of where that person is.
    start_depth : float
        Metres; median depth there.
    size_spread : float
        Standard deviation of the log size of one scenelet, person and furniture, about the body
        scale: how far a fitted motion leaves open at what distance it was (i3DB, stretches of 2 s).
    facing_spread : float
        Radians, scale of the wrapped Cauchy error of where the static path has somebody face
        about where the right scenelet does, both averaged over its frames.
    joint_step : float
        Metres an axis, of a body of the reference stature; scale of a joint's step, relative to
        the pelvis, from the frame before a scenelet to its first and from its last to the next.
        Nearly all of it is how scenelet and lifted pose differ (i3DB), so that it does not
        depend on the frame rate.
    smoothness_cost : float
        Factor on those steps' nats, for joints err together, as many as frames in the time over
        which these repeat their errors.
    furniture_aside : float
        Standard deviation of how far to its side a piece of furniture stands from where its
        scenelet says, as a share of its width. With the next one: of what is drawn, for the
        detections do not tell (``docs/explanation/model.md``).
    furniture_ahead : float
        Metres; the same to its front and back, and out of the way of somebody who walks there.
    collision_cost : float
        Nats per metre that two objects are in each other, on the floor.
    motion_cost : float
        Nats per metre and frame that the person is in an object, or below the floor, before
        ``frame_weight``.
    merge_angle : float
        Radians; two overlapping objects of the same label turned less than this against
        each other, or in any way if it has no front, are one object seen twice.
    support_angle : float
        Radians; angle of the thighs to the vertical that says as much for being carried as for
        standing on one's feet.
    support_slope : float
        Nats a radian by which a greater angle speaks for being carried.
    support_time : float
        Seconds over which frames say the same of that.
    scenelet_rate : float
        Prior odds of a scenelet starting at a given frame against none, shared among the
        library.
    likelihood : float
        Factor on everything that depends on data; 1, or 0 for the prior.
    energy : str
        ``"default"``, or ``"paper"`` for the published energy in place of the likelihood.
    paper_nats : float
        Nats a unit of the published energy, which comes without any. 700 would make a joint
        15 px off (the scale of i3DB's errors, at its focal length of 1955) cost what a normal
        error of that size does, .3 would make a joint that is lost and a metre in the open speak
        as loudly as in the default energy: no number does both, and this is between them.
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
            "support_angle", "support_slope", "support_time",
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(f"model setting {name} = {getattr(self, name)} must be positive")
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


@dataclass(frozen=True)
class StaticPathSettings:
    """Constants of the static path, calibrated (``docs/research/calibration.md``) but for three.

    Parameters
    ----------
    pixel_scale, dof : float
        Pixel error of a detection: scale in pixels at 1080 lines, degrees of freedom.
    correlation_time : float
        Seconds over which the errors of a frame repeat themselves, of detections and lifted
        poses alike.
    walk_bearing, walk_log_depth, walk_bone : float
        Standard deviation of one step at 10 frames a second: tangent (of bearing and of
        lift), log metres, metres.
    walk_time : float
        Seconds for which somebody goes on at about the same velocity.
    length_tolerance : float
        Factor on the published spreads of bone lengths.
    lifted_across, lifted_along : float
        Standard deviation of a lifted bone across and along the viewing direction, over its
        length.
    filled_tolerance : float
        Factor on these two where the pose was filled in; chosen.
    implausible : float
        Median pixel error at 1080 lines of the confident joints above which a lifted pose,
        put where it fits best, is not believed; chosen.
    bias_log_depth, bias_across : float
        Slow errors that stay within a correlation time: log metres, and metres.
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
    bias_log_depth: float = from_data("bias.log_depth")
    bias_across: float = from_data("bias.across")

    def frame_weight(self, fps: float) -> float:
        """One over the number of frames in a correlation time.

        Parameters
        ----------
        fps : float
            Frames a second.

        Returns
        -------
        float
            At most 1.
        """
        return min(1.0, 1.0 / (self.correlation_time * fps))


@dataclass(frozen=True)
class CameraSettings:
    """Constants of the camera's prior, calibrated or kept for a reason.

    See ``docs/research/calibration.md``.

    Parameters
    ----------
    pitch : float
        Radians; standard deviation about the clip's nominal pitch.
    roll : float
        Radians; standard deviation about the clip's nominal roll.
    log_elevation : float
        Standard deviation of the log height about the clip's nominal one.
    log_body : float
        Standard deviation of log stature about the reference body's.
    ankle : float
        Metres of an ankle joint above the floor under a standing foot.
    ankle_offset : float
        Metres; standard deviation of an error in this that stays the same all clip.
    ankle_spread : float
        Metres; scale of one independent observation of the lowest ankle.
    ankle_dof : float
        Degrees of freedom of its Student-t: feet are lifted, hidden and put on chairs.
    correlation_time : float
        Seconds between independent observations.
    """

    pitch: float = from_data("camera.pitch")
    roll: float = from_data("camera.roll")
    log_elevation: float = from_data("camera.log_elevation")
    log_body: float = from_data("body.log_scale")
    ankle: float = ANKLE
    ankle_offset: float = from_data("ankle.offset")
    ankle_spread: float = from_data("ankle.spread")
    ankle_dof: float = from_data("ankle.dof")
    correlation_time: float = from_data("frames.correlation_time")


@dataclass(frozen=True)
class Settings:
    """All constants of the model, and of what is estimated before it.

    Parameters
    ----------
    model : ModelSettings
    path : StaticPathSettings
    camera : CameraSettings
    detector : DetectorSettings
    device : str
        Of torch, on which scenelets are fitted to windows.
    """

    model: ModelSettings = field(default_factory=ModelSettings)
    path: StaticPathSettings = field(default_factory=StaticPathSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    device: str = "cpu"

    def without(self, scene: str) -> Settings:
        """The same with all that is estimated from data as it would be without one scene.

        The tails of the jumps of joints (``joints.jump_dof``) stay: they are part of compiled code.

        Parameters
        ----------
        scene : str
            Of i3DB, ``"Scene04"``.

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
