"""The log-likelihood of one frame: joints are projected and weighted by their visibility.

Equation (11) of ``model.md`` in two steps. Pose and camera determine the likelihoods of a frame's
detections for hidden and for visible joints (:func:`set_visibility_likelihoods`). Mixing them needs
the visibility of the joints (:func:`mix_likelihoods`). If only furniture moves, only the second
step is repeated.

Exponentials and logarithms are written out (Cody and Waite 1980: range reduction, then a
polynomial), because library calls would prevent vectorisation over joints. They are accurate to
their working precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.jit import inner, inner_inlined
from imapper_prob.models.kernels.axes import camera_pose, point_to_camera
from imapper_prob.models.kernels.visibility import Singles
from imapper_prob.models.problem import Problem
from imapper_prob.models.skeleton import MIRROR

__all__ = [
    "LIKELIHOODS",
    "PARAMS",
    "SCRATCH64",
    "Lens",
    "cap_likelihoods",
    "lens_of",
    "mix_likelihoods",
    "set_detections",
    "set_free_likelihoods",
    "set_visibility_likelihoods",
    "take_logs",
    "visibility_probabilities",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Lens = tuple[float, float, float, float, float, float, float, float, float]
"""Both focal lengths and the principal point in pixels, then a ``CameraPose``."""

LIKELIHOODS = 64
"""Numbers of a frame: densities of the detections if joints are hidden, and the differences of the
densities if they are seen; for sides as they are, then flipped. Flipped values are stored at the
joint, not at the detection, because only the product over joints counts."""

# Parameters of a joint's detection: whether it was used; squared scale, degrees of freedom, and
# density of the confidence over 2 pi; each for hidden and for seen joints.
_USED, _SCALE2, _DOF, _CONFIDENCE = 0, 1, 3, 5
PARAMS = 7
"""Number of such parameters."""

# Offsets in the scratch array: pixels, squared pixels of the pose tolerance, and densities (sides
# as they are: hidden, seen; sides flipped: hidden, seen).
_U, _V, _LOOSE, _DENSITY = 0, 16, 32, 48
SCRATCH64 = 112
"""Length of the scratch array."""
# Offsets in the single-precision scratch array, in the order of densities: first 1 + r^2 / (dof
# scale^2) and its power, later the fraction and the exponent of the density.
_RATIO, _POWER, _FRACTION, _EXPONENT = 0, 64, 0, 64

_SMALLEST = float(np.finfo(np.float64).tiny)
"""Lower bound of densities."""
_OTHER = np.array(MIRROR)
_PER_TURN = 1.0 / (2.0 * math.pi)
_LN2 = math.log(2.0)
_MANTISSA, _UNIT = 0x000FFFFFFFFFFFFF, 0x3FF0000000000000
"""Bit masks: the mantissa, and the exponent of numbers from 1 to 2."""
_DOUBLE_HALF_BITS = 0x3FE6A09E667F3BCD
"""The bits of sqrt(1/2), the lower end of reduced mantissas."""
_BIAS = 1023
"""The exponent that stands for 2^0."""

# Single precision, because one double operand would promote the whole expression.
_LOG2E = np.float32(1.0 / math.log(2.0))
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
"""ln 2 as a sum of two parts; small multiples of the first are exact."""
_ROUND, _ROUND_BITS = np.float32(12582912.0), 0x4B400000
"""1.5 * 2^23: adding it leaves a number's nearest integer in the lowest bits."""
_HALF_BITS = 0x3F3504F3
"""The bits of sqrt(1/2) in single precision."""
_E1, _E2, _E3, _E4, _E5, _E6 = (np.float32(1.0 / math.factorial(n)) for n in range(1, 7))
_L1, _L3, _L5, _L7, _L9 = (np.float32(2.0 / n) for n in (1, 3, 5, 7, 9))
_SINGLE_LN2, _LEAST_POWER = np.float32(_LN2), np.float32(-700.0)
_FAR = np.float32(30.0)
"""Clearance, in widths of the visibility step, beyond which the probability is constant."""


@inner
def lens_of(problem: Problem, camera: Array) -> Lens:
    """Precompute what projection needs of a camera.

    Parameters
    ----------
    problem : Problem
    camera : (5,) float
        phi, see :class:`imapper_prob.models.log_posterior.State`.

    Returns
    -------
    Lens
    """
    focal = math.exp(camera[2])
    fx, fy = focal * problem.fx, focal * problem.fy
    return (fx, fy, problem.cx, problem.cy, *camera_pose(camera))


