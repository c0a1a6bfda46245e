"""Folder of a run's results: for one run at a time, without touching users' files, or leaving those of a killed run."""

from __future__ import annotations

import json
import os
import shutil
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from trackers.errors import InputError
from twin.recording.atomic_file import partial_path, unwritable, write_atomic

LOCK = ".twin.lock"
MADE = ".made-by-twin.json"
"""List of the files that twin wrote into a folder; others are never overwritten or removed."""
EXPORTED = ".made-by-twin-export.json"
"""The same of a folder of `twin export`, with paths."""

_SUBFOLDER = "tracks"
_LONGEST_LIST_BYTES = 1_000_000
_WAIT_S = 0.3
"""Time to wait for another process about to exit."""


class OutFolder:
    """A folder of results, locked for one run; made by `out_folder`."""

    def __init__(self, path: Path, names: Sequence[str], made: set[str]) -> None:
        self.path = path
        self._names = set(names)
        self._made = made
        self._before = self._states()

    def _states(self) -> dict[str, tuple[int, int]]:
        """Return what tells each of the files that is there from another of its name."""
        found = {name: self.path / name for name in self._names if (self.path / name).is_file()}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, path in found.items() if (stat := path.stat())}

    def take_back(self) -> None:
        """Remove the files that this run has left so far: without each other, as where the disk is full, they are no use."""
        for name, state in self._states().items():
            if self._before.get(name) != state:
                (self.path / name).unlink()
        with suppress(OSError):  # it is not empty, or was not made
            (self.path / _SUBFOLDER).rmdir()

    def announce(self) -> None:
        """Note the files to be written, before the first appears, so that a failed run can be repeated."""
        self._note(self._made | self._names)

    def finish(self, written: Sequence[Path], kept: Sequence[str] = ()) -> list[str]:
        """Note the written files, and remove an earlier run's files that this one did not write, except `kept`.

        So runs do not mix in a folder, and users' files are not touched. Return a sentence about the removed ones, if any.
        """
        names = {path.relative_to(self.path).as_posix() for path in written}
        removed = [name for name in sorted(self._made - names - set(kept)) if (self.path / name).exists()]
        for name in removed:
            (self.path / name).unlink()
        self._note(names | (self._made & set(kept)))
        return [f"{self.path}: removed from the earlier run: {', '.join(removed)}"] if removed else []

    def _note(self, names: set[str]) -> None:
        write_atomic(self.path / MADE, json.dumps(sorted(names)))


@contextmanager
def out_folder(path: Path, names: Sequence[str]) -> Iterator[OutFolder]:
    """Lock the folder during the block, for files of these names (plain, or `tracks/` and plain).

    Partial files of a killed run are removed. Raises InputError where another process writes, where a file of one of the
    names exists that twin did not write, and for a malformed list of its files.
    """
    with locked_folder(path):
        made = _read_made(path)
        _check_others(path, set(names) - made)
        _clear_leftovers(path, made | set(names) | {MADE})
        yield OutFolder(path, names, made)


@contextmanager
def taken_back_on_failure(out: OutFolder) -> Iterator[None]:
    """Remove the files of a run that fails during the block."""
    try:
        yield
    except BaseException:
        out.take_back()
        raise


def check_others(folder: Path, names: Iterable[str], sign: str) -> None:
    """Raise InputError for a file of one of these names that is not twin's; `sign`: name of one that only twin writes there.

    Folders of suites, studies and the like hold it from the start, or as soon as they are whole.
    """
    if not (folder / sign).exists():
        _check_others(folder, names)


