"""The estimated constants, their estimators, and values kept in place of an estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.calibrated import Number
from imapper_prob.models.detector import CONFIDENCE_EDGES, ERROR_EDGES, LOST_ERROR
from imapper_prob.models.path_prior import remembered
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import MIRROR, SCORED
from imapper_prob.solver.path_fit import REFERENCE_RATE
from lab.calibrate.estimators import (
    autocorrelation,
    balanced_logistic_fit,
    between_groups,
    change_within,
    confusion_mean,
    correlation_length,
    predictive_spread,
    root_mean_square,
    shares,
    sight_width_fit,
    smoothing_time,
    student_t_fit,
    student_t_score,
    wrapped_cauchy_fit,
)
from lab.calibrate.evidence import Fitted, Placed, Seen

__all__ = ["FROM_FITS", "FROM_PATH", "FROM_TRUTH", "KEPT", "Estimator", "estimate"]


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimator:
    """A constant, and its estimator from the evidence of some clips."""

    name: str
    unit: str
    meaning: str
    source: str
    estimate: Callable[[Sequence[Any]], Number]


def estimate(estimators: Sequence[Estimator], evidence: Sequence[Seen]) -> dict[str, Number]:
    """Values of all constants of a step, by name."""
    return {e.name: e.estimate(evidence) for e in estimators}


# Detections.


def _detected(evidence: Sequence[Seen]) -> tuple[Array, NDArray[np.bool_], Array]:
    """Confidence (n,), hidden (n,) and error (n, 2) of all detections."""
    parts = [(e.detections, e.detections.used) for e in evidence]
    return (
        np.concatenate([d.confidence[used] for d, used in parts]),
        np.concatenate([d.hidden[used] for d, used in parts]),
        np.concatenate([d.error[used] for d, used in parts]),
    )


def _confidence(*, hidden: bool) -> Callable[[Sequence[Seen]], Number]:
    def shares_of(evidence: Sequence[Seen]) -> Number:
        confidence, flags, _ = _detected(evidence)
        return tuple(shares(confidence[flags == hidden], CONFIDENCE_EDGES).tolist())

    return shares_of


def _error_fits(evidence: Sequence[Seen], *, hidden: bool) -> list[tuple[float, float]]:
    """Scale and degrees of freedom for doubtful and for confident detections."""
    confidence, flags, error = _detected(evidence)
    classes = np.searchsorted(ERROR_EDGES, confidence, side="right")
    return [
        student_t_fit(error[(flags == hidden) & (classes == k)])
        for k in range(1, len(ERROR_EDGES) + 1)
    ]


def _errors(which: int, *, hidden: bool) -> Callable[[Sequence[Seen]], Number]:
    return lambda evidence: tuple(fit[which] for fit in _error_fits(evidence, hidden=hidden))


def _sure_errors(which: int) -> Callable[[Sequence[Seen]], Number]:
    return lambda evidence: _error_fits(evidence, hidden=False)[-1][which]


def _correlation_time(evidence: Sequence[Seen]) -> Number:
    fits = np.array(
        [[LOST_ERROR, *_error_fits(evidence, hidden=hidden)] for hidden in (False, True)]
    )
    series = []
    for e in evidence:
        classes = np.searchsorted(ERROR_EDGES, e.detections.confidence, side="right")
        scale, dof = np.moveaxis(fits[e.detections.hidden.astype(int), classes], -1, 0)
        score = student_t_score(e.detections.error, scale, dof)
        series.append(score.reshape(len(score), -1))
    seconds = evidence[0].detections.gap / evidence[0].clip.fps
    return correlation_length(series) * seconds


def _error_time(evidence: Sequence[Placed], errors: Sequence[Array]) -> float:
    """Correlation time of errors in seconds: half their integrated autocorrelation."""
    seconds = evidence[0].detections.gap / evidence[0].clip.fps
    return float(correlation_length([error[:, None] for error in errors]) * seconds / 2)


def _smoothing_time(evidence: Sequence[Placed], errors: Sequence[Array]) -> Number:
    """Time in seconds over which the error is smooth, at most half the correlation time.

    It is reduced by the rounding of both values, so that the stored values define a process.
    """
    seconds = _error_time(evidence, errors)
    found = smoothing_time(
        errors,
        spread=root_mean_square(np.concatenate(errors)),
        seconds=seconds,
        fps=evidence[0].clip.fps,
        gap=evidence[0].detections.gap,
    )
    return min(found, 0.495 * seconds)


def _stay_change(evidence: Sequence[Placed]) -> Number:
    """Time in seconds in which the error of depth changes as much elsewhere as within a whole stay.

    Without a stay of a second or more, the change within a stay is taken to be the whole variance.
    """
    errors = _along(evidence)
    seconds, fps = _error_time(evidence, errors), evidence[0].clip.fps
    rates = remembered(np.array([seconds]), np.array([_smoothing_time(evidence, errors)]), fps)[0]
    stays = [own[a:b] for e, own in zip(evidence, errors, strict=True) for a, b in e.path.stays]
    apart = round(fps / evidence[0].detections.gap)
    change = 1.0 - autocorrelation(rates, round(10 * fps * seconds))
    share = 1.0
    if any(len(stay) > apart for stay in stays):
        within = change_within(stays, apart=apart)
        share = within / root_mean_square(np.concatenate(errors)) ** 2
    return float(np.interp(share, change, np.arange(len(change)))) / fps


def _walk_time(evidence: Sequence[Seen]) -> Number:
    """Correlation time of bearing and log depth, each in units of its spread."""
    spreads = [
        root_mean_square(np.concatenate([getattr(e.motion, name) for e in evidence]))
        for name in ("bearing", "log_depth")
    ]
    series = [
        np.stack([e.motion.bearing / spreads[0], e.motion.log_depth / spreads[1]], -1)
        for e in evidence
    ]
    seconds = evidence[0].motion.gap / evidence[0].clip.fps
    return correlation_length(series) * seconds / 2


def _tolerances(across: Array) -> Number:
    """(16,) root mean square by joint, both sides together, of (n, 16, 2) deviations."""
    squares = (across**2).mean((0, 2))
    return tuple(np.sqrt((squares + squares[list(MIRROR)]) / 2).tolist())


def _support(which: int) -> Callable[[Sequence[Placed]], Number]:
    def fit(evidence: Sequence[Placed]) -> Number:
        thighs = [e.thighs for e in evidence]
        return balanced_logistic_fit(
            np.concatenate([t.angle for t in thighs]),
            np.concatenate([t.seen for t in thighs]),
            np.concatenate([t.carried for t in thighs]),
        )[which]

    return fit


def _flip_runs(evidence: Sequence[Seen]) -> tuple[float, float, float]:
    """Number of runs of flipped frames, and seconds flipped and observed."""
    runs = flipped = seen = 0.0
    for e in evidence:
        flags, seconds = e.detections.flipped, e.detections.gap / e.clip.fps
        runs += float(flags[0]) + float((flags[1:] & ~flags[:-1]).sum())
        flipped += seconds * float(flags.sum())
        seen += seconds * len(flags)
    return runs, flipped, seen


def _flip_rate(evidence: Sequence[Seen]) -> Number:
    runs, _, seen = _flip_runs(evidence)
    return runs / seen


def _flip_length(evidence: Sequence[Seen]) -> Number:
    runs, flipped, _ = _flip_runs(evidence)
    return flipped / max(runs, 1.0)


# Motion.


def _a_frame(evidence: Sequence[Seen], step: Callable[[Seen], Array]) -> Array:
    """Steps of a random walk, scaled to one frame at the reference rate."""
    return np.concatenate(
        [step(e) * np.sqrt(e.clip.fps / (REFERENCE_RATE * e.motion.gap)) for e in evidence]
    )


def _walk(name: str) -> Callable[[Sequence[Seen]], Number]:
    return lambda evidence: root_mean_square(_a_frame(evidence, lambda e: getattr(e.motion, name)))


def _joint_steps(which: int) -> Callable[[Sequence[Seen]], Number]:
    def fit(evidence: Sequence[Seen]) -> Number:
        steps = _a_frame(evidence, lambda e: e.motion.joints[:, list(SCORED)])
        return student_t_fit(steps.reshape(-1, 3))[which]

    return fit


def _jumps(which: int) -> Callable[[Sequence[Placed]], Number]:
    def fit(evidence: Sequence[Placed]) -> Number:
        jumps = np.concatenate([e.nearest.jumps[:, list(SCORED)] for e in evidence])
        return student_t_fit(jumps.reshape(-1, 3))[which]

    return fit


# Furniture.


def _furniture(axis: int) -> Callable[[Sequence[Placed]], Number]:
    return lambda evidence: root_mean_square(
        np.concatenate([e.nearest.furniture[:, axis] for e in evidence])
    )


def _seat_confusion(evidence: Sequence[Placed]) -> Number:
    return confusion_mean(np.concatenate([e.nearest.seats for e in evidence]))


def _sight_width(evidence: Sequence[Placed]) -> Number:
    return sight_width_fit(
        np.concatenate([e.nearest.clearance for e in evidence]),
        np.concatenate([e.nearest.hidden for e in evidence]),
        visibility_error=ModelSettings().visibility_error,
    )


# Body.


def _lifted(axes: tuple[int, ...]) -> Callable[[Sequence[Seen]], Number]:
    return lambda evidence: root_mean_square(
        np.concatenate([e.lifted.errors[..., axes] for e in evidence])
    )


def _along(evidence: Sequence[Placed]) -> list[Array]:
    """Errors of log depth, less their scene's median, over the deviation that the fit states."""
    return [
        (e.path.log_depth - np.median(e.path.log_depth)) / e.path.deviation[:, 1] for e in evidence
    ]


