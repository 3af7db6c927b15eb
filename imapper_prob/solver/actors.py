"""Solve clips with several people: one by one, with one camera and shared furniture.

Windows, path and smoothness belong to one actor, so every actor has their own log-posterior. Actors
share the camera: its pose, elevation and focal length are estimated from the feet of all of them.
So furniture found from one actor is in the same world frame for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from imapper_prob.models.camera import Camera
from imapper_prob.models.drawing import (
    axes_for,
    draw_furniture,
    draw_paths,
    name_axes_of_floor,
    picture_of,
    show_legend,
)
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.kernels.intersection import footprint_depth
from imapper_prob.models.log_posterior import State, log_posterior, state_camera
from imapper_prob.models.path_prior import CameraPrior, within_support
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, Settings
from imapper_prob.models.skeleton import LANK, LKNE, PELV, RANK, RKNE, THRX
from imapper_prob.progress import Progress
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.candidates import refine
from imapper_prob.solver.combinations import polish, state_of
from imapper_prob.solver.detections import own_detections
from imapper_prob.solver.limbs import limbs_of
from imapper_prob.solver.solver import METHODS, Solution, diverse_scenes, method_of, solve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "Part",
    "Solved",
    "SolvedScene",
    "share_camera",
    "shared_furniture",
    "solve_actors",
    "solved",
]

_SHARED, _BODY = [0, 1, 2, 4], 3
"""Indices in a camera prior: the camera's parameters, and the body scale of each actor."""


