"""The log-likelihood of a frame, its sixteen joints side by side, compiled.

What is computed is equation (11) of ``docs/model.md``. Exponentials and logarithms are
written out (Cody and Waite 1980: reduce, then a polynomial), for a call of the library's
would keep the compiler from working on many joints in one instruction; they are as exact.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.sight import FIRST_FREE
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import MIRROR

__all__ = ["weigh_frames"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.uint8]

# Where the rows of the bench start. Of the joints, then of the joints of the other side:
_SEEN = FIRST_FREE  # probability of being seen
_U, _V, _LOOSE = _SEEN + 32, _SEEN + 64, _SEEN + 96  # pixels; square pixels of the pose's doubt
# sides as they are, hidden and seen; sides swapped, hidden and seen:
_RATIO = _LOOSE + 32  # 1 + r^2 / (dof scale^2)
_POWER = _RATIO + 64
_SCALE2 = _POWER + 64  # square pixels
# the density of every detection: sides as they are, and swapped.
_DENSITY = _SCALE2 + 64

_SMALL = 1e-100
_SMALLEST = 1e-300
"""Products of densities are taken apart below the first; none counts less than the second."""

_LOG2E = 1.0 / math.log(2.0)
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
"""ln 2 in two parts, of which multiples of the first are exact."""
_LN2 = math.log(2.0)
_ROUND = 6755399441055744.0
"""1.5 * 2^52: adding it leaves a number's nearest integer in the lowest bits."""
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12 = (
    1.0 / math.factorial(n) for n in range(2, 13)
)
_HALF_BITS = 0x3FE6A09E667F3BCD
"""The bits of sqrt(1/2), from where mantissas are counted."""


@compiled
def _find_seen(gaps: Array, t: int, width: float, surprise: float, bench: Array) -> None:
    """Probability of being seen: :func:`imapper_prob.models.energy.occlusion.p_seen`."""
    sharpness = np.divide(1.0, width)
    for j in range(16):
        x = -min(max(gaps[t, j] * sharpness, -30.0), 30.0)
        shifted = x * _LOG2E + _ROUND
        n = shifted - _ROUND
        r = (x - n * _LN2_HIGH) - n * _LN2_LOW
        rr = r * r
        p = ((_E8 + _E9 * r) + rr * (_E10 + _E11 * r)) + rr * rr * _E12
        p = ((1.0 + r) + rr * (_E2 + _E3 * r)) + rr * rr * (
            ((_E4 + _E5 * r) + rr * (_E6 + _E7 * r)) + rr * rr * p
        )
        scale = np.int64((np.float64(shifted).view(np.int64) + 1023) << 52).view(np.float64)
        bench[_SEEN + j] = surprise + np.divide(1.0 - 2.0 * surprise, 1.0 + p * scale)


@compiled
def _project(
    lens: tuple[float, float, float, float, float],
    pose: tuple[float, float, float, float, float],
    body: float,
    joints: Array,
    row: int,
    bench: Array,
) -> None:
    """Pixels of the joints ``joints[row]``, and how loosely a scenelet's pose holds there.

    ``lens`` is both focal lengths, the principal point and the pose's doubt of one metre's
    depth, in pixels; ``pose`` is cosine and sine of the camera's pitch, its elevation, and
    cosine and sine of its roll; ``body`` is how large the person is.
    """
    fx, fy, cx, cy, doubt = lens
    cp, sp, elevation, cr, sr = pose
    # A larger body differs by more: else distance alone would seem to fit better.
    doubt *= body
    for j in range(16):
        x, y, z = joints[row, j, 0], joints[row, j, 1], joints[row, j, 2] - elevation
        nearness = np.divide(1.0, max(cp * y + sp * z, NEAREST))
        up = -sp * y + cp * z
        bench[_U + j] = cx + fx * (cr * x + sr * up) * nearness
        bench[_V + j] = cy - fy * (cr * up - sr * x) * nearness
        bench[_LOOSE + j] = (doubt * nearness) * (doubt * nearness)


@compiled
def _measure(
    keypoints: Array, scales: Array, dofs: Array, t: int, visible: int, of: int, to: int,
    bench: Array,
) -> None:  # fmt: skip
    """Misfit of frame t's detections by a hidden or seen joint's error, rows ``of`` to ``to``."""
    for j in range(16):
        du = bench[of + j] - keypoints[t, j, 0]
        dv = bench[of + (_V - _U) + j] - keypoints[t, j, 1]
        scale = scales[t, j, visible]
        scale2 = scale * scale + bench[of + (_LOOSE - _U) + j]
        dof = dofs[t, j, visible]
        bench[to + j] = 1.0 + np.divide(du * du + dv * dv, dof * scale2)
        bench[to + (_POWER - _RATIO) + j] = -0.5 * dof - 1.0
        bench[to + (_SCALE2 - _RATIO) + j] = scale2


@compiled
def _mix(confidence: Array, t: int, seen_at: int, of: int, to: int, bench: Array) -> None:
    """Density of every detection, of a joint seen with some probability."""
    for j in range(16):
        seen = bench[seen_at + j]
        hidden_part = confidence[t, j, 0] * bench[of + j]
        seen_part = confidence[t, j, 1] * bench[of + 16 + j]
        bench[to + j] = (seen * seen_part + (1.0 - seen) * hidden_part) / (2 * math.pi)


