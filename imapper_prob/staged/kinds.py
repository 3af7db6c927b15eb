"""Kinds of scenelets: what furniture each is about.

By itself, because chains ask for it in processes of their own, which start in half the time
where nothing has to load torch.
"""

from __future__ import annotations

from imapper_prob.models.problem import Problem

__all__ = ["furniture_kinds"]


def furniture_kinds(problem: Problem) -> tuple[tuple[int, ...], ...]:
    """For each scenelet the sorted categories of its objects."""
    kinds = []
    for first, last in zip(problem.box_first[:-1], problem.box_first[1:], strict=True):
        label_of = dict(
            zip(
                problem.box_object[first:last].tolist(),
                problem.box_label[first:last].tolist(),
                strict=True,
            )
        )
        kinds.append(tuple(sorted(label_of.values())))
    return tuple(kinds)
