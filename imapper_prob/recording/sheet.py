"""A contact sheet of a library: its scenelets side by side, with moving people.

Entities, in metres, z up::

    sheet/ACTION/tiles             the floor, brighter for more characteristic motions
    sheet/ACTION/kinds, numbers    names of the rows; number and charness of each scenelet
    sheet/ACTION/NAME              pose of the scenelet on the sheet
    sheet/ACTION/NAME/furniture    its boxes, in a colour for each category
    sheet/ACTION/NAME/poses        poses along the motion, darker for earlier ones
    sheet/ACTION/NAME/person, …    the person, moving on the timeline `frame`

Before each action and each name stands its number on the sheet, from 1. Motions differ in length:
all start at frame 0, and a motion that has ended keeps its last pose. All are shown at the highest
frame rate among them.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray

from imapper_prob.models.errors import InputError
from imapper_prob.models.problem import resample
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.plotting import Colour
from imapper_prob.recording import palette, shapes
from imapper_prob.recording.log import saved
from imapper_prob.recording.palette import BACKGROUND
from imapper_prob.recording.shapes import entity_part, log_person, log_static

__all__ = ["kinds", "write_sheet"]

Array = NDArray[np.float64]

_FEWEST: Final = 3
"""Most scenelets shown of a kind; more if there are few kinds."""
_IN_ALL: Final = 36
"""Number of tiles of a sheet with few kinds."""
_SMALLEST_TILE: Final = 3.0
"""Least distance in metres from one scenelet to the next."""
_CONTAINED: Final = 0.8
"""Fraction of the scenelets that fit on their tile; larger tiles would make the others look
small."""
_GAP: Final = 0.04
"""Gap between tiles, as a fraction of a tile."""
_HEADING: Final = 1.0
"""Tiles left free at the start of a row for the name of its kind."""
_TURN: Final = np.deg2rad(-120.0)
"""Rotation of a scenelet on its tile; seen from the side, people are not behind furniture."""
_THICKNESS: Final = 0.02
"""Thickness of a tile in metres."""
_POSES: Final = 5
"""Number of poses drawn along the motion."""
_POSE_RADIUS: Final = 0.012
"""Radius in metres, chosen by eye: thinner than a limb."""
_WIDE: Final = 2.2
"""Approximate least width of the sheet over its depth, which fills a screen in a slanted view."""
_BRIGHT: Final[Colour] = (235, 238, 243)
_DIM: Final[Colour] = (175, 181, 192)
_CHARACTERISTIC: Final = np.array([62.0, 92.0, 110.0])
"""Colour of a tile at charness 1; at 0 it has the colour of the floor."""


@dataclass(frozen=True)
class _Tile:
    """A scenelet on the sheet: column and row from the upper left, and size in metres."""

    scenelet: Scenelet
    kind: str
    charness: float
    column: float
    row: int
    side: float

    def at(self, right: float, up: float) -> tuple[float, float, float]:
        """A point on the floor, in metres, at an offset in tiles from the middle of this one."""
        return self.side * (self.column + right), self.side * (up - self.row), 0.0


def kinds(library: Library) -> list[str]:
    """Kind of each scenelet: its name without the number.

    If one name stands for several actions, as a recording's name does, the action is part of the
    kind.

    Parameters
    ----------
    library : Library

    Returns
    -------
    list of str
        One for each scenelet.
    """
    stems = [re.sub(r"-\d+$", "", s.name) for s in library]
    actions: dict[str, set[str]] = {}
    for stem, scenelet in zip(stems, library, strict=True):
        actions.setdefault(stem, set()).add(scenelet.action)
    return [
        stem if len(actions[stem]) == 1 else f"{stem} {scenelet.action}"
        for stem, scenelet in zip(stems, library, strict=True)
    ]


def write_sheet(path: str | os.PathLike[str], library: Library, charness: ArrayLike) -> None:
    """Write the sheet of a library as one ``.rrd`` file, including its layout of views.

    Parameters
    ----------
    path : path
        Written atomically; an existing file is replaced.
    library : Library
    charness : (L,) float
        In [0, 1]; a row shows the least and the most characteristic scenelet of its kind,
        and some between.

    Raises
    ------
    InputError
        The folder does not exist.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    charness = np.asarray(charness, float)
    by_action = _laid_out(library, charness)
    state = hashlib.sha256(library.digest.encode() + charness.tobytes())
    recording = rr.RecordingStream(
        "imapper-prob",
        recording_id=state.hexdigest()[:32],
        # The start time is a property; without properties, equal sheets make equal recordings.
        send_properties=False,
    )
    with saved(recording, Path(path), _blueprint(by_action)):
        _log(recording, by_action)


