"""Bags in any container, under any name; and why one cannot be read, with the tool that mends it."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from recorded import MS, a_scan, scan_messages, write_ros2_bag
from rosbags import rosbag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from trackers.errors import InputError
from trackers.user_input.plain_data import dump_yaml, parse_yaml
from twin.recording.reader import Recording

MAGIC = b"\x89MCAP0\r\n"
STAMPS = [10**18 + k * 100 * MS for k in range(30)]
NAMES = ["run #3", "50%20off", "what?", "a&b=c", "ü ß", "plain"]


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A folder of each storage, one file each in it."""
    folder = tmp_path_factory.mktemp("bags")
    for storage, name in ((StoragePlugin.SQLITE3, "db3"), (StoragePlugin.MCAP, "mcap")):
        write_ros2_bag(folder / name, scan_messages("/scan", STAMPS), storage)
    return folder


def stamps_in(path):
    return [each.stamp_ns + STAMPS[0] for each in Recording(path).observations()]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("suffix", ["db3", "mcap"])
def test_a_bag_is_read_whatever_its_name_is(bags, tmp_path, name, suffix):
    shutil.copytree(bags / suffix, tmp_path / name)
    assert stamps_in(tmp_path / name) == STAMPS
    shutil.copy(bags / suffix / f"{suffix}.{suffix}", tmp_path / f"{name}.{suffix}")
    assert stamps_in(tmp_path / f"{name}.{suffix}") == STAMPS
    (tmp_path / f"{name}.{suffix}").rename(tmp_path / f"{name}.{suffix.upper()}")
    assert stamps_in(tmp_path / f"{name}.{suffix.upper()}") == STAMPS


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
@given(file_of=st.lists(st.integers(0, 3), min_size=len(STAMPS), max_size=len(STAMPS)), seed=st.integers(0, 99))
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_bag_in_several_files_is_read_by_time_however_they_divide_it(tmp_path, storage, file_of, seed):
    folder = tmp_path / f"{storage.name}-{seed}-{hash(tuple(file_of))}"
    messages = scan_messages("/scan", STAMPS)
    numbers = np.random.default_rng(seed).permutation(sorted(set(file_of))).tolist()
    for number in numbers:
        own = [message for message, part in zip(messages, file_of, strict=True) if part == number]
        write_ros2_bag(folder / f"p{number}", own, storage)
    (folder / "whole").mkdir(parents=True)
    suffix = "mcap" if storage is StoragePlugin.MCAP else "db3"
    for number in numbers:
        shutil.copy(folder / f"p{number}" / f"p{number}.{suffix}", folder / "whole")
    metadata = parse_yaml((folder / f"p{numbers[0]}" / "metadata.yaml").read_text(), "metadata.yaml", "metadata")
    about = metadata["rosbag2_bagfile_information"]
    about["relative_file_paths"] = [f"p{number}.{suffix}" for number in numbers]
    about["message_count"] = about["topics_with_message_count"][0]["message_count"] = len(STAMPS)
    (folder / "whole" / "metadata.yaml").write_text(dump_yaml(metadata))
    assert stamps_in(folder / "whole") == STAMPS


@pytest.fixture(params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["db3", "mcap"])
def split(request, tmp_path):
    """A bag in three files of ten messages each, its suffix and the content of its metadata.yaml."""
    suffix = "mcap" if request.param is StoragePlugin.MCAP else "db3"
    folder, messages = tmp_path / "split", scan_messages("/scan", STAMPS)
    folder.mkdir()
    for n in range(3):
        write_ros2_bag(tmp_path / f"p{n}", messages[10 * n : 10 * n + 10], request.param)
        shutil.copy(tmp_path / f"p{n}" / f"p{n}.{suffix}", folder)
    metadata = parse_yaml((tmp_path / "p0" / "metadata.yaml").read_text(), "metadata.yaml", "metadata")
    about = metadata["rosbag2_bagfile_information"]
    about["relative_file_paths"] = [f"p{n}.{suffix}" for n in range(3)]
    about["message_count"] = about["topics_with_message_count"][0]["message_count"] = len(STAMPS)
    about["duration"]["nanoseconds"] = STAMPS[-1] - STAMPS[0]
    return folder, suffix, about


def rewritten(folder, about, as_written=lambda text: text):
    (folder / "metadata.yaml").write_bytes(as_written(dump_yaml({"rosbag2_bagfile_information": about})).encode())
    return folder