def _across(evidence: Sequence[Placed]) -> list[Array]:
    """Errors to the right over the deviation that the fit states."""
    return [e.path.across[:, 0] / e.path.deviation[:, 0] for e in evidence]


def _ankles(evidence: Sequence[Placed]) -> tuple[float, float]:
    heights = [e.path.ankle - np.median(e.path.ankle) for e in evidence]
    return student_t_fit(np.concatenate(heights)[:, None])


FROM_TRUTH: Final = (
    Estimator(
        "detections.seen_confidence", "probability of each bin", "confidence of joints in view",
        "histogram of i3DB's detections, hidden as its own ray casts say",
        _confidence(hidden=False),
    ),
    Estimator(
        "detections.hidden_confidence", "probability of each bin", "confidence of hidden joints",
        "histogram of i3DB's detections, hidden as its own ray casts say",
        _confidence(hidden=True),
    ),
    Estimator(
        "detections.seen_error_scale", "pixels at 1080 lines",
        "pixel error of joints in view, where confidence is below .5 (and above .02) and above",
        "bivariate Student-t fitted to detections minus projected true joints",
        _errors(0, hidden=False),
    ),
    Estimator(
        "detections.seen_error_dof", "degrees of freedom",
        "tails of the pixel errors of joints in view", "fit of `detections.seen_error_scale`",
        _errors(1, hidden=False),
    ),
    Estimator(
        "detections.hidden_error_scale", "pixels at 1080 lines",
        "pixel error of hidden joints, where confidence is below .5 (and above .02) and above",
        "bivariate Student-t fitted to detections minus projected true joints",
        _errors(0, hidden=True),
    ),
    Estimator(
        "detections.hidden_error_dof", "degrees of freedom",
        "tails of the pixel errors of hidden joints", "fit of `detections.hidden_error_scale`",
        _errors(1, hidden=True),
    ),
    Estimator(
        "path.pixel_scale", "pixels at 1080 lines", "pixel error of a detection, static path",
        "seen joints of confidence above .5", _sure_errors(0),
    ),
    Estimator(
        "path.pixel_dof", "degrees of freedom", "tails of the pixel error, static path",
        "seen joints of confidence above .5", _sure_errors(1),
    ),
    Estimator(
        "frames.correlation_time", "s", "time over which frames repeat their errors",
        "integrated autocorrelation of the Student-t's score of pixel errors",
        _correlation_time,
    ),
    Estimator(
        "side_flips.rate", "1/s", "how often the detector begins to take left for right",
        "runs of frames that fit the truth better by 5 nats with sides exchanged", _flip_rate,
    ),
    Estimator(
        "side_flips.length", "s", "how long the detector takes left for right",
        "mean length of the runs of `side_flips.rate`", _flip_length,
    ),
    Estimator(
        "walk.bearing", "tangent a frame of .1 s", "step of the pelvis across the view",
        "root mean square step of the true pelvis over .2 s, over sqrt 2", _walk("bearing"),
    ),
    Estimator(
        "walk.log_depth", "log m a frame of .1 s", "step of the pelvis along the view",
        "root mean square step of the true pelvis over .2 s, over sqrt 2", _walk("log_depth"),
    ),
    Estimator(
        "walk.bone", "m a frame of .1 s", "step of a bone's end against its root",
        "root mean square step of the true bones over .2 s, over sqrt 2", _walk("bones"),
    ),
    Estimator(
        "walk.time", "s", "time for which somebody goes on at about the same velocity",
        "half the integrated autocorrelation of true steps over .2 s", _walk_time,
    ),
    Estimator(
        "joints.step_scale", "m a frame of .1 s", "step of a joint against the pelvis",
        "trivariate Student-t fitted to true steps over .2 s, over sqrt 2", _joint_steps(0),
    ),
    Estimator(
        "joints.step_dof", "degrees of freedom", "tails of the steps of joints",
        "fit of `joints.step_scale`", _joint_steps(1),
    ),
    Estimator(
        "bones.lifted_across", "part of its length",
        "error of a lifted bone across the view",
        "root mean square of lifted minus true bones", _lifted((0, 2)),
    ),
    Estimator(
        "bones.lifted_along", "part of its length", "error of a lifted bone along the view",
        "root mean square of lifted minus true bones", _lifted((1,)),
    ),
    Estimator(
        "camera.pitch", "rad", "spread of cameras' pitch about the nominal one",
        "of cameras in whose frame the true furniture is upright; predictive, from so few",
        lambda evidence: predictive_spread([e.truth.camera.pitch for e in evidence]),
    ),
    Estimator(
        "camera.roll", "rad", "spread of cameras' roll about zero",
        "root mean square over the cameras of `camera.pitch`",
        lambda evidence: root_mean_square([e.truth.camera.roll for e in evidence]),
    ),
    Estimator(
        "camera.log_elevation", "log m", "spread of cameras' height about the nominal one",
        "root mean square over the cameras of `camera.pitch`, furniture on the floor",
        lambda evidence: root_mean_square(
            [np.log(e.truth.camera.elevation / e.clip.camera.elevation) for e in evidence]
        ),
    ),
)  # fmt: skip
"""Constants estimated from clip and truth."""

