"""Do probabilities of scenes hold from seed to seed, and are they as sure as is said?

    python -m lab.seeds FOLDER [CLIP ...] [--seeds 5] [--steps N] [--workers 2] [--picture PNG]

samples each clip, ``demo`` if none is named, with several seeds and prints three Markdown tables;
the picture shows the probabilities of the largest layouts by seed and chain. Every run is stored in
FOLDER as a folder that ``imapper-prob view`` opens, so that a killed command continues where it
was; the readers of such folders refuse runs of another program.

The scenes of all seeds of a clip are grouped into layouts together. A seed's probability of a
layout is the fraction of its draws in it, with the standard error that the run states. The mean
square scatter of the probabilities between seeds should equal the mean squared standard error. The
distance of a seed from the others is the total variation distance between the fractions of its
draws and those of the other seeds' draws. If there are long runs (:mod:`lab.gold`), the distance of
label sets from theirs is given as well.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import imapper_prob as im
from imapper_prob.cli.run import DEMO
from imapper_prob.config import Config
from imapper_prob.layouts import group_layouts
from imapper_prob.plotting import save_figure
from imapper_prob.results.load import load_posterior
from imapper_prob.results.posterior import Posterior
from imapper_prob.samplers.diagnostics import ShortChainWarning, layout_probabilities, rhat
from lab.gold import GOLD, distance, known, shares
from lab.mixing import OPEN
from lab.stored import is_whole, named_clip, with_steps

Array = NDArray[np.float64]
LARGEST = 5
"""Number of layouts of a clip that are compared."""


@dataclass(frozen=True)
class Seeds:
    """Results of S seeds for the same K layouts of a clip, the most probable first.

    Parameters
    ----------
    probability, stated : (S, K) float
        Fraction of a seed's draws, and its standard error as stated by the run.
    worst_rhat, effective : (S,) float
        Over the layouts that are neither excluded nor certain, greatest R-hat and least effective
        draws.
    best : (S,) float
        Greatest log-posterior, nats.
    good : (S,) bool
        Whether the run's verdict is convergence.
    seconds : (S,) float
        Duration of sampling.
    sets : tuple of S dict of str to float
        Fraction of draws with each set of objects.
    chains : tuple of S (C, K) float
        Fractions of the draws of each chain.
    scenelets : tuple of S (C, N) int
        Number of scenelets of each draw.
    """

    probability: Array
    stated: Array
    worst_rhat: Array
    effective: Array
    best: Array
    good: NDArray[np.bool_]
    seconds: Array
    sets: tuple[dict[str, float], ...] = ()
    chains: tuple[Array, ...] = ()
    scenelets: tuple[NDArray[np.int64], ...] = ()

    @property
    def scatter(self) -> Array:
        """(K,) standard deviation of a probability between seeds."""
        result: Array = self.probability.std(0, ddof=1)
        return result

    @property
    def distance(self) -> Array:
        """(S,) total variation distance between a seed and all the others."""
        others = (self.probability.sum(0) - self.probability) / (len(self.probability) - 1)
        result: Array = 0.5 * np.abs(self.probability - others).sum(1)
        return result


def compared(posteriors: Sequence[Posterior]) -> Seeds:
    """Compare runs of one clip with several seeds."""
    samples = [p.samples for p in posteriors]
    objects = [own for one in samples for own in one.seen]
    values = np.concatenate([one.log_posterior.ravel() for one in samples])
    radius = posteriors[0].config.sample.layout_radius
    layouts = group_layouts(objects, values, radius=radius)
    count = 1 + int(layouts.indicator.max())
    probability, stated = np.zeros((2, len(samples), count))
    rhats, effective, chains, first = [], [], [], 0
    for s, one in enumerate(samples):
        shape = one.shape
        own = layouts.indicator[first : first + shape[0] * shape[1]].reshape(shape)
        first += own.size
        chains.append(np.stack([(own == k).mean(1) for k in range(count)], -1))
        found = layout_probabilities(1 + own, rng=np.random.default_rng(s))
        probability[s, found.layouts - 1] = found.probability
        stated[s, found.layouts - 1] = found.standard_error
        unsure = (found.probability >= OPEN[0]) & (found.probability <= OPEN[1])
        rhats.append(
            max(
                (float(rhat((own == k - 1).astype(float))) for k in found.layouts[unsure]),
                default=1,
            )
        )
        effective.append(float(min(found.effective_draws[unsure], default=np.inf)))
    return Seeds(
        probability,
        stated,
        np.array(rhats),
        np.array(effective),
        np.array([one.log_posterior.max() for one in samples]),
        np.array([one.verdict.good for one in samples]),
        np.array([p.seconds.get("sampling", np.nan) for p in posteriors]),
        tuple(shares(one.objects) for one in samples),
        tuple(chains),
        tuple(np.reshape([s.n_scenelets for s in one.states], one.shape) for one in samples),
    )


def runs(name: str, folder: Path, seeds: int, steps: int | None, workers: int) -> list[Posterior]:
    """The runs of a clip, with its default settings if ``steps`` is None; missing ones are made."""
    usual = Config(sample=DEMO) if name == "demo" else Config()
    config = usual if steps is None else with_steps(steps)
    stem = f"{Path(name).stem}-{config.sample.steps}"
    paths = [folder / f"{stem}-{seed}" for seed in range(seeds)]
    missing = [path for path in paths if not is_whole(path)]
    if missing:
        clip = named_clip(name)
        library = im.load_library()
        solved = im.solve(clip, library, config=config)
        for path in missing:
            seed = paths.index(path)
            im.sample(clip, library, start=solved, config=config, rng=seed, workers=workers).save(
                path, overwrite=True
            )
            sys.stderr.write(f"{path.name} is done\n")
    return [load_posterior(path) for path in paths]


def tables(found: dict[str, Seeds]) -> str:
    """Markdown tables of clips, and of their most probable layouts."""
    lines = [
        "| clip | seeds | converged | s | R-hat of layouts | effective draws of layouts "
        "| best log posterior | distance of a seed from the others "
        "| of sets of objects, from long runs |",
        "|---|" + "---:|" * 8,
    ]
    long = known() if GOLD.exists() else {}
    for clip, one in found.items():
        away = np.array([distance(own, long[clip]) for own in one.sets if clip in long])
        lines.append(
            f"| {clip} | {len(one.best)} | {int(one.good.sum())} | {one.seconds.mean():.0f} "
            f"| {_spread(one.worst_rhat, '.2f')} | {_spread(one.effective, '.0f')} "
            f"| {_spread(one.best, '.0f')} | {_spread(one.distance, '.2f')} "
            f"| {_spread(away, '.2f') if len(away) else 'not known'} |"
        )
    lines += [
        "",
        "| clip | layout | probability, mean of seeds | scatter between seeds | stated ± "
        "| scatter / stated |",
        "|---|---:|" + "---:|" * 4,
    ]
    for clip, one in found.items():
        stated = np.sqrt((one.stated**2).mean(0))
        for k in range(min(LARGEST, len(stated))):
            lines.append(
                f"| {clip} | {k + 1} | {one.probability[:, k].mean():.2f} | {one.scatter[k]:.3f} "
                f"| {stated[k]:.3f} | {one.scatter[k] / stated[k]:.1f} |"
            )
    lines += ["", "| clip | scenelets | share of draws, by seed | by chain |", "|---|---:|---|---|"]
    for clip, one in found.items():
        for number in sorted({int(n) for own in one.scenelets for n in np.unique(own)}):
            by_chain = np.array([(own == number).mean(1) for own in one.scenelets])
            by_seed = ", ".join(f"{share:.2f}" for share in by_chain.mean(1))
            lines.append(
                f"| {clip} | {number} | {by_seed} | {by_chain.min():.2f} to {by_chain.max():.2f} |"
            )
    return "\n".join(lines) + "\n"


def picture(found: dict[str, Seeds], path: Path) -> None:
    """Plot probabilities of the largest layouts by seed and chain, one panel for each clip."""
    figure, panels = plt.subplots(
        1, len(found), figsize=(4.6 * len(found), 3.4), squeeze=False, sharey=True
    )
    for axes, (clip, one) in zip(panels[0], found.items(), strict=True):
        seeds, layouts = len(one.best), min(LARGEST, one.probability.shape[1])
        for s in range(seeds):
            at = 1 + np.arange(layouts) + 0.6 * ((s + 0.5) / seeds - 0.5)
            for own in one.chains[s]:
                axes.plot(at, own[:layouts], ".", color="0.6", zorder=1)
            axes.errorbar(
                at, one.probability[s, :layouts], one.stated[s, :layouts],
                fmt="o", markersize=4, capsize=3, label=f"seed {s}", zorder=2,
            )  # fmt: skip
        axes.set(title=clip, xlabel="layout, largest first", xticks=1 + np.arange(layouts))
        axes.legend(title="± as stated; grey: chains", fontsize="small", title_fontsize="small")
    panels[0, 0].set(ylabel="probability", ylim=(-0.02, 1.02))
    figure.tight_layout()
    save_figure(figure, path)
    plt.close(figure)


def _spread(values: Array, form: str) -> str:
    return f"{np.median(values):{form}} ({values.min():{form}} to {values.max():{form}})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the missing runs, and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("clips", nargs="*", default=["demo"])
    parser.add_argument("--seeds", type=int, default=5, help="two at least")
    parser.add_argument("--steps", type=int, help="(default: as the program's)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path, metavar="PNG", help="(default: none)")
    options = parser.parse_args(arguments)
    if options.seeds < 2:
        parser.error("one seed has nothing to be compared with: --seeds 2 or more")
    options.folder.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        # A short chain has no R-hat, as the table shows.
        warnings.simplefilter("ignore", ShortChainWarning)
        found = {
            Path(clip).stem: compared(
                runs(clip, options.folder, options.seeds, options.steps, options.workers)
            )
            for clip in options.clips
        }
    if options.picture is not None:
        picture(found, options.picture)
    sys.stdout.write(tables(found))


if __name__ == "__main__":
    main()
