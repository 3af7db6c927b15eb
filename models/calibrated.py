"""Constants that were estimated from data, read from the file that states their source.

``calibrated.toml`` beside this module is written by ``python -m lab.calibrate``. Each constant
has a table there: the value in use, its unit, where it comes from, what was measured, and how
far that moves when a scene is left out.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

__all__ = [
    "FOLDS", "PATH", "Constant", "Number", "calibrated", "constants", "from_data", "parsed",
    "table", "values_without", "with_values",
]  # fmt: skip

PATH: Final = Path(__file__).with_name("calibrated.toml")
"""The file of constants."""

FOLDS: Final = ("Scene04", "Scene10", "Scene13", "Scene14")
"""Scenes of i3DB that the constants were estimated from, in the order of their folds."""

Number = float | tuple[float, ...]
"""A constant, or a row of them."""

_Settings = TypeVar("_Settings")


@dataclass(frozen=True)
class Constant:
    """A calibrated number, or a row of them.

    Parameters
    ----------
    value : float or tuple of float
        What the program uses.
    unit : str
    meaning : str
        What it is of.
    source : str
        How it was estimated, and from what.
    measured : float or tuple of float
        What the data say; differs from ``value`` where there is a reason in ``kept``.
    error : float or tuple of float
        Jackknife standard error of ``measured`` over the scenes.
    folds : tuple
        The estimates with each scene left out in turn.
    kept : str
        Why ``value`` is not ``measured``; empty if it is.
    recovered : tuple of float
        A known value of the simulator, and the estimate from simulated clips; or empty.
    """

    value: Number
    unit: str
    meaning: str
    source: str
    measured: Number
    error: Number
    folds: tuple[Number, ...]
    kept: str = ""
    recovered: tuple[Number, ...] = ()


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


@cache
def constants() -> Mapping[str, Constant]:
    """All calibrated constants by name, ``"walk.bearing"``.

    Returns
    -------
    mapping of str to Constant
    """
    return parsed(PATH.read_text(encoding="utf-8"))


def parsed(text: str) -> Mapping[str, Constant]:
    """The constants that a text like the file's holds.

    Parameters
    ----------
    text : str
        TOML: a table for each constant.

    Returns
    -------
    mapping of str to Constant
        By name, ``"walk.bearing"``.
    """
    groups = tomllib.loads(text)
    return MappingProxyType(
        {
            f"{group}.{name}": Constant(**{key: _frozen(v) for key, v in entry.items()})
            for group, members in groups.items()
            for name, entry in members.items()
        }
    )


def calibrated(name: str) -> float:
    """The value in use of one constant.

    Parameters
    ----------
    name : str
        Of the constant, ``"walk.bearing"``.

    Returns
    -------
    float
        In the constant's unit.

    Raises
    ------
    TypeError
        If it is a row of numbers.
    """
    value = constants()[name].value
    if isinstance(value, tuple):
        raise TypeError(f"{name} is a row of numbers")
    return value


def table(name: str) -> tuple[float, ...]:
    """The values in use of a row of constants.

    Parameters
    ----------
    name : str
        Of the row, ``"detections.seen_confidence"``.

    Returns
    -------
    tuple of float
        In the constants' unit.

    Raises
    ------
    TypeError
        If it is a single number.
    """
    value = constants()[name].value
    if not isinstance(value, tuple):
        raise TypeError(f"{name} is one number")
    return value


def from_data(name: str, convert: Callable[[Number], Number] | None = None) -> Any:
    """A field of a dataclass of settings whose default is a calibrated constant.

    Parameters
    ----------
    name : str
        Of the constant, ``"walk.bearing"``.
    convert : callable, optional
        From the constant's value to that of the field.

    Returns
    -------
    dataclasses.Field
        With the constant's name and ``convert`` in its metadata.
    """
    value = constants()[name].value
    return field(
        default=value if convert is None else convert(value),
        metadata={"constant": name, "convert": convert},
    )


def with_values(settings: _Settings, values: Mapping[str, Number]) -> _Settings:
    """Settings with other values of the constants that their fields come from.

    Parameters
    ----------
    settings : dataclass
        With fields of :func:`from_data`.
    values : mapping of str to Number
        By name of the constant; fields of others stay as they are.

    Returns
    -------
    dataclass
        Of the type of ``settings``.
    """
    changed: dict[str, Any] = {}
    for entry in fields(settings):  # type: ignore[arg-type]
        name, convert = entry.metadata.get("constant"), entry.metadata.get("convert")
        if name is not None and name in values:
            changed[entry.name] = values[name] if convert is None else convert(values[name])
    return replace(settings, **changed)  # type: ignore[type-var]


def values_without(scene: str) -> dict[str, Number]:
    """The constants as they would be if a scene had never been seen.

    Constants that are kept for a reason stay; of a scene that they were not estimated from there
    is nothing to leave out.

    Parameters
    ----------
    scene : str
        Of i3DB, ``"Scene04"``.

    Returns
    -------
    dict of str to Number
        By name of the constant; empty if the scene is not in :data:`FOLDS`.
    """
    if scene not in FOLDS:
        return {}
    fold = FOLDS.index(scene)
    return {name: c.folds[fold] for name, c in constants().items() if not c.kept}
