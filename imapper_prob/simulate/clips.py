"""Simulated clips: detections and lifted poses of a simulated scene.

Camera, body and detector are drawn from the priors of the model, repeatedly until the person is in
view. Room and walk (:mod:`imapper_prob.simulate.scene`) are plausible but not draws from p(X); for
those see ``lab/prior.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.calibrated import calibrated
from imapper_prob.models.camera import Camera
from imapper_prob.models.detector import DetectionModel
from imapper_prob.models.errors import InputError
from imapper_prob.models.kernels.detection import draw_flips
from imapper_prob.models.problem import resample
from imapper_prob.models.scene import Clip, SceneObject, Track, Truth
from imapper_prob.models.scenelet import Library, Scenelet
from imapper_prob.models.settings import ModelSettings
from imapper_prob.models.skeleton import DETECTED, HEAD, LHIP, MIRROR, NECK, PELV, RHIP, THRX
from imapper_prob.simulate.scene import (
    Gait,
    Stay,
    draw_bystander,
    draw_entry,
    draw_stay,
    find_route,
    hidden_joints,
    in_image,
    low_pieces,
    walk_between,
)

__all__ = [
    "ACTION_WORDS",
    "NOMINAL_CAMERA",
    "draw_camera",
    "simulate_clip",
    "simulate_track",
]

Array = NDArray[np.float64]
LIFT_SCALE: Final = 1 / 1.06
LIFT_SCALE_SPREAD: Final = 0.03
"""Mean and spread of the scale of lifted skeletons, 6 % too small (measured on i3DB)."""
LIFT_NOISE_SEEN: Final = 0.04
LIFT_NOISE_HIDDEN: Final = 0.12
"""Errors of a lifter in metres a joint and axis: those of visible joints are MediaPipe's 8 cm in
3D, those of hidden joints three times that."""
LIFT_MEMORY: Final = 1.0
"""Correlation time in seconds of a lifter's errors (residuals on i3DB: 11-13 frames)."""
LOSS_STARTS: Final = 0.10
LOSS_STARTS_HIDDEN: Final = 1.0
LOSS_ENDS: Final = 3.0
"""Rates a second at which a detector loses a person in full view, additionally loses one with most
joints hidden, and finds a lost person again."""


def simulate_track(
    rng: np.random.Generator,
    joints: Array,
    hidden: NDArray[np.bool_],
    *,
    camera: Camera,
    fps: float,
    name: str = "actor",
    detections: DetectionModel | None = None,
    settings: ModelSettings | None = None,
) -> Track:
    """Simulate the detections and lifted poses of a motion.

    Detections are drawn from the detection model for joints inside the image; the others are
    missing. PELV and NECK are computed from the detections and have confidence 0. In some intervals
    the person is not detected, in others left and right are exchanged, with the model's rates.

    Parameters
    ----------
    rng : numpy.random.Generator
    joints : (T, 16, 3) float
        True joints in the world, metres.
    hidden : (T, 16) bool
        Whether furniture hides each joint.
    camera : Camera
        The true camera.
    fps : float
        Frames a second.
    name : str
        Name of the track.
    detections : DetectionModel, optional
        Detection tables; those measured on i3DB if not given.
    settings : ModelSettings, optional
        Gives rate and duration of left-right exchanges.

    Returns
    -------
    Track
    """
    model = detections or DetectionModel()
    keypoints, confidences = model.draw(
        rng, camera.project(joints), hidden, short_side=camera.short_side
    )
    poses = _lifted(rng, joints, hidden, camera=camera, fps=fps)
    missing = ~in_image(camera, joints)
    missing[_lost(rng, hidden | missing, fps=fps)] = True
    missing[:, [PELV, NECK]] = True
    confidences = np.where(missing, 0.0, confidences)
    keypoints = np.where(missing[..., None], np.nan, keypoints)
    keypoints[:, PELV] = (keypoints[:, RHIP] + keypoints[:, LHIP]) / 2
    keypoints[:, NECK] = (keypoints[:, THRX] + keypoints[:, HEAD]) / 2
    poses[missing.all(1)] = np.nan
    constants = settings or ModelSettings()
    flipped = draw_flips(
        rng,
        len(joints),
        begins=constants.side_flip_rate / fps,
        ends=1 / (constants.side_flip_length * fps),
    )
    for values in (keypoints, confidences, poses):
        values[flipped] = values[flipped][:, list(MIRROR)]
    return Track(name, keypoints, confidences, poses, np.zeros(len(joints), bool))


