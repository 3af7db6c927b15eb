"""The command line: ``imapper-prob COMMAND``, with one module for each group of commands."""

from __future__ import annotations

from imapper_prob.cli.main import main

__all__ = ["main"]
