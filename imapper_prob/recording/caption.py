"""What a recording says in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imapper_prob.models.scene import Scene
from imapper_prob.models.skeleton import PELV
from imapper_prob.recording.certainty import HIDDEN, Certainty
from imapper_prob.results.scenes import WeightedScene
from imapper_prob.results.uncertainty.clusters import ObjectCluster
from imapper_prob.results.uncertainty.nuisances import Nuisance

__all__ = ["TITLES", "caption", "certainty_text", "contents", "moves_text", "scene_name"]

_LEGEND = """\
**Boxes** are furniture, in a colour for each category. **Ellipses** on the floor hold 50 and
90 % of an object's position. The **yellow person** moves as in the most probable scene; **thin
doubles** are other draws of the same motion, blue people those of other scenes. **Grey
outlines** are the truth, where it is known.

The **coloured floor** is a map: the stronger the colour, the more probable that such an object
stands there, over all draws.

In the image, **dots** are detections, from red (unsure) to green (sure); the yellow skeleton is
the person projected back. **Squares** say that a joint is probably hidden, in the colour of what
hides it; in the room such joints are large.

Play `frame` to see the motion. Choose the timeline `scene` for one scene after the other, and
`draw` for what the chains did.
"""
_CERTAINTY_LEGEND = f"""\
An object is *there* in that share of all draws; its label is what it is called if it is there;
± are standard deviations. *Hides* counts the joints, over all frames, that it hides with a
probability of at least {HIDDEN:.1f}.

*Learned* is how much of the prior variance is gone: 0 % if the clip taught nothing, 100 % if
everything; below 0 the posterior is wider than the prior.
"""
_DOTS = 25
"""Of a full bar."""
TITLES = {
    "pitch": ("camera pitch", "°", 180 / np.pi),
    "roll": ("camera roll", "°", 180 / np.pi),
    "elevation": ("camera height", "m", 1.0),
    "log_focal_scale": ("log focal length", "%", 100.0),
    "log_body_scale": ("log stature", "%", 100.0),
}
"""How nuisance parameters are told: name, unit, and how many of it there are in ours."""


def scene_name(number: int, weighted: WeightedScene) -> str:
    """Number of a scene (from 1) and its probability with the Monte-Carlo error."""
    return f"Scene {number}: p = {weighted.probability:.2f} ± {weighted.error:.2f}"


def contents(scene: Scene) -> str:
    """The furniture of a scene, as in ``"2 chair, table"``."""
    labels = sorted(o.label for o in scene.objects)
    counts = {label: labels.count(label) for label in labels}
    return ", ".join(f"{n} {label}" if n > 1 else label for label, n in counts.items()) or "nothing"


def caption(description: str, scenes: Sequence[WeightedScene]) -> str:
    """The text panel in Markdown: ``description``, the scenes in a table, and a legend."""
    rows = [
        f"| {i} | {s.probability:.2f} ± {s.error:.2f} | {contents(s.scene)} | {s.difference} |"
        for i, s in enumerate(scenes, 1)
    ]
    header = "| scene | probability | furniture | unlike the first |"
    table = [header, "|---|---|---|---|", *rows]
    return "\n\n".join([description.strip(), "\n".join(table), _LEGEND])


def certainty_text(certainty: Certainty) -> str:
    """How sure each object and each parameter is, in two tables and a sentence on the person."""
    hidden = certainty.hidden
    objects = [
        "| object | there | label | across | depth | facing | hides |",
        "|---|---|---|---|---|---|---|",
        *(
            _object_row(c, int((hidden.by_object[k] >= HIDDEN).sum()))
            for k, c in enumerate(certainty.clusters)
        ),
    ]
    parameters = [
        "| parameter | before | after | learned |",
        "|---|---|---|---|",
        *(_parameter_row(n) for n in certainty.nuisances.values()),
    ]
    spread = 100 * certainty.joints.standard_deviation[:, PELV].mean(0)
    person = (
        f"The pelvis is known to {spread[0]:.0f} cm across the view, {spread[1]:.0f} cm in depth "
        f"and {spread[2]:.0f} cm in height (standard deviation, mean over frames)."
    )
    return "\n\n".join(["\n".join(objects), person, "\n".join(parameters), _CERTAINTY_LEGEND])


def moves_text(acceptance: Mapping[str, float]) -> str:
    """How often each move was accepted, most often first, with a bar; empty if nothing is known."""
    if not acceptance:
        return ""
    ranked = sorted(acceptance.items(), key=lambda item: (-item[1], item[0]))
    rows = [f"| {name} | {100 * rate:.1f} % | {_bar(rate)} |" for name, rate in ranked]
    return "\n".join(["| move | accepted | |", "|---|---|---|", *rows])


def _object_row(cluster: ObjectCluster, hides: int) -> str:
    across, depth = 100 * np.sqrt(np.diag(cluster.covariance))
    labels = ", ".join(f"{name} {share:.2f}" for name, share in cluster.labels.items())
    # Beyond half a turn the spread says no more than that any direction is possible.
    turn = np.degrees(cluster.yaw_spread)
    facing = f"{np.degrees(cluster.yaw):.0f}° ± {turn:.0f}°" if turn < 180 else "any"
    x, y = cluster.mean
    return (
        f"| {cluster.label} | {cluster.presence:.2f} ± {cluster.presence_error:.2f} | {labels} "
        f"| {x:.2f} m ± {across:.0f} cm | {y:.2f} m ± {depth:.0f} cm | {facing} | {hides} |"
    )


def _parameter_row(one: Nuisance) -> str:
    title, unit, scale = TITLES[one.name]
    digits = 2 if unit == "m" else 1

    def told(mean: float, spread: float) -> str:
        return f"{scale * mean:.{digits}f} ± {scale * spread:.{digits}f} {unit}"

    before = told(one.prior_mean, one.prior_standard_deviation)
    after = told(one.mean, one.standard_deviation)
    return f"| {title} | {before} | {after} | {100 * one.contraction:.0f} % |"


def _bar(share: float) -> str:
    return "•" * round(_DOTS * share)
