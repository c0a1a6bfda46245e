"""The kinds of input, each with how one of its mutants is made from a generator and what the twin is asked to do with it."""

from __future__ import annotations

import json
import shutil
import sqlite3
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer

from benchmarks.fuzz.inputs import SMALL, SUITE, Inputs
from benchmarks.fuzz.judge import Mutant
from benchmarks.fuzz.values import (
    ANY_NUMBER,
    FLOATS,
    TEXTS,
    YAML_TRAPS,
    corrupted_bytes,
    corrupted_mjcf,
    corrupted_table,
    corrupted_text,
    corrupted_tree,
    hostile,
)
from trackers.environment.build import _fingerprint
from twin.models import MODELS
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE

Make = Callable[[Inputs, Random, Path], Mutant]

_RENDER = ("--duration", "0.2", "--no-images", "--no-video", "--out", "out")


def _mutant(folder: Path, *command: object, environment: Mapping[str, str] | None = None) -> Mutant:
    return Mutant([str(each) for each in command], folder, (folder / "out",), dict(environment or {}))


def _yaml(tree: Any) -> bytes:
    """A tree as YAML, whatever it holds."""
    try:
        return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode("utf-8", "surrogatepass")
    except yaml.YAMLError:
        return json.dumps(tree, default=str).encode()


def _corrupted_yaml(text: str, rng: Random) -> bytes:
    return _yaml(corrupted_tree(yaml.safe_load(text), rng))


def scenarios(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A scenario with values, keys or structure exchanged."""
    (folder / "scenario.yaml").write_bytes(_corrupted_yaml(rng.choice(inputs.scenarios), rng))
    return _mutant(folder, "twin", "render", "scenario.yaml", *_RENDER)


def text(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A scenario's file with its text corrupted."""
    (folder / "scenario.yaml").write_bytes(corrupted_text(rng.choice(inputs.scenarios), rng))
    return _mutant(folder, "twin", "render", "scenario.yaml", *_RENDER)


def tables(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A table of truth or of tracks."""
    names = ["truth.csv", "tracks/laser-imm.csv"]
    contents = [(inputs.recording / name).read_bytes() for name in names]
    which = rng.randrange(2)
    contents[which] = corrupted_table(contents[which].decode(), rng)
    for name, content in zip(("truth.csv", "tracks.csv"), contents, strict=True):
        (folder / name).write_bytes(content)
    gate = rng.choice(([], [], [], ["--gate", str(rng.choice(ANY_NUMBER))]))
    return _mutant(folder, "twin", "evaluate", "truth.csv", "tracks.csv", *gate)


def rooms(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A room of one's own, in MJCF."""
    (folder / "room.xml").write_bytes(corrupted_mjcf(rng.choice(inputs.rooms), rng))
    scenario = {
        "name": "own",
        "room": "room.xml",
        "duration_s": 1,
        "people": {"ann": {"script": {"kind": "wander"}}},
        "sensors": {"waist": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.95], "yaw_deg": 90}}},
    }
    (folder / "scenario.yaml").write_bytes(_yaml(scenario))
    return _mutant(folder, "twin", "render", "scenario.yaml", *_RENDER)