@inner_inlined
def _project(
    lens: Lens, tolerance: Array, body: float, joints: Array, row: int, scratch64: Array
) -> None:
    """Project the joints ``joints[row]`` to pixels, and the pose tolerance to squared pixels."""
    fx, fy, cx, cy = lens[:4]
    pose = lens[4:]
    # The tolerance scales with the body: otherwise a large distance would fit too easily.
    metre = fx * body
    for j in range(16):
        x, y, z = joints[row, 0, j], joints[row, 1, j], joints[row, 2, j]
        right, depth, up = point_to_camera(pose, x, y, z)
        nearness = 1.0 / depth
        scratch64[_U + j] = cx + fx * right * nearness
        scratch64[_V + j] = cy - fy * up * nearness
        loose = metre * tolerance[j] * nearness
        scratch64[_LOOSE + j] = loose * loose


@inner_inlined
def set_detections(problem: Problem, t: int, uv: Array, params: Singles, row: int) -> None:
    """Copy the detections of a frame to their joints, and those of the opposite side beside them.

    Parameters
    ----------
    problem : Problem
    t : int
        The frame.
    uv : (R, 2, 2, 16) float
        Output, in row ``row``: u and v in pixels, for the joint's own side, then the opposite side.
    params : (R, 2, 7, 16) single
        Output, in row ``row``: parameters in the same order; see ``PARAMS``.
    row : int
    """
    keypoints, used = problem.keypoints, problem.used
    scales, dofs, confidence = problem.error_scale, problem.error_dof, problem.confidence_density
    for j in range(16):
        uv[row, 0, 0, j], uv[row, 0, 1, j] = keypoints[t, j, 0], keypoints[t, j, 1]
        params[row, 0, _USED, j] = used[t, j]
        for visible in range(2):
            params[row, 0, _SCALE2 + visible, j] = scales[t, j, visible] * scales[t, j, visible]
            params[row, 0, _DOF + visible, j] = dofs[t, j, visible]
            params[row, 0, _CONFIDENCE + visible, j] = confidence[t, j, visible] * _PER_TURN
    for j in range(16):
        for i in range(2):
            uv[row, 1, i, j] = uv[row, 0, i, _OTHER[j]]
        for i in range(PARAMS):
            params[row, 1, i, j] = params[row, 0, i, _OTHER[j]]


@inner_inlined
def _measure(uv: Array, params: Singles, row: int, scratch64: Array, scratch32: Singles) -> None:
    """Standardised misfit of detections, with the error scales of hidden and of seen joints."""
    for j in range(16):
        loose = np.float32(scratch64[_LOOSE + j])
        for side in range(2):
            du, dv = (
                scratch64[_U + j] - uv[row, side, 0, j],
                scratch64[_V + j] - uv[row, side, 1, j],
            )
            misfit = np.float32(du * du + dv * dv)
            for visible in range(2):
                to = 32 * side + 16 * visible + j
                scale2 = params[row, side, _SCALE2 + visible, j] + loose
                dof = params[row, side, _DOF + visible, j]
                scratch32[_RATIO + to] = _E1 + misfit / (dof * scale2)
                scratch32[_POWER + to] = -_E2 * dof - _E1


@inner_inlined
def _exponential(x: np.float32) -> tuple[np.float32, np.float32]:
    """e^x = p 2^n: the fraction p, and n plus ``_ROUND``, whose lowest bits are n."""
    # e^x = 2^n e^r with |r| below ln 2 / 2.
    shifted = x * _LOG2E + _ROUND
    n = shifted - _ROUND
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    rr = r * r
    p = ((_E1 + r) + rr * (_E2 + _E3 * r)) + rr * rr * ((_E4 + _E5 * r) + rr * _E6)
    return p, shifted


@inner_inlined
def _raise(scratch32: Singles) -> None:
    """Raise every ratio to its power; the result is a fraction p and an exponent n of p 2^n."""
    for j in range(64):
        # ln x = e ln 2 + 2 artanh((f - 1) / (f + 1)) with f in [sqrt(1/2), sqrt 2).
        bits = np.float32(scratch32[_RATIO + j]).view(np.int32)
        e = np.int32((bits - _HALF_BITS) >> 23)
        f = np.int32(bits - (e << 23)).view(np.float32)
        s = (f - _E1) / (f + _E1)
        z = s * s
        q = (_L1 + _L3 * z) + z * z * ((_L5 + _L7 * z) + z * z * _L9)
        x = max(scratch32[_POWER + j] * (s * q + np.float32(e) * _SINGLE_LN2), _LEAST_POWER)
        scratch32[_FRACTION + j], scratch32[_EXPONENT + j] = _exponential(x)


