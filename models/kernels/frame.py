"""The log-likelihood of a frame, its sixteen joints side by side, compiled.

What is computed is equation (11) of ``docs/model.md``, in two steps. The chances of a frame,
how likely its detections are if a joint is hidden and if it is seen, follow from the pose and
the camera; weighing them needs how visible the joints are. Furniture that moves changes but
the second.

Exponentials and logarithms are written out (Cody and Waite 1980: reduce, then a polynomial),
for a call of the library's would keep the compiler from working on many joints in one
instruction; they are as exact as their precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.sight import Singles
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import MIRROR

__all__ = ["CHANCES", "DESK", "Lens", "lens_of", "set_chances", "set_own_chances", "weigh"]

Array = NDArray[np.float64]
Lens = tuple[float, float, float, float, float, float, float, float, float, float]
"""Both focal lengths, the principal point and the pose's doubt of one metre's depth, in
pixels; cosine and sine of the camera's pitch, its elevation, cosine and sine of its roll."""

CHANCES = 64
"""Of a frame: densities of the detections of hidden joints, and by how much those of seen
joints are greater; both for sides as they are and then swapped. A joint is in its own place,
whichever side's detection it answers for: only their product counts."""

# Where the rows of the desk start: pixels, and square pixels of the pose's doubt;
_U, _V, _LOOSE = 0, 16, 32
# sides as they are, hidden and seen; sides swapped, hidden and seen:
_RATIO = 48  # 1 + r^2 / (dof scale^2), then the density
_POWER = _RATIO + 64
_SCALE2 = _POWER + 64  # square pixels
# When weighing: probability of being seen; the density of every detection, sides as they are
# and swapped, and its binary exponent.
_SEEN, _DENSITY, _EXPONENT = 0, 16, 48
DESK = _SCALE2 + 64
"""Numbers on the desk, the workspace."""

_SMALLEST = float(np.finfo(np.float64).tiny)
"""No density counts less."""
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
_MANTISSA, _UNIT = 0x000FFFFFFFFFFFFF, 0x3FF0000000000000
"""The bits of a mantissa, and those of the exponent of numbers from 1 to 2."""
_BIAS = 1023

# The same in single precision, in which lines of sight are.
_F1, _F2, _F3, _F4, _F5, _F6 = (np.float32(1.0 / math.factorial(n)) for n in range(1, 7))
_SINGLE_LOG2E, _SINGLE_ROUND = np.float32(_LOG2E), np.float32(12582912.0)
_SINGLE_LN2_HIGH, _SINGLE_LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_FAR = np.float32(30.0)
"""Widths of the step of visibility; farther from it the probability is what it is there."""


@compiled
def lens_of(problem: Problem, camera: Array) -> Lens:
    """What projection needs of a camera (5,)."""
    focal = math.exp(camera[2])
    fx, fy = focal * problem.fx, focal * problem.fy
    return (
        fx, fy, problem.cx, problem.cy, fx * problem.pose_tolerance,
        math.cos(camera[0]), math.sin(camera[0]), camera[1],
        math.cos(camera[4]), math.sin(camera[4]),
    )  # fmt: skip


@compiled
def _project(lens: Lens, body: float, joints: Array, row: int, desk: Array) -> None:
    """Pixels of the joints ``joints[row]``, and how loosely a scenelet's pose holds there."""
    fx, fy, cx, cy, doubt, cp, sp, elevation, cr, sr = lens
    # A larger body differs by more: else distance alone would seem to fit better.
    doubt *= body
    for j in range(16):
        x, y, z = joints[row, 0, j], joints[row, 1, j], joints[row, 2, j] - elevation
        nearness = 1.0 / max(cp * y + sp * z, NEAREST)
        up = -sp * y + cp * z
        desk[_U + j] = cx + fx * (cr * x + sr * up) * nearness
        desk[_V + j] = cy - fy * (cr * up - sr * x) * nearness
        desk[_LOOSE + j] = (doubt * nearness) * (doubt * nearness)


