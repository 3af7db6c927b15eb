"""Clusters: objects matched across draws, with their probability, label and position.

Draws have different numbers of objects with different labels, in arbitrary order. They are matched
draw by draw. A draw has at most one object in a cluster. An object may be displaced, along the
viewing ray twice as far as across it. An object with another label may belong to a cluster if it is
near enough, so that a cluster can be "a chair, or perhaps a stool".
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from imapper_prob.models.drawing import axes_for, picture_of
from imapper_prob.models.scene import FRONTLESS, SEATS, SceneObject
from imapper_prob.models.text import as_probability, with_error
from imapper_prob.samplers.diagnostics import ShortChainWarning, mean_error, unanimous_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "LEAST_NAMED",
    "ObjectCluster",
    "cells_of_object",
    "circular_mean_and_spread",
    "names_of",
    "object_clusters",
    "region_of",
]

Array = NDArray[np.float64]
LEAST_NAMED = 0.2
"""Presence from which an object has a name on maps; more names would cover each other."""
_FINEST = 0.001
"""Least standard deviation of a position, metres; so identical draws still have a region."""


@dataclass(frozen=True)
class Region:
    """An ellipse on the floor.

    Parameters
    ----------
    centre : (2,) float
        Metres.
    half_axes : (2,) float
        Metres, the shorter first.
    angle : float
        Direction of the first half axis, radians from x towards y.
    """

    centre: Array
    half_axes: Array
    angle: float

    def holds(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(n,) bool, which of the points (n, 2) lie inside or on the edge."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        local = (np.asarray(points, float) - self.centre) @ np.array([[c, -s], [s, c]])
        inside: NDArray[np.bool_] = ((local / self.half_axes) ** 2).sum(-1) <= 1 + 1e-9
        return inside


def region_of(points: ArrayLike, share: float) -> Region:
    """The ellipse about the mean, with the covariance's shape, that holds a share of the points.

    Its size is an empirical quantile. A chi-square quantile would be right for a normal
    distribution only, and positions of furniture are seldom normal.

    Parameters
    ----------
    points : (n, 2) float
        Metres; at least one.
    share : float
        Between 0 and 1.

    Returns
    -------
    Region
    """
    points = np.asarray(points, float)
    centre = points.mean(0)
    offset = points - centre
    covariance = offset.T @ offset / len(points) + _FINEST**2 * np.eye(2)
    variances, axes = np.linalg.eigh(covariance)
    distance = (((offset @ axes) ** 2) / variances).sum(1)
    reach = max(float(np.quantile(distance, share, method="higher")), 1.0e-6)
    half_axes = np.maximum(np.sqrt(reach * variances), _FINEST)
    return Region(centre, half_axes, float(np.arctan2(axes[1, 0], axes[0, 0])))


# ------------------------------------------------------------------------------------------------
# Clusters.

Ints = NDArray[np.int64]
_OTHER_SEAT, _OTHER_LABEL = 0.25, 0.5
"""Cost of another label as a share of the radius. Motion hardly distinguishes kinds of seats; an
object of any other label must be within half the radius."""
_ALONG = 2.0
"""Distance along the viewing ray that counts as one across it: nearly all uncertainty is in depth,
and draws of an object on i3DB spread at least twice as far along the ray."""
_TOGETHER = 0.2
"""Share of common draws above which two clusters are different objects: independent objects occur
together as often as the more probable one occurs."""
_ROUNDS = 30
"""Largest number of iterations of the matching; it usually converges after ten."""
_APART = 1e6
"""Cost of merging two clusters that must not be merged; those that may have one below 1."""
_RAREST = 0.001
"""Least probability of a label that is listed."""


@dataclass(frozen=True)
class ObjectCluster:
    """An object matched across draws.

    Parameters
    ----------
    presence : float
        Probability that the object exists.
    presence_error : float
        Monte-Carlo standard error of ``presence``; NaN with too few draws. If all draws agree, that
        of :func:`imapper_prob.samplers.diagnostics.unanimous_error`.
    labels : mapping of str to float
        Probability of each label if the object exists, in descending order, down to .001. Seats may
        have other labels than those of their scenelets (docs/explanation/model.md).
    positions : (n, 2) float
        Centre on the floor in every draw that has the object, including its displacement, metres.
    yaw : float
        Circular mean of the orientation, radians; if the label has no front, modulo half a turn.
    yaw_spread : float
        Circular standard deviation, radians; infinite for a uniform distribution.
    members : (n, 2) int
        Index of the draw, and of the object in it.
    typical : SceneObject
        The object nearest to the mean, among those whose scenelets have the most probable label, if
        there are any.
    """

    presence: float
    presence_error: float
    labels: Mapping[str, float]
    positions: Array
    yaw: float
    yaw_spread: float
    members: Ints
    typical: SceneObject

    def __repr__(self) -> str:
        x, y = self.mean
        there = f"p = {with_error(self.presence, self.presence_error)}"
        return f"ObjectCluster({self.label!r:.60}, {there}, at ({x:.2f}, {y:.2f}) m)"

    @property
    def label(self) -> str:
        """The most probable label."""
        return next(iter(self.labels))

    @property
    def mean(self) -> Array:
        """(2,) mean position, metres."""
        mean: Array = self.positions.mean(0)
        return mean

    @property
    def covariance(self) -> Array:
        """(2, 2) covariance of the position, square metres; zero for a single draw."""
        offset = self.positions - self.mean
        covariance: Array = offset.T @ offset / max(len(offset) - 1, 1)
        return covariance

    def region(self, share: float) -> Region:
        """The ellipse that holds a share of the positions, such as .5 or .9.

        Parameters
        ----------
        share : float
            Between 0 and 1.

        Returns
        -------
        Region
        """
        return region_of(self.positions, share)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw positions from above, and the regions of 50 and 90 %.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            If not given, the axes of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> axes = posterior.clusters()[0].plot()
        >>> axes.get_legend().get_texts()[0].get_text()
        'couch, p = 1.00...'
        """
        from imapper_prob.uncertainty.drawing import draw_clusters

        axes = axes_for(ax, size=(4.6, 4.2))
        draw_clusters(axes, [self])
        return axes

    def _repr_html_(self) -> str:
        """A view from above and a text, for notebooks."""
        return f"<p>{escape(repr(self))}</p>{picture_of(self.plot, size=(4.0, 4.0))}"


