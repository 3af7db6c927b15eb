"""What pulls rooms towards the camera or away from it.

``python benchmarks/scale.py RUN [RUN ...]`` takes folders of finished runs. A room with everybody
in it a twentieth larger, as much further away and seen from as much higher up gives the same
picture: only the prior of the body's scale should tell. For each run one row: the mean over draws
of what each term of the log-posterior gains by that, nats; positive pulls people away from the
camera.

Over draws these means sum to nothing, whatever the model is: a density that is shifted along its
own directions stays one. A term that does not vanish holds the others in balance.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.models.posterior import State, term_names, terms
from imapper_prob.models.problem import Problem
from imapper_prob.results.load import load_posterior

Array = NDArray[np.float64]

LARGER = 0.05
STEP = 0.01
"""Log scale of the central difference."""
DRAWS = 200


def scaled(state: State, log_factor: float) -> State:
    """The room as a whole larger, about the point on the floor below the camera."""
    factor, camera = np.exp(log_factor), np.array(state.camera)
    camera[1] *= factor
    camera[3] += log_factor
    placements = state.placements * [factor, factor, 1.0]
    return State(camera, state.items, placements, state.sizes, state.latent)


def pulls(problem: Problem, state: State) -> Array:
    """(10,) nats that each term gains when the room is a twentieth larger."""
    less, more = (np.array(list(terms(problem, scaled(state, d)).values())) for d in (-STEP, STEP))
    gained = (more - less) * LARGER / (2 * STEP)
    # Places are so much denser in a smaller room, where there are as many fewer of them.
    gained[term_names(problem).index("placement")] += 2 * LARGER * state.n_scenelets
    return gained


def main() -> None:
    """Print the table."""
    rows = []
    for folder in sys.argv[1:]:
        posterior = load_posterior(folder)
        problem, states = posterior.solution.problem, posterior.samples.states
        chosen = np.linspace(0, len(states) - 1, min(DRAWS, len(states))).astype(int)
        mean = np.mean([pulls(problem, states[k]) for k in chosen], axis=0)
        scales = np.array([state.camera[3] for state in states])
        rows.append(
            f"| {Path(folder).parent.name} | {scales.mean():+.3f} ± {scales.std():.3f} | "
            + " | ".join(f"{nats:+.2f}" for nats in mean)
            + " |"
        )
        names = term_names(problem)
    print("| run | log body scale | " + " | ".join(names) + " |")
    print("|---|---|" + "---:|" * len(names))
    print("\n".join(rows))


if __name__ == "__main__":
    main()
