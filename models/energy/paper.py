"""The energy of the published method, on the states of this model.

    E = w_r L_r + w_o L_o + w_s L_s + w_c L_c + w_m L_m         (Monszpart et al. 2019)

    L_r = sum over t, j of c_tj |Pi q_tj - u_tj|^2              reprojection
    L_o = sum over t, j of F(v_tj, c_tj)                        occlusion
    L_s = sum over t of |p_t - p_(t-1)|^2                       smoothness of the pelvis
    L_c = sum over pairs of objects of max(0, -d)               collision of objects
    L_m = sum over t, objects not in use of max(0, -d_t)        motion through objects

with joints q and pelvis p in metres, detections u in normalised image coordinates (pixels
from the principal point over the focal length) of confidence c, clearance v of a line of
sight and signed distance d on the floor, in metres.

Misprints, mended:

* eta_t, which says whether a scenelet covers frame t, is printed with the upper limit
  max(t, n_l) of its sum over starts; it is min(t, n_l). With the maximum a scenelet would
  cover every frame after its start.
* L_m is printed with the signed distance itself and would reward walking through things; it
  takes the negative part, as L_c does.
* L_o is undefined where there is no object; the distance to an empty volume is the cap V,
  and so is every larger one.

Ours, where our notes of the paper give no formula: F, whose properties alone are known; the
pelvis as what is smooth; which columns of the body meet an object and which objects are one
seen twice, both as in the default posterior, so that the two differ in their weights alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.energy.intersection import column_depth, footprint_depth
from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import NOTHING_IN_SIGHT, sight_clearance
from imapper_prob.models.jit import compiled
from imapper_prob.models.limits import NEAREST
from imapper_prob.models.posterior import State, log_posterior, motion
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import read_only
from imapper_prob.models.skeleton import (
    DETECTED,
    HEAD,
    JOINTS,
    LANK,
    LHIP,
    LKNE,
    N_JOINTS,
    PELV,
    RANK,
    RHIP,
    RKNE,
)

__all__ = ["SURE_BUT_HIDDEN", "PaperEnergy", "PaperWeights", "occlusion_cost", "paper_energy"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SURE_BUT_HIDDEN: Final = 0.44
"""What a confident joint costs in the hidden volume, in parts of what an unsure one costs in
the open. On i3DB confidences below .5 speak for hidden by log(.519 / .137) and those above
for seen by log(.863 / .481) (tables of ``energy.detections``); this is the ratio."""

_BELOW_PELVIS: Final = 0.05
"""Metres by which the trunk reaches below the joint PELV."""

_LIMBS: Final = ((RHIP, RKNE), (LHIP, LKNE), (RKNE, RANK), (LKNE, LANK))
"""Thighs and shins."""


@dataclass(frozen=True)
class PaperWeights:
    """The factors of the five terms.

    The paper gives none. These are the ones of the authors' released program, used in
    normalised image coordinates on clips of 10 frames a second. It smooths with 0.5 at first
    and with 0.05, the value here, later on.

    Raises
    ------
    InputError
        If a weight is negative or not finite.
    """

    reprojection: float = 1.0
    occlusion: float = 1.0
    smoothness: float = 0.05
    collision: float = 20.0
    motion: float = 10.0

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"weight {name} = {value} must be finite and at least 0")


@dataclass(frozen=True, eq=False)
class PaperEnergy:
    """What a state costs under the published energy.

    Parameters
    ----------
    terms : mapping of str to float
        Weighted terms, named as the fields of :class:`PaperWeights`; all infinite where the
        state is impossible.
    by_frame : mapping of str to (T,) float
        The same, frame by frame, of all terms but ``collision``, which belongs to no frame.
        A step of the pelvis counts for the frame it leads to.
    """

    terms: Mapping[str, float]
    by_frame: Mapping[str, Array]

    @property
    def total(self) -> float:
        """The energy."""
        return sum(self.terms.values())

    @property
    def log_density(self) -> float:
        """Minus the energy: an unnormalised log density, without any prior."""
        return -self.total


def paper_energy(
    problem: Problem,
    state: State,
    *,
    confidences: ArrayLike,
    weights: PaperWeights | None = None,
) -> PaperEnergy:
    """The published energy of a state of the default posterior.

    Parameters
    ----------
    problem : Problem
    state : State
    confidences : (T, 16) float
        Confidence of each detection in [0, 1], as the track has them; a problem keeps only
        what its detector model makes of them.
    weights : PaperWeights, optional

    Raises
    ------
    InputError
        If a confidence is not in [0, 1] or there are not T x 16 of them.
    """
    weights = weights or PaperWeights()
    confidences = _checked(confidences, n_frames=problem.n_frames)
    if not np.isfinite(log_posterior(problem, state)):
        # Scenelets that overlap or stick out, or a camera outside its prior: there is no motion.
        nowhere = np.full(problem.n_frames, np.inf)
        names = [f.name for f in fields(weights)]
        by_frame = {name: nowhere for name in names if name != "collision"}
        return PaperEnergy(dict.fromkeys(names, np.inf), by_frame)
    joints = motion(problem, state)
    confidences = np.where(problem.used, confidences, 0.0)
    boxes, of_item, row = _furniture(problem, state)
    by_frame = {
        "reprojection": weights.reprojection * _reprojection(problem, state, joints, confidences),
        "occlusion": weights.occlusion * _occlusion(state, joints, confidences, boxes),
        "smoothness": weights.smoothness * _smoothness(joints),
        "motion": weights.motion * _motion(joints, boxes, of_item, _covered_by(problem, state)),
    }
    terms = {name: float(values.sum()) for name, values in by_frame.items()}
    terms["collision"] = weights.collision * _collision(problem, state, boxes, of_item, row)
    return PaperEnergy(terms, by_frame)


def occlusion_cost(clearance: ArrayLike, confidence: ArrayLike) -> Array:
    """F(v, c), what it costs a joint to be as hidden and as confidently detected as it is.

        F(v, c) = (1 - c) min(max(v, 0), V) + k c min(max(-v, 0), V)

    with V = ``NOTHING_IN_SIGHT`` and k = ``SURE_BUT_HIDDEN``. In the open, v > 0, an unsure
    joint costs its way to the hidden volume, up to V where nothing hides it. In the volume,
    v < 0, a sure joint costs its way out, but less: detectors are often sure of what they
    cannot see. The form is ours; these properties are the paper's.

    Parameters
    ----------
    clearance : (...) float
        Metres, negative where furniture hides the joint.
    confidence : (...) float
        In [0, 1].

    Returns
    -------
    (...) float
        Metres, in [0, V].
    """
    v, c = np.asarray(clearance, float), np.asarray(confidence, float)
    open_by = np.clip(v, 0.0, NOTHING_IN_SIGHT)
    hidden_by = np.clip(-v, 0.0, NOTHING_IN_SIGHT)
    cost: Array = (1 - c) * open_by + SURE_BUT_HIDDEN * c * hidden_by
    return cost


def _checked(confidences: ArrayLike, *, n_frames: int) -> Array:
    values = read_only(confidences, shape=(n_frames, N_JOINTS), name="confidences")
    bad = np.logical_not((values >= 0) & (values <= 1))
    if bad.any():
        t, j = np.argwhere(bad)[0]
        raise InputError(
            f"confidences, frame {t}, joint {JOINTS[j]}: {values[t, j]} is not in [0, 1]; "
            "give a missing joint confidence 0"
        )
    return values


def _covered_by(problem: Problem, state: State) -> Ints:
    """(T,) index of the scenelet that covers each frame, -1 for none: eta_t of the paper.

    In frames counted from 1 its mended sum is
    ``eta_t = sum over l, and over k from 0 to min(t, n_l) - 1, of X_(l, t - k)``.
    """
    covered = np.full(problem.n_frames, -1)
    for i, (scenelet, start) in enumerate(state.items):
        covered[start : start + problem.lengths[scenelet]] = i
    return covered


def _furniture(problem: Problem, state: State) -> tuple[Array, Ints, Ints]:
    """Boxes in the world (K, 7), the scenelet each comes with, and its row in the problem."""
    first, scenelets = problem.box_first, state.items[:, 0]
    of_item = np.repeat(np.arange(len(scenelets)), first[scenelets + 1] - first[scenelets])
    rows = [np.arange(first[s], first[s + 1]) for s in scenelets]
    row = np.concatenate([np.empty(0, np.int64), *rows])
    x, y, yaw = state.placements[of_item].T
    boxes = problem.boxes[row]
    c, s = np.cos(yaw), np.sin(yaw)
    across, along = boxes[:, 0], boxes[:, 1]
    boxes = np.column_stack(
        [c * across - s * along + x, s * across + c * along + y, boxes[:, 2:6], boxes[:, 6] + yaw]
    )
    return boxes, of_item, row


def _reprojection(problem: Problem, state: State, joints: Array, confidences: Array) -> Array:
    """(T,) sum over joints of c |Pi q - u|^2, normalised image coordinates."""
    pitch, elevation, log_focal, _, roll = state.camera
    x, y, z = np.moveaxis(joints, -1, 0)
    c, s, focal = np.cos(pitch), np.sin(pitch), np.exp(log_focal)
    depth = np.maximum(c * y + s * (z - elevation), NEAREST)
    level = -s * y + c * (z - elevation)
    right, up = np.cos(roll) * x + np.sin(roll) * level, np.cos(roll) * level - np.sin(roll) * x
    u = (problem.keypoints[..., 0] - problem.cx) / problem.fx
    v = (problem.keypoints[..., 1] - problem.cy) / problem.fy
    squared = (focal * right / depth - u) ** 2 + (-focal * up / depth - v) ** 2
    total: Array = (confidences * squared).sum(1)
    return total


def _occlusion(state: State, joints: Array, confidences: Array, boxes: Array) -> Array:
    """(T,) sum over the joints a detector reports of F(v, c), metres."""
    detected = list(DETECTED)
    eye = (0.0, 0.0, state.camera[1])
    clearance = sight_clearance(eye, joints[:, detected], boxes)
    total: Array = occlusion_cost(clearance, confidences[:, detected]).sum(1)
    return total


def _smoothness(joints: Array) -> Array:
    """(T,) squared step of the pelvis into each frame, square metres; 0 in the first."""
    pelvis = joints[:, PELV]
    steps: Array = (np.diff(pelvis, axis=0, prepend=pelvis[:1]) ** 2).sum(-1)
    return steps


def _collision(problem: Problem, state: State, boxes: Array, of_item: Ints, row: Ints) -> float:
    """How deep objects of different scenelets are in each other, metres, unless they are one."""
    yaw = problem.box_yaw[row] + state.placements[of_item, 2]
    label = problem.box_label[row]
    total = 0.0
    for a, b in combinations(range(len(boxes)), 2):
        aligned = np.cos(yaw[a] - yaw[b]) > np.cos(problem.merge_angle)
        if of_item[a] != of_item[b] and not (label[a] == label[b] and aligned):
            total += footprint_depth(boxes[a], boxes[b])
    return total


def _motion(joints: Array, boxes: Array, of_item: Ints, covered_by: Ints) -> Array:
    """(T,) how deep the body stands in objects that are not in use in the frame, metres."""
    turns = np.column_stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])])
    depth = np.zeros((len(joints), len(boxes)))
    _body_depth(_columns(joints), boxes, turns, depth)
    total: Array = np.where(covered_by[:, None] == of_item, 0.0, depth).sum(1)
    return total


def _columns(joints: Array) -> Array:
    """(T, 5, 4) trunk, thighs and shins as upright columns: x, y, lowest and highest z."""
    near, far = joints[:, [a for a, _ in _LIMBS]], joints[:, [b for _, b in _LIMBS]]
    middle = (near + far)[..., :2] / 2
    low = np.minimum(near[..., 2:], far[..., 2:])
    high = np.maximum(near[..., 2:], far[..., 2:])
    limbs = np.concatenate([middle, low, high], -1)
    pelvis = joints[:, PELV]
    trunk = np.column_stack([pelvis[:, :2], pelvis[:, 2] - _BELOW_PELVIS, joints[:, HEAD, 2]])
    return np.concatenate([trunk[:, None], limbs], 1)


@compiled
def _body_depth(columns: Array, boxes: Array, turns: Array, depth: Array) -> None:
    """Depth (T, K) of the deepest of a frame's columns (T, 5, 4) in each box, in place."""
    for t in range(len(columns)):
        for k in range(len(boxes)):
            for i in range(columns.shape[1]):
                q = columns[t, i]
                deep = column_depth(q[0], q[1], q[2], q[3], boxes[k], turns[k])
                depth[t, k] = max(depth[t, k], deep)
