"""Scenes with their probabilities: made of layouts, described and compared.

Layouts are fine-grained: dozens of them share the probability. A scene consists of all layouts
within a given distance of its most probable one, and its probability is the sum of theirs. Neither
distinguishes kinds of seats, which have probabilities of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.layouts import group_of, match_objects, pair_objects, turn
from imapper_prob.models.drawing import INK, axes_for, draw_paths, picture_of
from imapper_prob.models.geometry import pack_boxes, sight_clearance
from imapper_prob.models.log_posterior import State
from imapper_prob.models.problem import Problem
from imapper_prob.models.scene import Clip, Scene, SceneObject
from imapper_prob.models.skeleton import DETECTED
from imapper_prob.models.text import with_error
from imapper_prob.people import everybody
from imapper_prob.sampling.sample import Samples
from imapper_prob.solver.detections import with_usual_confidences

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "APART",
    "SURE",
    "Explains",
    "Representative",
    "WeightedScene",
    "covariances_about",
    "describe_difference",
    "explained_by",
    "group_scenes",
    "representative",
    "where",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Explains:
    """What a scene explains: covered frames, and occluded detections.

    Parameters
    ----------
    frames : tuple of (int, int)
        First and last frame number of each scenelet.
    n_frames : int
        Number of frames, of all people in the clip.
    unsure : int
        Number of detections (one per joint and frame) with low confidence.
    unsure_behind : int
        Those of them that are behind furniture of the scene, i.e. hidden joints that it explains.
    sure_behind : int
        Number of confident detections that are behind furniture of the scene.
    """

    frames: tuple[tuple[int, int], ...]
    n_frames: int
    unsure: int
    unsure_behind: int
    sure_behind: int

    @property
    def covered(self) -> int:
        """Number of frames inside scenelets."""
        return sum(last - first + 1 for first, last in self.frames)

    @property
    def text(self) -> str:
        """Part of a sentence, to follow "it"."""
        return (
            f"covers {self.covered} of {self.n_frames} frames with scenelets, and has "
            f"{self.unsure_behind} of {self.unsure} unsure detections behind furniture "
            f"({self.sure_behind} sure ones too)"
        )


@dataclass(frozen=True)
class WeightedScene:
    """A scene of the posterior, or one layout, represented by a typical draw.

    Parameters
    ----------
    scene : Scene
        The representative draw.
    probability : float
        Posterior probability.
    error : float
        Monte-Carlo standard error of ``probability``.
    covariances : (n_objects, 2, 2) float
        Posterior covariance of each object's position on the floor about the place that is shown,
        square metres, see :func:`covariances_about`.
    ghosts : (n_ghosts, T, 16, 3) float
        Some more draws of the motion, world frame, metres.
    layouts : tuple of int
        Numbers, from 1, of its layouts, in descending order of probability.
    explains : Explains, optional
        What the scene explains.
    difference : str
        Difference from the best scene in words; empty for the best.
    draw : int
        Index of the representative draw, chain by chain; -1 if unknown.
    """

    scene: Scene
    probability: float
    error: float
    covariances: Array
    ghosts: Array
    layouts: tuple[int, ...] = ()
    explains: Explains | None = None
    difference: str = ""
    draw: int = -1

    def __repr__(self) -> str:
        names = ", ".join(self.names) or "nothing"
        return f"WeightedScene(p = {with_error(self.probability, self.error)}: {names:.200})"

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        """Furniture of the representative draw, in its world frame."""
        return self.scene.objects

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects, without the kinds of seats: ``seat`` for each seat."""
        return tuple(group_of(o.label) for o in self.scene.objects)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the scene from above with its probability, and other draws of the path in grey.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = posterior[0].plot()
        >>> axes.get_title().startswith("p = ")
        True
        """
        axes = axes_for(ax, size=(5.0, 4.6))
        for number, ghost in enumerate(self.ghosts):
            label = None if number else "other draws"
            draw_paths(axes, ghost, people=self.scene.people, label=label, quiet=True)
        self.scene.plot(axes)
        axes.set_title(f"p = {with_error(self.probability, self.error)}", color=INK, fontsize=11)
        return axes

    def _repr_html_(self) -> str:
        """A view from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(5.0, 4.6))}"


# ------------------------------------------------------------------------------------------------
# Representative draw of a layout.


