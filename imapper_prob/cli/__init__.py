"""The command line: ``imapper-prob demo | run | detect | track | info | scenelets``."""

from __future__ import annotations

from imapper_prob.cli.main import main

__all__ = ["main"]
