"""How deep i3DB's true people stand in its true furniture, and its furniture in each other.

``python -m benchmarks.true_crossings I3DB_FOLDER``: what "furniture may stand out of the way" in
``docs/decisions.md`` rests on. The person is the five columns that the model takes a body for,
furniture the cuboids of its annotation; every frame counts, those that use the object too.
"""

from __future__ import annotations

import argparse
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imapper_prob.inputs.i3db import read_i3db, read_i3db_truth
from imapper_prob.models.energy.intersection import footprint_depth
from imapper_prob.models.geometry import pack_boxes
from imapper_prob.models.kernels.body import depth_in_box, set_columns
from imapper_prob.models.scene import SceneObject

Array = NDArray[np.float64]


def deepest(joints: Array, furniture: SceneObject) -> float:
    """Metres that bodies (T, 3, 16) stand in the deepest part of a piece, at the worst moment."""
    boxes = pack_boxes([furniture])
    half_diagonal = np.sqrt((boxes[:, 3:6] ** 2).sum(1))
    turns = np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6]), half_diagonal], 1)
    columns, ground = np.empty((1, 5, 4)), np.empty((1, 4))
    found = 0.0
    for t in range(len(joints)):
        set_columns(joints, t, columns, ground, 0)
        found = max(found, *(depth_in_box(columns, 0, boxes, turns, k) for k in range(len(boxes))))
    return found


def main() -> None:
    """Print each piece's depth, and the root mean square over all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenes", type=Path)
    depths, overlaps = [], []
    for folder in sorted(p for p in parser.parse_args().scenes.iterdir() if (p / "gt").is_dir()):
        truth = read_i3db_truth(folder, read_i3db(folder))
        joints = np.ascontiguousarray(truth.joints.transpose(0, 2, 1))
        known = joints[np.isfinite(joints).all((1, 2))]
        for furniture in truth.objects:
            depths.append(deepest(known, furniture))
            sys.stdout.write(f"{folder.name} {furniture.label}: {depths[-1]:.2f} m\n")
        for one, other in combinations(truth.objects, 2):
            of = [(a, b) for a in pack_boxes([one]) for b in pack_boxes([other])]
            overlaps.append(max(footprint_depth(a, b) for a, b in of))
    rms = float(np.sqrt(np.mean(np.square(depths))))
    sys.stdout.write(
        f"{len(depths)} pieces: root mean square {rms:.2f} m, at most {max(depths):.2f}; "
        f"{np.count_nonzero(overlaps)} of {len(overlaps)} pairs of pieces in each other, by up to "
        f"{max(overlaps):.2f} m\n"
    )


if __name__ == "__main__":
    main()
