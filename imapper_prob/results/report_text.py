"""Sentences of the report: the answer, how far to trust it, and what makes it uncertain."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import SEATS, Clip
from imapper_prob.models.text import as_probability, plural, with_error
from imapper_prob.people import by_person, own_part
from imapper_prob.sampling.sample import Samples
from imapper_prob.uncertainty.checks import named
from imapper_prob.uncertainty.clusters import ObjectCluster, names_of
from imapper_prob.uncertainty.scenes import WeightedScene

__all__ = ["answer", "caption", "listed", "runner_up", "sides_of", "trust", "warnings_of"]

_NUMBERS: Final = (
    "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
)  # fmt: skip
_WEAK: Final = 0.5
"""Probability below which a scene is called weak."""
_PROBABLE, _SURE = 0.5, 0.9
"""Probabilities above which an object is likely to be there, and its label is as good as known."""
_VAGUE: Final = 0.1
"""Monte-Carlo error above which a probability is only an order of magnitude."""
_SHORT: Final = 5.0
"""Duration in seconds below which a clip is called short."""
_FLIPPED: Final = 0.5
"""Probability above which sides count as flipped."""
_LOST: Final = 0.2
"""Share of frames without any detection above which the person counts as lost."""


def answer(scenes: Sequence[WeightedScene]) -> str:
    """The objects of the most probable scene, in a sentence.

    Parameters
    ----------
    scenes : sequence of WeightedScene

    Returns
    -------
    str
    """
    there = listed(scenes[0].names)
    verb = "is" if there.startswith(("one ", "no ")) else "are"
    return f"Most probably ({_share(scenes[0])}) there {verb} {there}."


def runner_up(scenes: Sequence[WeightedScene]) -> str:
    """The second most probable scene in a sentence; empty if there is none.

    Parameters
    ----------
    scenes : sequence of WeightedScene

    Returns
    -------
    str
    """
    if len(scenes) < 2:
        return ""
    second = scenes[1]
    there = listed(second.names)
    return f"If not, then next ({_share(second)}) {there}; unlike the first: {second.difference}."


def listed(names: Sequence[str]) -> str:
    """Count objects in words: ``"two seats and one table"``.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    str
    """
    parts = [
        f"{_NUMBERS[n] if n < len(_NUMBERS) else n} {plural(name) if n > 1 else name}"
        for name, n in Counter(sorted(names)).most_common()
    ]
    if not parts:
        return "no furniture that the motion tells of"
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def warnings_of(
    clip: Clip,
    samples: Samples,
    scenes: Sequence[WeightedScene],
    *,
    lost: float,
    clusters: Sequence[ObjectCluster] = (),
    disputed: Sequence[int] = (),
) -> tuple[str, ...]:
    """Reasons why the result is less certain than it looks, one sentence each.

    Parameters
    ----------
    clip : Clip
    samples : Samples
    scenes : sequence of WeightedScene
    lost : float
        Share of frames without a detection of the person, of all people together.
    clusters : sequence of ObjectCluster
        Objects matched over all draws.
    disputed : sequence of int
        Numbers of the scenes whose layouts the chains disagree about.

    Returns
    -------
    tuple of str
    """
    best, said = scenes[0], []
    if not samples.finished:
        said.append("The run was interrupted: these are the draws that there were.")
    if len(disputed) == 1:
        said.append(
            f"The chains disagree about details of scene {disputed[0]}: what differs between them "
            "has no probability that can be trusted."
        )
    elif disputed:
        said.append(
            "The chains disagree: each prefers a room of its own, so the probabilities below, and "
            "their order, cannot be trusted."
        )
    elif not samples.verdict.good:
        said.append(
            "Probabilities and spreads are preliminary. To sample on, give the command of the run "
            "again with --until good."
        )
    if best.probability < _WEAK:
        said.append(
            "Weak evidence: even the most probable scene has a probability of only "
            f"{as_probability(best.probability)}. Look at the others too, and at what they have in "
            "common."
        )
    if math.isnan(best.error):
        said.append("One draw a chain: no error of its probability can be given.")
    if best.error > _VAGUE:
        said.append(
            f"Its probability is known to ± {best.error:.2f} only, from the draws that there are."
        )
    kinds = [
        f"{as_probability(cluster.labels[cluster.label])} ({name})"
        for name, cluster in zip(names_of(clusters), clusters, strict=True)
        if cluster.label in SEATS
        and cluster.presence > _PROBABLE
        and cluster.labels[cluster.label] < _SURE
    ]
    if kinds:
        said.append(
            "Motion hardly tells the kind of a seat. Its name in the table of objects is right "
            f"with probability {', '.join(kinds)}, if it is there."
        )
    if not clip.focal_known:
        said.append(
            f"The focal length was assumed ({clip.camera.fx:.0f} px ± "
            f"{100 * clip.focal_spread:.0f} %), not measured: all distances may be wrong by that "
            "factor together."
        )
    seconds = clip.n_frames / clip.fps
    if seconds < _SHORT:
        said.append(
            f"Few frames: {clip.n_frames} of them, {seconds:.1f} s. People tell of furniture by "
            "using it, and that takes time."
        )
    if lost > _LOST:
        whom = "the person" if len(clip.tracks) == 1 else "people"
        said.append(f"The detector lost {whom} in {100 * lost:.0f} % of the frames.")
    return tuple(said)


def trust(samples: Samples, *, alarmed: int, checked: int) -> str:
    """How far the result can be trusted, in plain words.

    Parameters
    ----------
    samples : Samples
    alarmed, checked : int
        Number of checks that raise an alarm, and of all checks.

    Returns
    -------
    str
    """
    chains = samples.shape[0]
    count = _NUMBERS[chains] if chains < len(_NUMBERS) else str(chains)
    whose = "One run of the sampler" if chains == 1 else f"{count.capitalize()} runs of the sampler"
    apart = "" if chains == 1 else ", begun apart,"
    if samples.verdict.good:
        said = f"{whose}{apart} came to the same answer, and probabilities are well known."
    elif samples.verdict.disagreement is not None:
        said = f"{whose}{apart} ended with different answers: which is right is not known."
    else:
        said = f"{whose}{apart} did not go on for long enough: what is said here is preliminary."
    if alarmed:
        return f"{said} {alarmed} of {checked} checks speak against the whole result."
    return f"{said} Nothing else speaks against the result ({checked} checks)."


def sides_of(clip: Clip, flipped: NDArray[np.float64]) -> tuple[str, ...]:
    """The frames in which left and right are probably flipped, by person.

    Parameters
    ----------
    clip : Clip
        Clip of K people.
    flipped : (K T,) float
        Probability of a flip by frame, one person after the other.

    Returns
    -------
    tuple of str
    """
    return tuple(
        _sides(own, clip.frame_ids, of=own_part(clip, person))
        for person, own in enumerate(by_person(clip, flipped))
    )


def caption(number: int, weighted: WeightedScene) -> str:
    """A scene in a sentence or two, with its probability.

    Parameters
    ----------
    number : int
        From 1, the most probable first.
    weighted : WeightedScene

    Returns
    -------
    str
    """
    parts = [
        f"Scene {number}, {_share(weighted)}: {listed(weighted.names)}",
    ]
    if weighted.difference:
        parts.append(f"Unlike the first: {weighted.difference}")
    if weighted.explains is not None:
        parts.append(f"It {weighted.explains.text}")
    return ". ".join(parts) + "."


def _sides(flipped: NDArray[np.float64], frame_ids: NDArray[np.int64], *, of: str) -> str:
    whose = f" of{of}" if of else ""
    frames = frame_ids[flipped > _FLIPPED]
    if not len(frames):
        return f"The detector took left for right{whose} in no frame."
    word = "frame" if len(frames) == 1 else "frames"
    return f"The detector probably took left for right{whose} in {word} {named(frames)}."


def _share(weighted: WeightedScene) -> str:
    return f"probability {with_error(weighted.probability, weighted.error)}"
