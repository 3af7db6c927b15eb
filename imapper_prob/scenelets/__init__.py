"""Libraries of scenelets: built-in, cut from captures, or from files."""

from __future__ import annotations

from imapper_prob.scenelets.library import load_library, save_library

__all__ = ["load_library", "save_library"]
