"""Writing a run's folder where something is already."""

from __future__ import annotations

from pathlib import Path

from imapper_prob.output import write_run
from tests.runs import posterior


def test_a_link_to_a_folder_stays_and_its_contents_are_replaced(tmp_path: Path) -> None:
    real, link = tmp_path / "disk" / "run", tmp_path / "run"
    write_run(real, posterior(), overwrite=False)
    before = (real / "scenes.json").read_bytes()
    (real / "scenes.json").write_bytes(b"an earlier run")
    link.symlink_to(real)
    write_run(link, posterior(), overwrite=True)
    assert link.is_symlink()
    assert (link / "scenes.json").read_bytes() == before
    assert sorted(p.name for p in real.parent.iterdir()) == ["run"]