FROM_PATH: Final = (
    Estimator(
        "bias.along", "1", "slow error of the static path's depth over what its fit states",
        "root mean square of its log depth over the true one, each scene's median taken off, over "
        "the standard deviation of the Laplace approximation",
        lambda evidence: root_mean_square(np.concatenate(_along(evidence))),
    ),
    Estimator(
        "bias.across", "1",
        "slow error of the static path across the view over what its fit states",
        "root mean square of its bearing minus the true one over the standard deviation of the "
        "Laplace approximation",
        lambda evidence: root_mean_square(np.concatenate(_across(evidence))),
    ),
    Estimator(
        "bias.correlation_time_along", "s", "correlation time of the slow error of depth",
        "half the integrated autocorrelation of that error",
        lambda evidence: _error_time(evidence, _along(evidence)),
    ),
    Estimator(
        "bias.correlation_time_across", "s", "correlation time of the slow error across the view",
        "half the integrated autocorrelation of that error",
        lambda evidence: _error_time(evidence, _across(evidence)),
    ),
    Estimator(
        "bias.smoothing_time_along", "s",
        "part of that time over which the error of depth is smooth",
        "most likely Gauss-Markov process of second order with that spread and time",
        lambda evidence: _smoothing_time(evidence, _along(evidence)),
    ),
    Estimator(
        "bias.smoothing_time_across", "s",
        "part of that time over which the error across is smooth",
        "most likely Gauss-Markov process of second order with that spread and time",
        lambda evidence: _smoothing_time(evidence, _across(evidence)),
    ),
    Estimator(
        "bias.stay_change", "s", "time in a stay after which the error of depth stands still",
        "over which it changes elsewhere as much as over a second or more of a stay",
        _stay_change,
    ),
    Estimator(
        "body.log_scale", "log", "spread of stature about the reference body",
        "root mean square over scenes of the median log depth of the path over the true one, "
        "in which a wrong focal length is included",
        lambda evidence: root_mean_square([np.median(e.path.log_depth) for e in evidence]),
    ),
    Estimator(
        "ankle.height", "m", "height of the path's lower ankle above the floor",
        "mean over scenes of its median",
        lambda evidence: float(np.mean([np.median(e.path.ankle) for e in evidence])),
    ),
    Estimator(
        "ankle.offset", "m", "deviation of a clip's height of the lower ankle from the mean",
        "standard deviation over scenes of the median, with the error of the mean",
        lambda evidence: predictive_spread([np.median(e.path.ankle) for e in evidence]),
    ),
    Estimator(
        "ankle.spread", "m", "error of a frame's lower ankle about the height in its clip",
        "Student-t fitted to the path's lower ankles minus their scene's median",
        lambda evidence: _ankles(evidence)[0],
    ),
    Estimator(
        "ankle.dof", "degrees of freedom", "tails of the error of a frame's lower ankle",
        "fit of `ankle.spread`",
        lambda evidence: _ankles(evidence)[1],
    ),
    Estimator(
        "pose.tolerance", "m", "a true joint about the right scenelet's, an axis, by joint",
        "root mean square across the view of the truth minus the scenelet nearest to it, of both "
        "sides",
        lambda evidence: _tolerances(np.concatenate([e.nearest.across for e in evidence])),
    ),
    Estimator(
        "facing.spread", "rad", "where a scenelet faces about where the static path does",
        "wrapped Cauchy fitted to the yaws of the scenelets nearest to the truth minus those at "
        "which they face, on average over their frames, as the path does",
        lambda evidence: wrapped_cauchy_fit(np.concatenate([e.nearest.turns for e in evidence])),
    ),
    Estimator(
        "support.angle", "rad", "angle of the thighs that speaks neither for nor against a seat",
        "logistic regression of sitting on the static path's thigh angle times how far legs are "
        "seen, both classes counting alike", _support(0),
    ),
    Estimator(
        "support.slope", "nats/rad", "evidence for a seat by a greater angle of the thighs",
        "regression of `support.angle`", _support(1),
    ),
    Estimator(
        "furniture.aside", "part of its width", "furniture beside where its scenelet says",
        "root mean square over true pieces of their mean distance, along their width, from what "
        "the scenelets nearest to the true motion say", _furniture(0),
    ),
    Estimator(
        "furniture.ahead", "m", "furniture before or behind where its scenelet says",
        "as `furniture.aside`, but across their width", _furniture(1),
    ),
    Estimator(
        "furniture.yaw", "rad", "furniture turned from where its scenelet says",
        "as `furniture.aside`, of the angle between bounding boxes modulo a quarter turn (a box "
        "turned by a quarter is one with exchanged sides)", _furniture(2),
    ),
    Estimator(
        "seats.confusion", "1", "probability that motion says nothing of which kind of seat it is",
        "posterior mean, uniform before, given how often the scenelets nearest to the true motion "
        "have the label of the seat that the person is on; each seat counts once", _seat_confusion,
    ),
    Estimator(
        "sight.width", "m", "width of the step from hidden to seen over the clearance of a ray",
        "logistic step fitted to which true joints a true piece hides, over their clearance from "
        "the piece that the scenelets nearest to the true motion have in its place", _sight_width,
    ),
    Estimator(
        "joints.jump_scale", "m", "jump of a joint between a free frame and a scenelet's end",
        "trivariate Student-t fitted to ends of the scenelets nearest to the truth minus the "
        "static pose of the frame beside", _jumps(0),
    ),
    Estimator(
        "joints.jump_dof", "degrees of freedom", "tails of the jumps of joints",
        "fit of `joints.jump_scale`", _jumps(1),
    ),
)  # fmt: skip
"""Constants that need a static path."""


