"""Settings survive TOML, and wrong ones are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from imapper_prob.config import Config, SampleSettings, read_config, to_toml
from imapper_prob.models.errors import InputError
from imapper_prob.models.settings import ModelSettings


def test_settings_survive_a_file(tmp_path: Path) -> None:
    config = Config(
        seed=5,
        library='odd "name" \\ here',
        model=replace(ModelSettings(), pose_tolerance=(0.1,) * 16),
        sample=replace(SampleSettings(), steps=50_000),
    )
    path = tmp_path / "config.toml"
    path.write_text(to_toml(config))
    assert read_config(path) == config


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sed = 3", "unknown setting 'sed'"),
        ("[model]\nsight_width = 'wide'", "must be of type float"),
        ("[model]\nsight_width = -1.0", r"config\.toml \[model\]: .*must be positive"),
        ("[model]\nlikelihood = -1.0", "likelihood = -1.0 must not be negative"),
        ("[model]\npose_tolerance = 0.08", "must be a list of numbers"),
        ("[model]\npose_tolerance = [0.1, 0.1]", "must be 16 positive numbers, of RANK"),
        ("[sample]\nsteps = true", "must be of type int"),
        ("[model]\nsurprise = 0.02", "key surprise; it is called visibility_error"),
        ("[model]\nmemory_depth = 1.0", "key memory_depth; it is called correlation_time_depth"),
        ("[sample]\nswap_rate = 0.1", "unknown setting 'swap_rate'"),
        ("[sample]\nsteps = 10", "cannot be kept"),
        ("model = 3", "must be a table"),
        ("seed = ", "not a TOML file"),
        ("seed = " + "[" * 3000, "not a TOML file"),
        ("seed = " + "9" * 5000, "not a TOML file"),
        ("seed = " + "9" * 50, "too large to be true"),
        ("seed = -1", "must be at least 0"),
        (f"seed = {2**63}", "must be less than 2\\^63"),
    ],
)
def test_a_wrong_setting_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_config(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_config(tmp_path / "missing.toml")
