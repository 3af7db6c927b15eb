"""``scenes.json``: the scenes of a posterior, for people and for other programs.

Positions are metres in the world frame (z up, floor at z = 0, origin on the floor below the camera,
y the horizontal viewing direction), angles radians. An unknown number is ``null``. ``objects`` are
matched over all draws, with standard deviations (``_sd``); the objects of a scene are those of its
representative draw.

The file has no joints, because a motion has hundreds of frames. ``posterior.nc`` in the same folder
has the joints of every draw.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from imapper_prob.files import require_intact, without_nan, written_whole
from imapper_prob.models.camera import Camera
from imapper_prob.models.errors import InputError
from imapper_prob.models.scene import Clip, Cuboid, Placement, Scene, SceneObject
from imapper_prob.models.skeleton import N_JOINTS
from imapper_prob.models.text import readable
from imapper_prob.uncertainty.checks import Check, alarms
from imapper_prob.uncertainty.scenes import Explains, WeightedScene

__all__ = [
    "FORMAT", "VERSION", "object_from_json", "object_to_json", "read_objects", "read_scenes",
    "write_scenes",
]  # fmt: skip

FORMAT: Final = "imapper-prob scenes"
VERSION: Final = 3
"""Version of the format, raised whenever an older reader would misread the file."""

_UNITS: Final = {"length": "metre", "angle": "radian", "image": "pixel"}
_FRAMES: Final = {
    "world": "z up, floor at z = 0, origin on the floor below the camera, y the horizontal "
    "viewing direction; positions, yaws and covariances are in it",
    "object": "placed in the world by position and yaw (counter-clockwise about z); y is the "
    "object's front, z the height above the floor; cuboids are in it",
}

_OF_OBJECT: Final = (
    "label_probability", "presence", "presence_error", "x", "x_sd", "y", "y_sd", "yaw", "yaw_sd",
)  # fmt: skip
_LARGEST: Final = 1e12
"""Largest variance of a position, square metres."""

Item = TypeVar("Item")


def write_scenes(
    path: str | os.PathLike[str],
    scenes: Sequence[WeightedScene],
    *,
    clip: Clip | None = None,
    checks: Iterable[Check] = (),
    objects: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Write scenes as JSON; an existing file is replaced.

    Parameters
    ----------
    path : path
        Written atomically.
    scenes : sequence of WeightedScene
        In descending order of probability. Joints and ghosts are not written.
    clip : Clip, optional
        Needed for several people, to tell who performs each scenelet.
    checks : iterable of Check
        Checks of the result; alarms are written before the scenes, in words.
    objects : sequence of mapping
        Objects over all draws, see :func:`imapper_prob.uncertainty.summary.object_rows`.

    Raises
    ------
    InputError
        The folder does not exist.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    actors, checks = _Actors() if clip is None else _Actors.of(clip), tuple(checks)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "units": _UNITS,
        "frames": _FRAMES,
        "alarms": list(alarms(checks)),
        "checks": [asdict(check) for check in checks],
        **({"actors": asdict(actors)} if actors.names else {}),
        "objects": list(objects),
        "scenes": [_from_scene(scene, actors) for scene in scenes],
    }
    text = json.dumps(without_nan(document), indent=1, allow_nan=False, ensure_ascii=False)
    with written_whole(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def read_scenes(path: str | os.PathLike[str]) -> tuple[WeightedScene, ...]:
    """Read the scenes of a file by :func:`write_scenes`.

    Parameters
    ----------
    path : path

    Returns
    -------
    tuple of WeightedScene
        In the order of the file, with motions and ghosts of zero frames.

    Raises
    ------
    InputError
        The file cannot be read, is not a ``scenes.json``, is of another version or is incomplete.
    """
    path = Path(path)
    document = _read(path)
    try:
        actors = _Actors(**document.get("actors", {}))
    except TypeError as error:
        raise InputError(f"{path}: actors: {error}") from error
    return _each(document.get("scenes"), lambda s: _to_scene(s, actors), f"{path}: scene")


def read_objects(path: str | os.PathLike[str]) -> tuple[dict[str, Any], ...]:
    """Read the objects over all draws from a file by :func:`write_scenes`.

    Parameters
    ----------
    path : path
        Path of ``scenes.json``.

    Returns
    -------
    tuple of dict
        Names and values for each object, as in `Posterior.summary`.

    Raises
    ------
    InputError
        As :func:`read_scenes`.
    """
    path = Path(path)
    return _each(_read(path).get("objects", []), _to_row, f"{path}: object")


def _read(path: Path) -> dict[str, Any]:
    """Read and check the document in a file of scenes."""
    require_intact(path)
    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refused)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({error})") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path}: is not a file of scenes; expected format {FORMAT!r}")
    if document.get("version") != VERSION:
        raise InputError(
            f"{path}: has version {document.get('version')!r}, this program reads {VERSION}"
        )
    return document


@dataclass(frozen=True)
class _Actors:
    """Names of several people in the order of their tracks, and frames per person."""

    names: Sequence[str] = ()
    n_frames: int = 0

    @classmethod
    def of(cls, clip: Clip) -> _Actors:
        """The people of a clip; empty for a single person."""
        names = [track.name for track in clip.tracks]
        return cls(names, clip.n_frames) if len(names) > 1 else cls()

    def told(self, scenelet: str, row: int) -> dict[str, Any]:
        """A scenelet with its start frame and the name of its person."""
        if not self.names:
            return {"scenelet": scenelet, "start": row}
        actor, start = divmod(row, self.n_frames)
        return {"scenelet": scenelet, "start": start, "actor": self.names[actor]}

    def row(self, part: Mapping[str, Any]) -> int:
        """Start frame of a scenelet if the frames of all people follow one another."""
        before = list(self.names).index(part["actor"]) if self.names else 0
        return before * self.n_frames + int(part["start"])


def _from_scene(weighted: WeightedScene, actors: _Actors) -> dict[str, Any]:
    scene = weighted.scene
    return {
        "probability": weighted.probability,
        "error": weighted.error,
        "layouts": list(weighted.layouts),
        "difference": weighted.difference,
        "explains": None if weighted.explains is None else _from_explains(weighted.explains),
        "draw": weighted.draw,
        "log_posterior": scene.log_posterior,
        "assignment": [actors.told(name, int(start)) for name, start in scene.assignment],
        "camera": asdict(scene.camera),
        "objects": [
            object_to_json(item, position_covariance=np.asarray(covariance).tolist())
            for item, covariance in zip(scene.objects, weighted.covariances, strict=True)
        ],
    }


def _from_explains(explains: Explains) -> dict[str, Any]:
    return {
        "frames": [list(span) for span in explains.frames],
        "covered": explains.covered,
        "of_frames": explains.n_frames,
        "unsure": explains.unsure,
        "unsure_behind": explains.unsure_behind,
        "sure_behind": explains.sure_behind,
    }


def _to_explains(values: Mapping[str, Any]) -> Explains:
    return Explains(
        frames=tuple((int(first), int(last)) for first, last in values["frames"]),
        n_frames=int(values["of_frames"]),
        unsure=int(values["unsure"]),
        unsure_behind=int(values["unsure_behind"]),
        sure_behind=int(values["sure_behind"]),
    )


def object_to_json(item: SceneObject, **further: Any) -> dict[str, Any]:
    """The entry of an object in a file.

    Parameters
    ----------
    item : SceneObject
    **further : object
        Further values of the entry, by name.

    Returns
    -------
    dict
        Values that JSON can represent.
    """
    return {
        "label": item.label,
        "position": [item.placement.x, item.placement.y],
        "yaw": item.placement.yaw,
        **further,
        "cuboids": [
            {"part": c.part, "centre": c.centre.tolist(), "size": c.size.tolist()}
            for c in item.cuboids
        ],
    }


def _to_scene(values: Mapping[str, Any], actors: _Actors) -> WeightedScene:
    entries = values["objects"]
    scene = Scene(
        camera=Camera(**values["camera"]),
        objects=_each(entries, object_from_json, "object"),
        joints=np.empty((0, N_JOINTS, 3)),
        assignment=tuple(
            (readable(str(part["scenelet"])), actors.row(part)) for part in values["assignment"]
        ),
        log_posterior=_number(values["log_posterior"]),
    )
    listed = np.array([o["position_covariance"] for o in entries], dtype=float)
    covariances = listed.reshape(len(entries), 2, 2)
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    if (np.abs(covariances) > _LARGEST).any() or (variances < 0).any():
        raise InputError("position_covariance is no covariance")
    return WeightedScene(
        scene=scene,
        probability=_number(values["probability"]),
        error=_number(values["error"]),
        covariances=covariances,
        ghosts=np.empty((0, 0, N_JOINTS, 3)),
        layouts=tuple(int(number) for number in values["layouts"]),
        explains=None if values["explains"] is None else _to_explains(values["explains"]),
        difference=readable(str(values["difference"])),
        draw=int(values["draw"]),
    )


def object_from_json(values: Mapping[str, Any]) -> SceneObject:
    """Read an entry by :func:`object_to_json`.

    Parameters
    ----------
    values : mapping

    Returns
    -------
    SceneObject

    Raises
    ------
    KeyError
        A value is missing.
    TypeError, ValueError
        A value is none of an object.
    """
    x, y = values["position"]
    cuboids = tuple(Cuboid(c["part"], c["centre"], c["size"]) for c in values["cuboids"])
    return SceneObject(values["label"], Placement(x, y, values["yaw"]), cuboids)


def _to_row(values: Mapping[str, Any]) -> dict[str, Any]:
    numbers = {name: _number(values[name]) for name in _OF_OBJECT}
    return {"label": readable(str(values["label"])), **numbers}


def _each(entries: Any, read: Callable[[Mapping[str, Any]], Item], what: str) -> tuple[Item, ...]:
    """Read a list; an error names the entry that is wrong."""
    if not isinstance(entries, list):
        raise InputError(f"{what}s are missing")
    items = []
    for number, entry in enumerate(entries, 1):
        try:
            items.append(read(entry))
        except KeyError as error:
            raise InputError(f"{what} {number} lacks {error}") from error
        except (ArithmeticError, AttributeError, IndexError, TypeError, ValueError) as error:
            raise InputError(f"{what} {number}: {error}") from error
    return tuple(items)


def _number(value: float | None) -> float:
    number = math.nan if value is None else float(value)
    if math.isinf(number):
        raise InputError(f"{value!r:.40} is too large to be true")
    return number


def _refused(name: str) -> float:
    """Refuse constants that are not in the JSON standard."""
    raise ValueError(f"{name} is no number")
