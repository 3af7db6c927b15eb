"""How often does a run say that it cannot be believed, of right clips and of clips that are wrong?

    python -m lab.alarms [COUNT] [--only TEXT]
    python -m lab.alarms [COUNT] --threshold

simulates COUNT clips a row (12 if not given) from motions of a sixth of the built-in library, with
joints that deviate from them by the model's tolerance (``pose.tolerance``), solves and samples each
briefly with that sixth, and prints a Markdown table: in how many clips any check raises an alarm,
and which one. It takes some five seconds a clip. ``--threshold`` prints instead how well the best
scenelets fit frames of correct clips, and how long a clip is that tells as much as one frame.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from imapper_prob.api import sample
from imapper_prob.config import Config, SampleSettings
from imapper_prob.evaluate.tables import markdown_table
from imapper_prob.lifting import lift_clip
from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Track
from imapper_prob.models.scenelet import Library
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import DETECTED, PELV
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip, simulate_track
from imapper_prob.solver.fits import best_fits
from imapper_prob.solver.solver import fit_clip

__all__ = ["shortened", "simulated"]

CONFIG: Final = Config(
    sample=SampleSettings(chains=2, steps=600, draws=60, temperatures=3, ensemble_steps=0)
)
CHECKS: Final = (
    "upright", "height", "slope", "camera", "prediction", "resemblance", "elsewhere",
)  # fmt: skip
_EVERY: Final = 6
_FRAMES: Final = 130
_SEATED: Final = ("sit", "sit-down", "stand-up", "lie")
_FIRST_SEED: Final = 7000

Change = Callable[[np.random.Generator, Clip], Clip]


def shortened(library: Library, *, without: tuple[str, ...] = ()) -> Library:
    """Every sixth scenelet, except those of some actions."""
    kept = [s for i, s in enumerate(library) if i % _EVERY == 0 and s.action not in without]
    return Library(f"a sixth of {library.name}", tuple(kept))


def simulated(rng: np.random.Generator, library: Library, *, only: tuple[str, ...] = ()) -> Clip:
    """A clip of motions of a library, with joints that deviate by the model's tolerance.

    With ``only``, interactions are of these actions.
    """
    acted = library
    if only:
        acted = Library(library.name, tuple(s for s in library if s.action in only))
    clip = simulate_clip(rng, acted, n_frames=_FRAMES, n_bystanders=1, walks=library)
    truth = clip.truth
    assert truth is not None
    memory = np.exp(-1.0 / (calibrated("scores.repeat_time") * clip.fps))
    off = rng.standard_normal(truth.joints.shape)
    for t in range(1, len(off)):
        off[t] = memory * off[t - 1] + np.sqrt(1.0 - memory**2) * off[t]
    off[:, PELV] = 0.0
    joints = truth.joints + np.array(ModelSettings().pose_tolerance)[:, None] * off
    track = simulate_track(rng, joints, np.asarray(truth.hidden), camera=truth.camera, fps=clip.fps)
    return replace(clip, tracks=(track,), truth=replace(truth, joints=joints))


def _pitched(degrees: float) -> Change:
    def change(rng: np.random.Generator, clip: Clip) -> Clip:
        by = np.radians(degrees) * rng.choice([-1.0, 1.0])
        return replace(clip, camera=replace(clip.camera, pitch=clip.camera.pitch + by))

    return change


def _raised(factor: float) -> Change:
    def change(rng: np.random.Generator, clip: Clip) -> Clip:
        return replace(clip, camera=replace(clip.camera, elevation=clip.camera.elevation * factor))

    return change


def _lifted_again(clip: Clip, track: Track) -> Clip:
    """The clip with poses lifted from its 2D joints, as for files without poses."""
    bare = replace(track, poses=np.full_like(track.poses, np.nan))
    return lift_clip(replace(clip, tracks=(bare,)))


def _pitched_in_2d(rng: np.random.Generator, clip: Clip) -> Clip:
    clip = _pitched(45.0)(rng, clip)
    return _lifted_again(clip, clip.tracks[0])


def _in_2d(rng: np.random.Generator, clip: Clip) -> Clip:
    return _lifted_again(clip, clip.tracks[0])


def _upside_down(rng: np.random.Generator, clip: Clip) -> Clip:
    track = clip.tracks[0]
    points = np.array(track.keypoints)
    points[..., 1] = clip.camera.height - points[..., 1]
    return _lifted_again(clip, replace(track, keypoints=points))


def _random_joints(rng: np.random.Generator, clip: Clip) -> Clip:
    """Every joint does a random walk through the image, independently."""
    track, size = clip.tracks[0], np.array([clip.camera.width, clip.camera.height])
    stray = np.cumsum(rng.standard_normal(track.keypoints.shape), axis=0) * 10.0
    points = np.clip(rng.uniform(0.1, 0.9, (1, 16, 2)) * size + stray, 0, size - 1)
    confidences = np.zeros(track.confidences.shape)
    confidences[:, list(DETECTED)] = rng.uniform(0.5, 1.0, (len(points), len(DETECTED)))
    return _lifted_again(clip, replace(track, keypoints=points, confidences=confidences))


def _away(rng: np.random.Generator, clip: Clip) -> Clip:
    """All joints are moved sideways by 600 pixels for 1.5 s."""
    track, begin = clip.tracks[0], int(rng.integers(20, clip.n_frames - 40))
    points = np.array(track.keypoints)
    points[begin : begin + 15, :, 0] += rng.choice([-600.0, 600.0])
    return replace(clip, tracks=(replace(track, keypoints=points),))


def _as_it_is(rng: np.random.Generator, clip: Clip) -> Clip:
    return clip


_CASES: Final[dict[str, tuple[Change, bool]]] = {
    "right": (_as_it_is, True),
    "right, poses from 2D": (_in_2d, True),
    "pitch wrong by 15°": (_pitched(15.0), True),
    "pitch wrong by 30°": (_pitched(30.0), True),
    "pitch wrong by 45°": (_pitched(45.0), True),
    "pitch wrong by 45°, poses from 2D": (_pitched_in_2d, True),
    "camera three times as high": (_raised(3.0), True),
    "camera a third as high": (_raised(1 / 3), True),
    "joints upside down": (_upside_down, True),
    "random joints": (_random_joints, True),
    "somebody sits, the library has no seats": (_as_it_is, False),
    "detector elsewhere for 1.5 s": (_away, True),
}
"""The change of each case, and whether the library has the motions."""


def row(name: str, library: Library, bare: Library, count: int) -> tuple[str, ...]:
    """Row for a case: clips with alarms, refused, with furniture, and alarms by check."""
    change, known = _CASES[name]
    found: Counter[str] = Counter()
    for number in range(count):
        rng = np.random.default_rng(_FIRST_SEED + number)
        clip = change(rng, simulated(rng, library, only=() if known else ("sit",)))
        try:
            run = sample(clip, library if known else bare, config=CONFIG)
        except InputError as error:
            sys.stderr.write(f"{name}, {number}: refused, {error}\n")
            found.update(("alarmed", "refused"))
            continue
        alarmed = [check.name for check in run.checks if check.alarmed]
        told = ", ".join(f"{c.name} {c.value:.3g} ({c.limit:.3g})" for c in run.checks)
        sys.stderr.write(f"{name}, {number}: {' '.join(alarmed) or 'nothing'}; {told}\n")
        found.update([*alarmed, *(["alarmed"] if alarmed else [])])
    return (
        name,
        f"{found['alarmed']} of {count}",
        *(str(found[key] or "") for key in ("refused", *CHECKS)),
    )


def threshold(library: Library, count: int) -> str:
    """Quantiles of the best fits to frames of correct clips, and how long frames resemble others.

    The part of a clip's frames above the 95 % quantile varies over clips as the part of that many
    independent frames would. Its seconds are those of a clip divided by that number.
    """
    best = []
    for number in range(count):
        clip = simulated(np.random.default_rng(number), library)
        fitted = fit_clip(clip, library)
        best.append(best_fits(fitted.problem, fitted.fits))
    shares = (0.5, 0.9, 0.95, 0.99)
    found = np.nanquantile(np.concatenate(best), shares)
    told = ", ".join(f"{100 * p:.0f} % {q:.2f}" for p, q in zip(shares, found, strict=True))
    parts = np.array([np.mean(b[np.isfinite(b)] > found[2]) for b in best])
    independent = parts.mean() * (1.0 - parts.mean()) / parts.var()
    seconds = np.mean([np.isfinite(b).sum() for b in best]) / clip.fps / independent
    return f"{told}; an independent frame in {seconds:.1f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, or the quantiles."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("count", type=int, nargs="?", default=12, help="clips a row")
    parser.add_argument("--threshold", action="store_true")
    parser.add_argument("--only", help="rows whose name holds this")
    options = parser.parse_args(arguments)
    whole = load_library()
    library = shortened(whole)
    if options.threshold:
        sys.stdout.write(threshold(library, options.count) + "\n")
        return 0
    bare = shortened(whole, without=_SEATED)
    rows: list[tuple[str, ...]] = [("", "alarmed", "refused", *CHECKS)]
    for name in _CASES:
        if options.only is None or options.only in name:
            rows.append(row(name, library, bare, options.count))
    sys.stdout.write(markdown_table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
