"""Several people before one camera: solved one by one, with one camera and shared furniture.

A window, a path, a smooth motion belong to one actor, so every actor has a log-posterior of
their own. What they share is the camera: its pose, height and focal length are estimated from
everybody's feet, so that furniture found by one stands in the world of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from imapper_prob.models.path_prior import CameraPrior
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import CameraSettings, Settings
from imapper_prob.models.skeleton import LANK, LKNE, PELV, RANK, RKNE, THRX
from imapper_prob.solver.camera_prior import estimate_camera
from imapper_prob.solver.candidates import refine
from imapper_prob.solver.combinations import polish, state_of
from imapper_prob.solver.elsewhere import own_detections
from imapper_prob.solver.limbs import limbs_of
from imapper_prob.solver.solver import METHODS, Solution, method_of, solve

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

Progress = Callable[[str, float], None]
_SHARED, _BODY = [0, 1, 2, 4], 3
"""Places in a camera prior of what the camera is, and of what is each actor's own."""


def solve_actors(
    clip: Clip,
    library: Library,
    *,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> tuple[Solution, ...]:
    """Solve every track of a clip, all with the same camera.

    Parameters
    ----------
    clip, library, settings, progress
        See :func:`imapper_prob.solver.solver.solve`.

    Returns
    -------
    tuple of Solution
        In the order of the tracks; the clip of each has that track only.
    """
    clips = [replace(clip, tracks=(track,)) for track in clip.tracks]
    if len(clips) == 1:
        return (solve(clip, library, settings=settings, progress=progress),)
    settings = settings or Settings()
    method = METHODS[settings.model.energy]
    own = [
        estimate_camera(
            own_detections(c),
            method.examine(c, settings=settings.path)[0],
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
    """What everybody's feet together say of the camera, and what that says of each body.

    Each actor's estimate is the camera's prior and what their feet saw; the prior counts
    once. With the elevation as a logarithm all of it is Gaussian and precisions add up. A
    body's scale is what its own estimate says, given the camera that all agreed on.

    Parameters
    ----------
    own : sequence of CameraPrior
        Of each actor, as `estimate_camera` gives it.
    nominal : Camera
        The clip's; the prior is about it.
    focal_spread : float
        The clip's, by how much its focal length may be wrong.
    settings : CameraSettings, optional
        Those the estimates were made with.

    Returns
    -------
    tuple of CameraPrior
        By actor.
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
    """An actor's five numbers once the four shared ones are known better."""
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
    return CameraPrior(new_mean, to_metres @ new @ to_metres)


# ------------------------------------------------------------------------------------------------
# One answer for everybody.
#
# Of the scenes that each actor has tried, those are taken together that are probable and do not
# stand in each other; what two actors both found is one object.

Array = NDArray[np.float64]
_ALTERNATIVES = 12
"""Scenes of each actor that are tried with those of the others."""
_SAME = 0.25
"""Part of the smaller footprint that two objects of one label share if they are one."""
_COLUMNS = ((PELV, THRX), (RANK, RKNE), (LANK, LKNE))
"""Trunk and shins, the parts of a person that cannot stand in furniture."""


@dataclass(frozen=True)
class SolvedScene:
    """One answer for all actors.

    Parameters
    ----------
    camera : Camera
        Its pose defines the world.
    objects : tuple of SceneObject
        In the world, what several found merged.
    users : tuple of tuple of int
        By object, the actors who found it.
    motions : tuple of (T, 16, 3) float
        By actor, joints in the world, metres.
    states : tuple of State
        By actor.
    log_posterior : float
        Sum over the actors, less what they cost each other.
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
        """Draw the scene from above: furniture by category, and everybody's way.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Those of a new figure if not given.

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
        """The scene from above, with its text, for a notebook."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(5.0, 4.6))}"


@dataclass(frozen=True)
class Solved:
    """A clip, what was found for each of its actors, and for all of them.

    Parameters
    ----------
    clip : Clip
        With all its tracks.
    actors : tuple of Solution
        In the order of the tracks, in one world.
    scenes : tuple of SolvedScene
        The best, then others of which no two have the same scenelet at nearby times. By
        log-posterior, or with the published energy by that, without the priors.

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
        """All scenes with what they cost, and the best from above, for a notebook."""
        rows = "".join(
            f"<tr><td>{number}<td>{scene.log_posterior:.1f}"
            f"<td>{escape(', '.join(o.label for o in scene.objects)) or 'none'}"
            for number, scene in enumerate(self.scenes, 1)
        )
        head = "<tr><th>scene<th>log posterior [nat]<th>furniture"
        best = picture_of(self.scenes[0].plot, size=(5.0, 4.6)) if self.scenes else ""
        return f"<p>{escape(repr(self))}</p><table>{head}{rows}</table>{best}"


def solved(clip: Clip, actors: Sequence[Solution], *, count: int = 5) -> Solved:
    """Put the solutions of all actors together.

    Parameters
    ----------
    clip : Clip
    actors : sequence of Solution
        As :func:`~imapper_prob.solver.actors.solve_actors` gives them.
    count : int
        Scenes asked for; the list ends where nothing else improves on an empty room.

    Returns
    -------
    Solved
    """
    # Polishing moves the camera, and several have to agree on it.
    finish = refine if len(actors) > 1 else _polished
    by_actor = [
        method_of(a.problem).scenes(a, first, finish=finish, count=count)
        for a, first in zip(actors, _best_together(actors), strict=True)
    ]
    ranks = range(max(len(states) for states in by_actor))
    scenes = [
        _scene(clip, actors, [states[min(rank, len(states) - 1)] for states in by_actor])
        for rank in ranks
    ]
    if method_of(actors[0].problem).by_log_posterior:
        scenes.sort(key=lambda scene: -scene.log_posterior)
    return Solved(clip, tuple(actors), tuple(scenes))


def _polished(problem: Problem, state: State) -> State:
    return polish(problem, refine(problem, state))


def _best_together(actors: Sequence[Solution]) -> tuple[State, ...]:
    """By actor the scene that is best with those of the others.

    From everybody's own best scene, one actor after the other takes the alternative that is
    best given the rest, until nobody changes. Repeatable, and exact for one actor.
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
    """The best scenes that one actor has tried, refined; all have the mean camera."""
    found = actor.combinations
    exchanged = [e.state for e in found.exchanges[-1:]]
    return exchanged + [
        refine(actor.problem, state_of(actor.problem, [found.pool[k] for k in tried.members]))
        for tried in found.tried[:_ALTERNATIVES]
    ]


@dataclass(frozen=True)
class Part:
    """One actor's share of a scene.

    Parameters
    ----------
    objects : tuple of SceneObject
        In the world.
    joints : (T, 16, 3) float
        World, metres.
    """

    objects: tuple[SceneObject, ...]
    joints: Array

    @classmethod
    def of(cls, actor: Solution, state: State) -> Part:
        """The furniture and the motion of an actor's state.

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
        return cls(objects, limbs_of(actor.problem, state, camera).joints)


def _mutual_cost(actor: Solution, one: Part, other: Part) -> float:
    """Nats for furniture in furniture and people in the furniture of others."""
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
    walked = _depth_inside(one.joints, strangers) + _depth_inside(other.joints, strange)
    return problem.collision_cost * collisions + problem.motion_cost * problem.frame_weight * walked


def _same(one: SceneObject, other: SceneObject) -> bool:
    """Whether two actors mean one object: same label, same place."""
    if one.label != other.label:
        return False
    a, b = Polygon(one.footprint), Polygon(other.footprint)
    return bool(a.intersection(b).area > _SAME * min(a.area, b.area))


def _depth_inside(joints: Array, objects: Sequence[SceneObject]) -> float:
    """Metres that trunk and shins are inside the boxes of objects, summed over frames."""
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
    """Everybody's objects, those that are one merged, and by object who found it.

    Kept is the one of the actor nearest to the camera, who is seen best. Two objects of one
    actor are never merged here: that actor's own scene has already decided about them.

    Parameters
    ----------
    parts : sequence of Part
        By actor.

    Returns
    -------
    objects : tuple of SceneObject
    users : tuple of tuple of int
        By object, the actors who found it.
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