@inner_inlined
def set_visibility_likelihoods(
    lens: Lens,
    tolerance: Array,
    body: float,
    joints: Array,
    row: int,
    uv: Array,
    params: Singles,
    of: int,
    scratch64: Array,
    scratch32: Singles,
    likelihoods: Array,
    to: int,
) -> None:
    """Likelihoods of a frame whose pose comes from a scenelet.

    Parameters
    ----------
    lens : Lens
        Of the camera, see :func:`lens_of`.
    tolerance : (16,) float
        Standard deviation of each joint of a person about the scenelet's, metres.
    body : float
        Size of the person, a factor.
    joints : (R, 3, 16) float
        World frame, metres; the frame is in row ``row``.
    row : int
    uv, params : (R, 2, 2, 16) float, (R, 2, 7, 16) single
        See :func:`set_detections`; the frame is in row ``of``.
    of : int
    scratch64, scratch32 : (SCRATCH64,) float, (SCRATCH32,) single
        Workspaces.
    likelihoods : (R, 64) float
        Output, in row ``to``; see ``LIKELIHOODS``.
    to : int
    """
    _project(lens, tolerance, body, joints, row, scratch64)
    _measure(uv, params, of, scratch64, scratch32)
    _raise(scratch32)
    for side in range(2):
        for visible in range(2):
            for j in range(params.shape[3]):
                at = 32 * side + 16 * visible + j
                scale2 = params[of, side, _SCALE2 + visible, j] + np.float32(scratch64[_LOOSE + j])
                part = (
                    scratch32[_FRACTION + at] * params[of, side, _CONFIDENCE + visible, j] / scale2
                )
                # 2^n needs double precision: detections far off exceed the range of single
                # precision.
                n = np.int64(np.float32(scratch32[_EXPONENT + at]).view(np.int32)) - _ROUND_BITS
                scratch64[_DENSITY + at] = part * np.int64((n + _BIAS) << 52).view(np.float64)
    for j in range(16):
        for side in range(2):
            hidden, seen = (
                scratch64[_DENSITY + 32 * side + j],
                scratch64[_DENSITY + 32 * side + 16 + j],
            )
            used = params[of, side, _USED, j] > 0
            # A joint without a detection contributes a factor of 1.
            likelihoods[to, 32 * side + j] = hidden if used else 1.0
            likelihoods[to, 32 * side + 16 + j] = seen - hidden if used else 0.0


@inner_inlined
def set_free_likelihoods(
    problem: Problem, t: int, scratch64: Array, likelihoods: Array, to: int
) -> None:
    """Likelihoods of a free frame in its static pose; they do not depend on the camera.

    Parameters
    ----------
    problem : Problem
    t : int
        The frame.
    scratch64 : (SCRATCH64,) float
        Workspace.
    likelihoods : (R, 64) float
        Output, in row ``to``; see ``LIKELIHOODS``.
    to : int
    """
    static, used = problem.static_density, problem.used
    for j in range(16):
        for side in range(2):
            hidden, seen = static[side, t, j, 0], static[side, t, j, 1]
            scratch64[_DENSITY + 32 * side + j] = hidden if used[t, j] else 1.0
            scratch64[_DENSITY + 32 * side + 16 + j] = seen - hidden if used[t, j] else 0.0
    for j in range(32):
        likelihoods[to, j] = scratch64[_DENSITY + j]
    for j in range(16):
        likelihoods[to, 32 + j] = scratch64[_DENSITY + 32 + _OTHER[j]]
        likelihoods[to, 48 + j] = scratch64[_DENSITY + 48 + _OTHER[j]]


@inner
def visibility_probabilities(seen: Singles, n: int, width: float, visibility_error: float) -> None:
    """Convert clearances to probabilities of being seen (``visibility_probability``).

    Parameters
    ----------
    seen : (n or more, 16) single
        Input: clearance of every joint, metres. Output: its probability, in the first ``n`` rows.
    n : int
        Number of rows.
    width, visibility_error : float
        Width of the visibility step in metres, and the visibility error, a probability.
    """
    sharpness, least = np.float32(1.0 / width), np.float32(visibility_error)
    span = np.float32(1.0 - 2.0 * visibility_error)
    for i in range(n):
        for j in range(16):
            x = -min(max(seen[i, j] * sharpness, -_FAR), _FAR)
            p, shifted = _exponential(x)
            scale = np.int32((np.float32(shifted).view(np.int32) + 127) << 23).view(np.float32)
            seen[i, j] = least + span / (_E1 + p * scale)


