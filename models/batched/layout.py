"""Which scenelet covers which frame, and which boxes stand in the room: all that is discrete."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from imapper_prob.models.batched.tensors import ProblemTensors

__all__ = ["Layout", "lay_out"]


@dataclass(frozen=True, eq=False)
class Layout:
    """Assignments of S states as tables of indices; K is the most boxes any state has.

    Parameters
    ----------
    admissible : (S,) bool
        No two scenelets overlap, none sticks out of the clip or into the film of the next
        person. States that are not are laid
        out without any scenelet, so that they stay finite.
    scenelet : (S, k) int
        Scenelet of each item, 0 where there is none.
    present : (S, k) bool
        Items that there are.
    item_of : (S, T) int
        Item that covers a frame, -1 if free.
    begins : (S, T) bool
        First frames of items.
    joint_row : (S, T) int
        Row of the library's joints that a covered frame shows.
    box_row, box_item : (S, K) int
        Row of the library's boxes, and the item it comes with.
    box_present : (S, K) bool
        Boxes that there are.
    """

    admissible: Tensor
    scenelet: Tensor
    present: Tensor
    item_of: Tensor
    begins: Tensor
    joint_row: Tensor
    box_row: Tensor
    box_item: Tensor
    box_present: Tensor

    @property
    def covered(self) -> Tensor:
        """(S, T) bool, frames under a scenelet."""
        return self.item_of >= 0


def lay_out(tensors: ProblemTensors, items: Tensor) -> Layout:
    """Tables of the assignments ``items`` (S, k, 2), scenelet and start; scenelet -1 is none."""
    start = items[..., 1]
    present = items[..., 0] >= 0
    scenelet = items[..., 0].clamp_min(0)
    first = tensors.joint_first[scenelet]
    end = start + tensors.joint_first[scenelet + 1] - first
    frames = torch.arange(tensors.problem.n_frames, device=items.device)
    covers = present[..., None] & (frames >= start[..., None]) & (frames < end[..., None])
    inside = (start >= 0) & (end <= len(frames))
    goes_on = (covers & tensors.path_starts & (frames > start[..., None])).any(2)
    admissible = ((inside & ~goes_on) | ~present).all(1) & (covers.sum(1) <= 1).all(1)
    present = present & admissible[:, None]
    covers = covers & admissible[:, None, None]

    # At most one item covers a frame, so that a sum over items picks its entry.
    number = torch.arange(1, items.shape[1] + 1, device=items.device)
    shift = (first - start)[..., None]
    last_box = tensors.box_first[scenelet + 1]
    count = (last_box - tensors.box_first[scenelet]) * present
    until = count.cumsum(1)
    slots = torch.arange(int(count.sum(1).max()), device=items.device)
    holds = (slots < until[..., None]) & (slots >= (until - count)[..., None])
    box_shift = (last_box - until)[..., None]
    return Layout(
        admissible=admissible,
        scenelet=scenelet,
        present=present,
        item_of=(covers * number[:, None]).sum(1) - 1,
        begins=(covers & (frames == start[..., None])).any(1),
        joint_row=(covers * (frames + shift)).sum(1),
        box_row=(holds * (slots + box_shift)).sum(1),
        box_item=(holds * number[:, None]).sum(1) - 1,
        box_present=holds.any(1),
    )
