"""Checks of a result that do not depend on the chains.

A run reports them before the verdict, because chains agree as well on nonsense. Each is a posterior
predictive or prior check: it holds one thing against a limit that a clip passes in 99 of 100 cases
if the model is right. What is usual is said by :mod:`imapper_prob.models.settings` and the spreads
of ``calibrated.toml``; ``docs/research/alarms.md`` has the rates measured on clips that are right
and on clips that are wrong.

``upright``      people on their feet are upright in the cameras of the draws
``height``       their feet are as high above the floor as feet are
``slope``        and no higher further away
``camera``       the camera is about where it was said to be
``prediction``   the draws predict such detections, and have a seat for who is off their feet
``resemblance``  some scenelet of the library looks like what is seen
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
from scipy.stats import binom, chi2, norm

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
from imapper_prob.models.settings import ANKLE, NEAREST
from imapper_prob.models.skeleton import LANK, LHIP, LKNE, MIRROR, PELV, RANK, RHIP, RKNE, THRX
from imapper_prob.models.text import readable
from imapper_prob.people import everybody, own_part
from imapper_prob.solver.elsewhere import frames_elsewhere

__all__ = [
    "Check",
    "alarms",
    "camera",
    "checks_of",
    "elsewhere",
    "elsewhere_frames",
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
"""How often each check is alarmed by a clip that is as the model says; six of them, 5 % in all."""


@dataclass(frozen=True)
class Check:
    """One thing that must be so.

    Parameters
    ----------
    name : str
        One word.
    value, limit : float
        What was found, and from where on it is alarming; NaN where nothing could be found. In
        degrees, metres, metres a metre, standard deviations, a probability, a part of the frames,
        and frames.
    alarmed : bool
    sentence : str
        What is wrong and what to do about it, or that nothing is.
    """

    name: str
    value: float
    limit: float
    alarmed: bool
    sentence: str


# ------------------------------------------------------------------------------------------------
# Camera: people upright, feet on a level floor.
#
# Lifted poses say what is upright, the static path where feet are: neither has been bent by any
# scenelet. All of it is in the worlds of the draws' cameras.

Array = NDArray[np.float64]
_NORMAL: Final = float(norm.isf(_RATE / 2))
"""Standard deviations that a normal number exceeds as rarely, either way."""
_TRUNK_AND_THIGHS: Final = [THRX, RHIP, LHIP, RKNE, LKNE]
_STRAIGHT: Final = math.radians(30.0)
"""Between trunk and thighs of somebody on their feet, at most; 60 degrees and more in a seat."""
_UPRIGHT_PART: Final = 0.25
"""Part of those frames that must be upright; in the others one may lie, lean or reach."""
_LEAN: Final = math.radians(6.3)
"""Deviation over clips, either way, of how the most upright of that part leans and of what a lifter
makes of it: simulated clips of ``python -m lab.alarms``. On i3DB they lean by 3 to 7 degrees."""
_OVERTURNED: Final = 60.0
"""Degrees from which on no pitch is to blame: who films so steeply says so."""
_LEAST_SECONDS: Final = 1.2
"""Of frames of use, below which nothing is said: ``frames.correlation_time``."""


def upright(clip: Clip, problem: Problem, cameras: Array) -> Check:
    """Whether people on their feet are upright.

    On their feet is who has trunk and thighs in line; whether that line is vertical is not asked.
    It should be in a quarter of these frames, but for an error either way.

    Parameters
    ----------
    clip : Clip
        With lifted poses.
    problem : Problem
        Of everybody in it.
    cameras : (N, 5) float
        Those of draws.

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
    if straight.sum() < _LEAST_SECONDS * clip.fps:
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
    """Of the lower seen ankle (T,): metres above the floor, metres of depth, and what it counts.

    Medians over the cameras. As in :mod:`imapper_prob.solver.camera_prior`: of hidden feet
    detectors make something up, and they count as far as the detector is sure of them.
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
    """Whether feet are where feet are, above the floor.

    Parameters
    ----------
    problem : Problem
    cameras : (N, 5) float
        Those of draws.
    fps : float
        Frames a second.

    Returns
    -------
    Check
    """
    above, _, counts = _feet(problem, cameras)
    often = counts.sum() / max(1.0, calibrated("frames.correlation_time") * fps)
    limit = _NORMAL * math.hypot(calibrated("ankle.offset"), _median_error(often))
    if counts.sum() < _LEAST_SECONDS * fps:
        return Check("height", math.nan, limit, False, "Feet are hardly ever seen.")
    value = _median(above, counts) - ANKLE
    if not abs(value) > limit:
        return Check("height", value, limit, False, f"Feet are on the floor, to {value:+.2f} m.")
    where = "float above" if value > 0 else "have their feet below"
    sentence = (
        f"The camera cannot be right: people {where} the floor, by {abs(value):.2f} m in the "
        "median. Give --camera-height in metres, and --pitch in degrees (down is negative)."
    )
    return Check("height", value, limit, True, sentence)


def slope(problem: Problem, cameras: Array, *, fps: float) -> Check:
    """Whether the floor is level: feet further away are no higher.

    Parameters
    ----------
    problem : Problem
    cameras : (N, 5) float
        Those of draws.
    fps : float
        Frames a second.

    Returns
    -------
    Check
    """
    above, away, counts = _feet(problem, cameras)
    nothing = Check("slope", math.nan, math.nan, False, "Too few feet are seen to say of a slope.")
    if counts.sum() < 2 * _LEAST_SECONDS * fps:
        return nothing
    middle = _median(away, counts)
    near, far = counts * (away <= middle), counts * (away > middle)
    if min(near.sum(), far.sum()) < 0.25 * counts.sum():
        return nothing
    apart = _median(away, far) - _median(away, near)
    seconds = max(1.0, calibrated("frames.correlation_time") * fps)
    # Who seems further away by a part of their depth has feet lower by that part of the camera's
    # height above them.
    sunk = calibrated("bias.log_depth") * float(np.median(cameras[:, 1]))
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
    """Whether the draws leave the camera about where it was said to be.

    In standard deviations of pitch, roll and log height as they were measured: the prior of the
    height is wider, so that a wrong one does little harm.

    Parameters
    ----------
    nominal : Camera
        As the clip says.
    cameras : (N, 5) float
        Those of draws.

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
        f"{elevation:.2f} m above the floor at a pitch of {math.degrees(pitch):.0f}° and a roll of "
        f"{math.degrees(roll):.0f}°"
    )
    if not value > limit:
        return Check("camera", value, limit, False, f"The camera is {found}, as was said.")
    said = (
        f"{nominal.elevation:.2f} m, {math.degrees(nominal.pitch):.0f}° and "
        f"{math.degrees(nominal.roll):.0f}°"
    )
    sentence = (
        f"The camera is not where it was said or assumed to be: what is seen puts it {found}, "
        f"where {said} were given. Measure --camera-height (metres) and --pitch (degrees, down is "
        "negative); one of them, or --focal, is wrong."
    )
    return Check("camera", value, limit, True, sentence)


