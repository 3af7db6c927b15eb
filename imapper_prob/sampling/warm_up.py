"""Compile the kernels of chains in a second process while this one solves.

A kernel is compiled at its first call and then kept on disk (:mod:`imapper_prob.models.jit`). After
an installation that takes more than a minute: the solver compiles the kernels of the model, chains
those of their moves. Here a second process compiles the moves meanwhile, which it calls for a small
problem. Draws do not depend on it: if it fails, chains compile what is missing.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Final

import numpy as np

from imapper_prob.config import SampleSettings
from imapper_prob.models.log_posterior import empty_state
from imapper_prob.models.problem import pack_problem, with_stays
from imapper_prob.models.scenelet import Library
from imapper_prob.progress import Progress
from imapper_prob.sampling.actors import JointProblem
from imapper_prob.sampling.ascent import climb
from imapper_prob.sampling.chain import tempered
from imapper_prob.sampling.crossover import TimeCrossover
from imapper_prob.sampling.redraws import draw_scene
from imapper_prob.sampling.sample import sample_scenes, setup_of
from imapper_prob.sampling.scene import state_of
from imapper_prob.sampling.steps import MOVES, propose
from imapper_prob.sampling.visits import Visits
from imapper_prob.scenelets.charness import motion_distances
from imapper_prob.scenelets.library import load_library
from imapper_prob.simulate.clips import simulate_clip
from imapper_prob.solver.camera_prior import estimate_camera, find_stays
from imapper_prob.solver.solver import METHODS

__all__ = ["compile_kernels", "kernels_compiled_meanwhile", "main", "small_problem"]

_PART: Final = 60
"""One of so many scenelets is in the small library."""
_FRAMES: Final = 60
"""Frames of the small clip, enough for a scenelet."""
_SHORT: Final = SampleSettings(chains=2, steps=80, draws=8, temperatures=2, ensemble_steps=2)
"""Chains that call every kernel but those of the ascent of their starts."""
_CHANGES: Final = 3
"""Changes of a scene that the ascent tries: an insertion, an exchange, draws."""


@contextmanager
def kernels_compiled_meanwhile(*, wanted: bool, progress: Progress | None = None) -> Iterator[None]:
    """Compile the kernels of chains during the block if they were never compiled.

    At the end of the block it waits for the other process, because chains would have to compile the
    rest. That process ends if the block raises, and if this process ends in any way.

    Parameters
    ----------
    wanted : bool
        Whether a second process may run.
    progress : callable, optional
        Called with the name of the stage and its completed share while it waits.

    Yields
    ------
    None
    """
    if not wanted or _are_compiled():
        yield
        return
    command = [sys.executable, "-m", __name__]
    silent = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent) as other:
        try:
            yield
            if progress is not None and other.poll() is None:
                progress("compiling, once", 0.0)
            other.wait()
        finally:
            other.kill()


def _are_compiled() -> bool:
    """Whether the steps of chains are on disk, with all their moves, or nothing is ever kept."""
    folder = propose.stats.cache_path
    return folder is None or any(Path(folder).glob("steps._advance-*.nbi"))


def small_problem() -> JointProblem:
    """A problem whose arrays are of the same kinds as those of any solved clip.

    Returns
    -------
    JointProblem
    """
    library = Library("few", tuple(load_library())[::_PART])
    clip = simulate_clip(
        np.random.default_rng(0), library, n_frames=_FRAMES, n_interactions=1, n_bystanders=0
    )
    path, _ = METHODS["default"].examine(clip)
    camera = estimate_camera(clip, path)
    problem = pack_problem(clip, path, camera, library)
    problem = with_stays(problem, find_stays(clip.tracks[0], path, camera, fps=clip.fps))
    return JointProblem(
        clip, library, problem, motion_distances(library), (empty_state(problem),),
        np.zeros(_FRAMES),
    )  # fmt: skip


def compile_kernels() -> None:
    """Call every kernel of chains, first those that need none of the model.

    The model's are compiled by the solver in the meantime.
    """
    source, rng, visits = small_problem(), np.random.default_rng(0), Visits()
    visits.note(source.states[0])
    moves = tempered(setup_of(source, _SHORT), visits).moves
    scene = draw_scene(moves.reference, rng)
    for move in range(len(MOVES)):
        propose(moves, move, rng, scene)
    TimeCrossover(source.problem)(rng, state_of(scene), state_of(scene))
    sample_scenes(source, _SHORT, seed=np.random.SeedSequence(0))
    while not len(scene.items):
        scene = draw_scene(moves.reference, rng)
    changes = iter(range(_CHANGES))
    climb(
        source.problem, moves, state_of(scene), rng, most=10**6,
        report=lambda _=None: next(changes, None) is not None,
    )  # fmt: skip


def _end_with_parent() -> None:
    """End this process when its parent, which never writes to it, is gone."""
    # Not `sys.stdin.read`: Python aborts if a thread holds a lock of a stream at the end.
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> None:
    """Compile as a process of :func:`kernels_compiled_meanwhile`."""
    Thread(target=_end_with_parent, daemon=True).start()
    compile_kernels()


if __name__ == "__main__":
    main()