@inner_inlined
def mix_likelihoods(
    likelihoods: Array, row: int, seen: Singles, at: int, scratch64: Array, logs: Array
) -> None:
    """p(u, c | q, m) of a frame, with sides as they are and flipped.

    Parameters
    ----------
    likelihoods : (R, 64) float
        The frame is in row ``row``.
    row : int
    seen : (n, 16) single
        Probability of every joint being seen; the frame is in row ``at``.
    at : int
    scratch64 : (SCRATCH64,) float
        Workspace.
    logs : (4, n) float
        Output, in column ``at``: for both densities a factor in [1, 2^16) and an exponent of 2.
        :func:`take_logs` converts them to nats.
    """
    for j in range(16):
        share = np.float64(seen[at, j])
        right = likelihoods[row, j] + share * likelihoods[row, 16 + j]
        wrong = likelihoods[row, 32 + j] + share * likelihoods[row, 48 + j]
        scratch64[j], scratch64[16 + j] = max(right, _SMALLEST), max(wrong, _SMALLEST)
    _multiply_joints(scratch64, at, logs)


@inner_inlined
def cap_likelihoods(likelihoods: Array, row: int, scratch64: Array, at: int, logs: Array) -> None:
    """Upper bound of :func:`mix_likelihoods` over all visibilities.

    Parameters
    ----------
    likelihoods, row, scratch64, at, logs
        As there.
    """
    for j in range(16):
        right = likelihoods[row, j] + max(likelihoods[row, 16 + j], 0.0)
        wrong = likelihoods[row, 32 + j] + max(likelihoods[row, 48 + j], 0.0)
        scratch64[j], scratch64[16 + j] = max(right, _SMALLEST), max(wrong, _SMALLEST)
    _multiply_joints(scratch64, at, logs)


@inner_inlined
def _multiply_joints(scratch64: Array, at: int, logs: Array) -> None:
    """Multiply the densities of all joints, which are at the beginning of the scratch array."""
    # Logarithms are slow: take one, of the product of all mantissas, which cannot underflow.
    for j in range(32):
        bits = np.float64(scratch64[j]).view(np.int64)
        scratch64[j] = np.int64((bits & _MANTISSA) | _UNIT).view(np.float64)
        scratch64[32 + j] = np.float64((bits >> 52) - _BIAS)
    # Multiply halves in parallel, because a sequential product would wait for each factor.
    for j in range(8):
        scratch64[j] *= scratch64[8 + j]
        scratch64[16 + j] *= scratch64[24 + j]
        scratch64[32 + j] += scratch64[40 + j]
        scratch64[48 + j] += scratch64[56 + j]
    right, wrong, twos_right, twos_wrong = 1.0, 1.0, 0.0, 0.0
    for j in range(8):
        right *= scratch64[j]
        wrong *= scratch64[16 + j]
        twos_right += scratch64[32 + j]
        twos_wrong += scratch64[48 + j]
    logs[0, at], logs[1, at], logs[2, at], logs[3, at] = right, wrong, twos_right, twos_wrong


@inner
def take_logs(logs: Array, n: int) -> None:
    """log p(u, c | q, m) of frames, as they are and with sides flipped, nats.

    Parameters
    ----------
    logs : (4, n or more) float
        Input: output of :func:`mix_likelihoods`. Output: nats in the first two rows.
    n : int
        Number of columns.
    """
    for side in range(2):
        for i in range(n):
            # As in single precision above, with twice as many terms.
            bits = np.float64(logs[side, i]).view(np.int64)
            e = (bits - _DOUBLE_HALF_BITS) >> 52
            f = np.int64(bits - (e << 52)).view(np.float64)
            s = (f - 1.0) / (f + 1.0)
            z = s * s
            zz = z * z
            q = (1.0 + 1 / 3 * z) + zz * ((1 / 5 + 1 / 7 * z) + zz * (1 / 9 + 1 / 11 * z))
            q += zz * zz * zz * ((1 / 13 + 1 / 15 * z) + zz * (1 / 17 + 1 / 19 * z))
            logs[side, i] = 2.0 * s * q + (np.float64(e) + logs[2 + side, i]) * _LN2