def _told(problem: Problem) -> NDArray[np.int64]:
    """(T, 16) 1 of joints that are detected and more probably seen than hidden."""
    result: NDArray[np.int64] = problem.used * problem.confidence_density.argmax(-1)
    return result


def _level(phi: Array) -> Camera:
    return Camera(
        1, 1, 1.0, 1.0, 0.0, 0.0, pitch=float(phi[0]), roll=float(phi[4]), elevation=float(phi[1])
    )


def _world(problem: Problem, phi: Array) -> Array:
    """(T, 16, 3) joints of the static path in the world of a camera, metres."""
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
    """Metres by which a median of so many independent heights of an ankle may be off.

    A Student-t of 2 degrees of freedom and scale s has 1 / (2 sqrt(2) s) for its density in the
    middle, and a median 1 / (2 sqrt(n)) of the inverse of that for its deviation.
    """
    return math.sqrt(2.0 / max(often, 1.0)) * calibrated("ankle.spread")


# ------------------------------------------------------------------------------------------------
# Prediction: detections like those of the clip, and a seat for who needs one.


def prediction(
    problem: Problem, states: Sequence[State], nominal: Camera, *, rng: np.random.Generator
) -> Check:
    """Whether the draws predict detections like those of the clip.

    A posterior predictive probability (Gelman, Meng and Stern 1996), averaged over draws, of
    detections that fit no better. Of a draw's frames with scenelets it takes the log-density of
    where used joints were detected, given the confidences, and holds it against detections drawn
    from the same scene; frames count ``frame_weight``, for they repeat each other. And a draw that
    leaves somebody sitting on air for S nats has a probability of exp(-S) or less: S is the log of
    a likelihood ratio (:mod:`imapper_prob.models.kernels.stays`). The rarer of the two, doubled.

    Parameters
    ----------
    problem : Problem
    states : sequence of State
        Draws.
    nominal : Camera
    rng : Generator
        For the detections that are drawn.

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
"""Detections drawn of every joint."""


def _tail(problem: Problem, state: State, seen_by: Camera, rng: np.random.Generator) -> float:
    """Probability of detections that fit a draw no better; 1 if it has no scenelet."""
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
    # Hidden, then seen, as the confidence has it.
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
    """(..., K) nats per square pixel, of squared distances (..., K) and rows (K, 2) of tables."""
    each = share * np.exp(student_t(squared[..., None], scale, dof))
    result: Array = np.log(np.maximum(each.sum(-1), np.finfo(float).tiny))
    return result


# ------------------------------------------------------------------------------------------------
# All checks of a result.

Flags = NDArray[np.bool_]
_LOOKED_AT: Final = 40
"""Draws, evenly spaced over the chains, that checks are made of."""


def checks_of(
    clip: Clip,
    problem: Problem,
    states: Sequence[State],
    best_fits: Array,
    *,
    rng: np.random.Generator,
) -> tuple[Check, ...]:
    """All checks, in the order in which their alarms are said.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        Of everybody in it.
    states : sequence of State
        Draws.
    best_fits : (T,) float
        See :func:`imapper_prob.solver.fits.best_fits`.
    rng : Generator
        For the detections that are drawn.

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
        resemblance(best_fits, frame_weight=problem.frame_weight),
        prediction(problem, drawn, clip.camera, rng=rng),
        elsewhere(clip),
    )