def solve_actors(
    clip: Clip,
    library: Library,
    *,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> tuple[Solution, ...]:
    """Solve every track of a clip with a common camera.

    Parameters
    ----------
    clip, library, settings, progress
        See :func:`imapper_prob.solver.solver.solve`.

    Returns
    -------
    tuple of Solution
        In the order of the tracks; the clip of each solution has only its own track.
    """
    clips = [replace(clip, tracks=(track,)) for track in clip.tracks]
    if len(clips) == 1:
        return (solve(clip, library, settings=settings, progress=progress),)
    settings = settings or Settings()
    method = METHODS[settings.model.energy]
    own = [
        estimate_camera(
            own_detections(c, settings.detector),
            method.examine(c, settings=settings.path, detector=settings.detector)[0],
            settings=settings.camera,
            detector=settings.detector,
        )
        for c in clips
    ]
    cameras = share_camera(
        own,
        nominal=clip.camera,
        focal_spread=clip.focal_spread,
        settings=settings.camera,
    )

    def named(actor: str) -> Progress | None:
        if progress is None:
            return None
        return lambda stage, part: progress(f"{actor}: {stage}", part)

    return tuple(
        solve(c, library, settings=settings, camera=camera, progress=named(c.tracks[0].name))
        for c, camera in zip(clips, cameras, strict=True)
    )


def share_camera(
    own: Sequence[CameraPrior],
    *,
    nominal: Camera,
    focal_spread: float,
    settings: CameraSettings | None = None,
) -> tuple[CameraPrior, ...]:
    """Combine the camera estimates of all actors, and update each actor's body scale.

    Each actor's estimate combines the camera prior with the evidence of their feet; the prior must
    count only once. With the log of the elevation everything is Gaussian, so precisions add. An
    actor's body scale is its own estimate conditioned on the common camera.

    Parameters
    ----------
    own : sequence of CameraPrior
        Estimate of each actor, from `estimate_camera`.
    nominal : Camera
        The clip's camera, which is the mean of the prior.
    focal_spread : float
        Standard deviation of the clip's log focal length.
    settings : CameraSettings, optional
        Settings with which the estimates were made.

    Returns
    -------
    tuple of CameraPrior
        One per actor.
    """
    settings = settings or CameraSettings()
    prior = np.diag(
        np.array([settings.pitch, settings.log_elevation, focal_spread, settings.roll]) ** -2.0
    )
    centre = np.array([nominal.pitch, np.log(nominal.elevation), 0.0, nominal.roll])
    information, pull = prior.copy(), prior @ centre
    actors = [_with_log_elevation(camera) for camera in own]
    for mean, covariance in actors:
        precision = np.linalg.inv(covariance[np.ix_(_SHARED, _SHARED)])
        information += precision - prior
        pull += precision @ mean[_SHARED] - prior @ centre
    agreed = np.linalg.inv(information)
    camera = agreed @ pull
    return tuple(_given(mean, covariance, camera, agreed) for mean, covariance in actors)


def _with_log_elevation(camera: CameraPrior) -> tuple[np.ndarray, np.ndarray]:
    mean = np.array(camera.mean)
    to_log = np.diag([1.0, 1.0 / mean[1], 1.0, 1.0, 1.0])
    mean[1] = np.log(mean[1])
    return mean, to_log @ camera.covariance @ to_log


def _given(
    mean: np.ndarray, covariance: np.ndarray, camera: np.ndarray, agreed: np.ndarray
) -> CameraPrior:
    """Camera prior of an actor, given a better estimate of the four shared parameters."""
    gain = covariance[_BODY, _SHARED] @ np.linalg.inv(covariance[np.ix_(_SHARED, _SHARED)])
    alone = covariance[_BODY, _BODY] - gain @ covariance[_SHARED, _BODY]
    new_mean, new = np.zeros(5), np.zeros((5, 5))
    new_mean[_SHARED] = camera
    new_mean[_BODY] = mean[_BODY] + gain @ (camera - mean[_SHARED])
    new[np.ix_(_SHARED, _SHARED)] = agreed
    new[_BODY, _SHARED] = new[_SHARED, _BODY] = gain @ agreed
    new[_BODY, _BODY] = alone + gain @ agreed @ gain
    elevation = np.exp(new_mean[1])
    to_metres = np.diag([1.0, elevation, 1.0, 1.0, 1.0])
    new_mean[1] = elevation
    return CameraPrior(within_support(new_mean), to_metres @ new @ to_metres)


# ------------------------------------------------------------------------------------------------
# Scenes of all actors together.
#
# From the scenes tried for each actor, those are combined that are probable and do not penetrate
# each other; an object found from two actors is one object.

Array = NDArray[np.float64]
_ALTERNATIVES = 12
"""Number of scenes of each actor that are combined with those of the others."""
_SAME = 0.25
"""Share of the smaller footprint that two objects of one label must have in common to be one."""
_COLUMNS = ((PELV, THRX), (RANK, RKNE), (LANK, LKNE))
"""Trunk and shins as pairs of joints, for penetration of people into furniture."""


@dataclass(frozen=True)
class SolvedScene:
    """A scene of all actors.

    Parameters
    ----------
    camera : Camera
        Camera of the scene; its pose defines the world frame.
    objects : tuple of SceneObject
        World frame; objects found from several actors are merged.
    users : tuple of tuple of int
        For each object, the actors from whom it was found.
    motions : tuple of (T, 16, 3) float
        For each actor, joints in the world frame, metres.
    states : tuple of State
        One per actor.
    log_posterior : float
        Sum over the actors minus mutual penetration costs, nats.
    """

    camera: Camera
    objects: tuple[SceneObject, ...]
    users: tuple[tuple[int, ...], ...]
    motions: tuple[Array, ...]
    states: tuple[State, ...]
    log_posterior: float

    def __repr__(self) -> str:
        names = ", ".join(o.label for o in self.objects) or "nothing"
        return f"SolvedScene(log posterior {self.log_posterior:.1f} nat: {names:.200})"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the scene from above: furniture by category, and the paths of all people.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = im.solve(clip, library).scenes[0].plot()
        >>> axes.get_xlabel(), axes.get_ylabel()
        ('x, to the right [m]', 'y, away from the camera [m]')
        """
        axes = axes_for(ax, size=(5.0, 4.6))
        joints = np.concatenate(self.motions)
        draw_paths(axes, joints, people=len(self.motions), label="pelvis")
        draw_furniture(axes, self.objects)
        name_axes_of_floor(axes)
        show_legend(axes, below=True)
        return axes

    def _repr_html_(self) -> str:
        """A view from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(5.0, 4.6))}"