@dataclass(frozen=True)
class Representative:
    """A typical draw of a layout.

    Parameters
    ----------
    draw : int
        Index of the draw, chain by chain.
    objects : tuple of n_objects SceneObject
        Its furniture, in the object order of the layout's first draw.
    members : (n,) int
        Indices of the draws of the layout.
    partners : (n, n_objects) int
        Index, in each of them, of the object that matches the one of ``objects``.
    """

    draw: int
    objects: tuple[SceneObject, ...]
    members: NDArray[np.int64]
    partners: NDArray[np.int64]


def representative(
    samples: Samples, layout: int, *, seen: Sequence[Sequence[SceneObject]], radius: float
) -> Representative:
    """The draw of a layout whose objects are nearest to their mean positions.

    Parameters
    ----------
    samples : Samples
    layout : int
        Index of the layout, from 0.
    seen : sequence of N sequence of SceneObject
        Objects of all draws, at positions for comparison.
    radius : float
        Matching distance in metres with which the layouts were made.

    Returns
    -------
    Representative
    """
    leader = samples.layouts.leaders[layout]
    founder = seen[leader]
    drawn = np.flatnonzero(samples.layouts.indicator == layout).tolist()
    found = {m: match_objects(founder, seen[m], radius=radius) for m in drawn}
    matched = {m: partner for m, partner in found.items() if partner is not None}
    members = np.array(list(matched), np.int64)
    partners = np.array(list(matched.values()), np.int64).reshape(len(members), len(founder))
    centres = _centres(samples.objects, members, partners)
    nearest = int(((centres - centres.mean(0)) ** 2).sum((1, 2)).argmin())
    draw = int(members[nearest])
    objects = tuple(samples.objects[draw][k] for k in partners[nearest].tolist())
    return Representative(draw, objects, members, partners)


def covariances_about(
    shown: Representative,
    layouts: Sequence[Representative],
    *,
    seen: Sequence[Sequence[SceneObject]],
    standing: Sequence[Sequence[SceneObject]],
) -> Array:
    """Covariance of each object's position over the draws of a scene, about the place shown.

    It is the mean square of deviations from the place shown instead of their mean, because regions
    are drawn about that place.

    Parameters
    ----------
    shown : Representative
        The layout that represents the scene.
    layouts : sequence of Representative
        All layouts of the scene, nearer to ``shown`` than :data:`APART`.
    seen : sequence of N sequence of SceneObject
        Objects of all draws, at positions for comparison.
    standing : sequence of N sequence of SceneObject
        The same objects where they stand, see :mod:`imapper_prob.uncertainty.estimate`.

    Returns
    -------
    (n_objects, 2, 2) float
        Square metres; NaN if the scene has fewer than two draws.
    """
    places = np.array([o.centre[:2] for o in shown.objects]).reshape(-1, 2)
    if sum(len(own.members) for own in layouts) < 2:
        return np.full((len(places), 2, 2), np.nan)
    first = _compared(shown, seen)
    orders = [[j for _, j in pair_objects(first, _compared(own, seen)).pairs] for own in layouts]
    centres = [
        _centres(standing, own.members, own.partners[:, order])
        for own, order in zip(layouts, orders, strict=True)
    ]
    offset = np.concatenate(centres) - places
    covariances: Array = np.einsum("nki,nkj->kij", offset, offset) / len(offset)
    return covariances


def _compared(own: Representative, seen: Sequence[Sequence[SceneObject]]) -> list[SceneObject]:
    """Objects of a representative draw, in its order, at positions for comparison."""
    (partner,) = own.partners[own.members == own.draw].tolist()
    return [seen[own.draw][k] for k in partner]


def _centres(
    objects: Sequence[Sequence[SceneObject]],
    members: NDArray[np.int64],
    partners: NDArray[np.int64],
) -> Array:
    """(n, n_objects, 2) positions of matched objects (n, n_objects) of n draws."""
    rows = zip(members.tolist(), partners.tolist(), strict=True)
    centres = [[objects[m][k].centre[:2] for k in partner] for m, partner in rows]
    return np.array(centres).reshape(*partners.shape, 2)


# ------------------------------------------------------------------------------------------------
# Scenes from layouts.

APART: Final = 0.9
"""Distance at which layouts are different scenes, metres, see :mod:`imapper_prob.layouts`: an
object more or less counts 1."""


def group_scenes(layouts: Sequence[Sequence[SceneObject]]) -> NDArray[np.int64]:
    """Group layouts into scenes.

    Parameters
    ----------
    layouts : sequence of K object sets
        In descending order of probability. Each joins the nearest earlier scene, or starts a new
        one if none is nearer than :data:`APART`.

    Returns
    -------
    (K,) int
        Scene index of each layout, in order of creation.
    """
    founders: list[int] = []
    scene = np.empty(len(layouts), np.int64)
    for k, objects in enumerate(layouts):
        distances = [pair_objects(layouts[f], objects).distance for f in founders]
        nearest = int(np.argmin(distances)) if distances else -1
        if not distances or distances[nearest] >= APART:
            nearest = len(founders)
            founders.append(k)
        scene[k] = nearest
    return scene