def names_of(clusters: Sequence[ObjectCluster]) -> tuple[str, ...]:
    """A name for each object: its most probable label, with a number if it is not unique.

    Parameters
    ----------
    clusters : sequence of ObjectCluster
        The most probable first.

    Returns
    -------
    tuple of str
        Such as ``("couch", "table", "table 2")``.
    """
    met: Counter[str] = Counter()
    names = []
    for cluster in clusters:
        met[cluster.label] += 1
        number = met[cluster.label]
        names.append(cluster.label if number == 1 else f"{cluster.label} {number}")
    return tuple(names)


class ObjectCells(NamedTuple):
    """What tables say of an object.

    Parameters
    ----------
    labels : str
        Labels with their probabilities, if the object is there.
    there : str
        Probability that it is there, with its error.
    right, away : str
        Mean and standard deviation of the position, metres.
    facing : str
        The same of the orientation, degrees from 0 to 359; ``any`` if it is beyond half a turn.
    """

    labels: str
    there: str
    right: str
    away: str
    facing: str


def cells_of_object(cluster: ObjectCluster) -> ObjectCells:
    """Put an object into words for tables.

    Parameters
    ----------
    cluster : ObjectCluster

    Returns
    -------
    ObjectCells
    """
    across, away = np.sqrt(np.diag(cluster.covariance))
    turn = np.degrees(cluster.yaw_spread)
    yaw = round(np.degrees(cluster.yaw)) % 360
    return ObjectCells(
        labels=", ".join(
            label if share == 1 else f"{label} {as_probability(share)}"
            for label, share in cluster.labels.items()
        ),
        there=with_error(cluster.presence, cluster.presence_error),
        right=f"{cluster.mean[0]:.2f} ± {across:.2f}",
        away=f"{cluster.mean[1]:.2f} ± {away:.2f}",
        facing=f"{yaw}° ± {turn:.0f}°" if turn < 180 else "any",
    )


