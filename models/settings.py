"""The constants of the model, each with its unit and where it comes from.

Those that were estimated from data are read from ``calibrated.toml``, which states the source,
and the spread, of every one (``docs/calibration.md``); the others are chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.errors import InputError

__all__ = ["ModelSettings"]


@dataclass(frozen=True)
class ModelSettings:
    """What the log-posterior is made with.

    Parameters
    ----------
    frame_weight : float
        Factor on every frame's log-likelihood at 10 frames a second, for joints and frames
        repeat each other's errors: one over the frames in which all of them say one thing.
    swap_rate : float
        How often a second the detector begins to take left for right.
    swap_length : float
        Seconds that this lasts, on average.
    pose_tolerance : float
        Metres, of a body of the reference stature; standard deviation of a real joint about
        the scenelet's. A library of a few hundred motions never holds exactly this person's.
    sight_width : float
        Metres; width of the step from hidden to seen over the clearance of the ray: furniture
        is neither quite of the scenelet's shape nor quite where it says.
    surprise : float
        Probability that a joint is hidden although nothing known is in its way, or seen
        although something is.
    memory_bearing, memory_depth : float
        Seconds in which the static path's errors across and along the view forget themselves.
    ease_bearing, ease_depth : float
        Seconds of these in which such an error changes its course, at most half of them: 0 for
        errors that are rough from frame to frame, half for the smoothest.
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
        detections do not tell (``docs/model.md``).
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
        error of that size does, .5 would make a hidden one speak as loudly as in the default
        energy: no number does both, and this is between them.
    """

    frame_weight: float = 1 / (10 * calibrated("scores.repeat_time"))
    swap_rate: float = calibrated("swaps.rate")
    swap_length: float = calibrated("swaps.length")
    pose_tolerance: float = calibrated("pose.tolerance")
    sight_width: float = calibrated("sight.width")
    surprise: float = 0.02
    memory_bearing: float = calibrated("bias.time_across")
    memory_depth: float = calibrated("bias.time_along")
    ease_bearing: float = calibrated("bias.ease_across")
    ease_depth: float = calibrated("bias.ease_along")
    walk_bearing: float = calibrated("walk.bearing")
    walk_log_depth: float = calibrated("walk.log_depth")
    start_bearing: float = 0.25
    start_log_depth: float = 0.4
    start_depth: float = 4.0
    size_spread: float = calibrated("scenelet.log_size")
    facing_spread: float = calibrated("facing.spread")
    joint_step: float = calibrated("joints.jump_scale")
    smoothness_cost: float = 1 / (10 * calibrated("frames.correlation_time"))
    furniture_aside: float = calibrated("furniture.aside")
    furniture_ahead: float = calibrated("furniture.ahead")
    collision_cost: float = 100.0
    motion_cost: float = 50.0
    merge_angle: float = 0.6
    support_angle: float = calibrated("support.angle")
    support_slope: float = calibrated("support.slope")
    support_time: float = calibrated("frames.correlation_time")
    scenelet_rate: float = 0.02
    likelihood: float = 1.0
    energy: str = "default"
    paper_nats: float = 30.0

    def __post_init__(self) -> None:
        for name in (
            "frame_weight", "swap_rate", "swap_length", "pose_tolerance", "sight_width",
            "walk_bearing", "walk_log_depth", "memory_bearing", "memory_depth",
            "start_bearing", "start_log_depth", "start_depth", "scenelet_rate", "size_spread",
            "facing_spread", "joint_step", "paper_nats", "furniture_aside", "furniture_ahead",
            "support_angle", "support_slope", "support_time",
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(f"model setting {name} = {getattr(self, name)} must be positive")
        for name in ("bearing", "depth"):
            ease, seconds = getattr(self, f"ease_{name}"), getattr(self, f"memory_{name}")
            if not 0 <= ease <= seconds / 2:
                raise InputError(
                    f"model setting ease_{name} = {ease} must be from 0 to half of "
                    f"memory_{name} = {seconds}"
                )
        if self.energy not in ("default", "paper"):
            raise InputError(f"model setting energy = {self.energy!r} must be default or paper")
        if not 0 < self.surprise < 0.5:
            raise InputError(f"model setting surprise = {self.surprise} must be in (0, 0.5)")