@compiled
def _measure(problem: Problem, t: int, desk: Array) -> None:
    """How far frame t's detections are from the joints, by the errors of hidden and seen ones."""
    keypoints, scales, dofs = problem.keypoints, problem.error_scale, problem.error_dof
    for j in range(16):
        for swapped in range(2):
            d = MIRROR[j] if swapped else j
            du, dv = desk[_U + j] - keypoints[t, d, 0], desk[_V + j] - keypoints[t, d, 1]
            for visible in range(2):
                at = 32 * swapped + 16 * visible + j
                scale, dof = scales[t, d, visible], dofs[t, d, visible]
                scale2 = scale * scale + desk[_LOOSE + j]
                desk[_RATIO + at] = 1.0 + (du * du + dv * dv) / (dof * scale2)
                desk[_POWER + at] = -0.5 * dof - 1.0
                desk[_SCALE2 + at] = scale2


@compiled
def _raise(desk: Array) -> None:
    """Student's density: every ratio to its power, over its square scale."""
    for j in range(64):
        # ln x = e ln 2 + 2 artanh((f - 1) / (f + 1)) with f in [sqrt(1/2), sqrt 2).
        bits = np.float64(desk[_RATIO + j]).view(np.int64)
        e = (bits - _HALF_BITS) >> 52
        f = np.int64(bits - (e << 52)).view(np.float64)
        s = (f - 1.0) / (f + 1.0)
        z = s * s
        zz = z * z
        q = (1.0 + 1 / 3 * z) + zz * ((1 / 5 + 1 / 7 * z) + zz * (1 / 9 + 1 / 11 * z))
        q += zz * zz * zz * ((1 / 13 + 1 / 15 * z) + zz * ((1 / 17 + 1 / 19 * z) + 1 / 21 * zz))
        x = desk[_POWER + j] * (2.0 * s * q + np.float64(e) * _LN2)
        # e^x = 2^n e^r with |r| below ln 2 / 2.
        shifted = max(x, -700.0) * _LOG2E + _ROUND
        n = shifted - _ROUND
        r = (max(x, -700.0) - n * _LN2_HIGH) - n * _LN2_LOW
        rr = r * r
        p = ((_E8 + _E9 * r) + rr * (_E10 + _E11 * r)) + rr * rr * _E12
        p = ((1.0 + r) + rr * (_E2 + _E3 * r)) + rr * rr * (
            ((_E4 + _E5 * r) + rr * (_E6 + _E7 * r)) + rr * rr * p
        )
        scale = np.int64((np.float64(shifted).view(np.int64) + _BIAS) << 52).view(np.float64)
        desk[_RATIO + j] = p * scale / desk[_SCALE2 + j]


@compiled
def set_chances(
    problem: Problem,
    lens: Lens,
    body: float,
    joints: Array,
    row: int,
    t: int,
    desk: Array,
    chances: Array,
    to: int,
) -> None:
    """Chances of frame t in which a scenelet poses the body, into ``chances[to]`` (64,).

    ``joints[row]`` (3, 16) in the world, metres; ``body`` is how large the person is.
    """
    _project(lens, body, joints, row, desk)
    _measure(problem, t, desk)
    _raise(desk)
    confidence, used = problem.confidence_density, problem.used
    for j in range(16):
        for swapped in range(2):
            d, at = MIRROR[j] if swapped else j, 32 * swapped + j
            hidden = confidence[t, d, 0] / (2 * math.pi) * desk[_RATIO + at]
            seen = confidence[t, d, 1] / (2 * math.pi) * desk[_RATIO + 16 + at]
            # What was not detected says nothing.
            chances[to, at] = hidden if used[t, d] else 1.0
            chances[to, 16 + at] = seen - hidden if used[t, d] else 0.0