def _sizes(evidence: Sequence[Fitted]) -> Number:
    return between_groups([size for e in evidence for size in e.fits.sizes])


def _free_cost(evidence: Sequence[Fitted]) -> Number:
    return float(np.concatenate([e.fits.free_cost for e in evidence]).mean())


def _repeat_time(evidence: Sequence[Fitted]) -> Number:
    seconds = evidence[0].detections.gap / evidence[0].clip.fps
    return float(np.concatenate([e.repeats for e in evidence]).mean() * seconds)


FROM_FITS: Final = (
    Estimator(
        "scenelet.log_size", "log", "size of a scenelet's person about the body",
        "standard deviation over stretches of 2 s in one place of the log of the depth of the "
        "ten best fits over the true one, each scene's median taken off", _sizes,
    ),
    Estimator(
        "free_pose.cost", "nats a frame, before weighting", "what a free frame pays for its pose",
        "mean of what the frame's own pose explains better than the best motion without "
        "furniture; worked out anew for every clip", _free_cost,
    ),
    Estimator(
        "scores.repeat_time", "s",
        "time in which joints and frames say one thing of which scenelet it is",
        "mean squared score, from the scenelet nearest to the truth towards each of the next ten, "
        "over the expected information of independent joints and frames, times a frame",
        _repeat_time,
    ),
)  # fmt: skip
"""Constants that need the library fitted to the detections."""


