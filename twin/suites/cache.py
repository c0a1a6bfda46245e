"""Recordings kept by content: each scenario is simulated once, however many trackers and versions of them track it."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackers.errors import InputError
from trackers.user_input.plain_data import parse_number
from twin.console import print_warning
from twin.recording.atomic_file import NO_SPACE

DEFAULT_LIMIT_GB = 20.0

LIMIT_VARIABLE = "ROOMTWIN_CACHE_GB"

_GB = 10**9

_LOCK = ".lock"

_MAKING = ".making-"

_SUMS = ".sha256.json"
"""File name for the digest of each file of a recording, as it was written."""


def cache_limit_bytes() -> int:
    """Read $ROOMTWIN_CACHE_GB in bytes (default 20 GB). Raises InputError for anything but a number above 0."""
    text = os.environ.get(LIMIT_VARIABLE) or str(DEFAULT_LIMIT_GB)
    limit = parse_number(text) or 0
    if limit <= 0:
        raise InputError(f"{LIMIT_VARIABLE}={text}: is no size; a number of gigabytes above 0 is expected")
    return round(limit * _GB)


@dataclass(frozen=True)
class RecordingCache:
    """Folder of recordings, each a folder under its key; several processes may use it at once.

    Beyond `limit_bytes`, the least recently used are removed, except those in use.
    """

    folder: Path
    limit_bytes: int

    @property
    def _entries(self) -> Path:
        return self.folder / "recordings"

    def check(self) -> None:
        """Raise InputError where the cache cannot be written: once, before many cases find out."""
        with self._writable(), tempfile.TemporaryFile(dir=self._entries) as probe:
            probe.write(b" ")

    @contextmanager
    def _writable(self) -> Iterator[None]:
        """Raise InputError where the block, or making the folder before it, fails."""
        try:
            self._entries.mkdir(parents=True, exist_ok=True)
            yield
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(
            f"{self._entries}: cannot be written ({error.strerror}); ROOMTWIN_CACHE naming a folder with free space is expected"
        )

    @contextmanager
    def recording(
        self, key: str, make: Callable[[Path], object], warn: Callable[[str], object] = print_warning
    ) -> Iterator[tuple[Path, bool]]:
        """Yield the folder under this key, and whether it existed; it stays at least as long as the block.

        If it is missing or damaged (reported to `warn`), `make(folder)` fills it; it takes its name when complete. Other
        processes that want it wait. Raises InputError where the cache cannot be written, or does not hold what was written.
        """
        entry = self._entries / key
        with self._writable():
            lock = os.open(self._entries / f"{key}{_LOCK}", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            found, made = True, False
            fcntl.flock(lock, fcntl.LOCK_SH)
            while (fault := fault_of(entry)) is not None:
                found = False
                if made and entry.exists():
                    raise InputError(
                        f"{entry}: is not as it was just written ({fault}); ROOMTWIN_CACHE naming a folder on a "
                        "sound disk is expected"
                    )
                fcntl.flock(lock, fcntl.LOCK_EX)
                if (fault := fault_of(entry)) is not None:  # no other process has made it meanwhile
                    if entry.exists():
                        warn(f"{entry}: {fault}; the recording is made again")
                        self._drop(entry)
                    self._make(entry, make)
                    made = True
                fcntl.flock(lock, fcntl.LOCK_SH)
            os.utime(entry)
            yield entry, found
        finally:
            os.close(lock)
        if not found:
            self.shrink()

    def _make(self, entry: Path, make: Callable[[Path], object]) -> None:
        for left in self._entries.glob(f"{_MAKING}{entry.name}.*"):  # of a killed process, since the lock is ours
            shutil.rmtree(left, ignore_errors=True)
        partial = Path(tempfile.mkdtemp(prefix=f"{_MAKING}{entry.name}.", dir=self._entries))
        try:
            make(partial)
            write_sums(partial)
            os.replace(partial, entry)
        except BaseException as error:
            shutil.rmtree(partial, ignore_errors=True)
            if isinstance(error, OSError) and error.errno in NO_SPACE:
                raise self._unwritable(error) from error
            raise

    def size(self) -> tuple[int, int]:
        """Count the recordings and their bytes."""
        sizes = [size for _, _, size in self._all()]
        return len(sizes), sum(sizes)

    def shrink(self, limit_bytes: int | None = None) -> tuple[int, int]:
        """Remove the least recently used recordings until the rest fits (None: the cache's limit).

        Returns their number and bytes; those in use stay.
        """
        limit = self.limit_bytes if limit_bytes is None else limit_bytes
        entries = sorted(self._all())
        held = sum(size for _, _, size in entries)
        removed = freed = 0
        for _, entry, size in entries:
            if held <= limit:
                break
            if self._remove(entry):
                held -= size
                freed += size
                removed += 1
        return removed, freed

    def empty(self) -> tuple[int, int]:
        """Remove all recordings not in use, and remains of killed processes; return their number and bytes."""
        freed = self.shrink(0)
        for partial in self._entries.glob(f"{_MAKING}*"):
            key = partial.name.removeprefix(_MAKING).partition(".")[0]
            with self._alone(key) as alone:
                if alone:
                    shutil.rmtree(partial, ignore_errors=True)
        return freed

    def _all(self) -> list[tuple[float, Path, int]]:
        """List last use, folder and bytes of each entry; one that another process removes meanwhile is left out."""
        entries = []
        for entry in self._entries.glob("*") if self._entries.is_dir() else ():
            if entry.name.startswith(".") or not entry.is_dir():
                continue
            try:
                size = sum(path.stat().st_size for path in entry.iterdir() if path.name != _SUMS)
                entries.append((entry.stat().st_mtime, entry, size))
            except FileNotFoundError:
                continue
        return entries

    def _remove(self, entry: Path) -> bool:
        with self._alone(entry.name) as alone:
            if not alone or not entry.is_dir():
                return False
            self._drop(entry)
            return True

    def _drop(self, entry: Path) -> None:
        """Remove an entry whose lock is ours; move it away first, so that no process finds half a recording."""
        doomed = Path(tempfile.mkdtemp(prefix=f"{_MAKING}{entry.name}.", dir=self._entries))
        os.replace(entry, doomed / entry.name)
        shutil.rmtree(doomed, ignore_errors=True)

    @contextmanager
    def _alone(self, key: str) -> Iterator[bool]:
        """Try to lock an entry exclusively for the block; yield whether that succeeded."""
        lock = os.open(self._entries / f"{key}{_LOCK}", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield True
        except BlockingIOError:
            yield False
        finally:
            os.close(lock)


def write_sums(folder: Path) -> None:
    """Write the digest of each file of a folder into it, for `fault_of`."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != _SUMS]
    sums = {path.relative_to(folder).as_posix(): _digest(path) for path in files}
    (folder / _SUMS).write_text(json.dumps(sums), encoding="utf-8")


def digests_of(entry: Path) -> dict[str, str]:
    """Read the SHA-256 of each file of a whole recording, by file name."""
    return json.loads((entry / _SUMS).read_text(encoding="utf-8"))


def fault_of(entry: Path) -> str | None:
    """Describe the difference between a folder's files and what was written; None without one."""
    if not entry.exists():
        return "is not there"
    try:
        sums = digests_of(entry)
        for name, digest in sums.items():
            if _digest(entry / name) != digest:
                return f"{name} is damaged"
    except OSError as error:
        return f"{Path(error.filename).name} cannot be read ({error.strerror})"
    except (ValueError, AttributeError, TypeError):
        return f"{_SUMS} is damaged"
    return None


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