@dataclass(frozen=True)
class Solved:
    """The solution of a clip: for each of its actors, and for all of them together.

    Parameters
    ----------
    clip : Clip
        The clip with all its tracks.
    actors : tuple of Solution
        In the order of the tracks, in one world frame.
    scenes : tuple of SolvedScene
        The best scene, then alternatives that do not share a scenelet at nearby times. Sorted by
        log-posterior; with the published energy, by that energy without priors.

    Examples
    --------
    >>> best = solved.scenes[0]
    >>> [o.label for o in best.objects]
    ['couch']
    >>> best.motions[0].shape == (clip.n_frames, 16, 3)
    True
    """

    clip: Clip
    actors: tuple[Solution, ...]
    scenes: tuple[SolvedScene, ...]

    def __repr__(self) -> str:
        best = f", the best {self.scenes[0]!r:.400}" if self.scenes else ""
        return f"Solved(clip={self.clip.name!r:.80}, scenes={len(self.scenes)}{best})"

    def _repr_html_(self) -> str:
        """A table of all scenes and a view of the best one, for notebooks."""
        rows = "".join(
            f"<tr><td>{number}<td>{scene.log_posterior:.1f}"
            f"<td>{escape(', '.join(o.label for o in scene.objects)) or 'none'}"
            for number, scene in enumerate(self.scenes, 1)
        )
        head = "<tr><th>scene<th>log posterior [nat]<th>furniture"
        best = picture_of(self.scenes[0].plot, size=(5.0, 4.6)) if self.scenes else ""
        return f"<p>{escape(repr(self))}</p><table>{head}{rows}</table>{best}"


def solved(clip: Clip, actors: Sequence[Solution], *, count: int = 5) -> Solved:
    """Combine the solutions of all actors.

    Parameters
    ----------
    clip : Clip
    actors : sequence of Solution
        Solutions by :func:`~imapper_prob.solver.actors.solve_actors`.
    count : int
        Number of scenes wanted; there are fewer if no other improves on an empty room.

    Returns
    -------
    Solved
    """
    diverse = method_of(actors[0].problem).diverse
    by_actor = [a.states[:count] for a in actors]
    if diverse:
        # Polishing changes the camera, which several actors share; so it is done only for one.
        finish = refine if len(actors) > 1 else _polished
        by_actor = [
            diverse_scenes(a, first, finish=finish, count=count)
            for a, first in zip(actors, _best_together(actors), strict=True)
        ]
    ranks = range(max(len(states) for states in by_actor))
    scenes = [
        _scene(clip, actors, [states[min(rank, len(states) - 1)] for states in by_actor])
        for rank in ranks
    ]
    if diverse:
        scenes.sort(key=lambda scene: -scene.log_posterior)
    return Solved(clip, tuple(actors), tuple(scenes))


def _polished(problem: Problem, state: State) -> State:
    return polish(problem, refine(problem, state))


def _best_together(actors: Sequence[Solution]) -> tuple[State, ...]:
    """For each actor, the scene that is best together with those of the others.

    Coordinate ascent: starting from the best scene of each actor, one actor after the other takes
    the alternative that is best given the rest, until nothing changes. Deterministic, and exact for
    one actor.
    """
    if len(actors) == 1:
        return (actors[0].states[0],)
    alternatives = [_alternatives(a) for a in actors]
    own = [[log_posterior(a.problem, s) for s in states]
           for a, states in zip(actors, alternatives, strict=True)]  # fmt: skip
    parts = [[Part.of(a, s) for s in states]
             for a, states in zip(actors, alternatives, strict=True)]  # fmt: skip
    chosen = [int(np.argmax(values)) for values in own]
    for _ in range(10):
        before = list(chosen)
        for k in range(len(actors)):
            others = [parts[i][chosen[i]] for i in range(len(actors)) if i != k]
            values = [
                value - sum(_mutual_cost(actors[k], part, other) for other in others)
                for value, part in zip(own[k], parts[k], strict=True)
            ]
            chosen[k] = int(np.argmax(values))
        if chosen == before:
            break
    return tuple(states[c] for states, c in zip(alternatives, chosen, strict=True))


def _alternatives(actor: Solution) -> list[State]:
    """The best scenes tried for one actor, refined; all with the mean camera."""
    found = actor.combinations
    exchanged = [e.state for e in found.exchanges[-1:]]
    return exchanged + [
        refine(actor.problem, state_of(actor.problem, [found.pool[k] for k in tried.members]))
        for tried in found.tried[:_ALTERNATIVES]
    ]


