"""Recordings are made once, kept while they are used, and go when the cache is full."""

from __future__ import annotations

import itertools
import os
import shutil
import threading
import time
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.models import cache_folder
from twin.suites import cache as suite_cache
from twin.suites.cache import RecordingCache


def maker(size: int, made: list[Path]):
    def make(folder: Path) -> None:
        (folder / "recording.mcap").write_bytes(b"x" * size)
        made.append(folder)

    return make


def test_a_recording_is_made_once(tmp_path: Path) -> None:
    cache, made = RecordingCache(tmp_path, 10**6), []
    for times in range(3):
        with cache.recording("key", maker(10, made)) as (entry, found):
            assert (entry / "recording.mcap").read_bytes() == b"x" * 10 and found is (times > 0)
    assert len(made) == 1 and cache.size() == (1, 10)


def test_those_used_longest_ago_go_and_none_in_use(tmp_path: Path) -> None:
    cache, made = RecordingCache(tmp_path, 250), []
    for age, key in enumerate("abc"):
        with cache.recording(key, maker(100, made)) as (entry, _):
            pass
        if entry.is_dir():
            os.utime(entry, (age, age))
    assert sorted(path.name for path in tmp_path.glob("recordings/[a-z]")) == ["b", "c"]
    with cache.recording("b", maker(100, made)) as (_, found):
        assert found  # and used now, later than c
    with cache.recording("c", maker(100, made)) as (entry, _), cache.recording("d", maker(100, made)):
        os.utime(entry, (0, 0))
    assert sorted(path.name for path in tmp_path.glob("recordings/[a-z]")) == ["c", "d"]


def test_emptying_leaves_what_is_in_use_and_takes_what_a_killed_process_left(tmp_path: Path) -> None:
    cache, made = RecordingCache(tmp_path, 10**6), []
    with cache.recording("old", maker(10, made)):
        pass
    (tmp_path / "recordings" / ".making-lost.abc").mkdir()
    with cache.recording("used", maker(20, made)) as (entry, _):
        assert cache.empty() == (1, 10)
        assert entry.is_dir()
    assert sorted(path.name for path in tmp_path.glob("recordings/*") if path.is_dir()) == ["used"]
    assert not list(tmp_path.glob("recordings/.making-*"))


def test_a_recording_that_fails_leaves_nothing(tmp_path: Path) -> None:
    cache, made = RecordingCache(tmp_path, 10**6), []

    def fail(folder: Path) -> None:
        (folder / "half").write_bytes(b"x")
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"), cache.recording("key", fail):
        pass
    assert cache.size() == (0, 0) and not [path for path in tmp_path.glob("recordings/*") if path.is_dir()]
    with cache.recording("key", maker(5, made)) as (_, found):
        assert not found


def test_two_who_want_the_same_make_it_once(tmp_path: Path) -> None:
    made: list[Path] = []

    def slow(folder: Path) -> None:
        time.sleep(0.2)
        maker(10, made)(folder)

    def want() -> None:
        with RecordingCache(tmp_path, 10**6).recording("key", slow) as (entry, _):
            assert (entry / "recording.mcap").is_file()

    threads = [threading.Thread(target=want) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1


def flip_a_bit(entry: Path) -> None:
    path = entry / "recording.mcap"
    content = bytearray(path.read_bytes())
    content[3] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (flip_a_bit, "recording.mcap is damaged"),
        (lambda entry: os.truncate(entry / "recording.mcap", 4), "recording.mcap is damaged"),
        (
            lambda entry: (entry / "recording.mcap").unlink(),
            "recording.mcap cannot be read (No such file or directory)",
        ),
        (lambda entry: (entry / ".sha256.json").unlink(), ".sha256.json cannot be read"),
        (lambda entry: (entry / ".sha256.json").write_text('["recording.mcap"]'), ".sha256.json is damaged"),
        (lambda entry: (entry / ".sha256.json").write_text("{"), ".sha256.json is damaged"),
        (lambda entry: (shutil.rmtree(entry), entry.write_text("")), "cannot be read (Not a directory)"),
    ],
)
def test_a_damaged_recording_is_made_again_and_it_is_said(damage, said: str, tmp_path: Path) -> None:
    cache, made, warnings = RecordingCache(tmp_path, 10**6), [], []
    with cache.recording("key", maker(10, made)) as (entry, _):
        pass
    damage(entry)
    with cache.recording("key", maker(10, made), warnings.append) as (entry, found):
        assert (entry / "recording.mcap").read_bytes() == b"x" * 10 and not found
    (warning,) = warnings
    assert warning.startswith(f"{entry}: ") and said in warning and warning.endswith("; the recording is made again")
    with cache.recording("key", maker(10, made), warnings.append) as (_, found):
        assert found
    assert len(made) == 2 and len(warnings) == 1 and cache.size() == (1, 10)


def test_a_damaged_recording_is_told_on_stderr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cache, made = RecordingCache(tmp_path, 10**6), []
    with cache.recording("key", maker(10, made)) as (entry, _):
        pass
    flip_a_bit(entry)
    with cache.recording("key", maker(10, made)):
        pass
    assert (
        capsys.readouterr().err == f"twin: warning: {entry}: recording.mcap is damaged; the recording is made again\n"
    )


def test_a_disk_that_does_not_hold_what_is_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite_cache, "_digest", lambda path, count=itertools.count(): str(next(count)))
    cache, made = RecordingCache(tmp_path, 10**6), []
    with (
        pytest.raises(InputError, match=r"is not as it was just written \(recording.mcap is damaged\)"),
        cache.recording("key", maker(10, made)),
    ):
        pass
    assert len(made) == 1


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/x/cache")
    monkeypatch.delenv("ROOMTWIN_CACHE", raising=False)
    assert cache_folder() == Path("/x/cache/roomtwin")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "roomtwin"
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")  # which the specification of it lets nobody heed
    assert cache_folder() == Path.home() / ".cache" / "roomtwin"
    monkeypatch.setenv("ROOMTWIN_CACHE", "~/kept")  # as services and containers set it, without a shell
    assert cache_folder() == Path.home() / "kept"
    monkeypatch.setenv("ROOMTWIN_CACHE", "/y")
    assert cache_folder() == Path("/y")
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"cannot be written \(Not a directory\); ROOMTWIN_CACHE naming a folder"),
        RecordingCache(tmp_path / "file", 1).recording("key", lambda folder: None),
    ):
        pass