def _lost(rng: np.random.Generator, hidden: NDArray[np.bool_], *, fps: float) -> NDArray[np.bool_]:
    """(T,) whether the detector has lost the person, as a Markov chain with two states."""
    share = hidden[:, list(DETECTED)].mean(1)
    starts = (LOSS_STARTS + LOSS_STARTS_HIDDEN * (share > 0.5)) / fps
    uniform = rng.random(len(hidden))
    lost = np.zeros(len(hidden), bool)
    for t in range(1, len(hidden)):
        lost[t] = uniform[t] < starts[t] or (lost[t - 1] and uniform[t] > LOSS_ENDS / fps)
    return lost


def _lifted(
    rng: np.random.Generator,
    joints: Array,
    hidden: NDArray[np.bool_],
    *,
    camera: Camera,
    fps: float,
) -> Array:
    """(T, 16, 3) poses of a simulated lifter: camera axes, relative to the pelvis, scaled, with
    noise."""
    true = camera.to_camera(joints)
    relative = true - true[:, PELV : PELV + 1]
    keep = np.exp(-1 / (LIFT_MEMORY * fps))
    shocks = rng.standard_normal(relative.shape)
    noise = np.empty_like(shocks)
    noise[0] = shocks[0]
    for t in range(1, len(noise)):
        noise[t] = keep * noise[t - 1] + np.sqrt(1 - keep**2) * shocks[t]
    spread = np.where(hidden, LIFT_NOISE_HIDDEN, LIFT_NOISE_SEEN)[..., None]
    poses: Array = LIFT_SCALE * np.exp(rng.normal(0.0, LIFT_SCALE_SPREAD)) * relative
    poses += spread * noise
    poses[:, NECK] = (poses[:, THRX] + poses[:, HEAD]) / 2
    return poses - poses[:, PELV : PELV + 1]


# ------------------------------------------------------------------------------------------------
# Clips.

_T = TypeVar("_T")
NOMINAL_CAMERA: Final = Camera(
    width=1920, height=1080, fx=1955.0, fy=1955.0, cx=960.0, cy=540.0,
    pitch=float(np.deg2rad(-4.0)), elevation=1.5,
)  # fmt: skip
"""The camera of i3DB, at the mean of the prior of its orientation: N(-4, 3) degrees of pitch."""
PITCH_SPREAD: Final = calibrated("camera.pitch")
ROLL_SPREAD: Final = calibrated("camera.roll")
ELEVATIONS: Final = (1.3, 1.7)
"""Range of the height of a camera on a tripod, metres; chosen, about the nominal 1.5 m."""
SCALE_SPREAD: Final = 0.05
"""Standard deviation of log focal length (assumed ones are accurate to 5 %) and of log body scale
(statures of adults about 1.70 m)."""
SHORTEST_STAY: Final = 2.0
"""Least duration of an interaction in seconds; shorter ones resemble walking past."""
STAYS_PUT: Final = 0.15
"""Greatest movement in metres of the pelvis in a scenelet that can be extended in time."""
ACTION_WORDS: Final = {
    "sit": "sitting", "stand": "standing", "reach": "reaching", "walk": "walking", "lie": "lying",
}  # fmt: skip
"""Words for actions, as in i3DB."""
FEWEST_IN_IMAGE: Final = 0.3
"""Least fraction of the joints inside the image in every frame."""
_PLACES = 30
"""Places tried for each piece of furniture before another room is drawn."""
_ROOMS = 200
"""Rooms tried before an error; two interactions in 150 frames need fewer than ten."""


