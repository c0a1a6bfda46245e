"""Damage of bags, as clauses with the tool that helps: not closed, cut, another kind of file, without its index."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path

MCAP_MAGIC = b"\x89MCAP0\r\n"
_SQLITE_MAGIC = b"SQLite format 3\0"
_ROS1_MAGIC = b"#ROSBAG V"
_KINDS = {
    ".bag": (_ROS1_MAGIC, "ROS 1 bag"),
    ".mcap": (MCAP_MAGIC, "MCAP file"),
    ".db3": (_SQLITE_MAGIC, "SQLite file"),
}
_PACKED = {b"\x1f\x8b": "gunzip", b"PK\x03\x04": "unzip", b"BZh": "bunzip2", b"\xfd7zXZ": "unxz", b"7z\xbc\xaf": "7z x"}
"""Tools that unpack a file, by its first bytes."""
_STORAGES = (".mcap", ".db3")
_HEAD_BYTES = 4096
"""A ROS 1 bag's header is padded to this length; its fields come in any order."""


def reason_unreadable(path: Path) -> str:
    """Describe, as a clause, why an existing bag cannot be opened; empty if no reason is found."""
    if path.is_dir():
        return _unreadable_folder(path)
    if path.suffix.lower() not in (".bag", *_STORAGES):
        return _other_file(path)
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head:
        return "is empty, 0 bytes: its recorder wrote nothing, or it was copied in part"
    magic, kind = _KINDS[path.suffix.lower()]
    if head[: len(magic)] == magic[: len(head)]:
        return _unfinished(path, head)
    if other := _kind_by_content(head):
        return f"is no {kind} but {other}"
    return f"is no {kind}: it does not begin with {magic.decode('ascii', 'replace').strip()!r}"


def _kind_by_content(head: bytes) -> str:
    """Describe what a file is by its first bytes, and what makes it one that is read; empty for anything else."""
    for suffix, (magic, kind) in _KINDS.items():
        if head.startswith(magic):
            return f"a {kind}: a name that ends in {suffix} makes it one that is read"
    packed = next((tool for magic, tool in _PACKED.items() if head.startswith(magic)), "")
    return f"a packed file: `{packed}` gives the bag in it" if packed else ""


def _unfinished(path: Path, head: bytes) -> str:
    """Describe, as a clause, why a file with the right beginning is incomplete; empty where it is complete."""
    size = path.stat().st_size
    if path.suffix.lower() == ".mcap":
        with path.open("rb") as stream:
            stream.seek(max(size - len(MCAP_MAGIC), 0))
            ends_well = size > len(MCAP_MAGIC) and stream.read() == MCAP_MAGIC
        if not ends_well:
            return (
                "is an MCAP file without its end: the recorder was stopped while it wrote, or the copy is not whole; "
                f"`mcap recover {path.name} -o whole.mcap` saves what is there"
            )
    elif path.suffix.lower() == ".bag":
        if not head.startswith(b"#ROSBAG V2.0\n"):
            version = head.split(b"\n")[0].decode("ascii", "replace")
            return f"is a ROS 1 bag of another version ({version}); `rosbag fix` makes one of version 2.0 of it"
        index = head.find(b"index_pos=")
        if index >= 0 and len(head) >= index + 18:
            (place,) = struct.unpack_from("<Q", head, index + 10)
            if place == 0 or place > size:
                why = "was not closed" if place == 0 else f"is cut after {size} bytes"
                return f"is a ROS 1 bag without its index, as it {why}; `rosbag reindex {path.name}` writes a new one"
    else:
        journal = path.with_name(path.name + "-wal")
        if journal.exists() and journal.stat().st_size:
            return (
                f"has messages in {journal.name} that are not yet in it, as its recorder was killed; "
                f"`sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'` writes them into it"
            )
    return ""


def _unreadable_folder(path: Path) -> str:
    if (path / "metadata.yaml").exists():
        for database in sorted(path.glob("*.db3")):
            if reason := _unfinished(database, b""):
                return f"its {database.name} {reason}"
        return ""
    held = sorted(each.name for each in path.iterdir() if each.suffix in (*_STORAGES, ".zstd"))
    if (path / "scenario.yaml").is_file() and len(held) == 1:
        return f"is the folder of a run, whose bag is {path / held[0]}"
    if not held and (path / "tracks").is_dir():
        return "is a folder of results without a recording; `twin track BAG --bag FILE.mcap` writes a copy with the tracks in it"
    if not held:
        return "is a folder without metadata.yaml, so no ROS 2 bag"
    return (
        f"is a folder without metadata.yaml, as a recorder that was killed leaves it; `ros2 bag reindex {path.name}` writes it "
        f"from {', '.join(held)}"
    )


def _other_file(path: Path) -> str:
    if path.name.endswith(".bag.active"):
        return "is a ROS 1 bag that was not closed; `rosbag reindex` and the name without .active make it whole"
    if path.suffix in (".zstd", ".zst"):
        return f"is compressed; `zstd -d {path.name}` unpacks it, or its folder with metadata.yaml is read as it is"
    with path.open("rb") as stream:
        held = _kind_by_content(stream.read(_HEAD_BYTES))
    return f"is {held}" if held else "is not named like a bag"


def describe_damage(path: Path, reason: str) -> str:
    """Describe, as a clause with the tool that helps, the damage of a bag in which reading failed with `reason`."""
    missing = "Some database files are missing"
    if reason.startswith(missing):
        names = reason.removeprefix(missing).strip(": ")
        return f"lacks files that its metadata.yaml names ({names}); `ros2 bag reindex {path.name}` writes a new one"
    if path.is_dir():
        about = ("metadata", "YAML", "version", "Storage plugin", "Compression format", "Serialization format")
        if any(word in reason for word in about):
            return f"its metadata.yaml cannot be used ({reason}); `ros2 bag reindex {path.name}` writes a new one"
    if reason.startswith("Unindexed MCAP messages"):
        return f"has no index, and its messages are in no order; `mcap recover {path.name} -o whole.mcap` writes one that has"
    databases = (path,) if path.is_file() else sorted(path.glob("*.db3"))
    for database in databases if "missing tables" in reason else ():
        if (tables := _tables(database)) not in (None, "messages, topics"):
            its = "" if database is path else f"its {database.name} "
            return f"{its}is a SQLite database but no bag: of the tables topics and messages it has {tables or 'none'}"
    suffixes = {path.suffix.lower()} if path.is_file() else {each.suffix for each in path.glob("*")}
    if ".mcap" in suffixes:
        tool = f"`mcap recover {path.name}` saves what can be read"
    elif ".db3" in suffixes:
        tool = f"`sqlite3 {path.name} .recover` saves what can be read"
    else:
        tool = f"`rosbag reindex {path.name}` saves what can be read"
    return f"is truncated or damaged ({reason}); {tool}"


def _tables(path: Path) -> str | None:
    """Name those of a bag's tables that a database has; None where it cannot be read."""
    query = "SELECT name FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages') ORDER BY name"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            return ", ".join(name for (name,) in connection.execute(query))
    except sqlite3.Error:
        return None