@dataclass(frozen=True)
class Part:
    """One actor's furniture and motion in a scene.

    Parameters
    ----------
    objects : tuple of SceneObject
        World frame.
    joints : (T, 16, 3) float
        World frame, metres.
    detected : (T,) bool
        Frames with a detected joint.
    """

    objects: tuple[SceneObject, ...]
    joints: Array
    detected: NDArray[np.bool_]

    @classmethod
    def of(cls, actor: Solution, state: State) -> Part:
        """Furniture and motion of an actor's state.

        Parameters
        ----------
        actor : Solution
        state : State

        Returns
        -------
        Part
        """
        objects = method_of(actor.problem).objects(actor.problem, actor.library, state)
        camera = state_camera(actor.clip.camera, state)
        detected: NDArray[np.bool_] = np.any(actor.problem.used, axis=1)
        return cls(objects, limbs_of(actor.problem, state, camera).joints, detected)


def _mutual_cost(actor: Solution, one: Part, other: Part) -> float:
    """Cost in nats of collisions between the actors' furniture, and of people inside the
    other's."""
    problem = actor.problem
    strange = [o for o in one.objects if not any(_same(o, p) for p in other.objects)]
    strangers = [p for p in other.objects if not any(_same(o, p) for o in one.objects)]
    collisions = sum(
        footprint_depth(a, b)
        for o in strange
        for p in other.objects
        if not _same(o, p)
        for a in pack_boxes([o])
        for b in pack_boxes([p])
    )
    # As in the energy of one actor, only frames with a detection count.
    walked = _depth_inside(one.joints[one.detected], strangers)
    walked += _depth_inside(other.joints[other.detected], strange)
    return problem.collision_cost * collisions + problem.motion_cost * problem.frame_weight * walked


def _same(one: SceneObject, other: SceneObject) -> bool:
    """Whether objects of two actors are the same: equal labels and overlapping footprints."""
    if one.label != other.label:
        return False
    a, b = Polygon(one.footprint), Polygon(other.footprint)
    return bool(a.intersection(b).area > _SAME * min(a.area, b.area))


def _depth_inside(joints: Array, objects: Sequence[SceneObject]) -> float:
    """Depth of trunk and shins inside the boxes of objects, summed over frames, metres."""
    total = 0.0
    for low, high in _COLUMNS:
        place = (joints[:, low] + joints[:, high]) / 2
        for x, y, z, hx, hy, hz, yaw in pack_boxes(objects):
            level = (joints[:, low, 2] < z + hz) & (joints[:, high, 2] > z - hz)
            dx, dy = place[:, 0] - x, place[:, 1] - y
            along = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy)
            across = np.abs(-np.sin(yaw) * dx + np.cos(yaw) * dy)
            depth = np.minimum(hx - along, hy - across)
            total += float(np.where(level, depth, 0.0).clip(min=0.0).sum())
    return total


def _scene(clip: Clip, actors: Sequence[Solution], states: Sequence[State]) -> SolvedScene:
    parts = [Part.of(a, s) for a, s in zip(actors, states, strict=True)]
    value = sum(log_posterior(a.problem, s) for a, s in zip(actors, states, strict=True))
    value -= sum(_mutual_cost(actors[0], one, other) for one, other in combinations(parts, 2))
    camera = state_camera(clip.camera, states[0])
    objects, users = shared_furniture(parts)
    return SolvedScene(camera, objects, users, tuple(p.joints for p in parts), tuple(states), value)


def shared_furniture(
    parts: Sequence[Part],
) -> tuple[tuple[SceneObject, ...], tuple[tuple[int, ...], ...]]:
    """Merge the objects of all actors, and tell for each object from whom it was found.

    Of merged objects, the one of the actor nearest to the camera is kept, because that actor is
    seen best. Two objects of one actor are not merged here: that actor's own scene has decided
    about them.

    Parameters
    ----------
    parts : sequence of Part
        One per actor.

    Returns
    -------
    objects : tuple of SceneObject
    users : tuple of tuple of int
        For each object, the actors from whom it was found.
    """
    distance = [float(np.median(np.linalg.norm(p.joints[:, PELV], axis=-1))) for p in parts]
    kept: list[SceneObject] = []
    users: list[list[int]] = []
    for k in np.argsort(distance, kind="stable").tolist():
        for item in parts[k].objects:
            partners = [i for i, o in enumerate(kept) if k not in users[i] and _same(o, item)]
            if partners:
                users[partners[0]].append(k)
            else:
                kept.append(item)
                users.append([k])
    return tuple(kept), tuple(tuple(sorted(u)) for u in users)
