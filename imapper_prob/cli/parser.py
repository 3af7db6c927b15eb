"""A parser that shows defaults, suggests similar words and accepts no abbreviations."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, NoReturn

from imapper_prob.models.text import readable

__all__ = ["Parser", "commands_of", "examples"]

_CLOSE: Final = 0.6
"""Least similarity, by difflib's ratio, of a word that is suggested."""


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` with short error messages and suggestions.

    Without arguments, a parser of commands prints its help. Errors are one line; for an unknown
    option, command or choice the message suggests a similar one.

    Parameters
    ----------
    **options
        Options of `argparse.ArgumentParser`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"allow_abbrev": False, "formatter_class": _Help, **options})

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse all words; a word that is left over is an error.

        Parameters
        ----------
        args : sequence of str, optional
            Those of the process if not given.
        namespace : argparse.Namespace, optional
            Object that receives the parsed values.

        Returns
        -------
        tuple of argparse.Namespace and list of str
            The list is empty.
        """
        words = list(sys.argv[1:] if args is None else args)
        has_commands = any(isinstance(a, argparse._SubParsersAction) for a in self._actions)
        if has_commands and not words:
            self.print_help()
            self.exit()
        self._require_known(words, before_command=has_commands)
        found, rest = super().parse_known_args(words, namespace)
        if rest:
            self.error(f"nothing is expected at {' '.join(rest)}")
        return found, rest

    def _require_known(self, words: Iterable[str], *, before_command: bool) -> None:
        """Report an unknown option before any missing argument."""
        known = [name for action in self._actions for name in action.option_strings]
        for word in words:
            if word == "--" or (before_command and not word.startswith("-")):
                return
            name = word.partition("=")[0]
            if name.startswith("--") and name not in known:
                self.error(f"there is no option {name}{_meant(name, known)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        choices = None if action.choices is None else [str(choice) for choice in action.choices]
        if choices is not None and value not in choices:
            said = f"{value!r} is none of {', '.join(choices)}{_meant(str(value), choices)}"
            raise argparse.ArgumentError(action, said)

    def error(self, message: str) -> NoReturn:
        """Print the message on one line, and exit with status 2.

        Parameters
        ----------
        message : str
        """
        self.exit(2, f"{self.prog}: {readable(message)}; see {self.prog} --help\n")


def _meant(word: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=_CLOSE)
    return f"; did you mean {near[0]}?" if near else ""


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help that shows the default of every option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str:
        text = action.help or ""
        shown = action.option_strings and action.default not in (None, False, argparse.SUPPRESS)
        return (
            f"{text} (default: %(default)s)".lstrip() if shown and "(default" not in text else text
        )


def examples(*lines: str) -> str:
    """Example commands for the end of a help text.

    Parameters
    ----------
    *lines : str
        Commands without the program's name.

    Returns
    -------
    str
        Commands without the program's name.
    """
    return "\n".join(["examples:", *(f"  imapper-prob {line}" for line in lines)])


def commands_of(
    parser: argparse.ArgumentParser, name: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    """Every parser below a parser, groups before their members, with the words that name it.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    name : tuple of str
        Words that name ``parser`` itself.

    Yields
    ------
    words : tuple of str
    parser : argparse.ArgumentParser
    """
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, below in action.choices.items():
                yield (*name, word), below
                yield from commands_of(below, (*name, word))
