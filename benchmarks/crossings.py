"""How many skeletons of two people who walk past each other are given to the right one.

``python -m benchmarks.crossings [CROSSINGS]``: simulated crossings, 50 for each share of missing
skeletons and frame rate if not given.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from imapper_prob.tracking.associate import associate
from tests.tracking.crossings import simulate_crossing


def main() -> None:
    """Print a line for each share of missing skeletons and each frame rate."""
    crossings = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    for missing in (0.0, 0.2, 0.4):
        for fps in (10.0, 30.0):
            right = total = swapped = 0
            start = time.process_time()
            for seed in range(crossings):
                crossing = simulate_crossing(np.random.default_rng(seed), missing=missing, fps=fps)
                rows = associate(
                    crossing.frames, crossing.keypoints, crossing.confidences, people=2
                )
                found = np.full(len(crossing.frames), -1)
                for actor, own in enumerate(rows):
                    found[own] = actor
                best = max((found == crossing.truth).sum(), (found == 1 - crossing.truth).sum())
                right, total = right + best, total + len(found)
                swapped += bool(best < 0.9 * len(found))
            seconds = (time.process_time() - start) / crossings
            sys.stdout.write(
                f"{missing:.0%} missing, {fps:.0f} a second: {right / total:.2%} of {total} "
                f"skeletons right, {swapped} of {crossings} exchanged, {seconds:.2f} s each\n"
            )


if __name__ == "__main__":
    main()