def draw_camera(rng: np.random.Generator, *, nominal: Camera = NOMINAL_CAMERA) -> Camera:
    """Draw pitch, roll, elevation and focal length of a camera around the nominal one.

    Parameters
    ----------
    rng : numpy.random.Generator
    nominal : Camera

    Returns
    -------
    Camera
    """
    return nominal.posed(
        pitch=float(rng.normal(nominal.pitch, PITCH_SPREAD)),
        roll=float(rng.normal(nominal.roll, ROLL_SPREAD)),
        elevation=float(rng.uniform(*ELEVATIONS)),
        focal_scale=float(np.exp(rng.normal(0.0, SCALE_SPREAD))),
    )


@dataclass(frozen=True)
class _Acted:
    """A furnished room and the person's motion in it, by frame."""

    objects: tuple[SceneObject, ...]
    joints: Array
    actions: tuple[str, ...]


def simulate_clip(
    rng: np.random.Generator,
    library: Library,
    *,
    n_frames: int = 150,
    n_interactions: int = 2,
    n_bystanders: int = 1,
    script: Sequence[str] = (),
    camera: Camera | None = None,
    walks: Library | None = None,
    name: str = "simulated",
) -> Clip:
    """Simulate a clip with ground truth.

    Parameters
    ----------
    rng : numpy.random.Generator
    library : Library
        Source of interactions, furniture and frame rate. The rate is that of the first scenelet;
        the others are resampled to it.
    n_frames : int
        Frames of the clip. Walking to an interaction and performing it takes about 60 at 10 frames
        a second.
    n_interactions : int
        Number of interactions; kinds of furniture repeat only after all have been used.
    n_bystanders : int
        Unused pieces of furniture in front of the person; fewer if there is no room.
    script : sequence of str
        Names of the scenelets to perform, in order, instead of ``n_interactions`` random ones.
    camera : Camera, optional
        The true camera. Without it, pitch, roll and focal length follow the model, and the height
        is a tripod's.
    walks : Library, optional
        Source of the gait, if ``library`` has no walk.
    name : str
        Name of the clip.

    Returns
    -------
    Clip
        One track; ``camera`` is the nominal camera, and ``truth`` holds the ground truth.

    Raises
    ------
    InputError
        The library has no walk or no interaction, a name in the script is unknown, or no room was
        found in which the time suffices.
    """
    if not script and n_interactions < 1:
        raise InputError(f"clip {name}: {n_interactions} interactions; ask for one or more")
    fps = library[0].fps
    library = _at_rate(library, fps)
    gait = Gait.of(library if walks is None else _at_rate(walks, fps))
    bystanders = low_pieces(library)
    for _ in range(_ROOMS):
        seen_by = camera or draw_camera(rng)
        scenelets = _scripted(library, script) if script else _chosen(rng, library, n_interactions)
        acted = _act(
            rng,
            scenelets,
            gait=gait,
            bystanders=bystanders,
            camera=seen_by,
            scale=float(np.exp(rng.normal(0.0, SCALE_SPREAD))),
            n_frames=n_frames,
            n_bystanders=n_bystanders,
        )
        if acted is not None:
            break
    else:
        raise InputError(
            f"clip {name}: found no room for {len(script) or n_interactions} interactions in "
            f"{n_frames} frames; ask for more frames or fewer interactions"
        )
    hidden = hidden_joints(seen_by, acted.joints, acted.objects)
    track = simulate_track(rng, acted.joints, hidden, camera=seen_by, fps=fps)
    nominal = NOMINAL_CAMERA
    if camera is not None:
        nominal = camera.posed(pitch=nominal.pitch, roll=nominal.roll, elevation=nominal.elevation)
    return Clip(
        name=name,
        camera=nominal,
        fps=fps,
        frame_ids=np.arange(n_frames),
        tracks=(track,),
        truth=Truth(seen_by, acted.objects, acted.joints, hidden, acted.actions),
    )


