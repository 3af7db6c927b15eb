"""The command line: ``imapper-prob COMMAND``, a module for each family of commands."""

from __future__ import annotations

from imapper_prob.cli.main import main

__all__ = ["main"]
