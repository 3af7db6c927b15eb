"""Scenelets: where libraries of them come from."""

from __future__ import annotations

from imapper_prob.scenelets.library import load_library, save_library

__all__ = ["load_library", "save_library"]