@compiled
def _raise(bench: Array) -> None:
    """Student's density: every ratio to its power, over its square scale."""
    for j in range(64):
        # ln x = e ln 2 + 2 artanh((f - 1) / (f + 1)) with f in [sqrt(1/2), sqrt 2).
        bits = np.float64(bench[_RATIO + j]).view(np.int64)
        e = (bits - _HALF_BITS) >> 52
        f = np.int64(bits - (e << 52)).view(np.float64)
        s = np.divide(f - 1.0, f + 1.0)
        z = s * s
        zz = z * z
        q = (1.0 + 1 / 3 * z) + zz * ((1 / 5 + 1 / 7 * z) + zz * (1 / 9 + 1 / 11 * z))
        q += zz * zz * zz * ((1 / 13 + 1 / 15 * z) + zz * ((1 / 17 + 1 / 19 * z) + 1 / 21 * zz))
        x = bench[_POWER + j] * (2.0 * s * q + np.float64(e) * _LN2)
        # e^x = 2^n e^r with |r| below ln 2 / 2.
        shifted = max(x, -700.0) * _LOG2E + _ROUND
        n = shifted - _ROUND
        r = (max(x, -700.0) - n * _LN2_HIGH) - n * _LN2_LOW
        rr = r * r
        p = ((_E8 + _E9 * r) + rr * (_E10 + _E11 * r)) + rr * rr * _E12
        p = ((1.0 + r) + rr * (_E2 + _E3 * r)) + rr * rr * (
            ((_E4 + _E5 * r) + rr * (_E6 + _E7 * r)) + rr * rr * p
        )
        scale = np.int64((np.float64(shifted).view(np.int64) + 1023) << 52).view(np.float64)
        bench[_RATIO + j] = np.divide(p * scale, bench[_SCALE2 + j])


@compiled
def weigh_frames(
    problem: Problem,
    camera: Array,
    wanted: Flags,
    cover: Ints,
    sizes: Array,
    joints: Array,
    rows: Ints,
    gaps: Array,
    bench: Array,
    by_frame: Array,
    to: Ints,
) -> None:
    """log p(u, c | q, m) of frames into ``by_frame``: as they are, and with sides swapped.

    Parameters
    ----------
    problem : Problem
    camera : (5,) float
    wanted : (T,) flags
        Which frames.
    cover : (T,) int
        Negative where no scenelet poses the frame but its own pose does.
    sizes : (S,) float
        Log size of the person of scenelet ``cover[t]``, on top of the body scale.
    joints : (R, 16, 3) float
        World joints, metres; those of frame t are in row ``rows[t]``.
    gaps : (T, 16) float
        Clearance of every joint, metres.
    bench : (BENCH,) float
        Workspace.
    by_frame : (R, 2) float
        Out, nats; frame t into row ``to[t]``.
    """
    focal = math.exp(camera[2])
    fx, fy = focal * problem.fx, focal * problem.fy
    lens = fx, fy, problem.cx, problem.cy, fx * problem.pose_tolerance
    pose = (
        math.cos(camera[0]), math.sin(camera[0]), camera[1],
        math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip
    body, of = 1.0, -1
    keypoints, scales, dofs = problem.keypoints, problem.error_scale, problem.error_dof
    confidence, static, used = problem.confidence_density, problem.static_density, problem.used
    for t in range(len(wanted)):
        if not wanted[t]:
            continue
        _find_seen(gaps, t, problem.sight_width, problem.surprise, bench)
        for j in range(16):
            bench[_SEEN + 16 + j] = bench[_SEEN + MIRROR[j]]
        if cover[t] >= 0:
            if cover[t] != of:
                of = cover[t]
                body = math.exp(camera[3] + sizes[of])
            _project(lens, pose, body, joints, rows[t], bench)
            for j in range(16):
                bench[_U + 16 + j] = bench[_U + MIRROR[j]]
                bench[_V + 16 + j] = bench[_V + MIRROR[j]]
                bench[_LOOSE + 16 + j] = bench[_LOOSE + MIRROR[j]]
            # Spelled out, so that the compiler knows where each row lies.
            _measure(keypoints, scales, dofs, t, 0, _U, _RATIO, bench)
            _measure(keypoints, scales, dofs, t, 1, _U, _RATIO + 16, bench)
            _measure(keypoints, scales, dofs, t, 0, _U + 16, _RATIO + 32, bench)
            _measure(keypoints, scales, dofs, t, 1, _U + 16, _RATIO + 48, bench)
            _raise(bench)
            _mix(confidence, t, _SEEN, _RATIO, _DENSITY, bench)
            _mix(confidence, t, _SEEN + 16, _RATIO + 32, _DENSITY + 16, bench)
        else:
            for j in range(16):
                hidden, seen = static[0, t, j, 0], static[0, t, j, 1]
                bench[_DENSITY + j] = hidden + bench[_SEEN + j] * (seen - hidden)
            for j in range(16):
                hidden, seen = static[1, t, j, 0], static[1, t, j, 1]
                bench[_DENSITY + 16 + j] = hidden + bench[_SEEN + 16 + j] * (seen - hidden)
        # Logarithms are dear: one of a product, before it can underflow.
        right, wrong = 1.0, 1.0
        log_right, log_wrong = 0.0, 0.0
        for j in range(16):
            if used[t, j]:
                right *= bench[_DENSITY + j]
                wrong *= bench[_DENSITY + 16 + j]
                if right < _SMALL:
                    log_right += math.log(max(right, _SMALLEST))
                    right = 1.0
                if wrong < _SMALL:
                    log_wrong += math.log(max(wrong, _SMALLEST))
                    wrong = 1.0
        by_frame[to[t], 0] = log_right + math.log(right)
        by_frame[to[t], 1] = log_wrong + math.log(wrong)
