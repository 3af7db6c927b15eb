"""All settings of a run, readable and writable as TOML."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from imapper_prob.files import parse_toml, read_text
from imapper_prob.models.detector import DetectorSettings
from imapper_prob.models.errors import (
    InputError,
    require_kind,
    require_number,
    require_whole,
)
from imapper_prob.models.settings import (
    CameraSettings,
    ModelSettings,
    Settings,
    StaticPathSettings,
)

__all__ = ["MOST_STEPS", "Config", "SampleSettings", "from_toml", "read_config", "to_toml"]

MOST_STEPS: Final = 10**9
"""Most steps of a chain at each temperature: days of sampling; chosen."""

_LARGEST: Final = 2**63
"""Largest magnitude of a setting; seeds have 63 bits."""
_RENAMED: Final = {
    "ease_bearing": "smoothing_time_bearing",
    "ease_depth": "smoothing_time_depth",
    "memory_bearing": "correlation_time_bearing",
    "memory_depth": "correlation_time_depth",
    "surprise": "visibility_error",
    "swap_length": "side_flip_length",
    "swap_rate": "side_flip_rate",
}
"""Keys of ``[model]`` in older files, and their present names."""


@dataclass(frozen=True)
class SampleSettings:
    """Settings of chains and ensembles.

    Parameters
    ----------
    chains : int
        Number of independent chains, from over-dispersed starts.
    steps : int
        Steps of each chain at each temperature. Burn-in and spacing of draws are relative to it.
        The default is chosen by time: Scene10 of i3DB then takes about five minutes on two cores
        (``python -m lab.seeds``).
    temperatures : int
        Largest number of tempered copies of each chain that swap their states. They reach from
        a learnt reference distribution of scenes, sampled independently, to the posterior; draws
        are kept from the last copy only. 1 means no tempering. A chain begins with eight at most.
        Late in the burn-in their number becomes twice the communication barrier plus one, which is
        best (Syed et al. 2022). Barriers of public scenes are about 2 to 5.
    swap_every : int
        Steps between two rounds of swaps; draws are kept after a round.
    burn_in : float
        Fraction of the steps that is discarded; the temperatures adapt during it. The default is
        chosen by the effective draws of the demo.
    draws : int
        Draws kept of each chain, evenly spaced; a continued chain keeps up to twice as many.
    last_step : int
        Step at which chains stop instead of at ``steps``, earlier or later, rounded up to a
        multiple of 200 steps; 0 to stop at ``steps``. It is set in continued runs.
    layout_radius : float
        Distance in metres within which objects of two draws count as the same.
    ensemble_steps : int
        Steps by which an ensemble of the draws moves together after the chains, each draw with its
        scenelets fixed; 0 for no such steps.
    """

    chains: int = 4
    steps: int = 160_000
    temperatures: int = 12
    swap_every: int = 5
    burn_in: float = 0.3
    draws: int = 800
    last_step: int = 0
    layout_radius: float = 0.8
    ensemble_steps: int = 50

    def __post_init__(self) -> None:
        least = {
            "chains": 2, "steps": 1, "temperatures": 1, "swap_every": 1, "draws": 1,
            "last_step": 0, "ensemble_steps": 0,
        }  # fmt: skip
        for name, value in least.items():
            said = getattr(self, name)
            require_whole(f"sample setting {name}", said, least=value, most=MOST_STEPS)
        require_number("sample setting layout_radius", self.layout_radius, above=0)
        require_number("sample setting burn_in", self.burn_in)
        if not 0 <= self.burn_in < 1:
            raise InputError(f"sample setting burn_in = {self.burn_in} must be in [0, 1)")
        if self.draws > self.most_draws:
            raise InputError(
                f"sample settings: {self.draws} draws cannot be kept of {self.steps} steps with "
                f"burn-in {self.burn_in} and one draw in {self.swap_every} steps: take draws = "
                f"{self.most_draws} at most, or more steps"
            )

        if self.last_step and self.last_step <= self.steps * self.burn_in:
            raise InputError(
                f"sample setting last_step = {self.last_step} must be beyond the burn-in, a share "
                f"of {self.burn_in} of {self.steps} steps"
            )

    @property
    def rounds(self) -> int:
        """Number of rounds of swaps in ``steps``."""
        return -(-self.steps // self.swap_every)

    @property
    def most_draws(self) -> int:
        """Greatest number of draws that can be kept of each chain."""
        return self.rounds - int(self.rounds * self.burn_in)

    @property
    def steps_made(self) -> int:
        """Step at which chains stop."""
        return self.last_step or self.steps


_TABLES: Final = {
    "model": ModelSettings, "path": StaticPathSettings, "camera": CameraSettings,
    "detector": DetectorSettings, "sample": SampleSettings,
}  # fmt: skip
"""Tables of a file of settings."""


@dataclass(frozen=True)
class Config:
    """All settings of a run; only the clip and statements are separate.

    Parameters
    ----------
    seed : int
        Seed of all randomness of a run.
    library : str
        ``"built-in"`` or the path of a library file.
    device : str
        Torch device on which scenelets are fitted to windows: ``cpu``, ``cuda``, ``mps``.
    model : ModelSettings
    path : StaticPathSettings
    camera : CameraSettings
    detector : DetectorSettings
    sample : SampleSettings

    Examples
    --------
    >>> from dataclasses import replace
    >>> config = im.Config(seed=1)
    >>> short = replace(config, sample=replace(config.sample, steps=60_000))
    >>> short.sample.steps, short.sample.chains
    (60000, 4)
    """

    seed: int = 0
    library: str = "built-in"
    device: str = "cpu"
    model: ModelSettings = field(default_factory=ModelSettings)
    path: StaticPathSettings = field(default_factory=StaticPathSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    sample: SampleSettings = field(default_factory=SampleSettings)

    def __post_init__(self) -> None:
        for name, kind in _TABLES.items():
            require_kind(name, getattr(self, name), kind, f"a {kind.__name__}")
        require_kind("library", self.library, str, "a name or path as text")
        require_kind("device", self.device, str, "the name of a torch device")
        if re.fullmatch(r"(cpu|cuda|mps|xpu)(:\d+)?", self.device) is None:
            raise InputError(f"device = {self.device!r:.60} must be cpu, cuda, mps, or as cuda:1")
        require_whole("seed", self.seed, least=0)
        if self.seed >= _LARGEST:
            raise InputError(f"seed = {self.seed} must be less than 2^63")
        try:
            self.library.encode()
        except UnicodeEncodeError as error:
            raise InputError(
                f"library {self.library}: its name is no UTF-8, and no file can say it; rename it"
            ) from error

    @property
    def settings(self) -> Settings:
        """The constants of the model and of the stages before it.

        Examples
        --------
        >>> im.Config().settings.model == im.Config().model
        True
        """
        return Settings(self.model, self.path, self.camera, self.detector, self.device)

    def without(self, scene: str) -> Config:
        """The settings with constants estimated without one scene of i3DB (`Settings.without`).

        Parameters
        ----------
        scene : str
            Name of the scene, such as ``"Scene04"``.

        Returns
        -------
        Config

        Examples
        --------
        >>> im.Config().without("Scene04").model == im.Config().model
        False
        """
        found = self.settings.without(scene)
        return dataclasses.replace(
            self, model=found.model, path=found.path, camera=found.camera, detector=found.detector
        )


def to_toml(config: Config) -> str:
    """The settings as TOML text; :func:`read_config` reads it back.

    Parameters
    ----------
    config : Config

    Returns
    -------
    str
    """

    def line(name: str, value: Any) -> str:
        if isinstance(value, str):
            # JSON escapes strings as TOML does, except for one character.
            return f"{name} = {json.dumps(value, ensure_ascii=False)}".replace("\x7f", "\\u007f")
        if isinstance(value, tuple):
            return f"{name} = [{', '.join(map(repr, value))}]"
        return f"{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}"

    top, tables = [], []
    for entry in dataclasses.fields(config):
        value = getattr(config, entry.name)
        if dataclasses.is_dataclass(value):
            rows = [line(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
            tables.append("\n".join([f"[{entry.name}]", *rows]))
        else:
            top.append(line(entry.name, value))
    return "\n\n".join(["\n".join(top), *tables]) + "\n"


def _build(cls: type, values: dict[str, Any], where: str) -> Any:
    known = {f.name: f for f in dataclasses.fields(cls)}
    default = cls()
    arguments = {}
    for name, value in values.items():
        if _RENAMED.get(name) in known:
            raise InputError(f"{where}: unknown key {name}; it is called {_RENAMED[name]}")
        if name not in known:
            raise InputError(f"{where}: unknown setting {name!r}; known are {sorted(known)}")
        wanted = getattr(default, name)
        if dataclasses.is_dataclass(wanted):
            if not isinstance(value, dict):
                raise InputError(f"{where}: {name} must be a table")
            arguments[name] = _build(type(wanted), value, f"{where} [{name}]")
            continue
        if isinstance(wanted, tuple):
            arguments[name] = _row(value, f"{where}: {name}")
            continue
        number = isinstance(wanted, float) and isinstance(value, int)
        if isinstance(value, bool) != isinstance(wanted, bool) or not (
            number or isinstance(value, type(wanted))
        ):
            raise InputError(f"{where}: {name} = {value!r} must be of type {type(wanted).__name__}")
        if isinstance(value, int | float) and not abs(value) <= _LARGEST:
            raise InputError(f"{where}: {name} = {value!r:.40} is too large to be true")
        arguments[name] = float(value) if number else value
    try:
        return cls(**arguments)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _row(value: Any, what: str) -> tuple[float, ...]:
    numbers = isinstance(value, list) and all(
        isinstance(v, (int, float)) and not isinstance(v, bool) for v in value
    )
    if not numbers or not all(abs(v) <= _LARGEST for v in value):
        raise InputError(f"{what} = {value!r} must be a list of numbers")
    return tuple(float(v) for v in value)


def read_config(path: str | Path) -> Config:
    """Read settings from a TOML file; missing settings keep their defaults.

    Parameters
    ----------
    path : path

    Returns
    -------
    Config

    Raises
    ------
    InputError
        The file is missing, not TOML, or has an unknown setting or a value of the wrong type.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("config.toml").write_text("seed = 7")
    >>> im.read_config("config.toml").seed
    7
    """
    path = Path(path)
    return from_toml(read_text(path), where=str(path))


def from_toml(text: str, *, where: str) -> Config:
    """Read settings from the text of :func:`to_toml`.

    Parameters
    ----------
    text : str
    where : str
        Name of the text's source, for messages.

    Returns
    -------
    Config

    Raises
    ------
    InputError
        See :func:`read_config`.
    """
    config: Config = _build(Config, parse_toml(text, where=where), where)
    return config
