"""Files and folders under faults of the disk, kills, and other processes."""

from __future__ import annotations

import errno
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from imapper_prob import files
from imapper_prob.files import (
    folder_held,
    folder_published,
    require_intact,
    require_own,
    written_whole,
)
from imapper_prob.models.errors import InputError

NAMES = ("a.txt", "b.txt", "c.txt", "models", "late.txt")
OLD = {"a.txt": "old a", "b.txt": "old b", "models/1": "old 1", "models/2": "old 2"}
NEW = {"a.txt": "new a", "c.txt": "new c", "models/1": "new 1"}


def publish(folder: Path, contents: dict[str, str]) -> None:
    with folder_published(folder, names=NAMES) as beside:
        for name, text in contents.items():
            (beside / name).parent.mkdir(exist_ok=True)
            (beside / name).write_text(text)


def contents(folder: Path) -> dict[str, str]:
    """What a user finds there."""
    found = [p.relative_to(folder) for p in folder.rglob("*") if p.is_file()]
    return {
        p.as_posix(): (folder / p).read_text() for p in found if not files._is_hidden(p.parts[0])
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an earlier result, and a file that was added to it later."""
    publish(tmp_path / "out", OLD)
    (tmp_path / "out" / "late.txt").write_text("late")
    return tmp_path / "out"


def test_a_new_result_takes_the_place_of_the_old_one(folder: Path) -> None:
    publish(folder, NEW)
    assert contents(folder) == NEW
    assert sorted(p.name for p in folder.iterdir()) == ["a.txt", "c.txt", "manifest.json", "models"]


def test_a_mount_point_is_written_into(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace, rmdir = os.replace, os.rmdir

    def refuse(error: int) -> None:
        raise OSError(error, os.strerror(error))

    def replaced(old: Path, new: Path) -> None:
        # Neither can the mount point be renamed, nor anything be renamed into it.
        if folder in (Path(old), Path(new)):
            refuse(errno.EBUSY)
        if (folder in Path(old).parents) != (folder in Path(new).parents):
            refuse(errno.EXDEV)
        if Path(new).name == "c.txt":  # a mount point of its own
            refuse(errno.EBUSY)
        replace(old, new)

    def removed(path: Path, **options: object) -> None:
        if folder == Path(path):
            refuse(errno.EBUSY)
        rmdir(path, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "replace", replaced)
    monkeypatch.setattr(os, "rename", replaced)
    monkeypatch.setattr(os, "rmdir", removed)
    (folder / "c.txt").write_text("mounted")
    publish(folder, NEW)
    assert contents(folder) == NEW


def test_a_failure_before_all_is_written_leaves_the_old_result(folder: Path) -> None:
    for error in (OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()):
        with (
            suppress(InputError, KeyboardInterrupt),
            folder_published(folder, names=NAMES) as beside,
        ):
            (beside / "a.txt").write_text("half")
            raise error
        assert contents(folder) == OLD | {"late.txt": "late"}
        assert not (folder / ".partial").exists()


def steps_of(monkeypatch: pytest.MonkeyPatch, run: Callable[[], None]) -> int:
    """How many renamings and removals a function does."""
    steps = 0

    def counted(function: Callable[..., None]) -> Callable[..., None]:
        def call(*arguments: object, **options: object) -> None:
            nonlocal steps
            steps += 1
            function(*arguments, **options)

        return call

    with monkeypatch.context() as patch:
        for name in ("replace", "unlink", "fsync"):
            patch.setattr(os, name, counted(getattr(os, name)))
        run()
    return steps


class Killed(BaseException):
    """Stands for the end of the process: nothing is caught or cleaned after it."""


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), Killed()])
def test_after_a_failure_at_any_step_the_old_or_the_new_result_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: BaseException
) -> None:
    publish(tmp_path / "probe", OLD)
    steps = steps_of(monkeypatch, lambda: publish(tmp_path / "probe", NEW))
    outcomes = []
    for at in range(steps):
        folder = tmp_path / f"{at}"
        publish(folder, OLD)
        left = at

        def failing(function: Callable[..., None]) -> Callable[..., None]:
            def call(*arguments: object, **options: object) -> None:
                nonlocal left
                left -= 1
                # Who is killed does nothing any more.
                if left == -1 or (left < 0 and isinstance(fault, Killed)):
                    raise fault
                function(*arguments, **options)

            return call

        with monkeypatch.context() as patch:
            for name in ("replace", "unlink", "fsync", "rmdir"):
                patch.setattr(os, name, failing(getattr(os, name)))
            # What is left over in the end is removed by the next one.
            with suppress(InputError, Killed):
                publish(folder, NEW)
        with folder_held(folder):
            pass
        outcomes.append(contents(folder))
        assert outcomes[-1] in (OLD, NEW)
        require_intact(folder / "a.txt")
        publish(folder, NEW)
        assert contents(folder) == NEW
    assert outcomes[0] == OLD
    assert outcomes[-1] == NEW
    assert outcomes == sorted(outcomes, key=lambda found: found == NEW)


def test_a_changed_file_is_not_taken_for_the_one_that_was_written(folder: Path) -> None:
    require_intact(folder / "a.txt")
    (folder / "a.txt").write_text("old A")
    with pytest.raises(InputError, match=r"a\.txt: is not the file that was written"):
        require_intact(folder / "a.txt")
    with written_whole(folder / "a.txt") as beside:
        beside.write_text("made again")
    require_intact(folder / "a.txt")
    require_intact(folder / "late.txt")
    (folder / "manifest.json").write_text('{"format": "imapper-prob manifest 1", "files": {"../x"')
    with pytest.raises(InputError, match=r"manifest\.json: damaged"):
        require_intact(folder / "a.txt")


def hold(folder: str, ready: str) -> None:
    with folder_held(Path(folder)):
        Path(ready).touch()
        time.sleep(60)


def test_one_process_at_a_time_writes_to_a_folder(tmp_path: Path) -> None:
    folder, ready = tmp_path / "out", tmp_path / "ready"
    holder = multiprocessing.get_context("spawn").Process(
        target=hold, args=(str(folder), str(ready))
    )
    holder.start()
    try:
        while not ready.exists():
            assert holder.is_alive()
            time.sleep(0.02)
        with pytest.raises(InputError, match=f"process {holder.pid} of .* is writing here"):
            folder_held(folder).__enter__()
    finally:
        assert holder.pid is not None
        os.kill(holder.pid, signal.SIGKILL)
        holder.join()
    (folder / ".partial").mkdir()  # of a process with the same number, perhaps
    (folder / ".scenes.partial-17.json").touch()
    (folder / "checkpoints" / ".problem-abc").mkdir(parents=True)
    with folder_held(folder):
        assert not (folder / ".partial").exists()
        assert not (folder / ".scenes.partial-17.json").exists()
        assert not (folder / "checkpoints" / ".problem-abc").exists()
    assert not (folder / ".lock").exists()


def test_a_folder_that_cannot_be_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "pool")
    (tmp_path / "pool").symlink_to(tmp_path / "loop")
    (tmp_path / "file").touch()
    for folder in (tmp_path / "loop", tmp_path / "loop" / "x", tmp_path / "file" / "x"):
        with pytest.raises(InputError, match=r"cannot be written|is a file"):
            files.require_writable(folder)


def test_the_manifest_is_a_file_of_the_run(folder: Path) -> None:
    with pytest.raises(InputError, match="is a file of the run"):
        files.require_output(folder / "manifest.json", ".json")
    files.require_output(folder / "other.json", ".json")


def test_a_long_name_is_written(tmp_path: Path) -> None:
    path = tmp_path / f"{'😀' * 60}.txt"
    with written_whole(path) as beside:
        beside.write_text("x")
    assert path.read_text() == "x"


def test_own_files_and_results_above_are_named(folder: Path) -> None:
    (folder / "mine.glb").touch()
    with pytest.raises(InputError, match=r"move mine.glb elsewhere, or name another folder"):
        require_own(folder, NAMES, what="run", overwrite=True)
    with pytest.raises(InputError, match=f"is inside {folder}, which holds another result"):
        require_own(folder / "sub" / "sub", NAMES, what="run", overwrite=False)
    other = folder.parent / "other"
    other.mkdir()
    (other / "manifest.json").write_text('{"name": "a web page"}')
    require_own(other / "sub", NAMES, what="run", overwrite=False)