def object_clusters(
    draws: Sequence[Sequence[SceneObject]],
    log_posterior: Array,
    *,
    radius: float,
    least: float = 0.05,
    standing: Sequence[Sequence[SceneObject]] | None = None,
    seen: Sequence[Sequence[SceneObject]] | None = None,
    labels: Sequence[Sequence[Mapping[str, float]]] | None = None,
) -> tuple[ObjectCluster, ...]:
    """Match the objects of all draws.

    Parameters
    ----------
    draws : sequence of C N sequences of SceneObject
        Furniture of each draw in its world frame, chain by chain.
    log_posterior : (C, N) float
        Clusters start from the most probable draws. Its effective number of draws is that of an
        object that all draws have.
    radius : float
        Distance in metres across the viewing ray within which objects of the same label match;
        along the ray, as seen from above the origin, twice as far.
    least : float
        Least probability of the clusters that are returned.
    standing : sequence of C N sequences of SceneObject, optional
        The same furniture with random displacements (:mod:`imapper_prob.uncertainty.estimate`).
        Objects are matched by their positions in scenelets, and these positions are reported.
    seen : sequence of C N sequences of SceneObject, optional
        The same objects with other positions for the matching, if these differ.
    labels : sequence of C N sequences of mapping of str to float, optional
        Probabilities of the true label of each object; certainly its own if not given.

    Returns
    -------
    tuple of ObjectCluster
        In descending order of probability.
    """
    everything = [(n, k, o) for n, objects in enumerate(draws) for k, o in enumerate(objects)]
    if not everything:
        return ()
    names = sorted({o.label for _, _, o in everything})
    members = np.array([(n, k) for n, k, _ in everything])
    compared = draws if seen is None else seen
    places = np.array([o.centre[:2] for own in compared for o in own])
    one_hot = np.eye(len(names))[[names.index(o.label) for _, _, o in everything]]
    likely_first = np.argsort(-np.ravel(log_posterior), kind="stable")
    begins = np.searchsorted(members[:, 0], np.arange(len(draws) + 1))
    rows = [np.arange(begins[n], begins[n + 1]) for n in likely_first]
    metric = _Metric(radius, _labels_apart(names))
    cluster = _matched(rows, members[:, 0], places, one_hot, metric)
    standing = draws if standing is None else standing
    labels = [[{o.label: 1.0} for o in own] for own in draws] if labels is None else labels
    results = [
        _summary(draws, standing, labels, members[cluster == c], log_posterior)
        for c in np.unique(cluster)
    ]
    kept = [c for c in results if c.presence >= least]
    return tuple(sorted(kept, key=lambda c: (-c.presence, c.label, *c.mean)))


def _matched(
    rows: Sequence[Ints], draw: Ints, places: Array, labels: Array, metric: _Metric
) -> Ints:
    """(M,) cluster index of each of M objects.

    This is like k-means with an open number of clusters: objects are matched to the existing
    clusters, clusters move to the means of their members, and so on until nothing changes. Then two
    near clusters that hardly ever occur in the same draw are united.

    Parameters
    ----------
    rows : sequence of (m,) int
        Objects of each draw; draws are in the order in which they start clusters.
    draw : (M,) int
        The draw of each object.
    places : (M, 2) float
    labels : (M, L) float
        One-hot labels.
    metric : _Metric
        Distance between objects and clusters.
    """
    cluster = np.full(len(places), -1)
    means, shares = np.empty((0, 2)), np.empty((0, labels.shape[1]))
    for _ in range(_ROUNDS):
        before, cluster = cluster, np.full(len(places), -1)
        for own in rows:
            cluster[own] = _partners(places[own], labels[own], means, shares, metric)
            for row in own[cluster[own] < 0]:
                cluster[row] = len(means)
                means = np.concatenate([means, places[[row]]])
                shares = np.concatenate([shares, labels[[row]]])
        cluster = np.unique(cluster, return_inverse=True)[1]
        if np.array_equal(before, cluster):
            break
        means, shares = _means(cluster, places, labels)
    while True:
        united = _united(cluster, draw, places, labels, metric)
        if united is None:
            return cluster
        cluster = united


def _means(cluster: Ints, places: Array, labels: Array) -> tuple[Array, Array]:
    """(K, 2) mean position and (K, L) shares of labels of each cluster."""
    member = np.eye(cluster.max() + 1)[cluster]
    count = member.sum(0)[:, None]
    return member.T @ places / count, member.T @ labels / count


@dataclass(frozen=True)
class _Metric:
    """The distance between objects and clusters.

    Parameters
    ----------
    radius : float
        Metres across the viewing ray beyond which they do not match, even with the same label.
    labels_apart : (L, L) float
        Cost of different labels, as a share of the radius.
    """

    radius: float
    labels_apart: Array

    def __call__(self, places: Array, labels: Array, means: Array, shares: Array) -> Array:
        """(m, K) cost of matching m objects or clusters to K clusters; above 1 they do not
        match."""
        away, ray = places[:, None] - means, places[:, None] + means
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True).clip(min=1e-9)
        along = (away * ray).sum(-1)
        across = away[..., 0] * ray[..., 1] - away[..., 1] * ray[..., 0]
        distance = np.hypot(across, along / _ALONG)
        cost: Array = distance / self.radius + labels @ self.labels_apart @ shares.T
        return np.where(cost > 1, _APART, cost)


