"""Scenelets (short motions with the objects around them), and libraries of scenelets."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import SceneObject, read_only
from imapper_prob.models.settings import QUICKEST_FILM
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.models.text import Listed, brief, readable

__all__ = ["Library", "Scenelet"]

Array = NDArray[np.float64]

_LEAST_RATE: Final = 0.1
"""Least frame rate of a recorded motion, frames per second; less indicates a damaged number."""
_FARTHEST: Final = 100.0
"""Largest distance in metres of joints and furniture from the origin of a scenelet's frame."""


@dataclass(frozen=True)
class Scenelet:
    """A motion of a second or two, with the furniture within reach.

    Local frame: floor at z = 0, origin below the pelvis in the centre frame (index ``n // 2``), +y
    is the facing direction of the person in that frame.

    Parameters
    ----------
    name : str
        Unique name in its library, such as ``"sit-couch-017"``.
    action : str
        Action: ``"walk"``, ``"sit"``, ``"stand"``, ``"reach"``, …
    joints : (n, 16, 3) float
        Joints in the local frame, metres, at ``fps`` frames per second.
    objects : tuple of SceneObject
        Furniture in the local frame; may be empty.
    fps : float
        Frames per second of ``joints``.
    weight : float
        Weight among similar motions: one over the number of scenelets that start near this one in
        the same source scene, so that a long stay in one place counts once (Monszpart et al. 2019,
        section 4).
    """

    name: str
    action: str
    joints: Array
    objects: tuple[SceneObject, ...]
    fps: float = 10.0
    weight: float = 1.0

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", readable(self.name))
        object.__setattr__(self, "action", readable(self.action))
        joints = read_only(self.joints, shape=(None, N_JOINTS, 3), name=f"scenelet {self.name}")
        if len(joints) < 2:
            raise InputError(f"scenelet {self.name}: needs at least 2 frames, has {len(joints)}")
        if not np.isfinite(joints).all():
            t, j = np.argwhere(~np.isfinite(joints).all(-1))[0]
            raise InputError(f"scenelet {self.name}, frame {t}, joint {j}: not finite")
        if np.abs(joints).max() > _FARTHEST:
            raise InputError(f"scenelet {self.name}: a joint {np.abs(joints).max():g} m away")
        for o in self.objects:
            bounds = np.abs([o.bounds.ravel().tolist(), [o.placement.x, o.placement.y, 0, 0, 0, 0]])
            if bounds.max() > _FARTHEST:
                raise InputError(f"scenelet {self.name}: its {o.label} is {bounds.max():g} m away")
        if not _LEAST_RATE <= self.fps <= QUICKEST_FILM:
            raise InputError(
                f"scenelet {self.name}: {self.fps:g} frames a second; it may have "
                f"{_LEAST_RATE:g} to {QUICKEST_FILM:g}"
            )
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise InputError(f"scenelet {self.name}: weight {self.weight} must be positive")
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "objects", tuple(self.objects))

    @property
    def n_frames(self) -> int:
        """n, the number of frames."""
        return len(self.joints)

    @property
    def slowest_film(self) -> float:
        """Least frame rate of a clip, frames per second, at which the motion has two frames.

        Examples
        --------
        >>> scenelet = im.load_library()[0]
        >>> 1 < scenelet.slowest_film < scenelet.fps
        True
        """
        # A motion at another rate keeps its middle frame, the later of two.
        return self.fps / (self.n_frames // 2)

    def scaled(self, factor: float) -> Scenelet:
        """The scenelet of a body ``factor`` times as large, its furniture with it.

        Parameters
        ----------
        factor : float

        Returns
        -------
        Scenelet
            Scaled about the origin, a point on the floor.
        """
        objects = tuple(piece.scaled(factor) for piece in self.objects)
        return replace(self, joints=self.joints * factor, objects=objects)

    @property
    def labels(self) -> tuple[str, ...]:
        """Categories of the objects, in order."""
        return tuple(o.label for o in self.objects)


@dataclass(frozen=True)
class Library(Sequence[Scenelet]):
    """An ordered collection of the scenelets that a run may use.

    Parameters
    ----------
    name : str
    scenelets : tuple of Scenelet
        At least one, with unique names.

    Examples
    --------
    >>> library = im.load_library()
    >>> few = im.Library("few", tuple(library)[::20])
    >>> len(few) < len(library)
    True
    >>> few[0].joints.shape[1:]
    (16, 3)
    """

    name: str
    scenelets: tuple[Scenelet, ...]

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", readable(self.name))
        object.__setattr__(self, "scenelets", Listed(self.scenelets))
        if not self.scenelets:
            raise InputError(f"library {self.name} is empty")
        names = [s.name for s in self.scenelets]
        if len(set(names)) != len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise InputError(f"library {self.name}: scenelet {twice} occurs twice")

    def __len__(self) -> int:
        return len(self.scenelets)

    def __getitem__(self, index: int) -> Scenelet:  # type: ignore[override]
        return self.scenelets[index]

    def __iter__(self) -> Iterator[Scenelet]:
        return iter(self.scenelets)

    def _repr_html_(self) -> str:
        """A table of actions with their scenelet counts and furniture, for notebooks."""
        rows = []
        for action, count in Counter(s.action for s in self).most_common():
            stood = Counter(label for s in self if s.action == action for label in s.labels)
            told = ", ".join(f"{n} {label}" for label, n in stood.most_common()) or "none"
            rows.append(f"<tr><td>{escape(action)}<td>{count}<td>{escape(told)}")
        head = "<tr><th>action<th>scenelets<th>furniture in them"
        return f"<p>{escape(repr(self))}</p><table>{head}{''.join(rows)}</table>"

    @property
    def digest(self) -> str:
        """SHA-256 of names, motions and objects, which a run records as provenance.

        Examples
        --------
        >>> len(im.load_library().digest)
        64
        """
        state = hashlib.sha256()
        for s in self.scenelets:
            state.update(f"{s.name}|{s.action}|{s.fps}|{s.weight}".encode())
            state.update(np.ascontiguousarray(s.joints).tobytes())
            for o in s.objects:
                state.update(repr((o.label, o.placement)).encode())
                for c in o.cuboids:
                    state.update(c.part.encode() + c.centre.tobytes() + c.size.tobytes())
        return state.hexdigest()
