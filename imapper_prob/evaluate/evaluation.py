"""All scores of several methods on one or more clips, and what is written of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.evaluate.paired import Difference, paired_difference
from imapper_prob.evaluate.posterior_score import PosteriorScore
from imapper_prob.evaluate.prediction import Prediction
from imapper_prob.evaluate.score import Score, Summary, score, summarise
from imapper_prob.evaluate.spread import Coverage, coverage
from imapper_prob.evaluate.tables import as_json, without_nan
from imapper_prob.evaluate.truth import TruthInView
from imapper_prob.files import written_whole

__all__ = ["Evaluation", "evaluate", "posterior_coverage", "write_evaluation"]

_BOOTSTRAP_SEED: Final = 8
_FORMAT: Final = "imapper-prob evaluation"
_VERSION: Final = 1


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores by method, ours first.

    Parameters
    ----------
    scores : dict of str to list of Score
        Of each method one a clip.
    posteriors : list of PosteriorScore
        One for each run that was sampled.
    """

    scores: dict[str, list[Score]]
    posteriors: list[PosteriorScore]

    @property
    def summaries(self) -> list[Summary]:
        """Each method over all its clips."""
        return [summarise(found) for found in self.scores.values()]

    @property
    def one_by_one(self) -> list[Summary]:
        """Each method on each clip."""
        clips = dict.fromkeys(s.clip for found in self.scores.values() for s in found)
        return [
            summarise([s])
            for clip in clips
            for found in self.scores.values()
            for s in found
            if s.clip == clip
        ]

    def differences(self, ours: Iterable[str], theirs: Iterable[str]) -> list[Difference]:
        """Each of our methods less each of theirs that claims furniture, object by object."""
        rng = np.random.default_rng(_BOOTSTRAP_SEED)
        others = [
            name for name in theirs if any(s.objects.predicted for s in self.scores.get(name, []))
        ]
        return [
            paired_difference(self.scores[one], self.scores[other], rng)
            for one in ours
            for other in others
            if one != other
        ]


def evaluate(
    answers: Iterable[tuple[TruthInView, Sequence[Prediction]]],
    posteriors: Iterable[PosteriorScore] = (),
) -> Evaluation:
    """Score every prediction on every clip.

    Raises
    ------
    InputError
        If a prediction is of other frames than the truth.
    """
    scores: dict[str, list[Score]] = {}
    for truth, predictions in answers:
        for prediction in predictions:
            scores.setdefault(prediction.name, []).append(score(prediction, truth))
    return Evaluation(scores, list(posteriors))


def posterior_coverage(posteriors: Sequence[PosteriorScore]) -> dict[str, tuple[Coverage, ...]]:
    """Coverage of objects, pelvis, joints and hidden joints, pooled over clips."""
    return {
        name: coverage(np.concatenate([getattr(p, ranks) for p in posteriors]))
        for name, ranks in (
            ("object centres", "object_ranks"),
            ("pelvis", "pelvis_ranks"),
            ("joints", "joint_ranks"),
            ("hidden joints", "hidden_ranks"),
        )
    }


def write_evaluation(
    path: Path, evaluation: Evaluation, differences: Sequence[Difference], made_by: dict[str, str]
) -> None:
    """Write ``evaluation.json``; ``made_by`` says with what: commit, command, settings."""
    document: dict[str, Any] = {
        "format": _FORMAT,
        "version": _VERSION,
        **made_by,
        "methods": [as_json(found, summarise(found)) for found in evaluation.scores.values()],
        "scene_by_scene": [asdict(s) for s in evaluation.one_by_one],
        "differences_cm": [asdict(d) for d in differences],
        "posteriors": [_plain(p) for p in evaluation.posteriors],
    }
    if evaluation.posteriors:
        document["coverage"] = {
            name: [asdict(c) for c in found]
            for name, found in posterior_coverage(evaluation.posteriors).items()
        }
    text = json.dumps(without_nan(document), indent=1, allow_nan=False, ensure_ascii=False)
    with written_whole(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def _plain(posterior: PosteriorScore) -> dict[str, Any]:
    """Ranks of objects one by one, those of joints as a histogram of ten bins."""
    values = dict(vars(posterior))
    values["object_ranks"] = posterior.object_ranks.tolist()
    for name in ("pelvis_ranks", "joint_ranks", "hidden_ranks", "distance_ranks"):
        counts, _ = np.histogram(values[name], bins=10, range=(0, 1))
        values[name] = counts.tolist()
    return values
