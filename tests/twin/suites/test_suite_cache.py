"""Recordings are made once, kept while they are used, and go when the cache is full."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.suites.cache import RecordingCache, cache_folder


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


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/x/cache")
    monkeypatch.delenv("ROOMTWIN_CACHE", raising=False)
    assert cache_folder() == Path("/x/cache/roomtwin")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "roomtwin"
    monkeypatch.setenv("ROOMTWIN_CACHE", "/y")
    assert cache_folder() == Path("/y")
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match=r"cannot be written \(Not a directory\); ROOMTWIN_CACHE naming a folder"),
        RecordingCache(tmp_path / "file", 1).recording("key", lambda folder: None),
    ):
        pass
