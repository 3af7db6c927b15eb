"""A run that keeps one draw a chain, of which no error can be given."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from imapper_prob.api import demo_clip
from imapper_prob.cli import main
from imapper_prob.clips.load import write_clip
from imapper_prob.evaluate.suite import first_part
from imapper_prob.models.scenelet import Library
from imapper_prob.results.load import load_posterior
from imapper_prob.scenelets.library import load_library, save_library

ONE = "[sample]\nsteps = 60\ndraws = 1\ntemperatures = 2\nchains = 2\nensemble_steps = 2\n"
SAID = "Not converged: there is one draw a chain, from which no error can be given."


def test_one_draw_a_chain_has_no_error_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "one.toml").write_text(ONE)
    write_clip(tmp_path / "clip.npz", first_part(demo_clip(), 0.5))
    save_library(Library("part", tuple(load_library())[::8]), tmp_path / "part.npz")
    out = str(tmp_path / "out")
    arguments = ["run", str(tmp_path / "clip.npz"), "--config", str(tmp_path / "one.toml")]
    arguments += ["--library", str(tmp_path / "part.npz")]
    assert main([*arguments, "--workers", "1", "-o", out]) == 0
    for command in (["info", out], ["info", "--energy", out], ["report", out]):
        assert main(command) == 0
    found = capsys.readouterr()
    page = re.sub(r"(?s)<script.*?</script>", "", (tmp_path / "out" / "report.html").read_text())
    posterior = load_posterior(out)
    texts = [found.out, found.err, page, *map(repr, posterior.layouts(9))]
    texts += [*map(repr, posterior.clusters()), *map(str, posterior.questions())]
    for text in texts:
        assert not re.search(r"\bnan\b", text)
    assert SAID in " ".join(found.out.split())
    assert SAID in page
    assert "One draw a chain: no error of its probability can be given." in page
    assert re.search(r"\d\.\d\d ± unknown", found.out)
    assert all("± unknown" in repr(layout) for layout in posterior.layouts(9))