def test_metadata_is_read_in_whatever_way_tools_write_it(split):
    """Each of these is refused, or leaves every message unread, by the library alone."""
    folder, suffix, about = split
    for offered in (None, "", [], "- history: 3\n  depth: 0", [{"history": "keep_last"}], "- [", [{"depth": "x"}]):
        about["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"] = offered
        assert stamps_in(rewritten(folder, about)) == STAMPS
    windows = {**about, "relative_file_paths": [rf"logs\p{n}.{suffix}" for n in range(3)]}
    packed = {**about, "relative_file_paths": [f"p{n}.{suffix}.zstd" for n in range(3)], "compression_mode": "FILE"}
    other = {**about, "storage_identifier": "mcap" if suffix == "db3" else "sqlite3"}
    for changed in (
        windows,
        packed | {"compression_format": "zstd"},
        other,
        {**about, "topics_with_message_count": []},
    ):
        assert stamps_in(rewritten(folder, changed)) == STAMPS
    assert stamps_in(rewritten(folder, about, lambda text: "\ufeff" + text.replace("\n", "\r\n"))) == STAMPS


def test_a_file_that_metadata_does_not_name_or_that_is_not_there_is_told(split):
    folder, suffix, about = split
    assert not Recording(rewritten(folder, about)).losses
    fewer = {**about, "relative_file_paths": [f"p{n}.{suffix}" for n in (0, 2)]}
    first, *_ = Recording(rewritten(folder, fewer)).losses
    assert first.is_reported and first.line.startswith(
        f"metadata.yaml: does not name p1.{suffix}, which lies beside it"
    )
    assert stamps_in(folder) == STAMPS[:10] + STAMPS[20:]
    (folder / f"p1.{suffix}").unlink()
    first, *_ = Recording(rewritten(folder, about)).losses
    assert first.line.startswith(f"metadata.yaml: names p1.{suffix}, and no such file is there")
    assert "`ros2 bag reindex split`" in first.line and stamps_in(folder) == STAMPS[:10] + STAMPS[20:]


def test_a_pipe_is_refused_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match="is a pipe or a device"):
        Recording(tmp_path / "pipe.mcap")


def with_profile(data: bytes, profile: bytes) -> bytes:
    """An MCAP file of another profile, as long: the library's name makes room."""
    (size,) = struct.unpack_from("<Q", data, 9)
    library = bytes(size - 8 - len(profile))
    content = struct.pack("<I", len(profile)) + profile + struct.pack("<I", len(library)) + library
    return data[:17] + content + data[17 + size :]


@pytest.mark.parametrize("profile", [b"", b"ros2", b"x", b"a profile"])
def test_an_mcap_file_is_read_whatever_profile_it_names(bags, tmp_path, profile):
    data = (bags / "mcap" / "mcap.mcap").read_bytes()
    (tmp_path / "other.mcap").write_bytes(with_profile(data, profile))
    assert stamps_in(tmp_path / "other.mcap") == STAMPS