def _labels_apart(names: Sequence[str]) -> Array:
    """(L, L) cost of a match between different labels."""
    cost = np.full((len(names), len(names)), _OTHER_LABEL)
    seats = np.array([name in SEATS for name in names])
    cost[np.ix_(seats, seats)] = _OTHER_SEAT
    np.fill_diagonal(cost, 0.0)
    return cost


def _partners(places: Array, labels: Array, means: Array, shares: Array, metric: _Metric) -> Ints:
    """(m,) cluster of each object of one draw, -1 if none is near enough."""
    cost = metric(places, labels, means, shares)
    found, columns = linear_sum_assignment(cost)
    near = cost[found, columns] <= 1
    partners = np.full(len(places), -1)
    partners[found[near]] = columns[near]
    return partners


def _united(
    cluster: Ints, draw: Ints, places: Array, labels: Array, metric: _Metric
) -> Ints | None:
    """Unite the two nearest clusters that are one object; None if there are none."""
    means, shares = _means(cluster, places, labels)
    there = np.zeros((draw.max() + 1, len(means)))
    there[draw, cluster] = 1
    fewer = np.minimum.outer(there.sum(0), there.sum(0))
    cost = metric(means, shares, means, shares)
    cost[there.T @ there > _TOGETHER * fewer] = _APART  # this includes each cluster with itself
    one, other = np.unravel_index(int(cost.argmin()), cost.shape)
    if cost[one, other] > 1:
        return None
    united = np.where(cluster == other, one, cluster)
    # Of draws that have both, the nearer object stays; the other ones form a new cluster.
    mean = places[united == one].mean(0)
    both = np.flatnonzero((there[:, one] > 0) & (there[:, other] > 0))
    for n in both:
        pair = np.flatnonzero((draw == n) & (united == one))
        united[pair[np.linalg.norm(places[pair] - mean, axis=1).argmax()]] = len(means)
    return np.unique(united, return_inverse=True)[1]


def _summary(
    draws: Sequence[Sequence[SceneObject]],
    standing: Sequence[Sequence[SceneObject]],
    labels: Sequence[Sequence[Mapping[str, float]]],
    members: Ints,
    log_posterior: Array,
) -> ObjectCluster:
    objects = [draws[n][k] for n, k in members.tolist()]
    counts: Counter[str] = Counter()
    for n, k in members.tolist():
        counts.update(labels[n][k])
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    probable = {label: c / len(objects) for label, c in ranked if c >= _RAREST * len(objects)}
    positions = np.array([standing[n][k].centre[:2] for n, k in members.tolist()])
    yaw, spread = circular_mean_and_spread(
        np.array([o.placement.yaw for o in objects]), front=ranked[0][0] not in FRONTLESS
    )
    there = np.zeros(log_posterior.shape)
    there.flat[members[:, 0]] = 1
    with warnings.catch_warnings():
        # The verdict reports a short run.
        warnings.simplefilter("ignore", ShortChainWarning)
        error = unanimous_error(log_posterior) if there.all() else float(mean_error(there))
    off = [float(np.linalg.norm(o.centre[:2] - positions.mean(0))) for o in objects]
    typical = min(range(len(off)), key=lambda i: (objects[i].label != ranked[0][0], off[i]))
    return ObjectCluster(
        presence=float(there.mean()),
        presence_error=error,
        labels=probable,
        positions=positions,
        yaw=yaw,
        yaw_spread=spread,
        members=members,
        typical=objects[typical],
    )


def circular_mean_and_spread(angles: Array, *, front: bool = True) -> tuple[float, float]:
    """Mean direction and circular standard deviation of (n,) angles, radians.

    The spread is sqrt(-2 log R), where R is the length of the mean vector (Mardia & Jupp 2000,
    section 2.3.4); if small, it is close to the usual standard deviation. Without a front, angles
    are equal modulo half a turn: the results are half of those for doubled angles.

    Parameters
    ----------
    angles : (n,) float
        Radians.
    front : bool
        Whether opposite directions differ.

    Returns
    -------
    mean, spread : float
        Radians.
    """
    times = 1 if front else 2
    vector = np.exp(1j * times * angles).mean()
    length = min(float(abs(vector)), 1.0)
    spread = float(np.sqrt(max(-2 * np.log(length), 0.0))) if length > 1e-12 else float("inf")
    return float(np.angle(vector)) / times, spread / times