KEPT: Final[Mapping[str, tuple[float, str]]] = {
    "side_flips.length": (
        1.0,
        "three single frames are no measure of runs; of MediaPipe on somebody turning they "
        "lasted seconds",
    ),
    "camera.pitch": (
        round(float(np.deg2rad(3.0)), 4),
        "four cameras say nothing sure: without Scene10 they would all but agree; 3 degrees are "
        "what the four say, rounded up",
    ),
    "walk.bone": (
        0.06,
        "of 24 simulated clips the path's poses are nearest to the truth with it: half as large "
        "they are off by .99 cm more, twice as large by .04, with errors of .19 and .14 "
        "(`lab.ablation --simulated`); errors that frames share weigh down detections but not "
        "steps",
    ),
    "camera.log_elevation": (
        0.5,
        "the four heights are those of one team's tripod; from a camera on a table to one "
        "above a door",
    ),
    "furniture.aside": (
        0.2,
        "the measurement holds the truth's own error, and pieces mistaken for their neighbours; "
        "about the middle of the seat that one is on, pelvises of the same clips spread by .19 m",
    ),
    "furniture.ahead": (
        0.2,
        "the measurement holds the truth's own error, and pieces mistaken for their neighbours; "
        "about the middle of the seat that one is on, pelvises of the same clips spread by .15 m",
    ),
    "scenelet.log_size": (
        0.0766,
        "what the hundred best fits of a window say: the benchmark was measured with it, and it is "
        "less than a standard error away",
    ),
    "body.log_scale": (
        0.05,
        "four clips hold too few people; adults of both sexes spread by .05 to .06",
    ),
}
"""Values used in place of an estimate, with the reason."""
