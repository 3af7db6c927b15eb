"""3D poses for clips that have only 2D joints, from the poses of the built-in library."""

from __future__ import annotations

from imapper_prob.lifting.lift import lift_clip

__all__ = ["lift_clip"]
