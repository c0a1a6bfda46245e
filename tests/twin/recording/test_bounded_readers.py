"""Bags whose compressed parts hold far more than their files: refused before they are unpacked, unless limits are lifted."""

from __future__ import annotations

import io
import sqlite3
import struct
import tracemalloc
from functools import partial
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys import Stores, get_typestore

from trackers.errors import InputError
from trackers.user_input.text_file import NO_LIMITS
from twin.recording.bags import bounded_readers
from twin.recording.bags.bag import open_bag
from twin.recording.bags.bounded_readers import zstd, zstd_bound
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import STRING

LONG = 2**20
ROS1 = get_typestore(Stores.ROS1_NOETIC)
STORAGES = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}


def ros1_bag(path: Path, how: str, texts: list[str]) -> Path:
    path = path / "packed.bag"
    writer = rosbag1.Writer(path)
    writer.set_compression(writer.CompressionFormat[how])
    with writer:
        connection = writer.add_connection("/text", STRING, typestore=ROS1)
        for k, each in enumerate(texts):
            writer.write(connection, k, ROS1.serialize_ros1(ROS1.types[STRING](each), STRING))
    return path


def ros2_bag(path: Path, how: str, texts: list[str], times: list[int] | None = None) -> Path:
    storage, mode = how.split()
    path = path / "packed"
    writer = rosbag2.Writer(path, version=9, storage_plugin=STORAGES[storage])
    writer.set_compression(CompressionMode.STORAGE if mode == "lz4" else CompressionMode[mode], CompressionFormat.ZSTD)
    with writer:
        if mode == "lz4":
            assert isinstance(writer.storage, McapWriter)
            writer.storage.compression = "lz4"
            writer.storage.compressor = partial(lz4.frame.compress, store_size=False)
        connection = writer.add_connection("/text", STRING, typestore=TYPESTORE)
        for k, each in zip(times or range(len(texts)), texts, strict=False):
            writer.write(connection, k, TYPESTORE.serialize_cdr(TYPESTORE.types[STRING](each), STRING))
    return path


KINDS = ["BZ2", "LZ4", "mcap STORAGE", "mcap lz4", "mcap MESSAGE", "mcap FILE", "db3 MESSAGE", "db3 FILE"]


def bag(path: Path, kind: str, texts: list[str]) -> Path:
    return (ros2_bag if " " in kind else ros1_bag)(path, kind, texts)


def texts_in(path: Path) -> list[str]:
    with open_bag(path) as opened:
        return [message.data for _, _, message in opened.messages(["/text"])]


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        texts_in(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path)) and "\n" not in sentence
    return sentence


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_packed_is_read_where_it_is_within_the_limits(tmp_path, kind):
    texts = ["a" * LONG, "b", "c" * 300_000]
    path = bag(tmp_path, kind, texts)
    assert texts_in(path) == texts
    with open_bag(path) as opened:
        written = [data for *_, data, _ in opened.encoded_messages({"/text": STRING}, in_file_order=True)]
    assert [len(each) > LONG for each in written] == [True, False, False]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("limit", ["MOST_CHUNK_BYTES", "MOST_BAG_BYTES"])