def alarms(checks: Iterable[Check]) -> tuple[str, ...]:
    """The sentences of those that are alarmed.

    Parameters
    ----------
    checks : iterable of Check

    Returns
    -------
    tuple of str
    """
    return tuple(check.sentence for check in checks if check.alarmed)


def to_json(checks: Iterable[Check]) -> str:
    """As text for an attribute; NaN is null there.

    Parameters
    ----------
    checks : iterable of Check

    Returns
    -------
    str
    """
    rows = [
        {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(c).items()}
        for c in checks
    ]
    return json.dumps(rows, allow_nan=False)


def from_json(text: str) -> tuple[Check, ...]:
    """What :func:`to_json` wrote.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of Check

    Raises
    ------
    InputError
        If it wrote something else.
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


_UNLIKE: Final = 0.64
"""Nats per confident joint from which a best fit is worse than right scenelets reach in 95 % of the
frames of simulated clips (``python -m lab.alarms --threshold``)."""
_UNLIKE_PART: Final = 0.05


def resemblance(best: Array, *, frame_weight: float) -> Check:
    """Whether the library has something that looks like what is seen.

    Parameters
    ----------
    best : (T,) float
        See :func:`imapper_prob.solver.fits.best_fits`.
    frame_weight : float
        One over the frames that say the same.

    Returns
    -------
    Check
    """
    judged = best[np.isfinite(best)]
    independent = max(1, round(len(judged) * min(1.0, frame_weight)))
    limit = float(binom.isf(_RATE, independent, _UNLIKE_PART)) / independent
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


def elsewhere_frames(clip: Clip) -> tuple[Flags, ...]:
    """Frames of each track in which the detector was on something else.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    tuple of (T,) bool
        By track.
    """
    return tuple(frames_elsewhere(t, camera=clip.camera, fps=clip.fps) for t in clip.tracks)


def elsewhere(clip: Clip) -> Check:
    """Whether the detector was on its people all the time.

    Parameters
    ----------
    clip : Clip

    Returns
    -------
    Check
    """
    away = elsewhere_frames(clip)
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
    """Frame numbers, ascending, in runs: ``"12-25, 70"``.

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
