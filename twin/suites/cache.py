"""Recordings kept by content: a scenario is simulated once, however many trackers, and versions of them, follow it."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackers.errors import InputError

DEFAULT_LIMIT_GB = 20.0
LIMIT_VARIABLE = "ROOMTWIN_CACHE_GB"
_GB = 10**9
_LOCK = ".lock"
_MAKING = ".making-"


def cache_folder() -> Path:
    """$ROOMTWIN_CACHE, else roomtwin in $XDG_CACHE_HOME, else ~/.cache/roomtwin."""
    named = os.environ.get("ROOMTWIN_CACHE")
    if named:
        return Path(named)
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "roomtwin"


def cache_limit_bytes() -> int:
    """$ROOMTWIN_CACHE_GB in bytes (default 20 GB); raises InputError for what is no number above 0."""
    text = os.environ.get(LIMIT_VARIABLE, str(DEFAULT_LIMIT_GB))
    try:
        limit = float(text)
    except ValueError:
        limit = 0.0
    if not 0 < limit < float("inf"):
        raise InputError(f"{LIMIT_VARIABLE}={text}: is no size; a number of gigabytes above 0 is expected")
    return round(limit * _GB)


@dataclass(frozen=True)
class RecordingCache:
    """A folder of recordings, each a folder under its key; several processes may use it at the same time.

    When it holds more than `limit_bytes`, those used longest ago go, but none that is in use.
    """

    folder: Path
    limit_bytes: int

    @property
    def _entries(self) -> Path:
        return self.folder / "recordings"

    @contextmanager
    def recording(self, key: str, make: Callable[[Path], object]) -> Iterator[tuple[Path, bool]]:
        """The folder under this key, and whether it was there; it stays at least as long as the block runs.

        Where it is not there, `make(folder)` fills it; it takes its name when it is whole. Other processes that want the
        same wait for it. Raises InputError where the cache cannot be written.
        """
        entry = self._entries / key
        try:
            self._entries.mkdir(parents=True, exist_ok=True)
            lock = os.open(self._entries / f"{key}{_LOCK}", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise InputError(
                f"{self._entries}: cannot be written ({error.strerror}); ROOMTWIN_CACHE naming a folder with free space "
                "is expected"
            ) from error
        try:
            found = True
            while True:
                fcntl.flock(lock, fcntl.LOCK_SH)
                if entry.is_dir():
                    break
                found = False
                fcntl.flock(lock, fcntl.LOCK_EX)
                if not entry.is_dir():
                    self._make(entry, make)
            os.utime(entry)
            yield entry, found
        finally:
            os.close(lock)
        if not found:
            self.shrink()

    def _make(self, entry: Path, make: Callable[[Path], object]) -> None:
        for left in self._entries.glob(f"{_MAKING}{entry.name}.*"):  # of one that was killed: the lock is ours
            shutil.rmtree(left, ignore_errors=True)
        partial = Path(tempfile.mkdtemp(prefix=f"{_MAKING}{entry.name}.", dir=self._entries))
        try:
            make(partial)
            os.replace(partial, entry)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise

    def size(self) -> tuple[int, int]:
        """How many recordings there are, and their bytes."""
        sizes = [size for _, _, size in self._all()]
        return len(sizes), sum(sizes)

    def shrink(self, limit_bytes: int | None = None) -> tuple[int, int]:
        """Remove the recordings used longest ago until the rest fits (None: the cache's limit).

        Gives how many went and their bytes; those in use stay.
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
        """Remove all recordings but those in use, and what killed processes left; how many recordings went, and bytes."""
        gone = self.shrink(0)
        for partial in self._entries.glob(f"{_MAKING}*"):
            key = partial.name.removeprefix(_MAKING).partition(".")[0]
            with self._alone(key) as alone:
                if alone:
                    shutil.rmtree(partial, ignore_errors=True)
        return gone

    def _all(self) -> list[tuple[float, Path, int]]:
        """When each was used last, its folder, its bytes; one that another process removes meanwhile is left out."""
        entries = []
        for entry in self._entries.glob("*") if self._entries.is_dir() else ():
            if entry.name.startswith(".") or not entry.is_dir():
                continue
            try:
                size = sum(path.stat().st_size for path in entry.iterdir())
                entries.append((entry.stat().st_mtime, entry, size))
            except FileNotFoundError:
                continue
        return entries

    def _remove(self, entry: Path) -> bool:
        with self._alone(entry.name) as alone:
            if not alone or not entry.is_dir():
                return False
            # Out of the way under another name first: half a recording must never be found.
            doomed = Path(tempfile.mkdtemp(prefix=f"{_MAKING}{entry.name}.", dir=self._entries))
            os.replace(entry, doomed / entry.name)
            shutil.rmtree(doomed, ignore_errors=True)
            return True

    @contextmanager
    def _alone(self, key: str) -> Iterator[bool]:
        """Whether nobody uses or makes this recording; and nobody does as long as the block runs."""
        lock = os.open(self._entries / f"{key}{_LOCK}", os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield True
        except BlockingIOError:
            yield False
        finally:
            os.close(lock)
