"""The file of constants, and the table of them in the documentation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields

from imapper_prob.models.calibrated import Constant, Number

__all__ = ["as_markdown", "as_toml"]


def as_toml(found: Mapping[str, Constant], *, heading: Iterable[str]) -> str:
    """The text of the file that :mod:`imapper_prob.models.calibrated` reads, in order of name.

    Parameters
    ----------
    found : mapping of str to Constant
        By name, ``"group.name"``.
    heading : iterable of str
        Lines of comment to begin with.
    """
    blocks = ["\n".join(f"# {line}" for line in heading)]
    for name, constant in sorted(found.items()):
        lines = [f"[{name}]"]
        for field in fields(constant):
            value = getattr(constant, field.name)
            if value not in ("", ()):
                lines.append(f"{field.name} = {_toml(value)}")
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks) + "\n"


def _toml(value: str | Number | tuple[Number, ...]) -> str:
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(v) for v in value)}]"
    return repr(value)


def as_markdown(found: Mapping[str, Constant]) -> str:
    """Tables of all constants: numbers, rows of numbers, and those told to the simulator."""
    found = dict(sorted(found.items()))
    numbers = {name: c for name, c in found.items() if not isinstance(c.value, tuple)}
    rows = {name: c for name, c in found.items() if isinstance(c.value, tuple)}
    parts = [
        _table(
            ("constant", "in use", "measured", "without each scene", "unit", "what, and how"),
            (
                (
                    f"`{name}`", _short(c.value), f"{_short(c.measured)} ± {_short(c.error)}",
                    ", ".join(_short(fold) for fold in c.folds), c.unit, _what(c),
                )
                for name, c in numbers.items()
            ),
        ),
        _table(
            ("constant", "in use", "error", "unit", "what, and how"),
            (
                (f"`{name}`", _short(c.value), _short(c.error), c.unit, _what(c))
                for name, c in rows.items()
            ),
        ),
        _table(
            ("constant", "told the simulator", "found again"),
            (
                (f"`{name}`", *(_short(number) for number in c.recovered))
                for name, c in found.items()
                if c.recovered
            ),
        ),
    ]  # fmt: skip
    return "\n".join(parts)


def _what(constant: Constant) -> str:
    why = f" **Kept:** {constant.kept}." if constant.kept else ""
    return f"{constant.meaning}: {constant.source}.{why}"


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heading, ["---"] * len(heading), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _short(value: Number) -> str:
    """Numbers as people write them in a table: ``.0122``."""
    if isinstance(value, tuple):
        return " ".join(_short(v) for v in value)
    return f"{value:.3g}".removeprefix("0") if value else "0"