@compiled
def set_own_chances(problem: Problem, t: int, chances: Array, to: int) -> None:
    """Chances of frame t in its own pose, which no camera changes, into ``chances[to]`` (64,)."""
    static, used = problem.static_density, problem.used
    for j in range(16):
        for swapped in range(2):
            d, at = MIRROR[j] if swapped else j, 32 * swapped + j
            hidden, seen = static[swapped, t, d, 0], static[swapped, t, d, 1]
            chances[to, at] = hidden if used[t, d] else 1.0
            chances[to, 16 + at] = seen - hidden if used[t, d] else 0.0


@compiled
def _find_seen(gaps: Singles, at: int, width: float, surprise: float, desk: Array) -> None:
    """Probability of being seen: :func:`imapper_prob.models.energy.occlusion.p_seen`."""
    sharpness = np.float32(1.0 / width)
    for j in range(16):
        x = -min(max(gaps[at, j] * sharpness, -_FAR), _FAR)
        shifted = x * _SINGLE_LOG2E + _SINGLE_ROUND
        n = shifted - _SINGLE_ROUND
        r = (x - n * _SINGLE_LN2_HIGH) - n * _SINGLE_LN2_LOW
        rr = r * r
        p = ((_F1 + r) + rr * (_F2 + _F3 * r)) + rr * rr * ((_F4 + _F5 * r) + rr * _F6)
        scale = np.int32((np.float32(shifted).view(np.int32) + 127) << 23).view(np.float32)
        desk[_SEEN + j] = surprise + (1.0 - 2.0 * surprise) / (1.0 + np.float64(p * scale))


@compiled
def weigh(
    chances: Array,
    row: int,
    gaps: Singles,
    at: int,
    width: float,
    surprise: float,
    desk: Array,
) -> tuple[float, float]:
    """log p(u, c | q, m) of a frame, nats: as it is, and with sides swapped.

    Parameters
    ----------
    chances : (R, 64) float
        The frame's are in row ``row``.
    gaps : (R, 16) single
        Clearance of every joint, metres; the frame's is in row ``at``.
    width, surprise : float
        Of the step of visibility: see :func:`imapper_prob.models.energy.occlusion.p_seen`.
    desk : (DESK,) float
        Workspace.
    """
    _find_seen(gaps, at, width, surprise, desk)
    for j in range(16):
        right = chances[row, j] + desk[_SEEN + j] * chances[row, 16 + j]
        wrong = chances[row, 32 + j] + desk[_SEEN + j] * chances[row, 48 + j]
        desk[_DENSITY + j] = max(right, _SMALLEST)
        desk[_DENSITY + 16 + j] = max(wrong, _SMALLEST)
    # Logarithms are dear: one of the product of all mantissas, which cannot underflow.
    for j in range(32):
        bits = np.float64(desk[_DENSITY + j]).view(np.int64)
        desk[_EXPONENT + j] = np.float64((bits >> 52) - _BIAS)
        desk[_DENSITY + j] = np.int64((bits & _MANTISSA) | _UNIT).view(np.float64)
    _fold(desk, 8)
    _fold(desk, 4)
    _fold(desk, 2)
    _fold(desk, 1)
    return (
        math.log(desk[_DENSITY]) + desk[_EXPONENT] * _LN2,
        math.log(desk[_DENSITY + 16]) + desk[_EXPONENT + 16] * _LN2,
    )


@compiled
def _fold(desk: Array, half: int) -> None:
    """Halve what is left to be multiplied, and the exponents to be added."""
    for j in range(half):
        desk[_DENSITY + j] *= desk[_DENSITY + half + j]
        desk[_DENSITY + 16 + j] *= desk[_DENSITY + 16 + half + j]
        desk[_EXPONENT + j] += desk[_EXPONENT + half + j]
        desk[_EXPONENT + 16 + j] += desk[_EXPONENT + 16 + half + j]
