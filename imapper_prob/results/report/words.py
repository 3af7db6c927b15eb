"""The answer in one sentence, and what to beware of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.scene import Clip, SceneObject
from imapper_prob.people import by_person, everybody, own_part
from imapper_prob.results.checks import elsewhere_frames, named
from imapper_prob.results.scenes import WeightedScene
from imapper_prob.sampling.sample import Samples

__all__ = ["answer", "listed", "runner_up", "sides_of", "warnings_of"]

_NUMBERS: Final = (
    "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
)  # fmt: skip
_WEAK: Final = 0.5
"""A scene less probable than this is not what one would bet on."""
_VAGUE: Final = 0.1
"""Monte-Carlo error from which a probability is only an order of magnitude."""
_SHORT: Final = 5.0
"""Seconds; shorter than it takes to come in and sit down."""
_SWAPPED: Final = 0.5
"""Probability from which sides count as exchanged."""
_LOST: Final = 0.2
"""Part of the frames without any detection of the person."""


def answer(scenes: Sequence[WeightedScene]) -> str:
    """What is in the room, in a sentence."""
    there = listed(scenes[0].scene.objects)
    verb = "is" if there.startswith(("one ", "no ")) else "are"
    return f"Most probably ({_share(scenes[0])}) there {verb} {there}."


def runner_up(scenes: Sequence[WeightedScene]) -> str:
    """What there is if that is wrong; empty if there is no other scene."""
    if len(scenes) < 2:
        return ""
    second = scenes[1]
    there = listed(second.scene.objects)
    return f"If not, then next ({_share(second)}) {there}; unlike the first: {second.difference}."


def listed(objects: Sequence[SceneObject]) -> str:
    """Objects counted in words: ``"two chairs and one table"``."""
    labels = [o.label for o in objects]
    counts = {
        label: labels.count(label) for label in sorted(labels, key=lambda n: (-labels.count(n), n))
    }
    parts = [
        f"{_NUMBERS[n] if n < len(_NUMBERS) else n} {_plural(label) if n > 1 else label}"
        for label, n in counts.items()
    ]
    if not parts:
        return "no furniture that the motion tells of"
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def warnings_of(
    clip: Clip,
    samples: Samples,
    scenes: Sequence[WeightedScene],
    *,
    disputed: Sequence[int] = (),
) -> tuple[str, ...]:
    """What makes the result less sure than it looks, one sentence each.

    ``disputed`` are the scenes that show the layouts which chains disagree about.
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
        said.append("The chains have not converged: probabilities and spreads are preliminary.")
    if best.probability < _WEAK:
        said.append(
            f"Weak evidence: even the most probable scene has a probability of only "
            f"{best.probability:.2f}. Look at the others too, and at what they have in common."
        )
    if best.error > _VAGUE:
        said.append(
            f"Its probability is known to ± {best.error:.2f} only, from the draws that there are."
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
    away = np.concatenate(elsewhere_frames(clip))
    lost = 1 - float(np.mean((everybody(clip).confidences > 0).any(1) & ~away))
    if lost > _LOST:
        whom = "the person" if len(clip.tracks) == 1 else "people"
        said.append(f"The detector lost {whom} in {100 * lost:.0f} % of the frames.")
    return tuple(said)


def sides_of(clip: Clip, swapped: NDArray[np.float64]) -> tuple[str, ...]:
    """In which frames the detector took left for right, more probably than not, by person.

    Parameters
    ----------
    clip : Clip
        Of K people.
    swapped : (K T,) float
        Probability of that by frame, of several people in a row.
    """
    return tuple(
        _sides(own, clip.frame_ids, of=own_part(clip, person))
        for person, own in enumerate(by_person(clip, swapped))
    )


def _sides(swapped: NDArray[np.float64], frame_ids: NDArray[np.int64], *, of: str) -> str:
    whose = f" of{of}" if of else ""
    frames = frame_ids[swapped > _SWAPPED]
    if not len(frames):
        return f"The detector took left for right{whose} in no frame."
    word = "frame" if len(frames) == 1 else "frames"
    return f"The detector probably took left for right{whose} in {word} {named(frames)}."


def _share(weighted: WeightedScene) -> str:
    return f"probability {weighted.probability:.2f} ± {weighted.error:.2f}"


def _plural(label: str) -> str:
    if label.endswith("f"):
        return f"{label[:-1]}ves"
    return f"{label}es" if label.endswith(("ch", "sh", "s", "x")) else f"{label}s"