def settings(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """Command line arguments: --set, --seed, --duration, names."""
    (folder / "scenario.yaml").write_text(SMALL, encoding="utf-8")
    tree = yaml.safe_load(SMALL)
    path, value = rng.choice(list(_leaves(tree)))
    value = rng.choice(
        (rng.choice(ANY_NUMBER), rng.choice(TEXTS), rng.choice(YAML_TRAPS), json.dumps(hostile(rng)), value)
    )
    path = rng.choice((path, path, path, path + "x", path.rpartition(".")[0], f"{path}.x", "." + path, path + "."))
    command = ["twin", "run", "scenario.yaml", "--no-images", "--no-video", "--tracker", "laser-imm", "--out", "out"]
    command += ["--set", rng.choice((f"{path}={value}", f"{path}={value}", f"{path}={value}", path, f"={value}"))]
    other = rng.choice(("--duration", "--duration", "--duration", "--seed", "--tracker", "typed"))
    if other == "typed":
        command += ["--duration", str(rng.choice(ANY_NUMBER))]
    elif other == "--duration":
        command += ["--duration", "0.3"]
    else:
        command += ["--duration", "0.3", other, str(rng.choice((*ANY_NUMBER, *TEXTS)))]
    # No command line can hold NUL, nor one argument more than 128 KiB.
    return _mutant(folder, *(part.replace("\0", "\\0")[:130_000] for part in command))


def _leaves(tree: Any, path: str = ""):
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        here = f"{path}.{key}" if path else str(key)
        if isinstance(value, dict | list) and value:
            yield from _leaves(value, here)
        else:
            yield here, value


def pedestrians(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """Recorded paths, in both layouts, and what the scenario says of them."""
    is_table = rng.random() < 0.5
    rows = [
        (step, number, 0.05 * step * (-1) ** number + number - 3, 3.0 + number)
        for step in range(0, 100, 4)
        for number in range(1, 6)
        if step < 20 * number
    ]
    if is_table:
        lines = ["t,id,x,y", *(f"{step / 10},{number},{x:.3f},{y:.3f}" for step, number, x, y in rows)]
    else:
        lines = [f"{step} {number} {x:.3f} 0 {y:.3f} 0 0 0" for step, number, x, y in rows]
    said: dict[str, Any] = {"file": "paths.txt", "start_s": 0.5, "shift_m": [0.5, 0], "turn_deg": 5}
    content = "\n".join(lines).encode()
    if not is_table:
        said["frame_rate_hz"] = 10
    if rng.random() < 0.25:
        said = corrupted_tree({"pedestrians": said}, rng).get("pedestrians", None)
    else:
        content = corrupted_table(content.decode(), rng, "," if is_table else " ")
    (folder / "paths.txt").write_bytes(content)
    tree = {
        "name": "recorded",
        "room": "plaza",
        "duration_s": 2,
        "pedestrians": said,
        "sensors": {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [3, 0, 0.4], "yaw_deg": 90}}},
    }
    (folder / "scenario.yaml").write_bytes(_yaml(tree))
    return _mutant(folder, "twin", "render", "scenario.yaml", *_RENDER)


