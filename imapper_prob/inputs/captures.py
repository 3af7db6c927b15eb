"""Captures: motion recorded together with the furniture around it.

What scenelets are cut from: motion capture with scanned or measured furniture, or the truth
of a benchmark. A capture is known, where a clip is only seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject, read_only
from imapper_prob.models.skeleton import JOINTS, N_JOINTS

__all__ = ["Capture"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Capture:
    """One person's motion among furniture.

    World frame: metres, z up, floor at z = 0.

    Parameters
    ----------
    name : str
        For messages, and the first part of the names of its scenelets.
    scene : str
        The room; captures of one room share it.
    joints : (T, 16, 3) float
        Joints, metres; NaN for a whole frame in which nobody was tracked.
    objects : tuple of SceneObject
        Furniture, which stays where it is.
    fps : float
        Frames a second.
    actions : tuple of str
        A word a frame, or empty.
    """

    name: str
    scene: str
    joints: Array
    objects: tuple[SceneObject, ...]
    fps: float
    actions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        joints = read_only(self.joints, shape=(None, N_JOINTS, 3), name=f"capture {self.name}")
        finite: NDArray[np.bool_] = np.all(np.isfinite(joints), axis=2)
        partial = np.any(finite, axis=1) & ~np.all(finite, axis=1)
        if partial.any():
            t = int(np.argmax(partial))
            j = int(np.argmin(finite[t]))
            raise InputError(
                f"capture {self.name}, frame {t}, joint {JOINTS[j]}: not finite; a frame has all "
                "joints or none"
            )
        if not finite.any():
            raise InputError(f"capture {self.name}: no frame with a person in it")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise InputError(f"capture {self.name}: frame rate {self.fps} must be positive")
        if self.actions and len(self.actions) != len(joints):
            raise InputError(
                f"capture {self.name}: {len(self.actions)} actions for {len(joints)} frames"
            )
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "objects", tuple(self.objects))
        object.__setattr__(self, "actions", tuple(self.actions))
