"""Do programs of two versions say the same to the last bit? Digests of what short runs leave.

    python -m lab.digests FILE [--only NAME ...]

makes the runs below and writes the SHA-256 of every array of their posteriors to ``FILE``, JSON. If
``FILE`` is there, nothing is written: what differs is listed, and the exit code is 1. Digests hold
on one machine and its versions of numpy and numba only.

- ``one-worker``, ``two-workers``: the demo; the two must be equal.
- ``resumed``: the same, killed after its first checkpoint and taken up again; equal to the two.
- ``paper``: the demo under the preset ``paper``.
- ``couple``: two people at one table.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from imapper_prob.api import demo_clip
from imapper_prob.clips.load import write_clip
from imapper_prob.config import Config, SampleSettings, to_toml
from imapper_prob.files import written_whole
from imapper_prob.results.folders import CHECKPOINTS
from imapper_prob.scenelets.library import save_library
from lab.couple import at_one_table, chairs_and_tables

__all__ = ["differences", "digests"]

SETTINGS: Final = SampleSettings(
    chains=2, steps=600, draws=40, temperatures=3, ensemble_steps=4,
)  # fmt: skip
"""Short settings in which every stage has work."""
RUNS: Final = {
    "one-worker": ("demo.npz",),
    "two-workers": ("demo.npz", "--workers", "2"),
    "resumed": ("demo.npz", "--workers", "2"),
    "paper": ("demo.npz", "--preset", "paper"),
    "couple": ("couple.npz", "--library", "chairs.npz"),
}
"""Arguments of ``imapper-prob run``."""
EQUAL: Final = ("one-worker", "two-workers", "resumed")


def digests(posterior: Path) -> dict[str, str]:
    """SHA-256 digests of the arrays of a posterior, by group and name.

    Parameters
    ----------
    posterior : Path
        File ``posterior.nc`` of a run. Its attributes, which contain times, are left out.
    """
    found = {}
    with xr.open_datatree(posterior, engine="h5netcdf") as tree:
        for node in tree.subtree:
            for name, variable in node.to_dataset(inherit=False).variables.items():
                values = np.ascontiguousarray(variable.values)
                if values.dtype.kind in "OU":
                    content = json.dumps(values.tolist()).encode()
                else:
                    content = values.tobytes()
                text = f"{values.dtype.str}{values.shape}".encode()
                found[f"{node.path}/{name}"] = hashlib.sha256(text + content).hexdigest()[:16]
    return found


def differences(first: dict[str, str], second: dict[str, str]) -> list[str]:
    """Names of arrays that differ, or that only one has."""
    names = sorted({*first, *second})
    return [name for name in names if first.get(name) != second.get(name)]


def prepare(folder: Path) -> None:
    """Write the input files of the runs."""
    write_clip(folder / "demo.npz", demo_clip())
    write_clip(folder / "couple.npz", at_one_table(1))
    save_library(chairs_and_tables(1), folder / "chairs.npz")
    (folder / "config.toml").write_text(to_toml(Config(sample=SETTINGS)), encoding="utf-8")


def made(folder: Path, name: str) -> dict[str, str]:
    """Digests of a run of that name, made in ``folder``."""
    output = folder / name
    command = [
        sys.executable, "-m", "imapper_prob.cli", "run", *RUNS[name], "-o", str(output),
        "--config", "config.toml", "--seed", "3",
    ]  # fmt: skip
    if name == "resumed":
        _killed(command, folder, output)
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"run {name} ended with {done.returncode}:\n{done.stderr}")
    return digests(output / "posterior.nc")


def _killed(command: Sequence[str], folder: Path, output: Path) -> None:
    """Start a run and kill it once there is a checkpoint."""
    running = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while running.poll() is None and not any((output / CHECKPOINTS).glob("*")):
        time.sleep(0.05)
    if running.poll() is not None:
        raise RuntimeError("the run that was to be killed was over before its first checkpoint")
    running.kill()
    running.wait()


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the runs; write their digests, or compare them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="of digests, JSON")
    parser.add_argument("--only", choices=tuple(RUNS), nargs="+", default=tuple(RUNS))
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        prepare(Path(name))
        found = {run: made(Path(name), run) for run in options.only}
    wrong = [
        f"{run}: {array} is not that of {EQUAL[0]}"
        for run in EQUAL[1:]
        if run in found and EQUAL[0] in found
        for array in differences(found[EQUAL[0]], found[run])
    ]
    if options.file.exists():
        before = json.loads(options.file.read_text("utf-8"))
        for run, own in found.items():
            wrong += [f"{run}: {array} differs" for array in differences(before.get(run, {}), own)]
    else:
        with written_whole(options.file) as beside:
            beside.write_text(json.dumps(found, indent=1), encoding="utf-8")
    sys.stdout.write("".join(f"{line}\n" for line in wrong) or "all arrays are the same\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
