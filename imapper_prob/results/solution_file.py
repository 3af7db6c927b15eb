"""``solution.json`` and ``solution.npz``: the staged solver's scenes, and how it came to them.

The JSON holds what one reads: scenes, and by actor the table of every stage. The archive holds
what one computes with: by actor (``actor0/…``, in the order of the JSON) the frames, the charness
curve and the joints of every scene. Positions are metres in the world frame, angles radians,
energies nats; frames have the input's own numbers.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from imapper_prob.files import written_whole
from imapper_prob.models.posterior import State
from imapper_prob.models.scene import SceneObject
from imapper_prob.results.solved import Solved, SolvedScene
from imapper_prob.staged.candidates import Candidate
from imapper_prob.staged.solver import Solution

__all__ = ["FORMAT", "VERSION", "solution_document", "write_solution"]

FORMAT: Final = "imapper-prob solution"
VERSION: Final = 1
_COMBINATIONS: Final = 50
"""Combinations of which the file tells members and gains; nobody reads a thousand."""


def write_solution(folder: Path, solved: Solved) -> None:
    """Write both files into a folder, each beside and then renamed."""
    text = json.dumps(solution_document(solved), indent=1, allow_nan=False, ensure_ascii=False)
    with written_whole(folder / "solution.json") as beside:
        beside.write_text(text + "\n", encoding="utf-8")
    with written_whole(folder / "solution.npz") as beside:
        np.savez_compressed(beside, allow_pickle=False, **_arrays(solved))


def solution_document(solved: Solved) -> dict[str, Any]:
    """What ``solution.json`` says."""
    library = solved.actors[0].library
    return {
        "format": FORMAT,
        "version": VERSION,
        "clip": solved.clip.name,
        "library": library.name,
        "library_digest": library.digest,
        "units": {"length": "metre", "angle": "radian", "energy": "nat"},
        "scenes": [_scene(solved, scene) for scene in solved.scenes],
        "actors": [_stages(actor) for actor in solved.actors],
    }


def _scene(solved: Solved, scene: SolvedScene) -> dict[str, Any]:
    names = [actor.clip.tracks[0].name for actor in solved.actors]
    return {
        "log_posterior": scene.log_posterior,
        "camera": asdict(scene.camera),
        "objects": [
            {**_object(o), "found_by": [names[k] for k in users]}
            for o, users in zip(scene.objects, scene.users, strict=True)
        ],
        "actors": [
            {"name": name, "scenelets": _scenelets(actor, state)}
            for name, actor, state in zip(names, solved.actors, scene.states, strict=True)
        ],
    }


def _object(o: SceneObject) -> dict[str, Any]:
    return {
        "label": o.label,
        "position": [o.placement.x, o.placement.y],
        "yaw": o.placement.yaw,
        "cuboids": [
            {"part": c.part, "centre": c.centre.tolist(), "size": c.size.tolist()}
            for c in o.cuboids
        ],
    }


def _scenelets(actor: Solution, state: State) -> list[dict[str, Any]]:
    ids = actor.clip.frame_ids
    return [
        {
            "scenelet": actor.library[scenelet].name,
            "start": int(ids[start]),
            "placement": placement.tolist(),
        }
        for (scenelet, start), placement in zip(state.items.tolist(), state.placements, strict=True)
    ]


def _stages(actor: Solution) -> dict[str, Any]:
    """Every stage's table of one actor, in the order in which they ran."""
    ids, centres = actor.clip.frame_ids, actor.curve.centres
    combinations = actor.combinations
    return {
        "name": actor.clip.tracks[0].name,
        "frames": actor.frames.counts(),
        "peaks": [
            {
                "frame": int(ids[centres[p.window]]),
                "charness": p.charness,
                "dropped": p.dropped or None,
            }
            for p in actor.curve.peaks
        ],
        "maxima": [
            {
                "frame": int(ids[centres[table.window]]),
                "counts": table.counts(),
                "candidates": [
                    {
                        **_candidate(actor, row.candidate),
                        "gain": row.candidate.gain,
                        "fit": row.fit,
                        "motion": row.motion,
                        "occlusion": row.occlusion,
                        "fate": str(row.fate),
                    }
                    for row in table.rows
                ],
            }
            for table in actor.shortlists
        ],
        "combinations": {
            "tried": len(combinations.tried),
            "complete": combinations.complete,
            "best_score_left": None if combinations.complete else combinations.left,
            "pool": [_candidate(actor, c) for c in combinations.pool],
            "best": [asdict(t) for t in combinations.tried[:_COMBINATIONS]],
        },
        "exchanges": [
            {"gain": e.gain, "candidates": [_candidate(actor, c) for c in e.candidates]}
            for e in combinations.exchanges
        ],
    }


def _candidate(actor: Solution, c: Candidate) -> dict[str, Any]:
    scenelet = actor.library[c.scenelet]
    return {
        "scenelet": scenelet.name,
        "objects": list(scenelet.labels),
        "start": int(actor.clip.frame_ids[c.start]),
        "placement": c.placement.tolist(),
        "log_size": c.size,
    }


def _arrays(solved: Solved) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {"frame": solved.clip.frame_ids}
    for k, actor in enumerate(solved.actors):
        own = f"actor{k}"
        arrays |= {
            f"{own}/joints": np.stack([scene.motions[k] for scene in solved.scenes]),
            f"{own}/pose_source": np.array([str(p) for p in actor.frames.pose]),
            f"{own}/pixel_miss": actor.frames.miss,
            f"{own}/outlier": actor.frames.outlier,
            f"{own}/static_bearing_log_depth": actor.path.estimate,
            f"{own}/window_frame": solved.clip.frame_ids[actor.curve.centres],
            f"{own}/charness": actor.curve.values,
            f"{own}/charness_unsmoothed": actor.curve.raw,
        }
    return arrays
