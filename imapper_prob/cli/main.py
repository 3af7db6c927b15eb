"""The parser of all commands, and the handling of errors."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout, suppress

import imapper_prob
from imapper_prob.cli.ask import add_ask_command
from imapper_prob.cli.clips import add_detect_command, add_track_command
from imapper_prob.cli.completion import add_completion_command
from imapper_prob.cli.console import interrupt_message, stoppable, told
from imapper_prob.cli.evaluate_options import add_evaluate_command
from imapper_prob.cli.export import add_export_commands, add_recording_commands
from imapper_prob.cli.parser import Parser, examples
from imapper_prob.cli.run import add_run_commands
from imapper_prob.cli.scenelets import add_scenelet_commands
from imapper_prob.cli.solve import add_solve_command
from imapper_prob.models.errors import InputError
from imapper_prob.models.text import readable

__all__ = ["command_parser", "main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments after the program's name; those of the process if not given.

    Returns
    -------
    int
        0; 2 if the input or the arguments are invalid or a file operation fails; 130 after Ctrl-C,
        143 after SIGTERM.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = argparse.Namespace(words=given)
    with told():
        try:
            with stoppable():
                command_parser().parse_args(given, options)
                asked = getattr(options, "json", False) or options.command == "completion"
                with _silent(quiet=options.quiet, document=asked):
                    options.execute(options)
                sys.stdout.flush()
        except InputError as error:
            if options.debug:
                raise
            sys.stderr.write(f"imapper-prob: {readable(str(error))}\n")
            return 2
        except BrokenPipeError:  # the reader of the output, such as head, has enough
            _drop_output()
            return 0
        except OSError as error:
            if options.debug:
                raise
            _drop_output()
            named = "a file or the output" if error.filename is None else error.filename
            said = f"{named}: cannot be read or written ({error.strerror or error})"
            sys.stderr.write(f"imapper-prob: {readable(said)}\n")
            return 2
        except KeyboardInterrupt as error:
            words, code = interrupt_message(error, options)
            sys.stderr.write(f"imapper-prob: {words}\n")
            return code
    return 0


def _drop_output() -> None:
    """Drop what standard output refuses, because Python writes it again at the end."""
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _silent(*, quiet: bool, document: bool) -> Iterator[None]:
    """Suppress all output of a command except warnings, which :func:`told` prints, and a document
    that is asked for."""
    if not quiet:
        yield
        return
    shown = nullcontext() if document else redirect_stdout(io.StringIO())
    with redirect_stderr(io.StringIO()), shown:
        yield


def command_parser() -> Parser:
    """The parser of all commands.

    Returns
    -------
    Parser
    """
    parser = Parser(
        prog="imapper-prob",
        description="Furniture and motion of a half-hidden person, from 2D joints, as a posterior.",
        epilog=examples("demo -o out/demo", "run clip.mp4 -o out/clip", "run --help"),
    )
    version = f"imapper-prob {imapper_prob.__version__}"
    parser.add_argument(
        "--version", action="version", version=version, help="print the version and end"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument("--debug", action="store_true", help="show tracebacks")
    shared.add_argument(
        "--quiet", action="store_true", help="print nothing but warnings and errors"
    )
    add_run_commands(commands, shared)
    add_ask_command(commands, shared)
    add_detect_command(commands, shared)
    add_track_command(commands, shared)
    add_solve_command(commands, shared)
    add_recording_commands(commands, shared)
    add_export_commands(commands, shared)
    add_scenelet_commands(commands, shared)
    add_evaluate_command(commands, shared)
    add_completion_command(commands, shared, parser)
    return parser
