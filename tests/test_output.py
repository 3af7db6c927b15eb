"""Writing a run's folder where something is already."""

from __future__ import annotations

import shutil
from pathlib import Path

from PIL import Image

from imapper_prob.results.folders import write_run
from tests.recording.reading import read
from tests.runs import posterior


def test_a_link_to_a_folder_stays_and_its_contents_are_replaced(
    run_of_demo: Path, tmp_path: Path
) -> None:
    real, link = tmp_path / "disk" / "run", tmp_path / "run"
    shutil.copytree(run_of_demo, real)
    before = (real / "scenes.json").read_bytes()
    (real / "scenes.json").write_bytes(b"an earlier run")
    link.symlink_to(real)
    write_run(link, posterior(), overwrite=True)
    assert link.is_symlink()
    assert (link / "scenes.json").read_bytes() == before
    assert sorted(p.name for p in real.parent.iterdir()) == ["run"]


def test_the_recording_shows_the_pictures_that_were_looked_at(
    run_of_demo: Path, tmp_path: Path
) -> None:
    clip = posterior().clip
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for frame in clip.frame_ids[:3].tolist():
        picture = Image.new("RGB", (clip.camera.width // 4, clip.camera.height // 4), "teal")
        picture.save(pictures / f"{frame}.png")
    write_run(tmp_path / "run", posterior(), overwrite=False, video=pictures)
    shown = ("/world/camera/image/video", "EncodedImage:blob")
    assert len(read(tmp_path / "run" / "recording.rrd")[shown]) == 3
    assert shown not in read(run_of_demo / "recording.rrd")