# ------------------------------------------------------------------------------------------------
# Differences in words.

_MOVED: Final = 0.3
"""Least displacement in metres that is reported, about the standard deviation of a position."""
_TURNED: Final = np.radians(30)
"""Least rotation in radians that is reported."""


def describe_difference(best: Sequence[SceneObject], other: Sequence[SceneObject]) -> str:
    """Describe the differences of a scene from the best one, as seen from the camera.

    Seats of all kinds are called seats. If two objects have the same name, their distance tells
    which one is meant.

    Parameters
    ----------
    best, other : sequence of SceneObject
        In world frames with the same focal length, see
        :func:`imapper_prob.layouts.through_one_lens`.

    Returns
    -------
    str
        Such as "the seat 0.4 m nearer; no table; also a shelf 1.2 m to the right and 4.0 m away".
    """
    found = pair_objects(best, other)
    groups = [group_of(o.label) for o in best]
    names = [
        group if groups.count(group) == 1 else f"{group} (at {o.centre[1]:.1f} m)"
        for group, o in zip(groups, best, strict=True)
    ]
    parts = [_change(names[i], best[i], other[j]) for i, j in found.pairs]
    parts += [f"no {names[i]}" for i in found.only_first]
    parts += [f"also a {group_of(other[j].label)} {where(other[j])}" for j in found.only_second]
    return "; ".join(part for part in parts if part) or "the same furniture, nearly as it stands"


def where(o: SceneObject) -> str:
    """Describe the position of an object as seen from the camera.

    Parameters
    ----------
    o : SceneObject
        World frame.

    Returns
    -------
    str
        Such as ``"1.2 m to the right and 4.0 m away"``.
    """
    x, y = o.centre[:2]
    side = "right" if x >= 0 else "left"
    return f"{abs(x):.1f} m to the {side} and {y:.1f} m away"


def _change(name: str, first: SceneObject, second: SceneObject) -> str:
    """Describe the difference of a pair of objects; empty if it is too small."""
    right, away = (second.centre - first.centre)[:2]
    moves = []
    if abs(right) > _MOVED:
        moves.append(f"{abs(right):.1f} m to the {'right' if right > 0 else 'left'}")
    if abs(away) > _MOVED:
        moves.append(f"{abs(away):.1f} m {'further away' if away > 0 else 'nearer'}")
    if not moves and np.hypot(right, away) > _MOVED:
        moves.append(f"{np.hypot(right, away):.1f} m off")
    turned = turn(first, second)
    if turned > _TURNED:
        moves.append(f"turned by {np.degrees(turned):.0f}°")
    return f"the {name} {', '.join(moves)}" if moves else ""


# ------------------------------------------------------------------------------------------------
# What a scene explains.

SURE: Final = 0.5
"""Confidence above which a detection counts as confident. On i3DB 28 to 84 % of hidden joints are
below it."""


def explained_by(clip: Clip, problem: Problem, scene: Scene, state: State) -> Explains:
    """Count the frames and occluded detections that a scene explains.

    A joint is behind furniture if the line of sight from the camera to it cuts a box.

    Parameters
    ----------
    clip : Clip
    problem : Problem
        The clip's log-posterior, for the lengths of scenelets.
    scene : Scene
    state : State
        The draw that the scene represents.

    Returns
    -------
    Explains
    """
    ids, last = np.tile(clip.frame_ids, len(clip.tracks)), problem.n_frames - 1
    lengths = problem.lengths[state.items[:, 0]]
    spans = tuple(
        (int(ids[start]), int(ids[min(start + length - 1, last)]))
        for start, length in zip(state.items[:, 1].tolist(), lengths.tolist(), strict=True)
    )
    detected = list(DETECTED)
    boxes = pack_boxes(scene.objects)
    behind = sight_clearance(scene.camera.centre, scene.joints[:, detected], boxes) < 0
    usual = replace(clip, tracks=tuple(map(with_usual_confidences, clip.tracks)))
    sure = everybody(usual).confidences[:, detected] >= SURE
    return Explains(
        frames=spans,
        n_frames=problem.n_frames,
        unsure=int(np.sum(~sure)),
        unsure_behind=int(np.sum(~sure & behind)),
        sure_behind=int(np.sum(sure & behind)),
    )
