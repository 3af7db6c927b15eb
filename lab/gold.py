"""How probable sets of objects are by long computations, which shorter runs are held against.

    python -m lab.gold FOLDER [CLIP ...] [--runs 3] [--steps 200000] [--workers 2]

samples each clip in several long independent runs: every copy of every chain starts from a random
scene of its own, and each run learns its own reference distribution. ``demo`` is sampled if no clip
is named; ``simulated-N`` is the clip that seed N simulates. A killed command continues where it
was. The results for a clip are written to ``lab/gold.json``: the fraction of draws with each set of
merged objects, all kinds of seats alike, and its standard error from the scatter between runs.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

import imapper_prob as im
from imapper_prob.config import SampleSettings
from imapper_prob.files import written_whole
from imapper_prob.layouts import group_of
from imapper_prob.models.log_posterior import State, log_posterior
from imapper_prob.models.scene import SceneObject
from imapper_prob.sampling.actors import join_actors
from imapper_prob.sampling.chain import Setup, tempered
from imapper_prob.sampling.sample import sample_scenes, setup_of
from imapper_prob.sampling.visits import Visits
from lab.stored import named_clip

__all__ = ["GOLD", "distance", "known", "shares", "tabled"]

GOLD: Final = Path(__file__).with_name("gold.json")
_RAREST: Final = 0.005
"""Least fraction of a set of objects that is listed; rarer sets are combined."""
_OTHERS: Final = "all others"


def shares(objects: Sequence[Sequence[SceneObject]]) -> dict[str, float]:
    """Fraction of draws with each set of objects, all kinds of seats alike.

    Parameters
    ----------
    objects : sequence of sequence of SceneObject
        Objects of each draw.

    Returns
    -------
    dict of str to float
    """
    names = (sorted(group_of(o.label) for o in own) for own in objects)
    counts = Counter(", ".join(own) or "nothing" for own in names)
    return {name: n / len(objects) for name, n in counts.items()}


def tabled(runs: Sequence[dict[str, float]]) -> dict[str, list[float]]:
    """Mean of runs and its standard error, the most probable set first.

    Parameters
    ----------
    runs : sequence of dict of str to float
        :func:`shares` of each run.

    Returns
    -------
    dict of str to list of float
    """
    values = {name: np.array([run.get(name, 0.0) for run in runs]) for name in set().union(*runs)}
    often = {name: own for name, own in values.items() if own.mean() >= _RAREST}
    rest = 1.0 - sum(often.values(), np.zeros(len(runs)))
    rows = [*sorted(often.items(), key=lambda row: -row[1].mean()), (_OTHERS, rest)]
    error = {name: own.std(ddof=1) / math.sqrt(len(runs)) for name, own in rows}
    return {name: [round(float(own.mean()), 4), round(error[name], 4)] for name, own in rows}


def distance(found: dict[str, float], gold: dict[str, list[float]]) -> float:
    """Total variation distance between the sets of objects of a run and those of long runs.

    Parameters
    ----------
    found : dict of str to float
    gold : dict of str to list of float

    Returns
    -------
    float
        From 0 to 1; unlisted sets count as one set.
    """
    listed = {name: p for name, (p, _) in gold.items() if name != _OTHERS}
    rest = abs(gold[_OTHERS][0] - (1.0 - sum(found.get(name, 0.0) for name in listed)))
    return 0.5 * (rest + sum(abs(p - found.get(name, 0.0)) for name, p in listed.items()))


def known() -> dict[str, dict[str, list[float]]]:
    """Stored tables, by clip."""
    tables: dict[str, dict[str, list[float]]] = json.loads(GOLD.read_text(encoding="utf-8"))
    return tables


def scattered(setup: Setup, seed: np.random.SeedSequence) -> list[list[State]]:
    """Random starting scenes for every copy of every chain, from the solver's scenes."""
    visits, rng = Visits(), np.random.default_rng(seed)
    for state in setup.staged:
        visits.note(state)
    learnt = tempered(setup, visits)

    def possible() -> State:
        while True:
            state = learnt.independent(rng)
            if math.isfinite(log_posterior(setup.problem, state)):
                return state

    settings = setup.settings
    return [[possible() for _ in range(settings.temperatures)] for _ in range(settings.chains)]


def long_runs(
    name: str, folder: Path, count: int, settings: SampleSettings, workers: int
) -> list[dict[str, float]]:
    """Fractions of sets of objects in each of some runs of a clip."""
    everybody = join_actors(im.solve(named_clip(name), im.load_library()).actors)
    setup, found = setup_of(everybody, settings), []
    for run in range(count):
        start_seed, seed = np.random.SeedSequence([20261125, run]).spawn(2)
        samples = sample_scenes(
            everybody, settings, seed=seed, workers=workers, starts=scattered(setup, start_seed),
            checkpoints=folder / f"{Path(name).stem}-{run}",
        )  # fmt: skip
        found.append(shares(samples.objects))
        sys.stderr.write(f"{name}, run {run}: {samples.verdict.text}\n")
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the missing runs, and write the tables of their clips to the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("clips", nargs="*", default=["demo"])
    parser.add_argument("--runs", type=int, default=3, help="two at least")
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    if options.runs < 2:
        parser.error("one run has no scatter: --runs 2 or more")
    settings = SampleSettings(steps=options.steps, ensemble_steps=0)
    options.folder.mkdir(parents=True, exist_ok=True)
    for clip in options.clips:
        table = tabled(long_runs(clip, options.folder, options.runs, settings, options.workers))
        tables = (known() if GOLD.exists() else {}) | {Path(clip).stem: table}
        with written_whole(GOLD) as path:
            path.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")
        sys.stdout.write(f"{clip}\n")
        for name, (share, error) in table.items():
            sys.stdout.write(f"  {name:40} {share:.3f} ± {error:.3f}\n")


if __name__ == "__main__":
    main()
