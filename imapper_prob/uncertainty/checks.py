"""Checks of a result that do not depend on the convergence of chains.

A run reports them before the verdict, because chains may also agree on a wrong result. Each is a
prior or posterior predictive check: one quantity is compared with a limit that 99 of 100 clips stay
within if the model is right. Usual values come from :mod:`imapper_prob.models.settings` and the
spreads of ``calibrated.toml``; ``docs/research/alarms.md`` has the rates measured on correct and on
faulty clips.

``upright``      people on their feet are upright in the cameras of the draws
``height``       their feet are at the usual height above the floor
``slope``        their feet are at the same height near and far
``camera``       the camera is about where it was said to be
``prediction``   the draws predict such detections, and a seat for everyone who is off their feet
``resemblance``  some scenelet of the library resembles the detected motion
``elsewhere``    the detector was on the person
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import beta, chi2, norm

from imapper_prob.files import without_nan
from imapper_prob.models.calibrated import calibrated, constants
from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import student_t
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import sight_clearance
from imapper_prob.models.kernels.placement import place_boxes
from imapper_prob.models.kernels.stays import unsupported
from imapper_prob.models.kernels.visibility import visibility_probability
from imapper_prob.models.log_posterior import State, camera_at, motion, side_flips
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip
from imapper_prob.models.settings import NEAREST
from imapper_prob.models.skeleton import (
    DETECTED,
    LANK,
    LHIP,
    LKNE,
    MIRROR,
    PELV,
    RANK,
    RHIP,
    RKNE,
    THRX,
)
from imapper_prob.models.text import readable
from imapper_prob.people import everybody, own_part

__all__ = [
    "Check",
    "alarms",
    "camera",
    "checks_of",
    "elsewhere",
    "from_json",
    "height",
    "named",
    "prediction",
    "resemblance",
    "slope",
    "to_json",
    "upright",
]

_RATE: Final = 0.01
"""Rate at which each check raises a false alarm; for six of them about 6 % in total."""


@dataclass(frozen=True)
class Check:
    """The result of one check.

    Parameters
    ----------
    name : str
        One word.
    value, limit : float
        The checked quantity, and the limit beyond which it is alarming; NaN if unknown. In degrees,
        metres, metres per metre, standard deviations, a probability, a share of the frames, and
        frames.
    alarmed : bool
    sentence : str
        What is wrong and what to do about it, or that nothing is wrong.
    """

    name: str
    value: float
    limit: float
    alarmed: bool
    sentence: str


# ------------------------------------------------------------------------------------------------
# Camera: people upright, feet on a level floor.
#
# Lifted poses tell what is upright, and the static path tells where feet are; both are independent
# of scenelets. Everything is evaluated in the world frames of the draws' cameras.

Array = NDArray[np.float64]
_NORMAL: Final = float(norm.isf(_RATE / 2))
"""Standard deviations of a two-sided normal test at that rate."""
_TRUNK_AND_THIGHS: Final = [THRX, RHIP, LHIP, RKNE, LKNE]
_STRAIGHT: Final = math.radians(30.0)
"""Largest angle between trunk and thighs of people on their feet; in a seat it is 60 degrees or
more."""
_UPRIGHT_PART: Final = 0.25
"""Share of those frames that must be upright; in the others the person may lie, lean or reach."""
_LEAN: Final = math.radians(6.3)
"""Standard deviation over clips, per direction, of the lean of the most upright of these frames and
of the lifter's error: simulated clips of ``python -m lab.alarms``. On i3DB they lean by 3 to 7
degrees."""
_OVERTURNED: Final = 60.0
"""Degrees above which a wrong pitch is unlikely to be the cause."""


def upright(clip: Clip, problem: Problem, cameras: Array) -> Check:
    """Check that people on their feet are upright.

    People are on their feet if trunk and thighs are in line. That line should be vertical, up to an
    error, in a quarter of these frames.

    Parameters
    ----------
    clip : Clip
        With lifted poses.
    problem : Problem
        Problem of all people in the clip.
    cameras : (N, 5) float
        Cameras of draws.

    Returns
    -------
    Check
    """
    people = everybody(clip)
    own = people.has_pose & ~people.interpolated
    poses = np.where(own[:, None, None], people.poses, 0.0)
    trunk = _unit(poses[:, THRX] - poses[:, PELV])
    thighs = _unit(poses[:, [RHIP, LHIP]].sum(1) - poses[:, [RKNE, LKNE]].sum(1))
    seen = _told(problem)[:, _TRUNK_AND_THIGHS].mean(1) > 0.5
    straight = own & seen & ((trunk * thighs).sum(1) > math.cos(_STRAIGHT))
    pitch, roll = calibrated("camera.pitch"), calibrated("camera.roll")
    either_way = math.sqrt(_LEAN**2 + (pitch**2 + roll**2) / 2)
    limit = math.degrees(either_way * math.sqrt(-2.0 * math.log(_RATE)))
    if straight.sum() < calibrated("frames.correlation_time") * clip.fps:
        return Check("upright", math.nan, limit, False, "Nobody is seen on their feet for long.")
    axis = _unit(trunk + thighs)[straight]
    up = np.median([_level(phi).rotation[2] for phi in cameras], axis=0)
    tilt = np.degrees(np.arccos(np.clip(axis @ _unit(up), -1.0, 1.0)))
    value = float(np.quantile(tilt, _UPRIGHT_PART))
    if not value > limit:
        return Check("upright", value, limit, False, f"People stand upright, to {value:.0f}°.")
    why = (
        "its pitch or roll is wrong: give --pitch in degrees (down is negative)"
        if value < _OVERTURNED
        else "the film lies on its side or the joints are upside down (pixels count downward from "
        "the top): turn them; unless the person lies down all the time"
    )
    sentence = (
        f"The camera cannot be right: whoever is on their feet leans by {value:.0f}° or more, "
        f"where {limit:.0f}° are rare. Probably {why}. Furniture and distances mean nothing."
    )
    return Check("upright", value, limit, True, sentence)


def _feet(problem: Problem, cameras: Array) -> tuple[Array, Array, Array]:
    """Height and depth in metres of the lower visible ankle (T,), and its weight.

    Heights and depths are medians over the cameras. As in :mod:`imapper_prob.solver.camera_prior`,
    hidden feet are ignored, and others weighted by the detector's confidence.
    """
    index, ankles = np.arange(problem.n_frames), [RANK, LANK]
    guessed = _told(problem)[:, ankles] == 0
    world = np.array([_world(problem, phi)[:, ankles] for phi in cameras])
    up = np.median(world[..., 2], axis=0)
    lower = np.where(guessed & ~guessed.all(1, keepdims=True), np.inf, up).argmin(1)
    away = np.median(world[..., 1], axis=0)[index, lower]
    sure = (problem.used * problem.confidences)[:, ankles][index, lower]
    return up[index, lower], away, sure * ~guessed[index, lower]


def height(problem: Problem, cameras: Array, *, fps: float) -> Check:
    """Check that feet are at the usual height above the floor.

    Parameters
    ----------
    problem : Problem
    cameras : (N, 5) float
        Cameras of draws.
    fps : float
        Frames per second.

    Returns
    -------
    Check
    """
    above, _, counts = _feet(problem, cameras)
    often = counts.sum() / max(1.0, calibrated("frames.correlation_time") * fps)
    limit = _NORMAL * math.hypot(calibrated("ankle.offset"), _median_error(often))
    if counts.sum() < calibrated("frames.correlation_time") * fps:
        return Check("height", math.nan, limit, False, "Feet are hardly ever seen.")
    value = _median(above, counts) - calibrated("ankle.height")
    if not abs(value) > limit:
        return Check("height", value, limit, False, f"Feet are on the floor, to {value:+.2f} m.")
    where = "float above" if value > 0 else "have their feet below"
    sentence = (
        f"The camera cannot be right: people {where} the floor, by {abs(value):.2f} m in the "
        "median. Give --camera-height in metres, and --pitch in degrees (down is negative)."
    )
    return Check("height", value, limit, True, sentence)


def slope(problem: Problem, cameras: Array, *, fps: float) -> Check:
    """Check that the floor is level: distant feet are as high as near ones.

    Parameters
    ----------
    problem : Problem
    cameras : (N, 5) float
        Cameras of draws.
    fps : float
        Frames per second.

    Returns
    -------
    Check
    """
    above, away, counts = _feet(problem, cameras)
    nothing = Check("slope", math.nan, math.nan, False, "Too few feet are seen to say of a slope.")
    if counts.sum() < 2 * calibrated("frames.correlation_time") * fps:
        return nothing
    middle = _median(away, counts)
    near, far = counts * (away <= middle), counts * (away > middle)
    if min(near.sum(), far.sum()) < 0.25 * counts.sum():
        return nothing
    apart = _median(away, far) - _median(away, near)
    seconds = max(1.0, calibrated("frames.correlation_time") * fps)
    # A relative error of the depth lowers the feet by the same fraction of the camera's height
    # above them.
    sunk = float(_median(problem.path_scale[:, 1], counts) * np.median(cameras[:, 1]))
    error = math.hypot(
        *(
            math.hypot(_median_error(often), sunk / math.sqrt(max(often, 1.0)))
            for often in (near.sum() / seconds, far.sum() / seconds)
        )
    )
    pitch = float(np.std(cameras[:, 0]))
    limit = _NORMAL * math.hypot(error / max(apart, 1e-9), pitch)
    value = (_median(above, far) - _median(above, near)) / max(apart, 1e-9)
    if not abs(value) > limit:
        return Check("slope", value, limit, False, f"The floor is level, to {value:+.2f}.")
    way = "rises" if value > 0 else "falls"
    sentence = (
        f"The camera cannot be right: the floor {way} by {100 * abs(value):.0f} cm a metre away "
        f"from it. Give --pitch in degrees (down is negative), about "
        f"{abs(math.degrees(math.atan(value))):.0f}° {'lower' if value > 0 else 'higher'}, and "
        "--focal if it was guessed."
    )
    return Check("slope", value, limit, True, sentence)


def camera(nominal: Camera, cameras: Array) -> Check:
    """Check that the draws' cameras are about where the clip's camera was said to be.

    The distance is in standard deviations of pitch, roll and log elevation as measured; the prior
    of the elevation is wider, so that a wrong one does little harm.

    Parameters
    ----------
    nominal : Camera
        The camera of the clip.
    cameras : (N, 5) float
        Cameras of draws.

    Returns
    -------
    Check
    """
    pitch, elevation, _, _, roll = np.median(cameras, axis=0).tolist()
    usual = constants()
    apart = np.array(
        [
            (pitch - nominal.pitch) / calibrated("camera.pitch"),
            (roll - nominal.roll) / calibrated("camera.roll"),
            math.log(elevation / nominal.elevation)
            / float(np.asarray(usual["camera.log_elevation"].measured)),
        ]
    )
    value, limit = float(np.linalg.norm(apart)), math.sqrt(chi2.isf(_RATE, len(apart)))
    found = (
        f"{elevation:.2f} m above the floor at a pitch of {_degrees(pitch)} and a roll of "
        f"{_degrees(roll)}"
    )
    said = f"{nominal.elevation:.2f} m, {_degrees(nominal.pitch)} and {_degrees(nominal.roll)}"
    if not value > limit:
        sentence = f"The camera is {found}, near enough to the {said} that were said or assumed."
        return Check("camera", value, limit, False, sentence)
    sentence = (
        f"The camera is not where it was said or assumed to be: what is seen puts it {found}, "
        f"where {said} were given. Measure --camera-height (metres) and --pitch (degrees, down is "
        "negative); one of them, or --focal, is wrong."
    )
    return Check("camera", value, limit, True, sentence)


def _degrees(angle: float) -> str:
    """An angle in radians as whole degrees, without a sign of zero."""
    return f"{round(math.degrees(angle))}°"


def _told(problem: Problem) -> NDArray[np.int64]:
    """(T, 16) 1 for joints that are detected and more probably seen than hidden."""
    result: NDArray[np.int64] = problem.used * problem.confidence_density.argmax(-1)
    return result


def _level(phi: Array) -> Camera:
    return Camera(
        1, 1, 1.0, 1.0, 0.0, 0.0, pitch=float(phi[0]), roll=float(phi[4]), elevation=float(phi[1])
    )


def _world(problem: Problem, phi: Array) -> Array:
    """(T, 16, 3) joints of the static path in the world frame of a camera, metres."""
    focal, body = math.exp(phi[2]), math.exp(phi[3])
    depth = np.exp(problem.path_centre[:, 1]) * focal * body
    pelvis = np.stack(
        [problem.path_centre[:, 0] / focal, np.ones_like(depth), problem.lift / focal]
    )
    joints = (depth * pelvis).T[:, None] + body * problem.poses
    return _level(phi).to_world(joints)


def _unit(vectors: Array) -> Array:
    result: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return result


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(heap, heap[-1] / 2)])


def _median_error(often: float) -> float:
    """Standard error in metres of the median of so many independent ankle heights.

    The density of a Student-t of 2 degrees of freedom and scale s is 1 / (2 sqrt(2) s) at its
    centre, and the standard error of a median is 1 / (2 sqrt(n)) divided by that density.
    """
    return math.sqrt(2.0 / max(often, 1.0)) * calibrated("ankle.spread")


# ------------------------------------------------------------------------------------------------
# Prediction: detections like those of the clip, and seats for those who need one.


def prediction(
    problem: Problem, states: Sequence[State], nominal: Camera, *, rng: np.random.Generator
) -> Check:
    """Check that the draws predict detections like those of the clip.

    This is a posterior predictive p-value (Gelman, Meng and Stern 1996), averaged over draws. For
    each draw, the log-density of detected positions given their confidences, in frames inside
    scenelets, is compared with that of detections drawn from the same scene; frames have the weight
    ``frame_weight``, because they are correlated. In addition, a draw in which people sit on
    nothing at a cost of S nats has a p-value of at most exp(-S), because S is a log likelihood
    ratio (:mod:`imapper_prob.models.kernels.stays`). The result is twice the smaller of both.

    Parameters
    ----------
    problem : Problem
    states : sequence of State
        Posterior draws.
    nominal : Camera
    rng : Generator
        Generator for simulated detections.

    Returns
    -------
    Check
    """
    of_detections = float(
        np.mean([_tail(problem, s, camera_at(nominal, s.camera), rng) for s in states])
    )
    on_air = [unsupported(problem.stays, problem.lowered, state.items) for state in states]
    carried = float(np.mean(np.exp(-np.asarray(on_air))))
    value = min(1.0, 2.0 * min(of_detections, carried))
    if not value < _RATE:
        sentence = f"The scenes predict such detections (posterior predictive p = {value:.2f})."
        return Check("prediction", value, _RATE, False, sentence)
    what = (
        f"somebody is off their feet for seconds and the scenes have nothing to carry them "
        f"({np.mean(on_air):.0f} nats against it)"
        if carried < of_detections
        else "the people in it are not where the joints were detected"
    )
    sentence = (
        f"The scenes do not explain the clip (posterior predictive p = {value:.4f}): {what}. Do "
        "not believe them; the library lacks what is done here, or camera or joints are wrong."
    )
    return Check("prediction", value, _RATE, True, sentence)


_REPEATS: Final = 8
"""Simulated detections per joint."""


def _tail(problem: Problem, state: State, seen_by: Camera, rng: np.random.Generator) -> float:
    """Probability of detections that fit a draw no better; 1 if the draw has no scenelet."""
    covered = np.zeros(problem.n_frames, bool)
    bodies = np.full(problem.n_frames, state.camera[3])
    for (scenelet, start), size in zip(state.items.tolist(), state.sizes.tolist(), strict=True):
        own = slice(start, start + int(problem.lengths[scenelet]))
        covered[own], bodies[own] = True, state.camera[3] + size
    if not (covered[:, None] & problem.used).any():
        return 1.0
    frames = np.flatnonzero(covered)
    turned = side_flips(problem, state)[frames, None] > 0.5
    of = (frames[:, None], np.where(turned, MIRROR, np.arange(len(MIRROR))))
    joints = motion(problem, state)[frames]
    depth = np.maximum(seen_by.to_camera(joints)[..., 1], NEAREST)
    loose = seen_by.fx * problem.pose_tolerance * np.exp(bodies[frames])[:, None] / depth
    boxes, *_ = place_boxes(problem, state.camera, state.items, state.placements, state.sizes)
    clear = sight_clearance(seen_by.centre, joints, boxes)
    in_view = np.vectorize(visibility_probability)(
        clear, problem.sight_width, problem.visibility_error
    )
    used = problem.used[of] & np.isfinite(seen_by.project(joints)).all(-1)
    squared = ((seen_by.project(joints) - problem.keypoints[of]) ** 2).sum(-1)[used]
    # Probabilities of hidden and seen, given the confidence.
    share = np.stack([1.0 - in_view, in_view], -1)[used] * problem.confidence_density[of][used]
    share /= share.sum(-1, keepdims=True)
    scale = np.hypot(problem.error_scale[of], loose[..., None])[used]
    dof = problem.error_dof[of][used]
    found = _log_density(squared, share, scale, dof)
    state_of = (rng.random((_REPEATS, len(share))) < share[:, 1]).astype(np.int64)
    row = np.arange(len(share))
    tails, width = dof[row, state_of], scale[row, state_of]
    # (r / s)^2 / nu exceeds x with probability (1 + x)^(-nu / 2).
    radius = width**2 * tails * np.expm1(-2.0 / tails * np.log1p(-rng.random(state_of.shape)))
    drawn = _log_density(radius, share, scale, dof)
    spread = math.sqrt(float(drawn.var(0).sum()) / min(1.0, problem.frame_weight))
    return float(norm.cdf((found.sum() - drawn.mean(0).sum()) / max(spread, 1e-9)))


def _log_density(squared: Array, share: Array, scale: Array, dof: Array) -> Array:
    """(..., K) nats per square pixel, from squared distances (..., K) and tables (K, 2)."""
    each = share * np.exp(student_t(squared[..., None], scale, dof))
    result: Array = np.log(np.maximum(each.sum(-1), np.finfo(float).tiny))
    return result


# ------------------------------------------------------------------------------------------------
# All checks of a result.

Flags = NDArray[np.bool_]
_LOOKED_AT: Final = 40
"""Number of draws, evenly spaced over the chains, that checks use."""


def checks_of(
    clip: Clip,
    problem: Problem,
    states: Sequence[State],
    best_fits: Array,
    *,
    rng: np.random.Generator,
) -> tuple[Check, ...]:
    """Make all checks, in the order in which their alarms are reported.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        Problem of all people in the clip.
    states : sequence of State
        Posterior draws.
    best_fits : (T,) float
        See :func:`imapper_prob.solver.fits.best_fits`.
    rng : Generator
        Generator for simulated detections.

    Returns
    -------
    tuple of Check
    """
    chosen = np.linspace(0, len(states) - 1, min(_LOOKED_AT, len(states))).round().astype(int)
    drawn = [states[k] for k in chosen.tolist()]
    cameras = np.array([state.camera for state in drawn])
    return (
        upright(clip, problem, cameras),
        height(problem, cameras, fps=clip.fps),
        slope(problem, cameras, fps=clip.fps),
        camera(clip.camera, cameras),
        resemblance(best_fits, fps=clip.fps),
        prediction(problem, drawn, clip.camera, rng=rng),
        elsewhere(clip, _away(clip, problem)),
    )


def _away(clip: Clip, problem: Problem) -> list[Flags]:
    """Frames of each track whose detections the problem has not."""
    detected = (everybody(clip).confidences[:, list(DETECTED)] > 0).any(1)
    return np.split(detected & ~problem.used.any(1), len(clip.tracks))


def alarms(checks: Iterable[Check]) -> tuple[str, ...]:
    """The sentences of the checks that raise an alarm.

    Parameters
    ----------
    checks : iterable of Check

    Returns
    -------
    tuple of str
    """
    return tuple(check.sentence for check in checks if check.alarmed)


def to_json(checks: Iterable[Check]) -> str:
    """Serialise checks as JSON; NaN becomes null.

    Parameters
    ----------
    checks : iterable of Check

    Returns
    -------
    str
    """
    return json.dumps(without_nan([asdict(check) for check in checks]), allow_nan=False)


def from_json(text: str) -> tuple[Check, ...]:
    """Read checks that :func:`to_json` wrote.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of Check

    Raises
    ------
    InputError
        The text is not of that format.
    """
    try:
        return _from_rows(json.loads(text))
    except (AttributeError, LookupError, OverflowError, RecursionError, TypeError) as error:
        raise InputError(f"checks are not as they were written ({error})") from error
    except ValueError as error:
        raise InputError(f"checks are no JSON ({error})") from error


def _from_rows(rows: Iterable[Mapping[str, Any]]) -> tuple[Check, ...]:
    return tuple(
        Check(
            str(row["name"]),
            math.nan if row["value"] is None else float(row["value"]),
            math.nan if row["limit"] is None else float(row["limit"]),
            bool(row["alarmed"]),
            readable(str(row["sentence"])),
        )
        for row in rows
    )


_UNLIKE: Final = 0.72
"""Nats per confident joint: 95 % of the frames of simulated clips have a right scenelet that fits
better (``python -m lab.alarms 160 --threshold``)."""
_UNLIKE_PART: Final = 0.05
"""Part of the frames of simulated clips whose right scenelet fits worse than `_UNLIKE`."""
_UNLIKE_TIME: Final = 3.0
"""Seconds of a clip that tell as much of this part as one independent frame, by the variance of the
part of the frames of a clip (the same command)."""


def resemblance(best: Array, *, fps: float) -> Check:
    """Check that the library has scenelets that resemble the detected motion.

    The limit belongs to a beta distribution of the part of the frames, which has the mean and the
    variance of that part over simulated clips.

    Parameters
    ----------
    best : (T,) float
        See :func:`imapper_prob.solver.fits.best_fits`.
    fps : float
        Frames a second.

    Returns
    -------
    Check
    """
    judged = best[np.isfinite(best)]
    others = len(judged) / (fps * _UNLIKE_TIME) - 1.0
    known = _UNLIKE_PART * others, (1.0 - _UNLIKE_PART) * others
    limit = float(beta.isf(_RATE, *known)) if others > 0 else 1.0
    if not len(judged):
        return Check("resemblance", math.nan, limit, False, "Nothing says how well scenelets fit.")
    value = float(np.mean(judged > _UNLIKE))
    told = f"No scenelet of the library resembles {100 * value:.0f} % of the clip"
    if not value > limit:
        return Check("resemblance", value, limit, False, f"{told}.")
    sentence = (
        f"{told} ({100 * limit:.0f} % are rare): what is done there the program does not know, and "
        "what it says of furniture there is a guess. Check camera and joints; if they are right, "
        "add scenelets of such motions with --library."
    )
    return Check("resemblance", value, limit, True, sentence)


def elsewhere(clip: Clip, away: Sequence[Flags]) -> Check:
    """Check that the detector was always on its people.

    Parameters
    ----------
    clip : Clip
    away : sequence of (T,) bool
        Frames of each track in which the detector was on something else, see
        :func:`imapper_prob.solver.detections.elsewhere_frames`.

    Returns
    -------
    Check
    """
    frames = int(sum(flags.sum() for flags in away))
    if not frames:
        return Check("elsewhere", 0.0, 0.0, False, "The detector was on the person throughout.")
    whose = [
        f"{named(clip.frame_ids[flags])}{f' of{own_part(clip, k)}' if len(away) > 1 else ''}"
        for k, flags in enumerate(away)
        if flags.any()
    ]
    sentence = (
        f"The detector was on something else in frame{'s' if frames > 1 else ''} "
        f"{'; '.join(whose)}: all joints jump there and back as nobody moves. These frames count "
        "as undetected."
    )
    return Check("elsewhere", float(frames), 0.0, True, sentence)


def named(frames: ArrayLike) -> str:
    """Write ascending frame numbers as ranges: ``"12-25, 70"``.

    Parameters
    ----------
    frames : (n,) int

    Returns
    -------
    str
    """
    numbers = np.asarray(frames, np.int64)
    if not len(numbers):
        return "none"
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
