"""Long clips and the memory that there is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from imapper_prob import memory
from imapper_prob.api import demo_clip, sample, solve
from imapper_prob.cli import main
from imapper_prob.clips.load import load_clip, write_clip
from imapper_prob.config import SampleSettings
from imapper_prob.models.errors import InputError
from imapper_prob.scenelets.library import load_library
from lab.long_clips import long_clip
from tests.conftest import ROOT


@pytest.mark.parametrize("n_frames", [5_000, 20_000])
def test_a_clip_that_is_too_long_is_refused_before_the_work(
    n_frames: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_clip(tmp_path / "clip.npz", long_clip(n_frames))
    arguments = ["run", str(tmp_path / "clip.npz"), "-o", str(tmp_path / "out")]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert f"{n_frames} frames of 1 are too many" in said
    assert not (tmp_path / "out").exists()
    first, last = (int(text) for text in said.split("--frames ")[1].split(":"))
    part = load_clip(tmp_path / "clip.npz", frames=(first, last))
    assert part.n_frames == memory.MOST_FRAMES
    memory.require_feasible(part, load_library(), SampleSettings())


def test_a_clip_that_does_not_fit_is_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(memory, "memory_there", lambda: 4e9)
    write_clip(tmp_path / "clip.npz", long_clip(memory.MOST_FRAMES))
    arguments = ["run", str(tmp_path / "clip.npz"), "-o", str(tmp_path / "out")]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert "2000 frames of 1 need about" in said
    assert "4.0 GB are there; take parts of up to" in said
    assert not (tmp_path / "out").exists()
    last = int(said.split("--frames 0:")[1].split(",")[0])
    part = load_clip(tmp_path / "clip.npz", frames=(0, last))
    assert part.n_frames == last + 1 > 1000
    memory.require_feasible(part, load_library(), SampleSettings())
    with pytest.raises(InputError, match="GB of memory"):
        memory.require_feasible(load_clip(tmp_path / "clip.npz"), load_library(), SampleSettings())


@pytest.mark.parametrize("command", ["run", "solve"])
def test_a_clip_that_is_too_slow_for_the_library_is_refused_before_the_work(
    command: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def work(*_: object, **__: object) -> None:
        raise AssertionError("work was begun")

    monkeypatch.setattr("imapper_prob.solver.solver.fit_clip", work)
    monkeypatch.setattr("imapper_prob.solver.actors.estimate_camera", work)
    for fps in (0.01, 1.42):
        clip = replace(demo_clip(), fps=fps)
        write_clip(tmp_path / "clip.npz", clip)
        assert main([command, str(tmp_path / "clip.npz"), "-o", str(tmp_path / "out")]) == 2
        said = " ".join(capsys.readouterr().err.split())
        assert f"clip demo: {fps:g} frames a second; library built-in 4 needs at least 1.43" in said
        assert not (tmp_path / "out").exists()
        with pytest.raises(InputError, match=r"needs at least 1\.43"):
            solve(clip)
        with pytest.raises(InputError, match=r"needs at least 1\.43"):
            sample(clip)
    page = (ROOT / "docs" / "reference" / "robustness.md").read_text()
    assert "| frames a second | 1,000; at least 1.43 with the built-in library |" in page
    memory.require_feasible(replace(demo_clip(), fps=1.43), load_library())


def test_frames_of_all_people_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "memory_there", lambda: float("inf"))
    clip = long_clip(memory.MOST_FRAMES)
    memory.require_feasible(clip, load_library())
    (track,) = clip.tracks
    both = replace(clip, tracks=(track, replace(track, name="another")))
    with pytest.raises(InputError, match=r"2000 frames of 2 .* up to 1000 frames, .* 0:999"):
        memory.require_feasible(both, load_library())


@pytest.mark.parametrize(("n_frames", "gigabytes"), [(400, "2.1"), (2_000, "5.7")])
def test_what_the_pages_say_of_long_clips_is_what_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, n_frames: int, gigabytes: str
) -> None:
    page = " ".join((ROOT / "docs" / "reference" / "robustness.md").read_text().split())
    assert f"{gigabytes} GB for {n_frames:,}" in page
    clip, library = long_clip(n_frames), load_library()
    needed = float(gigabytes) * 1e9
    monkeypatch.setattr(memory, "memory_there", lambda: 1.05 * needed)
    memory.require_feasible(clip, library, SampleSettings())
    monkeypatch.setattr(memory, "memory_there", lambda: max(0.9 * needed, 1.1e9))
    with pytest.raises(InputError, match=f"need about {gigabytes} GB .* --frames 0:") as refused:
        memory.require_feasible(clip, library, SampleSettings())
    fits = int(str(refused.value).split("parts of up to ")[1].split()[0])
    assert 0 < fits < n_frames
    memory.require_feasible(long_clip(fits), library, SampleSettings())
    # To solve takes less, and is asked for by itself.
    monkeypatch.setattr(memory, "memory_there", lambda: 1.01e9)
    with pytest.raises(InputError, match="GB of memory"):
        memory.require_feasible(clip, library)
    # Where no part would fit, none is named.
    monkeypatch.setattr(memory, "memory_there", lambda: 1e8)
    with pytest.raises(InputError, match=r"0\.1 GB are there; end other programs, or take a"):
        memory.require_feasible(clip, library)


def test_frames_that_are_not_there_are_refused(tmp_path: Path) -> None:
    write_clip(tmp_path / "clip.npz", demo_clip())
    assert load_clip(tmp_path / "clip.npz", frames=(20, 49)).frame_ids[[0, -1]].tolist() == [20, 49]
    with pytest.raises(InputError, match="no frames 100 to 130; it has 0 to 129"):
        load_clip(tmp_path / "clip.npz", frames=(100, 130))
    with pytest.raises(InputError, match="a clip of 3 frames"):
        load_clip(tmp_path / "clip.npz", frames=(100, 102))


def test_memory_there_is_of_the_machine_or_of_its_container(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there, limit, used = tmp_path / "meminfo", tmp_path / "max", tmp_path / "current"
    there.write_text("MemTotal: 9000 kB\nMemAvailable: 4000 kB\n")
    monkeypatch.setattr(memory, "_AVAILABLE", there)
    monkeypatch.setattr(memory, "_GROUPS", ((limit, used),))
    assert memory.memory_there() == 4000 * 1024
    limit.write_text("3000000\n")
    used.write_text("1000000\n")
    assert memory.memory_there() == 2e6
    # What the system holds of files is free when it is needed.
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 400000\nactive_file 7\n")
    assert memory.memory_there() == 2.4e6
    (tmp_path / "memory.stat").write_text("inactive_file 1\ntotal_inactive_file 300000\n")
    assert memory.memory_there() == 2.3e6
    (tmp_path / "memory.stat").write_text("nonsense\n")
    assert memory.memory_there() == 2e6
    limit.write_text("max\n")
    there.write_text("nothing\n")
    assert memory.memory_there() == float("inf")