def _check_others(folder: Path, names: Iterable[str]) -> None:
    for name in sorted(names):
        if (folder / name).exists():
            raise InputError(
                f"--out {folder}: holds {name}, which twin did not write; an empty folder, or one of an earlier run, "
                "is expected"
            )


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock the folder against other processes; a missing one is made, and removed if it stays empty.

    The system releases the lock when the process ends in any way. Raises InputError where another process holds it, and
    where the folder cannot be made.
    """
    from filelock import FileLock, Timeout  # it imports asyncio

    path = folder / LOCK
    try:
        missing = [each for each in (folder, *folder.parents) if not each.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path, timeout=_WAIT_S, poll_interval=_WAIT_S / 3)
        lock.acquire()
    except Timeout:
        holder = ""
        with suppress(OSError):  # its holder has exited meanwhile
            holder = path.read_text(encoding="utf-8", errors="replace")[:200]
        raise InputError(
            f"--out {folder}: {holder or 'another process'} is writing there; another folder is expected"
        ) from None
    except OSError as error:
        raise InputError(
            f"--out {folder}: cannot be written ({error.strerror}); a folder is expected, where there is free space"
        ) from error
    try:
        with suppress(OSError):  # a full disk: the lock holds without content
            path.write_text(f"process {os.getpid()} on {socket.gethostname()}", encoding="utf-8")
        yield
    finally:
        path.unlink(missing_ok=True)  # while it is held: a process that has opened it meanwhile sees the deletion
        lock.release()
        for each in missing:
            with suppress(OSError):  # not empty, or missing
                each.rmdir()


def _read_made(folder: Path) -> set[str]:
    """Read the names in the folder's list; raises InputError for a list not written by twin."""
    path = folder / MADE
    if not path.exists() and not path.is_symlink():
        return set()
    expected = "the list of files that twin wrote there (names alone, no paths) is expected, or an empty folder"
    try:
        if path.is_symlink() or not path.is_file() or path.stat().st_size > _LONGEST_LIST_BYTES:
            raise ValueError("it is no short file")
        names = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read ({error}); {expected}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {expected}") from error
    if not isinstance(names, list):
        raise InputError(f"{path}: holds {type(names).__name__}; {expected}")
    for name in names:
        if not isinstance(name, str) or not _is_own_name(folder, name):
            raise InputError(f"{path}: {name!r} is no name of a file in this folder; {expected}")
    return set(names)


def _is_own_name(folder: Path, name: str) -> bool:
    """Return True for a plain name, or one in our own subfolder, of a file in this folder itself."""
    parts = PurePosixPath(name).parts
    plain = parts[1:] if parts[:1] == (_SUBFOLDER,) and len(parts) > 1 else parts
    if len(plain) != 1 or "/".join(parts) != name or plain[0] in (".", "..") or set(plain[0]) & {"\\", "\0"}:
        return False
    try:
        in_link = len(parts) > 1 and (folder / _SUBFOLDER).is_symlink()
        return not in_link and not ((folder / name).is_dir() and not (folder / name).is_symlink())
    except OSError:  # a name too long for any file
        return False


def _clear_leftovers(folder: Path, names: set[str]) -> None:
    """Remove partial files of these names left by a killed process (`atomic_path`, bag, video)."""
    for name in names:
        place = (folder / name).parent
        if place.is_symlink() or not place.is_dir():
            continue
        start = f".{PurePosixPath(name).name}."
        for left in place.iterdir():
            if not (left.name.startswith(start) and left.name.endswith(".partial")):
                continue
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a hidden folder beside `path`, which takes that name when the block ends normally; else it is removed.

    It replaces a folder made by this function, with nothing else in it. Raises InputError where another folder or file
    exists, and where it cannot be written or the disk is full.
    """
    path = Path(os.path.abspath(path))
    _check_replaceable(path)
    partial = partial_path(path)
    replaced = path.with_name(f".{path.name}.{os.getpid()}.replaced")
    try:
        partial.mkdir(parents=True)
        yield partial
        (partial / EXPORTED).write_text(json.dumps(sorted(_files_in(partial))), encoding="utf-8")
        if path.exists():
            os.replace(path, replaced)
        os.replace(partial, path)
    except OSError as error:
        raise unwritable(f"--out {path}", error) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        shutil.rmtree(replaced, ignore_errors=True)


def _files_in(folder: Path) -> set[str]:
    """Return the paths of all files in a folder, relative to it."""
    return {each.relative_to(folder).as_posix() for each in folder.rglob("*") if not each.is_dir() or each.is_symlink()}


def _check_replaceable(path: Path) -> None:
    """Raise InputError for what is no folder of `twin export`, or has files beside those that it wrote."""
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    listed, former = path / EXPORTED, path / MADE
    try:
        if listed.is_file() and not listed.is_symlink():
            made = json.loads(listed.read_text(encoding="utf-8"))
            others = sorted(_files_in(path) - {EXPORTED, *made})
        elif former.is_file() and former.read_text(encoding="utf-8") == "[]":  # without a list, in versions before
            others = []
        else:
            raise InputError(
                f"--out {path}: exists and was not made by `twin export`; the name of a new folder is expected"
            )
    except (ValueError, TypeError, OSError) as error:
        raise InputError(f"{listed}: cannot be read ({error}); the name of a new folder is expected") from error
    if others:
        raise InputError(
            f"--out {path}: holds {others[0]}, which `twin export` did not write; the name of a new folder is expected"
        )
