"""Atomic writing of files and of folders of results.

A folder's files are published one by one, because the folder may be a mount point or on a network
drive. No file of an earlier result is removed before its successor is written:

1. all files are written into ``.partial`` inside the folder, each flushed to the disk;
2. ``.partial/manifest.json`` with their sizes and checksums marks them as complete;
3. each file is renamed to its place, then files that only the earlier result has are removed;
4. the manifest is moved last.

If a process ends before step 2, the earlier result is unchanged. If it ends after step 2, the next
process that holds the folder completes the renaming.
"""

from __future__ import annotations

import errno
import getpass
import hashlib
import json
import math
import os
import shutil
import socket
import time
import tomllib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

import numpy as np

from imapper_prob.models.errors import InputError
from imapper_prob.models.text import readable

try:
    import fcntl
except ImportError:  # systems without such locks exclude nobody
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "disk_errors_named", "folder_held", "folder_published", "parse_toml", "read_text", "read_toml",
    "require_intact", "require_output", "require_own", "require_writable", "without_nan",
    "written_whole",
]  # fmt: skip

_MANIFEST: Final = "manifest.json"
_FORMAT: Final = "imapper-prob manifest 1"
_STAGE: Final = ".partial"
_LOCK: Final = ".lock"
_LEFT_BY_A_KILL: Final = (".*.partial-*", ".problem-*")
"""Patterns of temporary files of :func:`written_whole` and of processes of chains."""
_LONGEST_NAME: Final = 100
"""Bytes of a name that a temporary file's name repeats; file systems allow 255."""
_LARGEST_TEXT: Final = 128 << 20
"""Largest text file in bytes, as JSON an hour of one person at 30 Hz; it takes twenty times that in
memory."""
_NO_RENAME: Final = (errno.EXDEV, errno.EBUSY)
"""Errors on renaming to a file that is a mount point: its content is replaced instead."""
_NO_LOCKS: Final = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL)
"""Errors of network drives without locks, on which nobody is excluded."""
_NO_FLUSH: Final = (errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EBADF)
"""Errors of file systems that cannot flush folders."""


@contextmanager
def disk_errors_named(path: Path) -> Iterator[None]:
    """Turn errors of the disk into input errors that name the path.

    Parameters
    ----------
    path : Path
        File or folder that is written.

    Yields
    ------
    None

    Raises
    ------
    InputError
        The system refuses.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, renamed to ``path`` if no exception is raised.

    An existing file stays unchanged until then, and no temporary file is left behind. The temporary
    name has the suffix of ``path``, for writers that depend on it. If a manifest lists the file, it
    is updated.

    Parameters
    ----------
    path : Path

    Yields
    ------
    Path
        Temporary path in the same folder.
    """
    stem = path.stem.encode()[:_LONGEST_NAME].decode(errors="ignore")
    beside = path.with_name(f".{stem}.partial-{uuid4().hex}{path.suffix}")
    try:
        yield beside
        _flush(beside)
        _replace(beside, path)
        _flush_folder(path.parent)
    finally:
        beside.unlink(missing_ok=True)
    _note(path)


def read_text(path: Path) -> str:
    """The text of a file of limited size, without a byte order mark.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str

    Raises
    ------
    InputError
        The file cannot be read, is a pipe or device, is too large, or is not text.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise InputError(f"{path}: is a pipe or device; write its content to a file first")
        size = path.stat().st_size
        if size > _LARGEST_TEXT:
            raise InputError(f"{path}: {size / 2**20:.0f} MB, more than {_LARGEST_TEXT >> 20}")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: no text file ({error})") from error


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    dict of str to object

    Raises
    ------
    InputError
        See :func:`read_text`, or the file is not TOML.
    """
    return parse_toml(read_text(path), where=str(path))