def test_what_claims_more_than_the_limits_is_refused_before_it_is_unpacked(tmp_path, monkeypatch, kind, limit):
    if limit == "MOST_BAG_BYTES" and "MESSAGE" in kind:
        pytest.skip("messages are unpacked one by one and held by nobody")
    if limit == "MOST_CHUNK_BYTES" and "FILE" in kind:
        pytest.skip("a file is unpacked to disk, piece by piece")
    path = bag(tmp_path, kind, ["x" * LONG])
    monkeypatch.setattr(bounded_readers, limit, LONG // 4)
    monkeypatch.setattr(bounded_readers, "MOST_GROWTH", 2)
    said = refused(path)
    assert "to 1" in said and "MiB; at most 0.25, or --no-limits, is expected" in said
    monkeypatch.setenv(NO_LIMITS, "1")
    assert texts_in(path) == ["x" * LONG]


@pytest.mark.parametrize("kind", ["BZ2", "LZ4", "mcap STORAGE", "mcap lz4"])
def test_what_holds_more_than_it_claims_is_not_unpacked_further(tmp_path, monkeypatch, kind):
    path = bag(tmp_path, kind, ["x" * 2**25])
    file = path if path.is_file() else path / "packed.mcap"
    content = file.read_bytes()
    if " " in kind:
        with file.open("rb") as stream:
            (true,) = bounded_readers._claimed_on_the_way(stream, len(content))
        lie = content.replace(struct.pack("<Q", true), struct.pack("<Q", 1000))
    else:
        at = content.index(b"size=", content.index(b"compression=")) + 5
        lie = content[:at] + struct.pack("<I", 1000) + content[at + 4 :]
    file.write_bytes(lie)
    monkeypatch.setenv(NO_LIMITS, "1")  # they have no say in this
    tracemalloc.start()
    said = refused(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "holds more than the 1000 bytes that it claims" in said
    assert peak < 2**23


def test_chunks_that_overlap_in_time_are_refused_where_they_are_large_together(tmp_path, monkeypatch):
    texts = ["x" * (2 * LONG)] * 6
    apart, over = tmp_path / "apart", tmp_path / "over"
    for folder, times in ((apart, None), (over, [5] * 6)):
        folder.mkdir()
        ros2_bag(folder, "mcap STORAGE", texts, times)
    monkeypatch.setattr(bounded_readers, "MOST_HELD_BYTES", 5 * LONG)
    assert len(texts_in(apart / "packed")) == 6
    assert "chunks that overlap in time, which are held at once, unpack to 12" in refused(over / "packed")


def test_ros_1_chunks_that_overlap_are_not_unpacked_for_every_message(tmp_path, monkeypatch):
    path = tmp_path / "over.bag"
    writer = rosbag1.Writer(path)
    writer.set_compression(writer.CompressionFormat.LZ4)
    writer.chunk_threshold = 1_195_000  # the first half, then the second
    with writer:
        connection = writer.add_connection("/text", STRING, typestore=ROS1)
        for start in (0, 1):
            for k in range(60):
                text = ROS1.types[STRING]("x" * 20_000)
                writer.write(connection, start + 2 * k, ROS1.serialize_ros1(text, STRING))
    assert len(texts_in(path)) == 120
    monkeypatch.setattr(bounded_readers, "MOST_BAG_BYTES", 0)
    monkeypatch.setattr(bounded_readers, "_MOST_AGAIN", 5)
    monkeypatch.setattr(bounded_readers, "MOST_GROWTH", 10**6)
    assert "chunks overlap in time" in refused(path)


def test_an_sqlite_bag_that_works_its_messages_out_is_refused(tmp_path):
    for name, column in (
        ("made", "data BLOB GENERATED ALWAYS AS (zeroblob(id * 9000000)) VIRTUAL"),
        ("kept", "data BLOB"),
    ):
        base = sqlite3.connect(tmp_path / f"{name}.db3")
        base.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT);"
            f"CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, {column});"
            f"INSERT INTO topics VALUES(1, '/text', '{STRING}', 'cdr', '');"
            "INSERT INTO messages(topic_id, timestamp) VALUES(1, 1), (1, 2);"
        )
        base.close()
    assert "column 'data' of its table 'messages' is worked out from others" in refused(tmp_path / "made.db3")
    assert "worked out" not in refused(tmp_path / "kept.db3")


def test_a_value_of_an_sqlite_bag_is_no_larger_than_a_message(tmp_path, monkeypatch):
    path = ros2_bag(tmp_path, "db3 NONE", ["x" * LONG])
    monkeypatch.setattr(bounded_readers, "MOST_CHUNK_BYTES", LONG // 4)
    assert "holds a value that is larger than any message" in refused(path)
    monkeypatch.setenv(NO_LIMITS, "1")
    assert texts_in(path) == ["x" * LONG]


@pytest.mark.parametrize("n_bytes", [0, 1, 1000, 2**17, 2**17 + 1, 3 * 2**20])
def test_the_bound_of_zstd_frames_is_never_below_what_they_hold(n_bytes):
    rng = np.random.default_rng(n_bytes)
    for data in (bytes(n_bytes), rng.bytes(n_bytes), rng.bytes(n_bytes // 2) + bytes(n_bytes - n_bytes // 2)):
        packed = zstd.compress(data)
        skipped = struct.pack("<II", 0x184D2A53, 5) + b"12345"
        for many, content in ((1, packed), (2, packed + skipped + packed)):
            bound = zstd_bound(io.BytesIO(content))
            assert many * n_bytes <= bound <= many * (n_bytes + 2**17)
