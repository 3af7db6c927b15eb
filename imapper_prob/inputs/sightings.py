"""What a detector's files say before anybody knows who is who: one row a person a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.limits import LONGEST_CLIP, MOST_PEOPLE
from imapper_prob.models.skeleton import N_JOINTS

__all__ = ["FARTHEST", "Sightings"]

Array = NDArray[np.float64]

FARTHEST: Final = 1e6
"""Pixels or metres beyond which a coordinate is damage: its square must still be a number."""


@dataclass(frozen=True)
class Sightings:
    """All people in all frames, in the detector's own pixels and scores.

    Parameters
    ----------
    name : str
        Of the clip.
    map_name : str
        Which of the maps of `confidence_maps` its scores want.
    frames : (N,) int
        In which frame each person was seen.
    keypoints : (N, 16, 2) float
        Pixels, or parts of the image where ``relative``; NaN where missing.
    scores : (N, 16) float
        In the detector's units; 0 where a joint is missing or made of others.
    span : (int, int)
        First and last frame of the clip, people or not.
    poses : (N, 16, 3) float, optional
        Lifted joints relative to the pelvis, camera axes, metres; NaN for those without.
    along_ray : bool
        Whether poses are as a camera turned towards the person would see them.
    identities : (N,) str, optional
        Track names, where the program gave any.
    relative : bool
        Whether keypoints are parts of the image's width and height.
    size : (int, int), optional
        Width and height of the image in pixels, where the files say.
    fps : float, optional
        Frames a second, where the files say.
    likely_focal : float, optional
        Focal length in pixels, where the files have an idea of it.
    missing : tuple of str
        Joints that this kind of file never has.
    """

    name: str
    map_name: str
    frames: NDArray[np.int64]
    keypoints: Array
    scores: Array
    span: tuple[int, int]
    poses: Array | None = None
    along_ray: bool = False
    identities: tuple[str, ...] = ()
    relative: bool = False
    size: tuple[int, int] | None = None
    fps: float | None = None
    likely_focal: float | None = None
    missing: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        first, last = self.span
        if last - first >= LONGEST_CLIP:
            raise InputError(
                f"{self.name}: frames run from {first} to {last}, more than {LONGEST_CLIP}; "
                "check the frame numbers, or cut the clip"
            )
        rows = len(self.frames)
        assert self.keypoints.shape == (rows, N_JOINTS, 2)
        assert self.scores.shape == (rows, N_JOINTS)
        assert self.poses is None or self.poses.shape == (rows, N_JOINTS, 3)
        assert not self.identities or len(self.identities) == rows
        if rows:
            frames, people = np.unique(self.frames, return_counts=True)
            if people.max() > MOST_PEOPLE:
                frame = frames[np.argmax(people)]
                raise InputError(
                    f"{self.name}, frame {frame}: {people.max()} people; at most {MOST_PEOPLE} "
                    "can be told apart"
                )
