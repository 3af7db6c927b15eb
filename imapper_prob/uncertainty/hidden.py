"""The probability that furniture hides a joint from the camera, by object.

A joint is hidden in a draw if a box of that draw's furniture cuts the line of sight from the camera
to it. The share of draws is a probability, also given for every object that is matched across
draws. Two objects may hide a joint together.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.jit import compiled
from imapper_prob.models.kernels.axes import rotated_back
from imapper_prob.models.scene import SceneObject
from imapper_prob.models.skeleton import JOINTS
from imapper_prob.models.text import brief
from imapper_prob.uncertainty.clusters import ObjectCluster

__all__ = ["HiddenJoints", "cut_by", "hidden_joints"]

Array = NDArray[np.float64]


@compiled
def _lines_cut(elevation: float, joints: Array, boxes: Array) -> NDArray[np.bool_]:
    """Whether any box cuts the line from the camera to each joint.

    The line is inside a box between the point where it has entered all three slabs between opposite
    sides and the point where it leaves the first of them (Kay & Kajiya 1986).

    Parameters
    ----------
    elevation : float
        Height of the camera above the world's origin, metres.
    joints : (T, 16, 3) float
        World, metres.
    boxes : (K, 7) float
        World, see `imapper_prob.models.geometry.pack_boxes`.

    Returns
    -------
    (T, 16) bool
    """
    cut = np.zeros(joints.shape[:2], np.bool_)
    for k in range(len(boxes)):
        c, s = math.cos(boxes[k, 6]), math.sin(boxes[k, 6])
        x, y, z = -boxes[k, 0], -boxes[k, 1], elevation - boxes[k, 2]
        start = (*rotated_back(c, s, x, y), z)
        for t in range(joints.shape[0]):
            for j in range(joints.shape[1]):
                x, y = joints[t, j, 0], joints[t, j, 1]
                slope = (*rotated_back(c, s, x, y), joints[t, j, 2] - elevation)
                enters, leaves = 0.0, 1.0
                for axis in range(3):
                    half = boxes[k, 3 + axis]
                    if slope[axis] == 0.0:
                        if abs(start[axis]) >= half:
                            leaves = -1.0
                    else:
                        middle = -start[axis] / slope[axis]
                        reach = half / abs(slope[axis])
                        enters = max(enters, middle - reach)
                        leaves = min(leaves, middle + reach)
                if enters < leaves:
                    cut[t, j] = True
    return cut


@dataclass(frozen=True)
class HiddenJoints:
    """Probability that joints are hidden, and by which objects.

    Parameters
    ----------
    clusters : tuple of K ObjectCluster
        The objects of ``by_object``.
    probability : (T, 16) float
        Probability that any furniture hides the joint.
    by_object : (K, T, 16) float
        Probability that the object hides it, alone or with others.
    """

    clusters: tuple[ObjectCluster, ...]
    probability: Array
    by_object: Array

    __repr__ = brief

    def behind(self, what: str | int, *, least: float = 0.5) -> dict[str, int]:
        """The joints behind an object, with the number of frames in which each is hidden.

        Parameters
        ----------
        what : str or int
            A label, for the most probable object with that label; or an index in ``clusters``.
        least : float
            Least probability in a frame that the object hides the joint.

        Returns
        -------
        dict of str to int
            In descending order of frames; joints that are never hidden are left out.

        Raises
        ------
        InputError
            There is no such object.
        """
        frames = (self.by_object[self._number(what)] >= least).sum(0)
        order = np.argsort(-frames, kind="stable")
        return {JOINTS[j]: int(frames[j]) for j in order if frames[j]}

    def _number(self, what: str | int) -> int:
        if isinstance(what, int):
            if not 0 <= what < len(self.clusters):
                raise InputError(f"no object {what}; there are {len(self.clusters)}, from 0")
            return what
        for k, cluster in enumerate(self.clusters):
            if cluster.label == what:
                return k
        names = ", ".join(dict.fromkeys(c.label for c in self.clusters)) or "nothing"
        raise InputError(f"no object is most probably a {what}; there are: {names}")


def hidden_joints(
    draws: Sequence[Sequence[SceneObject]],
    motions: Iterable[Array],
    elevations: Sequence[float],
    clusters: Sequence[ObjectCluster],
) -> HiddenJoints:
    """Compute hidden joints over all draws.

    Parameters
    ----------
    draws : sequence of N sequences of SceneObject
        Furniture of each draw in its world frame.
    motions : iterable of N (T, 16, 3) float
        Motion of each draw in the same frame, metres.
    elevations : sequence of N float
        Height of each draw's camera above the floor, metres.
    clusters : sequence of ObjectCluster
        Clusters of the same draws, see `object_clusters`.

    Returns
    -------
    HiddenJoints
    """
    cluster_of = {
        (n, k): c for c, cluster in enumerate(clusters) for n, k in cluster.members.tolist()
    }
    count, anything, by_object = 0, np.zeros(()), np.zeros(())
    for n, (objects, joints, elevation) in enumerate(zip(draws, motions, elevations, strict=True)):
        if not count:
            anything = np.zeros(joints.shape[:2])
            by_object = np.zeros((len(clusters), *joints.shape[:2]))
        count += 1
        cut = [cut_by(o, joints, elevation) for o in objects]
        if cut:
            anything += np.any(cut, axis=0)
        for k, by_this in enumerate(cut):
            if (n, k) in cluster_of:
                by_object[cluster_of[n, k]] += by_this
    return HiddenJoints(tuple(clusters), anything / max(count, 1), by_object / max(count, 1))


def cut_by(o: SceneObject, joints: Array, elevation: float) -> NDArray[np.bool_]:
    """(T, 16) bool, whether an object cuts the line of sight to each joint.

    Parameters
    ----------
    o : SceneObject
        World frame.
    joints : (T, 16, 3) float
        World frame, metres.
    elevation : float
        Height of the camera above the world's origin, metres.

    Returns
    -------
    (T, 16) bool
    """
    cut: NDArray[np.bool_] = _lines_cut(
        float(elevation), np.ascontiguousarray(joints), pack_boxes([o])
    )
    return cut