def suites(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A suite; its cases are expanded, checked and noted, but not run: a corrupted suite may well be one of thousands."""
    (folder / "small.yaml").write_text(SMALL, encoding="utf-8")
    content = rng.choice(inputs.suites)
    corrupted = corrupted_text(content, rng) if rng.random() < 0.25 else _corrupted_yaml(content, rng)
    (folder / "suite.yaml").write_bytes(corrupted)
    return _mutant(folder, "twin-without-simulation", "suite", "run", "suite.yaml", "--jobs", "1", "--out", "out")


def bags(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A recording with its bytes corrupted, or what its messages say."""
    how = rng.choice(("mcap", "ros1", "messages", "messages"))
    if how == "mcap":
        path = folder / "corrupted.mcap"
        path.write_bytes(corrupted_bytes((inputs.recording / "recording.mcap").read_bytes(), rng))
    elif how == "ros1":
        path = folder / "corrupted.bag"
        path.write_bytes(corrupted_bytes(inputs.ros1.read_bytes(), rng))
    else:
        path = folder / "corrupted"
        _write_corrupted_messages(path, inputs, rng)
    tracker = rng.choice(("laser-imm", "laser-imm", "laser-fisheye-imm"))
    return _mutant(folder, "twin", "track", path.name, "--tracker", tracker, "--no-video", "--out", "out")


def _write_corrupted_messages(path: Path, inputs: Inputs, rng: Random) -> None:
    """A ROS 2 bag of the recording's messages, those of one topic, all or one of them, with a field corrupted."""
    topic = rng.choice(sorted({topic for topic, *_ in inputs.messages}))
    numbers = [number for number, each in enumerate(inputs.messages) if each[0] == topic]
    corrupt = set(numbers if rng.random() < 0.5 else [rng.choice(numbers)])
    seed = rng.random()
    with Writer(path, version=9, storage_plugin=rng.choice((StoragePlugin.MCAP, StoragePlugin.SQLITE3))) as writer:
        connections = {}
        for number, (name, msgtype, log_ns, message) in enumerate(inputs.messages):
            if name not in connections:
                connections[name] = writer.add_connection(name, msgtype, typestore=TYPESTORE)
            data = TYPESTORE.serialize_cdr(message, msgtype)
            if number in corrupt:
                try:
                    data = TYPESTORE.serialize_cdr(_corrupted_message(message, Random(seed)), msgtype)
                except Exception:  # a value that the type cannot hold: its bytes are corrupted instead
                    data = corrupted_bytes(bytes(data), Random(seed))
            writer.write(connections[name], log_ns, data)


def _corrupted_message(message: Any, rng: Random) -> Any:
    fields = [name for name in vars(message) if name != "__msgtype__"]
    name = rng.choice(fields)
    value = getattr(message, name)
    if name == "header" and rng.random() < 0.7:
        stamp = replace(value.stamp, sec=rng.choice((0, -1, value.stamp.sec + 2_592_000, 2**31 - 1, -(2**31))))
        return replace(message, header=replace(value, stamp=stamp))
    if isinstance(value, str):
        try:
            tree = yaml.safe_load(value)
        except yaml.YAMLError:
            tree = value
        if isinstance(tree, dict | list):
            return replace(message, **{name: _yaml(corrupted_tree(tree, rng)).decode("utf-8", "replace")})
        return replace(message, **{name: rng.choice(TEXTS)})
    if isinstance(value, np.ndarray):
        if value.dtype == np.uint8:
            return replace(message, **{name: np.frombuffer(corrupted_bytes(value.tobytes(), rng), np.uint8)})
        sized = np.resize(value, rng.choice((0, 1, value.size - 1, value.size + 1, 100_000, value.size, value.size)))
        spots = np.random.default_rng(rng.randrange(2**32)).random(sized.size) < rng.choice((0, 0.1, 1))
        return replace(message, **{name: np.where(spots, rng.choice(FLOATS), sized).astype(value.dtype)})
    if isinstance(value, int | float):
        return replace(message, **{name: rng.choice(ANY_NUMBER)})
    return message


def rigs(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A rig.yaml for a bag."""
    content = Recording(inputs.recording / "recording.mcap").rig.dump_yaml()
    corrupted = corrupted_text(content, rng) if rng.random() < 0.3 else _corrupted_yaml(content, rng)
    (folder / "rig.yaml").write_bytes(corrupted)
    bag, tracker = inputs.recording / "recording.mcap", rng.choice(("laser-imm", "laser-fisheye-imm"))
    return _mutant(
        folder, "twin", "track", bag, "--rig", "rig.yaml", "--tracker", tracker, "--no-video", "--out", "out"
    )


def baselines(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A baseline, compared with itself as it was."""
    shipped = rng.choice(sorted((MODELS / "suites" / "baselines").glob("*.json")))
    content = shipped.read_text(encoding="utf-8")
    whole = rng.random() < 0.3
    corrupted = corrupted_bytes(content.encode(), rng) if whole else _json(corrupted_tree(json.loads(content), rng))
    (folder / "corrupted.json").write_bytes(corrupted)
    shutil.copy(shipped, folder / "whole.json")
    names = rng.choice((("corrupted.json", "whole.json"), ("whole.json", "corrupted.json")))
    return _mutant(folder, "twin", "suite", "compare", *names, "--out", "out/page.html")


def _json(tree: Any) -> bytes:
    return json.dumps(tree, default=str).encode()


def messages(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """Decoded observations, straight into a tracker."""
    return _mutant(folder, "messages", inputs.recording / "recording.mcap", rng.random())


def stores(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """Files that the twin wrote and reads again: results, manifests, recordings in the cache."""
    how = rng.choice(("results", "results", "results", "made", "cache"))
    (folder / "small.yaml").write_text(SMALL, encoding="utf-8")
    (folder / "victim.txt").write_text("not to be touched", encoding="utf-8")
    out = folder / "out"
    if how == "made":
        out.mkdir()
        for name in ("truth.csv", "notes.txt"):
            (out / name).write_text("", encoding="utf-8")
        made = corrupted_tree(["truth.csv", "../victim.txt", str(folder / "victim.txt"), "..", "tracks", "."], rng)
        content = (
            corrupted_bytes(_json(made), rng) if rng.random() < 0.3 else _json(rng.choice((made, made, hostile(rng))))
        )
        (out / ".made-by-twin.json").write_bytes(content)
        return _mutant(folder, "twin", "render", "small.yaml", *_RENDER)
    if how == "cache":
        return _with_corrupted_cache(inputs, rng, folder)
    shutil.copytree(inputs.folder / "suite", out)
    _corrupt_results(out / "results.sqlite", rng)
    (folder / "suite.yaml").write_text(SUITE, encoding="utf-8")
    command = rng.choice(
        (
            ("twin", "suite", "show", "out"),
            ("twin", "suite", "compare", "out", inputs.folder / "suite"),
            ("twin-without-simulation", "suite", "run", "suite.yaml", "--jobs", "1", "--resume", "--out", "out"),
        )
    )
    mutant = _mutant(folder, *command)
    return replace(mutant, may_write=(*mutant.may_write, inputs.folder / "suite"))


def _corrupt_results(path: Path, rng: Random) -> None:
    if rng.random() < 0.4:
        path.write_bytes(corrupted_bytes(path.read_bytes(), rng))
        return
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("PRAGMA foreign_keys = OFF")
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice(tables)
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
        how = rng.choice(("update", "update", "update", "delete", "drop"))
        if how == "drop":
            connection.execute(f"DROP TABLE {table}")
        elif how == "delete":
            connection.execute(f"DELETE FROM {table} WHERE rowid % 2 = 0")
        else:
            value = rng.choice((None, b"\xff\x00", *(each for each in ANY_NUMBER if abs(each) < 2**63), *TEXTS[:-3]))
            value = value if not isinstance(value, str) else value.encode("utf-8", "replace").decode()
            rows = "" if rng.random() < 0.5 else " WHERE rowid = 1"
            connection.execute(f"UPDATE OR IGNORE {table} SET {rng.choice(columns)} = ?{rows}", (value,))


def _with_corrupted_cache(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """A suite whose recording is in the cache, damaged there."""
    cache = folder / "cache"
    shutil.copytree(inputs.folder / "cache", cache)
    files = sorted(path for path in cache.rglob("*") if path.is_file() and path.stat().st_size)
    corrupted = rng.choice(files)
    if rng.random() < 0.2:
        corrupted.unlink()
    else:
        corrupted.write_bytes(corrupted_bytes(corrupted.read_bytes(), rng))
    command = ("twin", "suite", "run", inputs.folder / "cached.yaml", "--jobs", "1", "--out", "out")
    mutant = _mutant(folder, *command, environment={"ROOMTWIN_CACHE": str(cache)})
    return replace(mutant, may_write=(*mutant.may_write, cache))


def environments(inputs: Inputs, rng: Random, folder: Path) -> Mutant:
    """An environment's .npz: bytes, or arrays exchanged with and without the fingerprint that fits."""
    path = folder / "corrupted.npz"
    if rng.random() < 0.4:
        path.write_bytes(corrupted_bytes(inputs.environment.read_bytes(), rng))
    else:
        with np.load(inputs.environment) as archive:
            arrays = {name: archive[name] for name in archive.files}
        name = rng.choice(sorted(set(arrays) - {"fingerprint"}))
        arrays[name] = _other_array(arrays[name], rng)
        if rng.random() < 0.8:
            arrays["fingerprint"] = np.array(_fingerprint(arrays))
        if rng.random() < 0.1:
            del arrays[name]
        np.savez_compressed(path, **arrays)
        if rng.random() < 0.05:
            with zipfile.ZipFile(path, "a") as archive:
                archive.writestr("../../victim.npy", b"x")
    return _mutant(folder, "environment", path.name)


def _other_array(array: np.ndarray, rng: Random) -> np.ndarray:
    if array.dtype.kind in "US":
        return np.array(rng.choice((*TEXTS[:6], 3, np.nan)))
    value = rng.choice(FLOATS)
    with np.errstate(all="ignore"):
        filled = np.full(array.shape, value)
        spotted = np.where(np.random.default_rng(rng.randrange(2**32)).random(array.shape) < 0.3, filled, array)
        shaped = (array[:0], array[:1], array.astype(str)) if array.ndim else (np.array([array]), array.astype(str))
        return rng.choice((filled, spotted, spotted.astype(array.dtype), *shaped, array * -1.0, array * 1e6))


KINDS: dict[str, Make] = {
    "scenarios": scenarios,
    "text": text,
    "tables": tables,
    "rooms": rooms,
    "settings": settings,
    "pedestrians": pedestrians,
    "suites": suites,
    "bags": bags,
    "rigs": rigs,
    "baselines": baselines,
    "messages": messages,
    "stores": stores,
    "environments": environments,
}