def parse_toml(text: str, *, where: str) -> dict[str, Any]:
    """The tables of a text in TOML.

    Parameters
    ----------
    text : str
    where : str
        Name of the text's source, for messages.

    Returns
    -------
    dict of str to object

    Raises
    ------
    InputError
        The text is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also covers numbers of more than 4,300 digits
        raise InputError(f"{where}: not a TOML file ({error})") from error


def without_nan(value: Any) -> Any:
    """Replace numbers that JSON cannot represent by ``None``.

    Parameters
    ----------
    value : object
        Dictionaries, sequences, text and numbers.

    Returns
    -------
    object
        The same structure; sequences are lists.
    """
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


@contextmanager
def folder_held(folder: Path) -> Iterator[Path]:
    """Lock a folder, made if necessary, so that no other process writes to it.

    An unfinished publication of a killed process is completed, or its temporary files are removed.
    A folder that was made here and stays empty is removed.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    Path
        The folder with symbolic links resolved.

    Raises
    ------
    InputError
        Another process holds the folder, or a file operation fails.
    """
    with disk_errors_named(folder):
        folder = _resolved(folder)
        made = _make(folder)
    try:
        with disk_errors_named(folder):
            descriptor = _lock(folder)
        try:
            with disk_errors_named(folder):
                _settle(folder)
            yield folder
        finally:
            with suppress(OSError):
                (folder / _LOCK).unlink(missing_ok=True)
            os.close(descriptor)
    finally:
        _unmake(made)


@contextmanager
def folder_published(folder: Path, *, names: Collection[str]) -> Iterator[Path]:
    """Yield a folder inside ``folder`` to write to, published if no exception is raised.

    Parameters
    ----------
    folder : Path
        Locked by this process, see :func:`folder_held`, or not existing.
    names : collection of str
        All names that results of this kind may have. Those that the new result lacks are removed
        after it is in place.

    Yields
    ------
    Path
        A stage inside ``folder``.

    Raises
    ------
    InputError
        A file operation fails. The folder is unchanged, or the next process that holds it completes
        it.
    """
    with disk_errors_named(folder):
        folder = _resolved(folder)
        made = _make(folder)
        stage = folder / _STAGE
        shutil.rmtree(stage, ignore_errors=True)
        stage.mkdir()
        try:
            yield stage
            files = {name: _entry(stage / name) for name in _files(stage)}
            for name in files:
                _flush(stage / name)
            old = _stale(folder, files, names)
            document = {"format": _FORMAT, "files": files, "stale": old}
            with written_whole(stage / _MANIFEST) as beside:
                beside.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        finally:
            if not (stage / _MANIFEST).is_file():
                shutil.rmtree(stage, ignore_errors=True)
                _unmake(made)
        _roll_forward(folder)


def require_own(
    folder: Path,
    files: Collection[str],
    *,
    what: str,
    overwrite: bool,
    unfinished: str = "",
    resumes: bool = False,
) -> None:
    """Refuse an output folder that is not writable or holds files that must not be replaced.

    Parameters
    ----------
    folder : Path
    files : collection of str
        Names of the files of a result of this kind.
    what : str
        Kind of the result: ``run`` or ``solution``.
    overwrite : bool
        Whether an earlier result may be replaced; other files never are.
    unfinished : str
        Name that exists while a result is unfinished and can be continued.
    resumes : bool
        Whether an unfinished result is continued, and so need not be protected.

    Raises
    ------
    InputError
        It is a file, holds other files or an earlier result, or is not writable.
    """
    require_writable(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the output")
    for above in folder.resolve().parents:
        if _holds_result(above):
            raise InputError(
                f"{folder}: is inside {above}, which holds another result; name a folder elsewhere"
            )
    found = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
    strange = [n for n in found if n not in files and n != unfinished and not _is_hidden(n)]
    if strange:
        raise InputError(
            f"{folder}: holds {strange[0]}, which is not of a {what}; move {strange[0]} elsewhere, "
            "or name another folder"
        )
    earlier = any(name in files or name == unfinished for name in found)
    if earlier and not overwrite and not (resumes and unfinished in found):
        raise InputError(
            f"{folder}: holds an earlier {what}; name another folder or add --overwrite"
        )


def _holds_result(folder: Path) -> bool:
    """Whether a folder has a manifest of this program."""
    with suppress(InputError, OSError):
        return (folder / _MANIFEST).is_file() and bool(_read(folder / _MANIFEST))
    return False


def _is_hidden(name: str) -> bool:
    """Whether a name belongs to the administration of a folder and not to its result."""
    temporary = any(fnmatchcase(name, pattern) for pattern in _LEFT_BY_A_KILL)
    return name in (_LOCK, _MANIFEST, _STAGE) or temporary


def require_intact(path: Path, *, below: Path | None = None) -> None:
    """Refuse a file that differs from what its folder's manifest lists.

    Files without a manifest, or not listed in it, are not checked.

    Parameters
    ----------
    path : Path
    below : Path, optional
        Folder of the manifest, if it is not the folder of the file.

    Raises
    ------
    InputError
        The file was changed, or its replacement was interrupted by a kill.
    """
    folder = path.parent if below is None else below
    if (folder / _STAGE / _MANIFEST).is_file():
        raise InputError(
            f"{folder}: its files were being put in place when that was interrupted; the command "
            "that wrote them completes it"
        )
    listed = _listed(folder).get(path.relative_to(folder).as_posix())
    if listed is None:
        return
    try:
        found = _entry(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if found != listed:
        raise InputError(
            f"{path}: is not the file that was written, its checksum differs from that in "
            f"{_MANIFEST}; copy it again, or delete {_MANIFEST} if it was changed on purpose"
        )


def require_output(path: Path, suffix: str, *, of_run: str = "") -> None:
    """Refuse a path for an output file of another kind, or of a file of a run.

    Parameters
    ----------
    path : Path
    suffix : str
        With which the name ends: ``".glb"``.
    of_run : str
        Name of the file in a run's folder that this output may replace; others are refused.

    Raises
    ------
    InputError
        The suffix differs, or the path is a folder, a file of a run, or cannot be written.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    if path.suffix != suffix:
        raise InputError(f"{path}: the name must end in {suffix}")
    absolute = path.absolute()
    for folder in absolute.parents[:2]:
        name, listed = absolute.relative_to(folder).as_posix(), {}
        with suppress(InputError):  # a damaged manifest is reported when something is read
            listed = dict(_listed(folder))
        if (name in listed and name != of_run) or (name == _MANIFEST and path.exists()):
            raise InputError(f"{path}: is a file of the run in {folder}; name another file")
    require_writable(path.parent)


