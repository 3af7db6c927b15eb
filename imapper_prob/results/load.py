"""A finished run, opened again from its folder alone."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from imapper_prob.config import from_toml
from imapper_prob.files import require_intact
from imapper_prob.models.errors import InputError
from imapper_prob.results.checks import from_json
from imapper_prob.results.posterior import Posterior
from imapper_prob.results.provenance import seconds_of
from imapper_prob.results.stored_input import read_source
from imapper_prob.results.stored_samples import read_samples
from imapper_prob.results.tree import FORMAT

__all__ = ["load_posterior"]

_SAID = (
    "agreement", "clip", "clip_digest", "config", "config_digest", "library", "library_digest",
    "program", "seed", "verdict",
)  # fmt: skip
"""Attributes that reports quote."""


def load_posterior(folder: str | Path) -> Posterior:
    """Open the run in a folder: its draws, scenes, clip and recording.

    Nothing is solved or sampled again, and neither clip nor library need be there any more.
    The normal numbers that the paths were drawn with are kept in single precision; so are the
    motions.

    Parameters
    ----------
    folder : path
        Of ``imapper-prob run``, with its ``posterior.nc``.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another program or an earlier version.

    Examples
    --------
    >>> import imapper_prob as im
    >>> im.load_posterior("out").scenes(3)  # doctest: +SKIP
    """
    path = Path(folder) / "posterior.nc"
    if not path.is_file():
        raise InputError(f"{path}: no such file; name the folder of a finished run")
    require_intact(path)
    try:
        with xr.open_datatree(path, engine="h5netcdf") as opened:
            tree = opened.load()
    except Exception as error:  # xarray, h5netcdf and h5py each have their own way to fail
        raise InputError(f"{path}: damaged, or not the posterior of a run; run it again") from error
    if tree.attrs.get("format") != FORMAT:
        raise InputError(f"{path}: not the posterior of a run of this version; run the clip again")
    groups = tree.to_dict()
    try:
        source = read_source(path, groups)
        samples = read_samples(groups, source)
        seconds, said = seconds_of(tree.attrs), {name: str(tree.attrs[name]) for name in _SAID}
        from_json(str(tree.attrs.get("checks", "[]")))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is not what a run wrote ({error}); run it again") from error
    config = from_toml(said["config"], where=str(path))
    return Posterior(source, samples, config, seconds=seconds, stored=tree)
