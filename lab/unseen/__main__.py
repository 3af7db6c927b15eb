"""Is something to sit on found when people sit as the library does not know, and else nothing?

    python -m lab.unseen [FOLDER] [--clips 6] [--only FAMILY] [--seed 0]

simulates short clips of every family of motions, solves and samples each briefly with a third of
the built-in library, and prints Markdown tables. The result of each clip is stored in FOLDER; the
same command continues from there, and starts again if the program has changed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from imapper_prob.files import written_whole
from lab.stored import digest
from lab.unseen import clips, families, scores
from lab.unseen.clips import CARRIED, UNCARRIED
from lab.unseen.scores import Answer, Outcome, outcome_of

__all__ = ["Task", "page", "tasks_of"]

MAKERS: Final = tuple(Path(str(module.__file__)) for module in (clips, families, scores))
"""Modules of simulation and scores, whose digest is part of the results' names."""
SHOWN: Final = 0.5
"""Least difference of a term in nats that is shown."""


@dataclass(frozen=True)
class Task:
    """One clip to make, and the library for its inference.

    Parameters
    ----------
    family : str
    index : int
        Index of the clip in its family.
    unseen : bool
        Whether the library lacks the family.
    """

    family: str
    index: int
    unseen: bool

    def path(self, folder: Path) -> Path:
        """File of its outcome."""
        library = "without" if self.unseen else "with"
        return folder / f"{self.family}-{library}-{self.index:03d}.json"


def tasks_of(clips: int, only: str | None = None) -> tuple[Task, ...]:
    """Tasks of all clips, one of each family before the second of any."""
    return tuple(
        Task(family, index, unseen)
        for index in range(clips)
        for family in CARRIED + UNCARRIED
        for unseen in ((True,) if family in CARRIED else (True, False))
        if only in (None, family)
    )


def outcomes(tasks: Iterable[Task], folder: Path, seed: int) -> Iterator[Outcome]:
    """Outcomes, read from ``folder`` or computed and stored there."""
    for task in tasks:
        path = task.path(folder)
        if not path.exists():
            outcome = outcome_of(task.family, task.index, unseen=task.unseen, seed=seed)
            with written_whole(path) as beside:
                beside.write_text(json.dumps(outcome.as_json(), indent=1), encoding="utf-8")
        yield Outcome.from_json(json.loads(path.read_text(encoding="utf-8")))


def page(found: Sequence[Outcome]) -> str:
    """Markdown tables of what was found and what was missed."""
    parts = []
    carried = [o for o in found if o.family in CARRIED]
    if carried:
        parts.append(
            "| on a seat or bed, unseen | clips | staged | draws | mean probability | under the "
            "person, wherever that is |\n|---|---:|---:|---:|---:|---:|\n"
            + "".join(_carried_row(f, own) for f, own in _grouped(carried))
        )
    uncarried = [o for o in found if o.family in UNCARRIED]
    if uncarried:
        parts.append(
            "| low down, nothing near | library | clips | staged: furniture | draws: furniture "
            "| mean probability |\n|---|---|---:|---:|---:|---:|\n"
            + "".join(
                _uncarried_row(f, library, own)
                for library, unseen in (("with it", False), ("without it", True))
                for f, own in _grouped([o for o in uncarried if o.unseen == unseen])
            )
        )
    wrong = [o for o in found if not (o.right(o.staged) and o.right(o.sampled))]
    if wrong:
        parts.append(
            "| wrong | performed | staged, draws | stays seen | answer | best scene that is right "
            "| nats from the answer to that | mostly |\n|---|---|---|---|---|---|---:|---|\n"
            + "".join(_wrong_row(o) for o in wrong)
        )
    return "\n".join(parts)


def _grouped(found: Sequence[Outcome]) -> Iterator[tuple[str, list[Outcome]]]:
    """Outcomes by family, then all of them."""
    families = dict.fromkeys(o.family for o in found)
    for family in families:
        yield family, [o for o in found if o.family == family]
    if len(families) > 1:
        yield "all", list(found)


def _carried_row(family: str, own: Sequence[Outcome]) -> str:
    staged = sum(o.right(o.staged) for o in own)
    sampled = sum(o.right(o.sampled) for o in own)
    mean = sum(o.sampled.supported for o in own) / len(own)
    under = sum(o.sampled.carried > 0.5 for o in own)
    return f"| {family} | {len(own)} | {staged} | {sampled} | {mean:.2f} | {under} |\n"


def _uncarried_row(family: str, library: str, own: Sequence[Outcome]) -> str:
    staged = sum(not o.right(o.staged) for o in own)
    sampled = sum(not o.right(o.sampled) for o in own)
    mean = sum(o.sampled.furnished for o in own) / len(own)
    return f"| {family} | {library} | {len(own)} | {staged} | {sampled} | {mean:.2f} |\n"


def _wrong_row(outcome: Outcome) -> str:
    carried = outcome.family in CARRIED
    shares = [s.supported if carried else s.furnished for s in (outcome.staged, outcome.sampled)]
    library = "without" if outcome.unseen else "with"
    stays = ", ".join(f"{a}–{b}: {nats:.1f}" for a, b, nats in outcome.signs) or "none"
    cells = [
        f"{outcome.family} {outcome.index}, {library} it",
        f"{outcome.performed}, {outcome.stay[0]}–{outcome.stay[1]}",
        ", ".join(f"{share:.2f}" for share in shares),
        stays,
        _story(outcome.best),
        "none" if outcome.rival is None else _story(outcome.rival),
        "" if outcome.rival is None else f"{outcome.rival.total - outcome.best.total:+.1f}",
        "" if outcome.rival is None else apart(outcome.best, outcome.rival),
    ]
    return "| " + " | ".join(cells) + " |\n"


def _story(answer: Answer) -> str:
    return ", ".join(f"{name} {start}" for name, start in answer.scenelets) or "nothing"


def apart(first: Answer, second: Answer) -> str:
    """The terms in which the second answer differs most, with the difference in nats."""
    more = {name: second.terms[name] - first.terms[name] for name in first.terms}
    largest = sorted(more, key=lambda name: -abs(more[name]))[:4]
    return ", ".join(f"{name} {more[name]:+.1f}" for name in largest if abs(more[name]) >= SHOWN)


def main(arguments: Sequence[str] | None = None) -> None:
    """Simulate, solve, sample, score, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/unseen_motions"))
    parser.add_argument("--clips", type=int, default=6, help="of each family")
    parser.add_argument("--only", choices=CARRIED + UNCARRIED, help="one family")
    parser.add_argument("--seed", type=int, default=0, help="of clips, library and chains")
    said = parser.parse_args(arguments)
    folder = said.folder / f"{digest(*MAKERS)}-{said.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    tasks = tasks_of(said.clips, said.only)
    found = []
    for outcome in outcomes(tasks, folder, said.seed):
        found.append(outcome)
        sys.stderr.write(
            f"{len(found)} of {len(tasks)}: {outcome.family} {outcome.index}, "
            f"{'without' if outcome.unseen else 'with'} it: {outcome.staged} {outcome.sampled}\n"
        )
    sys.stdout.write(page(found))


if __name__ == "__main__":
    main()