def require_writable(folder: Path) -> None:
    """Refuse a folder that cannot be made or written to.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    InputError
        The folder, or its nearest existing parent, is not writable.
    """
    with disk_errors_named(folder):
        there = _resolved(folder)
        while not there.exists():
            there = there.parent
    if not there.is_dir():
        where = "" if there == folder else f"{there} "
        raise InputError(f"{folder}: {where}is a file; name another folder")
    if not os.access(there, os.W_OK):
        raise InputError(f"{folder}: {there} is not writable; name another folder")


def _resolved(folder: Path) -> Path:
    """The folder with symbolic links resolved, so that the link itself stays."""
    try:
        return folder.resolve()
    except RuntimeError as error:  # raised by Python 3.11 and 3.12 for circular links
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from error


def _make(folder: Path) -> list[Path]:
    """Make a folder; return the folders that did not exist before, the innermost first."""
    made = []
    above = folder
    while not above.exists():
        made.append(above)
        above = above.parent
    folder.mkdir(parents=True, exist_ok=True)
    return made


def _unmake(made: list[Path]) -> None:
    """Remove those of the folders that are empty."""
    for empty in made:
        with suppress(OSError):
            empty.rmdir()


def _lock(folder: Path) -> int:
    """Acquire a lock that the system releases when this process ends in any way."""
    path = folder / _LOCK
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if fcntl is not None:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = readable(os.read(descriptor, 200).decode(errors="replace"))
            os.close(descriptor)
            raise InputError(
                f"{folder}: {holder or 'another process'} is writing here; wait for it, or name "
                "another folder"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(descriptor)
                raise
        if _is_open(path, descriptor):
            with suppress(OSError):  # on a full disk the name cannot be written; the lock holds
                os.ftruncate(descriptor, 0)
                os.write(descriptor, _own_name().encode())
            return descriptor
        os.close(descriptor)  # its holder has just removed it


def _is_open(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _own_name() -> str:
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # containers may run as users without a name
        user = str(os.getuid())
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return f"process {os.getpid()} of {user} on {socket.gethostname()}, since {since},"


def _settle(folder: Path) -> None:
    """Complete or remove what a process left in the folder when it was killed."""
    if (folder / _STAGE / _MANIFEST).is_file():
        _roll_forward(folder)
    shutil.rmtree(folder / _STAGE, ignore_errors=True)
    for pattern in _LEFT_BY_A_KILL:
        for path in [*folder.glob(pattern), *folder.glob(f"*/{pattern}")]:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _roll_forward(folder: Path) -> None:
    """Move the files of a complete stage to their places; can be repeated after any failure."""
    stage = folder / _STAGE
    document = _read(stage / _MANIFEST)
    for name, listed in document["files"].items():
        if not (stage / name).is_file():
            if (folder / name).is_file() and _entry(folder / name) == listed:
                continue  # moved already by the interrupted process
            raise InputError(f"{folder}: {name} is lost from {stage}; delete that, and run again")
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        _replace(stage / name, target)
    for name in document["stale"]:
        (folder / name).unlink(missing_ok=True)
    for below in {(folder / name).parent for name in [*document["files"], *document["stale"]]}:
        if below != folder and below.is_dir():
            with suppress(OSError):  # the folder may hold other files
                below.rmdir()
            if below.is_dir():
                _flush_folder(below)
    _flush_folder(folder)
    _replace(stage / _MANIFEST, folder / _MANIFEST)
    _flush_folder(folder)
    shutil.rmtree(stage, ignore_errors=True)


def _stale(folder: Path, new: Collection[str], names: Collection[str]) -> list[str]:
    """Files of an earlier result that the new result lacks."""
    there = [name for name in _files(folder) if name.split("/")[0] in names]
    return [name for name in there if name not in new]


def _files(folder: Path) -> list[str]:
    """Files below a folder by relative path, without temporary ones."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    names = [path.relative_to(folder).as_posix() for path in paths]
    return [name for name in names if not name.startswith(".") and name != _MANIFEST]


def _entry(path: Path) -> dict[str, Any]:
    """Entry of a file in a manifest."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        size = file.tell()
    return {"size": size, "sha256": digest}


def _listed(folder: Path) -> Mapping[str, Any]:
    path = folder / _MANIFEST
    files: Mapping[str, Any] = _read(path)["files"] if path.is_file() else {}
    return files


def _read(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: damaged ({error}); delete it") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise InputError(f"{path}: is no manifest of this version; delete it")
    files, stale = document.get("files"), document.get("stale")
    if not isinstance(files, dict) or not isinstance(stale, list):
        raise InputError(f"{path}: lists no files; delete it")
    if not all(_inside(name) for name in (*files, *stale)):
        raise InputError(f"{path}: names a file elsewhere; delete it")
    return document


def _inside(name: Any) -> bool:
    """Whether a name is a relative path to a file inside the folder."""
    parts = Path(name).parts if isinstance(name, str) else ()
    return bool(parts) and not Path(name).is_absolute() and ".." not in parts


def _note(path: Path) -> None:
    """Update the entry of a replaced file in the manifest of its folder."""
    manifest = path.parent / _MANIFEST
    if path == manifest or not manifest.is_file():
        return
    with suppress(InputError):  # a damaged manifest is reported when something is read
        document = _read(manifest)
        if path.name in document["files"]:
            document["files"][path.name] = _entry(path)
            with written_whole(manifest) as beside:
                beside.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def _replace(new: Path, old: Path) -> None:
    try:
        os.replace(new, old)
    except OSError as error:
        if error.errno not in _NO_RENAME:
            raise
        shutil.copyfile(new, old)
        _flush(old)
        new.unlink()


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _flush_folder(folder: Path) -> None:
    try:
        _flush(folder)
    except OSError as error:
        if error.errno not in _NO_FLUSH:
            raise