def _at_rate(library: Library, fps: float) -> Library:
    """The scenelets resampled to one frame rate."""
    if all(s.fps == fps for s in library):
        return library
    changed = (
        replace(s, joints=resample(s.joints, fps=s.fps, to_fps=fps), fps=fps) for s in library
    )
    return Library(library.name, tuple(changed))


def _stays_put(scenelet: Scenelet) -> bool:
    """Whether a scenelet is an interaction with furniture that can be extended in time."""
    moved = np.ptp(scenelet.joints[:, PELV, :2], axis=0).max()
    return bool(scenelet.objects) and bool(moved < STAYS_PUT)


def _chosen(rng: np.random.Generator, library: Library, n: int) -> list[Scenelet]:
    kinds: dict[tuple[str, ...], list[Scenelet]] = {}
    for scenelet in filter(_stays_put, library):
        kinds.setdefault(scenelet.labels, []).append(scenelet)
    if not kinds:
        raise InputError(f"library {library.name}: no scenelet stays with an object")
    groups = list(kinds.values())
    order = np.concatenate([rng.permutation(len(groups)) for _ in range(-(-n // len(groups)))])
    return [groups[k][rng.integers(len(groups[k]))] for k in order[:n]]


def _scripted(library: Library, script: Sequence[str]) -> list[Scenelet]:
    by_name = {s.name: s for s in library if _stays_put(s)}
    for wanted in script:
        if wanted not in by_name:
            raise InputError(f"library {library.name}: no scenelet {wanted} that stays put")
    return [by_name[wanted] for wanted in script]


def _first(attempts: Iterable[_T | None]) -> _T | None:
    """The first attempt that succeeded, or None."""
    return next((attempt for attempt in attempts if attempt is not None), None)


def _act(
    rng: np.random.Generator,
    scenelets: Sequence[Scenelet],
    *,
    gait: Gait,
    bystanders: Sequence[SceneObject],
    camera: Camera,
    scale: float,
    n_frames: int,
    n_bystanders: int,
) -> _Acted | None:
    """One attempt to draw a room and a motion through it."""
    fps = scenelets[0].fps
    furniture: list[SceneObject] = []
    stays: list[Stay] = []
    for scenelet in scenelets:
        stay = _first(
            draw_stay(rng, scenelet, camera=camera, scale=scale, furniture=furniture)
            for _ in range(_PLACES)
        )
        if stay is None:
            return None
        stays.append(stay)
        furniture += stay.furniture(scale)
    for k in range(n_bystanders):
        stay = stays[k % len(stays)]
        piece = _first(
            draw_bystander(
                rng, bystanders, stay=stay, camera=camera, scale=scale, furniture=furniture
            )
            for _ in range(_PLACES)
        )
        furniture += [piece] if piece is not None else []
    entry = _first(
        draw_entry(rng, stays[0], camera=camera, furniture=furniture) for _ in range(_PLACES)
    )
    if entry is None:
        return None
    points = [entry, *(stay.approach for stay in stays)]
    routes: list[Array] = []
    for start, end in pairwise(points):
        route = find_route(rng, start, end, camera=camera, furniture=furniture)
        if route is None:
            return None
        routes.append(route)
    motion = walk_between(
        rng,
        stays,
        routes,
        gait=gait,
        n_frames=n_frames,
        scale=scale,
        fps=fps,
        shortest_stay=round(SHORTEST_STAY * fps),
    )
    if motion is None:
        return None
    joints, which = motion
    if in_image(camera, joints).mean(1).min() < FEWEST_IN_IMAGE:
        return None
    actions = [scenelets[k].action if k >= 0 else "walk" for k in which]
    return _Acted(tuple(furniture), joints, tuple(ACTION_WORDS.get(a, a) for a in actions))
