"""Constants that were estimated from data, read from a file that also states their source.

``python -m lab.calibrate`` writes ``calibrated.toml``, which lies beside this module. Each constant
has a table there: the value in use, its unit, its source, the estimate, and the estimates with one
scene left out.
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
    "values_without", "with_values",
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
        What the constant describes.
    source : str
        How it was estimated, and from what.
    measured : float or tuple of float
        The estimate from data; differs from ``value`` for the reason given in ``kept``.
    error : float or tuple of float
        Jackknife standard error of ``measured`` over the scenes.
    folds : tuple
        The estimates with each scene left out in turn, in the order of :data:`FOLDS`.
    kept : str
        Why ``value`` differs from ``measured``; empty if it does not.
    recovered : tuple of float
        A known value of the simulator and its estimate from simulated clips; empty if not checked.
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
    """All calibrated constants by name, such as ``"walk.bearing"``.

    Returns
    -------
    mapping of str to Constant
    """
    return parsed(PATH.read_text(encoding="utf-8"))


def parsed(text: str) -> Mapping[str, Constant]:
    """Parse constants from a text in the format of ``calibrated.toml``.

    Parameters
    ----------
    text : str
        TOML with a table for each constant.

    Returns
    -------
    mapping of str to Constant
        By name, such as ``"walk.bearing"``.
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
    """The value in use of one scalar constant.

    Parameters
    ----------
    name : str
        Name of the constant, such as ``"walk.bearing"``.

    Returns
    -------
    float
        Value in the constant's unit.

    Raises
    ------
    TypeError
        The constant is a row of numbers.
    """
    value = constants()[name].value
    if isinstance(value, tuple):
        raise TypeError(f"{name} is a row of numbers")
    return value


def from_data(name: str, convert: Callable[[Number], Number] | None = None) -> Any:
    """A field of a settings dataclass whose default is a calibrated constant.

    Parameters
    ----------
    name : str
        Name of the constant, such as ``"walk.bearing"``.
    convert : callable, optional
        Converts the constant's value to that of the field.

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
    """Replace the settings that come from given constants.

    Parameters
    ----------
    settings : dataclass
        Settings with fields made by :func:`from_data`.
    values : mapping of str to Number
        New values by name of the constant; other fields keep theirs.

    Returns
    -------
    dataclass
        Of the same type as ``settings``.
    """
    changed: dict[str, Any] = {}
    for entry in fields(settings):  # type: ignore[arg-type]
        name, convert = entry.metadata.get("constant"), entry.metadata.get("convert")
        if name is not None and name in values:
            changed[entry.name] = values[name] if convert is None else convert(values[name])
    return replace(settings, **changed)  # type: ignore[type-var]


def values_without(scene: str) -> dict[str, Number]:
    """The constants estimated without one scene, for cross-validation.

    Constants with a reason in ``kept`` are left out, because their value is not the estimate. For a
    scene that is not a calibration scene there is nothing to replace.

    Parameters
    ----------
    scene : str
        Name of a scene of i3DB, such as ``"Scene04"``.

    Returns
    -------
    dict of str to Number
        Values by name of the constant; empty if the scene is not in :data:`FOLDS`.
    """
    if scene not in FOLDS:
        return {}
    fold = FOLDS.index(scene)
    return {name: c.folds[fold] for name, c in constants().items() if not c.kept}
