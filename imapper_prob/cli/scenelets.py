"""``scenelets build | info | plot | record``: make and show libraries."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imapper_prob.cli.parser import examples
from imapper_prob.files import disk_errors_named, require_output, written_whole
from imapper_prob.models.errors import InputError
from imapper_prob.scenelets.build import SOURCES, captures_from

if TYPE_CHECKING:
    from imapper_prob.models.scenelet import Library

__all__ = ["add_scenelet_commands"]

_FIGURES = ("embedding.png", "furniture.png", "charness.png")


def add_scenelet_commands(
    commands: argparse._SubParsersAction[Any], shared: argparse.ArgumentParser
) -> None:
    """Add the group to a parser.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        The program's subparsers.
    shared : argparse.ArgumentParser
        Options that all commands have.
    """
    group = commands.add_parser(
        "scenelets",
        help="build a library of scenelets, or look at one",
        epilog=examples("scenelets info", "scenelets build --help"),
    )
    actions = group.add_subparsers(dest="scenelets", required=True, metavar="COMMAND")
    library = argparse.ArgumentParser(add_help=False)
    library.add_argument(
        "--library",
        default="built-in",
        metavar="NAMES",
        help="'built-in', a library file (.npz), or several joined by commas",
    )
    overwrite = argparse.ArgumentParser(add_help=False)
    overwrite.add_argument("--overwrite", action="store_true", help="replace what is there")

    build = actions.add_parser(
        "build",
        parents=[shared, overwrite],
        help="cut recordings of people and furniture",
        epilog=examples("scenelets build --from i3db i3db/ --leave-out Scene04 -o i3db.npz"),
    )
    build.add_argument("path", type=Path, help="folder or file of the recordings")
    build.add_argument(
        "--from", dest="source", choices=SOURCES, required=True, help="what the recordings are"
    )
    build.add_argument(
        "--leave-out", metavar="SCENE", help="a scene that must not get in (default: take all)"
    )
    build.add_argument(
        "-o", "--output", type=Path, required=True, metavar="LIBRARY.npz", help="file to write"
    )
    build.set_defaults(execute=_build)

    info = actions.add_parser(
        "info",
        parents=[shared, library],
        help="what is in a library",
        epilog=examples("scenelets info", "scenelets info --library built-in,i3db.npz"),
    )
    info.set_defaults(execute=_info)

    plot = actions.add_parser(
        "plot",
        parents=[shared, library, overwrite],
        help="figures: " + ", ".join(_FIGURES),
        epilog=examples("scenelets plot -o out/figures"),
    )
    plot.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to; made"
    )
    plot.set_defaults(execute=_plot)

    record = actions.add_parser(
        "record",
        parents=[shared, library, overwrite],
        help="a sheet of scenelets for rerun",
        epilog=examples("scenelets record -o out/sheet.rrd"),
    )
    record.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE.rrd", help="file to write"
    )
    record.set_defaults(execute=_record)


def _build(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console, print_lines
    from imapper_prob.scenelets.build import build_library_from
    from imapper_prob.scenelets.library import save_library

    _check([options.output], suffix=".npz", overwrite=options.overwrite)
    captures = captures_from(options.source, options.path, leave_out=options.leave_out)
    library, report = build_library_from(captures, name=options.output.stem)
    with _written(options.output):
        save_library(library, options.output)
    console().print(str(report))
    _describe(library)
    names = shlex.quote(f"built-in,{options.output}")
    print_lines(f"Written to {options.output}; use it with: --library {names}")


def _info(options: argparse.Namespace) -> None:
    from imapper_prob.scenelets.library import load_library

    _describe(load_library(options.library))


def _plot(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import console
    from imapper_prob.plotting import save_figure
    from imapper_prob.scenelets.charness import charness, motion_distances
    from imapper_prob.scenelets.figures import charness_figure, embedding_figure, furniture_figure
    from imapper_prob.scenelets.library import load_library

    paths = [options.output / name for name in _FIGURES]
    _check(paths, suffix=".png", overwrite=options.overwrite)
    library = load_library(options.library)
    distances = motion_distances(library)
    values = charness(library, distances)
    figures = (
        embedding_figure(library, distances, values),
        furniture_figure(library, distances),
        charness_figure(library, values),
    )
    for path, figure in zip(paths, figures, strict=True):
        with _written(path), written_whole(path) as beside:
            save_figure(figure, beside)
        console().print(f"Written: {path}")


def _record(options: argparse.Namespace) -> None:
    from imapper_prob.cli.console import print_lines
    from imapper_prob.recording.sheet import write_sheet
    from imapper_prob.scenelets.charness import charness, motion_distances
    from imapper_prob.scenelets.library import load_library

    _check([options.output], suffix=".rrd", overwrite=options.overwrite)
    library = load_library(options.library)
    values = charness(library, motion_distances(library))
    with _written(options.output):
        write_sheet(options.output, library, values)
    command = shlex.join(["rerun", str(options.output)])
    print_lines(f"Written to {options.output}; look at it with: {command}")


def _describe(library: Library) -> None:
    import imapper_prob
    from imapper_prob.cli.console import console
    from imapper_prob.scenelets.charness import charness, motion_distances
    from imapper_prob.scenelets.figures import action_table, furniture_table

    out = console()
    out.print(
        f"{library.name}: {len(library)} scenelets, digest {library.digest[:12]}, "
        f"imapper-prob {imapper_prob.__version__}"
    )
    out.print(action_table(library, charness(library, motion_distances(library))))
    out.print(furniture_table(library))


def _check(paths: Iterable[Path], *, suffix: str, overwrite: bool) -> None:
    """Refuse invalid or existing output paths before anything is computed."""
    for path in paths:
        require_output(path, suffix)
        if path.exists() and not overwrite:
            raise InputError(f"{path}: is there already; name another or add --overwrite")


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """Make the folder for a file, and name the file in errors of the disk."""
    with disk_errors_named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