def record(op: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack("<BQ", op, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def an_mcap_file(
    encoding: bytes, schema_encoding: bytes, messages: list[tuple[int, bytes]], has_summary: bool = True
) -> bytes:
    """One topic of scans, each message by log time, as the format's specification has it; no chunks."""
    written = b"\xff no text" if schema_encoding == b"protobuf" else b"float32 angle_min"
    schema = record(3, struct.pack("<H", 1), text(b"sensor_msgs/LaserScan"), text(schema_encoding), text(written))
    channel = record(4, struct.pack("<HH", 1, 1), text(b"/scan"), text(encoding), text(b""))
    data = [record(5, struct.pack("<HIQQ", 1, k, at, at), message) for k, (at, message) in enumerate(messages)]
    counts = struct.pack("<IHQ", 10, 1, len(data))
    times = struct.pack("<QQ", messages[0][0], messages[-1][0])
    statistics = record(11, struct.pack("<QHIIII", len(data), 1, 1, 0, 0, 0), times, counts)
    body = MAGIC + record(1, text(b"ros1"), text(b"by hand")) + schema + channel + b"".join(data) + record(15, bytes(4))
    if not has_summary:
        return body + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    return body + schema + channel + statistics + record(2, struct.pack("<QQI", len(body), 0, 0)) + MAGIC


@pytest.mark.parametrize("has_summary", [True, False])
@pytest.mark.parametrize("schema_encoding", [b"ros1msg", b"protobuf", b""])
def test_an_mcap_file_of_ros_1_is_read(tmp_path, schema_encoding, has_summary):
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds, said = store.types, []
    for stamp_ns in STAMPS:
        scan = a_scan(stamp_ns)
        stamp = kinds["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        message = kinds["sensor_msgs/msg/LaserScan"](
            kinds["std_msgs/msg/Header"](0, stamp, "scan"),
            scan.angle_min_rad, 1.0, scan.angle_increment_rad, 0.0, 0.0, scan.range_min_m, scan.range_max_m,
            scan.ranges_m, np.zeros(0, np.float32),
        )  # fmt: skip
        said.append((stamp_ns, bytes(store.serialize_ros1(message, "sensor_msgs/msg/LaserScan"))))
    (tmp_path / "ros1.mcap").write_bytes(an_mcap_file(b"ros1", schema_encoding, said, has_summary))
    assert stamps_in(tmp_path / "ros1.mcap") == STAMPS
    (tmp_path / "other.mcap").write_bytes(an_mcap_file(b"protobuf", schema_encoding, said, has_summary))
    with pytest.raises(InputError, match=r"/scan \(sensor_msgs/msg/LaserScan encoded as protobuf\)"):
        Recording(tmp_path / "other.mcap")


def refused(path) -> str:
    with pytest.raises(InputError) as caught:
        list(Recording(path).observations())
    sentence = str(caught.value)
    assert sentence.startswith(f"{path}: ") and "\n" not in sentence
    return sentence


def test_a_folder_whose_metadata_is_missing_names_the_tool(bags, tmp_path):
    shutil.copytree(bags / "db3", tmp_path / "killed")
    (tmp_path / "killed" / "metadata.yaml").unlink()
    assert "`ros2 bag reindex killed` writes it from db3.db3" in refused(tmp_path / "killed")
    (tmp_path / "killed" / "metadata.yaml").write_text("nonsense: [")
    assert "its metadata.yaml cannot be used" in refused(tmp_path / "killed")
    shutil.copytree(bags / "db3", tmp_path / "part")
    (tmp_path / "part" / "db3.db3").unlink()
    assert "lacks files that its metadata.yaml names" in refused(tmp_path / "part")


def with_header_fields_turned_round(bag: bytes) -> bytes:
    """The ROS 1 bag whose header record has its fields in the other order; its length stays."""
    start = len(b"#ROSBAG V2.0\n")
    (length,) = struct.unpack_from("<I", bag, start)
    fields, at, end = [], start + 4, start + 4 + length
    while at < end:
        (size,) = struct.unpack_from("<I", bag, at)
        fields.append(bag[at : at + 4 + size])
        at += 4 + size
    return bag[: start + 4] + b"".join(reversed(fields)) + bag[end:]


@pytest.mark.parametrize("share", [0.2, 0.7, 0.999])
def test_a_file_that_a_recorder_did_not_finish_names_the_tool(bags, tmp_path, share):
    whole = (bags / "mcap" / "mcap.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: int(share * len(whole))])
    assert "`mcap recover cut.mcap -o whole.mcap`" in refused(tmp_path / "cut.mcap")
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(tmp_path / "whole.bag") as writer:
        connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        for k in range(50):
            text = store.types["std_msgs/msg/String"]("x" * 100)
            writer.write(connection, k, store.serialize_ros1(text, "std_msgs/msg/String"))
    whole = (tmp_path / "whole.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: int(share * len(whole))])
    said = refused(tmp_path / "cut.bag")
    assert "rosbag reindex cut.bag" in said
    (tmp_path / "cut.bag").write_bytes(with_header_fields_turned_round(whole)[: int(share * len(whole))])
    assert refused(tmp_path / "cut.bag") == said


def test_messages_that_only_the_journal_holds_are_not_passed_over(bags, tmp_path):
    path = tmp_path / "killed.db3"
    shutil.copy(bags / "db3" / "db3.db3", path)
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("DELETE FROM messages WHERE id > 20")
    connection.commit()
    for suffix in ("", "-wal"):
        shutil.copy(f"{path}{suffix}", tmp_path / f"copy.db3{suffix}")
    connection.close()
    assert "wal_checkpoint" in refused(tmp_path / "copy.db3")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.bag", b"", "is empty, 0 bytes"),
        ("a.bag", b"\x89MCAP0\r\n" + bytes(100), "is no ROS 1 bag but a MCAP file"),
        ("a.mcap", b"#ROSBAG V2.0\n" + bytes(100), "is no MCAP file but a ROS 1 bag"),
        ("a.bag", b"#ROSBAG V1.2\n" + bytes(100), "`rosbag fix`"),
        ("a.db3", b"SQLite format 3\0" + bytes(4000), "`sqlite3 a.db3 .recover`"),
        ("a.db3", b"nothing of the kind, and long enough to look like something", "is no SQLite file"),
        ("a.bag.active", b"#ROSBAG V2.0\n", "was not closed"),
        ("a.db3.zstd", b"(\xb5/\xfd", "`zstd -d a.db3.zstd`"),
    ],
)
def test_each_failure_says_what_it_is(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    assert said in refused(tmp_path / name)


@pytest.mark.parametrize(("table", "said"), [("results", "it has none"), ("topics", "it has topics")])
def test_a_database_of_something_else_is_not_called_damaged(tmp_path, table, said):
    with contextlib.closing(sqlite3.connect(tmp_path / "a#b.db3")) as connection:
        connection.execute(f"CREATE TABLE {table} (id INTEGER)")
    sentence = refused(tmp_path / "a#b.db3")
    assert "is a SQLite database but no bag" in sentence and said in sentence and "damaged" not in sentence
