"""Does the estimation find what it is told? The same steps on clips of the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from imapper_prob.calibrate.constants import FROM_TRUTH, estimate
from imapper_prob.calibrate.evidence import detection_model, look
from imapper_prob.models.calibrated import Number
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.simulate import PITCH_SPREAD, simulate_clip
from imapper_prob.models.simulate_track import simulate_track

__all__ = ["recover"]

_TOLD: Final = (
    "detections.seen_confidence", "detections.hidden_confidence",
    "detections.seen_error_scale", "detections.seen_error_dof",
    "detections.hidden_error_scale", "detections.hidden_error_dof",
    "path.pixel_scale", "path.pixel_dof", "swaps.rate", "swaps.length",
)  # fmt: skip
"""Constants that the simulator draws detections with."""


def recover(
    rng: np.random.Generator, library: Library, values: Mapping[str, Number], *, n_clips: int
) -> dict[str, tuple[Number, Number]]:
    """Simulate clips by known constants and estimate these from them.

    Parameters
    ----------
    rng : numpy.random.Generator
    library : Library
        What people do in the clips.
    values : mapping of str to float or tuple of float
        Constants that detections are drawn with.
    n_clips : int
        Clips of 15 seconds.

    Returns
    -------
    dict of str to (known, found)
        The simulator's frames err independently and its cameras are drawn anew for every
        clip, so that correlation time and pitch are known, too.
    """
    model = detection_model(values)
    swaps = {"swap_rate": values["swaps.rate"], "swap_length": values["swaps.length"]}
    settings = replace(ModelSettings(), **swaps)  # type: ignore[arg-type]
    evidence = []
    for _ in range(n_clips):
        clip = simulate_clip(rng, library)
        truth = clip.truth
        assert truth is not None
        track = simulate_track(
            rng, truth.joints, truth.hidden, camera=truth.camera, fps=clip.fps,
            detections=model, settings=settings,
        )  # fmt: skip
        evidence.append(look(replace(clip, tracks=(track,)), truth))
    found = estimate(FROM_TRUTH, evidence)
    told = {name: values[name] for name in _TOLD}
    told |= {"frames.correlation_time": 1 / evidence[0].clip.fps, "camera.pitch": PITCH_SPREAD}
    return {name: (known, found[name]) for name, known in told.items()}