def _laid_out(library: Library, charness: Array) -> dict[str, list[_Tile]]:
    """Tiles by action: one row a kind, with rows in as many columns as make the sheet wide."""
    of_kind: dict[tuple[str, str], list[int]] = {}
    for index, (scenelet, kind) in enumerate(zip(library, kinds(library), strict=True)):
        of_kind.setdefault((scenelet.action, kind), []).append(index)
    most = max(_FEWEST, _IN_ALL // len(of_kind))
    actions = list(dict.fromkeys(action for action, _ in of_kind))
    rows = sorted(of_kind, key=lambda key: actions.index(key[0]))
    chosen = {row: _spread(of_kind[row], charness, most) for row in rows}
    reaches = [_reach(library[i]) for members in chosen.values() for i in members]
    side = max(_SMALLEST_TILE, 2 * float(np.quantile(reaches, _CONTAINED)))
    width = max(map(len, chosen.values())) + _HEADING
    n_columns = max(1, round(np.sqrt(_WIDE * len(rows) / width)))
    depth = -(-len(rows) // n_columns)
    fps = max(library[i].fps for members in chosen.values() for i in members)
    by_action: dict[str, list[_Tile]] = {action: [] for action in actions}
    for k, (action, kind) in enumerate(rows):
        for n, i in enumerate(chosen[action, kind]):
            joints = resample(library[i].joints, fps=library[i].fps, to_fps=fps)
            shown, column = replace(library[i], joints=joints, fps=fps), (k // depth) * width + n
            tile = _Tile(shown, kind, float(charness[i]), column, k % depth, side)
            by_action[action].append(tile)
    return by_action


def _spread(members: Sequence[int], charness: Array, most: int) -> list[int]:
    """Some of the members, evenly spaced from the least to the most characteristic."""
    ordered = sorted(members, key=lambda i: (charness[i], i))
    picks = np.linspace(0, len(ordered) - 1, min(most, len(ordered))).round()
    return [ordered[int(p)] for p in picks]


def _reach(scenelet: Scenelet) -> float:
    """Distance in metres, top view, from the origin to the farthest joint or corner."""
    corners = [scenelet.joints[..., :2].reshape(-1, 2), *(o.footprint for o in scenelet.objects)]
    return float(np.linalg.norm(np.concatenate(corners), axis=1).max())


def _log(recording: rr.RecordingStream, by_action: Mapping[str, Sequence[_Tile]]) -> None:
    everything = [t.scenelet for tiles in by_action.values() for t in tiles]
    categories = palette.category_ids(label for s in everything for label in s.labels)
    n_frames = max(s.n_frames for s in everything)
    log_static(recording, "/", palette.annotation_context(categories))
    log_static(recording, "sheet", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for entity, tiles in zip(_entities(by_action), by_action.values(), strict=True):
        log_static(recording, f"{entity}/tiles", _ground(tiles))
        firsts = list({t.kind: t for t in reversed(tiles)}.values())[::-1]
        places = [t.at(-0.9, 0.0) for t in firsts]
        log_static(recording, f"{entity}/kinds", _words(places, [t.kind for t in firsts], _BRIGHT))
        places = [t.at(0.0, -0.42) for t in tiles]
        numbers = [f"{t.scenelet.name.split('-')[-1]} · {t.charness:.2f}" for t in tiles]
        log_static(recording, f"{entity}/numbers", _words(places, numbers, _DIM))
        for number, tile in enumerate(tiles, 1):
            own = f"{entity}/{entity_part(number, tile.scenelet.name)}"
            _log_scenelet(recording, own, tile, categories, n_frames)


def _entities(actions: Iterable[str]) -> list[str]:
    """The entity of each action."""
    return [f"sheet/{entity_part(number, action)}" for number, action in enumerate(actions, 1)]


def _log_scenelet(
    recording: rr.RecordingStream,
    entity: str,
    tile: _Tile,
    categories: dict[str, int],
    n_frames: int,
) -> None:
    scenelet = tile.scenelet
    turn = rr.RotationAxisAngle(axis=(0, 0, 1), radians=_TURN)
    log_static(recording, entity, rr.Transform3D(translation=tile.at(0.0, 0.0), rotation=turn))
    log_static(recording, f"{entity}/furniture", shapes.boxes(scenelet.objects, categories))

    stops = np.linspace(0, scenelet.n_frames - 1, _POSES).round().astype(int)
    poses = [shapes.limbs(scenelet.joints[t]) for t in stops]
    light = np.repeat(np.linspace(0.5, 1.2, _POSES), [len(limbs) for limbs in poses])
    ghosts = rr.LineStrips3D(
        [limb for limbs in poses for limb in limbs],
        colors=np.outer(light, palette.GHOSTS[palette.ESTIMATE]).astype(np.uint8),
        radii=_POSE_RADIUS,
    )
    log_static(recording, f"{entity}/poses", ghosts)

    frames = np.arange(n_frames)
    joints = scenelet.joints[np.minimum(frames, scenelet.n_frames - 1)]
    time = rr.TimeColumn("frame", sequence=frames)
    log_person(recording, entity, joints, palette.ESTIMATE, time)


def _ground(tiles: Sequence[_Tile]) -> rr.Boxes3D:
    floor = np.array(palette.FLOOR, float)
    sides = np.array([t.side * (1 - _GAP) for t in tiles])
    charness = np.array([t.charness for t in tiles])
    return rr.Boxes3D(
        # A millimetre below the furniture.
        centers=np.array([t.at(0.0, 0.0) for t in tiles]) - (0.0, 0.0, _THICKNESS / 2 + 0.001),
        sizes=np.column_stack([sides, sides, np.full(len(tiles), _THICKNESS)]),
        colors=(floor + charness[:, None] * (_CHARACTERISTIC - floor)).astype(np.uint8),
        fill_mode=rr.components.FillMode.Solid,
    )


def _words(
    places: Sequence[tuple[float, float, float]], words: Sequence[str], colour: Colour
) -> rr.Points3D:
    labels = [palette.drawable(word) for word in words]
    return rr.Points3D(places, labels=labels, radii=0.001, colors=colour, show_labels=True)


def _blueprint(by_action: Mapping[str, Sequence[_Tile]]) -> rrb.Blueprint:
    everything, entities = [t for tiles in by_action.values() for t in tiles], _entities(by_action)
    views = [
        _view(action.capitalize(), [f"{entity}/**"], tiles)
        for entity, (action, tiles) in zip(entities, by_action.items(), strict=True)
    ]
    if len(views) > 1:
        # From far away the numbers would hide the people.
        contents = ["sheet/**", *(f"- {entity}/numbers" for entity in entities)]
        views = [_view("All (bright: characteristic)", contents, everything), *views]
    return rrb.Blueprint(
        rrb.Tabs(*views, active_tab=0),
        rrb.TimePanel(
            timeline="frame",
            fps=everything[0].scenelet.fps,
            state="collapsed",
            play_state="paused",
        ),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _view(name: str, contents: Sequence[str], tiles: Sequence[_Tile]) -> rrb.Spatial3DView:
    """A view with these tiles in sight, from the front and above."""
    low = np.min([t.at(-0.5 - _HEADING, -0.5) for t in tiles], axis=0)
    high = np.max([t.at(0.5, 0.5) for t in tiles], axis=0)
    width, depth, _ = high - low
    # Near things look larger, so the eye points to slightly in front of the middle.
    target = (low + high) / 2 + (0.0, -0.06 * depth, 0.5)
    far = max(0.62 * width, 1.02 * depth)
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=target + far * np.array([0.0, -0.62, 0.9]),
        look_target=target,
        eye_up=(0.0, 0.0, 1.0),
    )
    return rrb.Spatial3DView(
        origin="sheet",
        contents=["sheet", *contents],
        name=palette.drawable(name),
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
    )
