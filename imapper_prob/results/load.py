"""Open a finished run from its folder."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from imapper_prob.config import from_toml
from imapper_prob.files import require_intact
from imapper_prob.models.errors import InputError
from imapper_prob.results.posterior import Posterior
from imapper_prob.uncertainty.checks import from_json
from imapper_prob.uncertainty.stored import read_samples, read_source
from imapper_prob.uncertainty.tree import FORMAT, seconds_of, told_of

__all__ = ["load_posterior"]

_SAID = (
    "clip", "clip_digest", "config", "config_digest", "ensembles", "library", "library_digest",
    "program", "seed", "verdict",
)  # fmt: skip
"""Attributes that reports show."""


def load_posterior(folder: str | Path) -> Posterior:
    """Open a run from its folder: draws, scenes, clip and recording.

    Nothing is solved or sampled again, and neither clip nor library files are needed. The latent
    variables of paths are stored in single precision, and so are motions.

    Parameters
    ----------
    folder : path
        Folder of ``imapper-prob run``, or the ``posterior.nc`` in it.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        The file is missing, damaged, of another program or of an earlier version.

    Examples
    --------
    >>> im.load_posterior("run").clip.name
    'demo'
    """
    path = Path(folder)
    if path.name != "posterior.nc":
        path = path / "posterior.nc"
    if not path.is_file():
        raise InputError(f"{path}: no such file; name the folder of a finished run")
    require_intact(path)
    try:
        with xr.open_datatree(path, engine="h5netcdf") as opened:
            tree = opened.load()
    except Exception as error:  # the exceptions of xarray, h5netcdf and h5py differ
        raise InputError(f"{path}: damaged, or not the posterior of a run; run it again") from error
    if tree.attrs.get("format") != FORMAT:
        raise InputError(f"{path}: not the posterior of a run of this version; run the clip again")
    groups = tree.to_dict()
    try:
        source = read_source(path, groups)
        samples = read_samples(groups, source)
        told = told_of(tree.attrs)
        seconds, said = seconds_of(tree.attrs), {name: str(tree.attrs[name]) for name in _SAID}
        from_json(str(tree.attrs.get("checks", "[]")))
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is not what a run wrote ({error}); run it again") from error
    config = from_toml(said["config"], where=str(path))
    return Posterior(source, samples, config, seconds=seconds, stored=tree, told=told)
