"""Two hundred robots' bags with something wrong in each: tracked as well as the clean one, reported on stderr, or refused.

A clean bag of the twin's (two scanners, five people, 12 s) becomes a robot's: ROS 1, MCAP or SQLite, stamps of today. A mutant
has one fault, drawn by its seed, of one scanner or of all. It is handled well if its tracks are nearly as good as the clean
bag's, or a warning names the scanner, or it is refused in a sentence. A loss that is reported nowhere is a failure.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from benchmarks.figure import Figure
from trackers.errors import InputError
from trackers.rig import Rig
from twin.recording.bags.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import LASER_SCAN, STRING, time_message
from twin.recording.tables import TrackTable, TruthTable, read_tracks, read_truth
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import load_scenario

EPOCH_NS = 1_700_000_000 * 10**9
S, MS = 10**9, 10**6
_LAST_NS = (2**31 - 3600) * S
"""An hour before the seconds of a stamp end [ns]."""
MUTANTS = 200
_NEARLY = 0.03
_GATE_M, _SLACK_NS = 0.5, 80 * MS
_SUFFIXES = (".bag", ".mcap", ".db3")
_ROS1 = get_typestore(Stores.ROS1_NOETIC)


@dataclass
class Logged:
    """A message in a bag: topic, type, log time [ns], and the message or its bytes."""

    topic: str
    msgtype: str
    log_ns: int
    message: Any

    @property
    def stamp_ns(self) -> int:
        """Its header's stamp [ns]."""
        stamp = self.message.header.stamp
        return stamp.sec * S + stamp.nanosec

    def stamped(self, stamp_ns: int) -> Logged:
        """The same with another stamp in its header."""
        header = replace(self.message.header, stamp=time_message(stamp_ns))
        return replace(self, message=replace(self.message, header=header))


@dataclass
class Content:
    """Contents of a bag, and the damage done to the file afterwards."""

    messages: list[Logged]
    suffix: str
    also_topics: list[str] = field(default_factory=list)
    damage: Callable[[Path], None] | None = None


@dataclass(frozen=True)
class Clean:
    """The recording that mutants are made of: messages, rig and truth, and how well it is tracked."""

    messages: list[Logged]
    rig: Rig
    truth: TruthTable
    score: float


@dataclass(frozen=True)
class Outcome:
    """Outcome for a mutant; fault: '' where it was handled as it should be."""

    what: str
    score: float
    said: tuple[str, ...]
    fault: str


Fault = Callable[[Content, str, np.random.Generator], str]
"""Corrupts the messages of one topic and says what is wrong now."""


def of(content: Content, topic: str) -> list[int]:
    """The numbers of a topic's messages."""
    return [number for number, each in enumerate(content.messages) if each.topic == topic]


def some(content: Content, topic: str, rng: np.random.Generator) -> set[int]:
    """From a twentieth to nearly half of a topic's messages."""
    numbers = of(content, topic)
    return set(rng.choice(numbers, int(rng.uniform(0.05, 0.45) * len(numbers)), replace=False).tolist())


def drop(content: Content, topic: str, rng: np.random.Generator) -> str:
    lost = some(content, topic, rng)
    content.messages = [each for number, each in enumerate(content.messages) if number not in lost]
    return f"{len(lost)} messages dropped"


def silence(content: Content, topic: str, rng: np.random.Generator) -> str:
    starts = EPOCH_NS + round(rng.uniform(0, 9) * S)
    ends = starts + round(rng.uniform(2, 8) * S)
    content.messages = [each for each in content.messages if each.topic != topic or not starts <= each.log_ns < ends]
    return "silent for a while"


def unset(content: Content, topic: str, rng: np.random.Generator) -> str:
    corrupted = some(content, topic, rng)
    for number in corrupted:
        content.messages[number] = content.messages[number].stamped(0)
    return f"{len(corrupted)} stamps of 0"


def all_unset(content: Content, topic: str, rng: np.random.Generator) -> str:
    value = int(rng.choice([0, 1, EPOCH_NS - 10**12]))
    for number in of(content, topic):
        content.messages[number] = content.messages[number].stamped(value)
    return f"all stamps {value}"


def jump(content: Content, topic: str, rng: np.random.Generator) -> str:
    by_ns = round(float(rng.choice([-1, 1])) * 10 ** rng.uniform(-0.3, 6) * S)
    at_ns = EPOCH_NS + round(rng.uniform(1, 11) * S)
    for number in of(content, topic):
        if content.messages[number].log_ns >= at_ns:
            content.messages[number] = content.messages[number].stamped(content.messages[number].stamp_ns + by_ns)
    return f"clock set by {by_ns / S:g} s"


def drift(content: Content, topic: str, rng: np.random.Generator) -> str:
    ppm = int(rng.choice([-1, 1]) * 10 ** rng.uniform(3, 5))
    for number in of(content, topic):
        each = content.messages[number]
        content.messages[number] = each.stamped(each.stamp_ns + (each.log_ns - EPOCH_NS) * ppm // 10**6)
    return f"drifts by {ppm} ppm"


def other_clock(content: Content, topic: str, rng: np.random.Generator) -> str:
    by_ns = round(float(rng.choice([-1, 1])) * 10 ** rng.uniform(-0.8, 9) * S)
    by_ns = min(max(by_ns, -EPOCH_NS), _LAST_NS - EPOCH_NS)
    for number in of(content, topic):
        content.messages[number] = content.messages[number].stamped(content.messages[number].stamp_ns + by_ns)
    return f"clock off by {by_ns / S:g} s"


def twice(content: Content, topic: str, rng: np.random.Generator) -> str:
    doubled = some(content, topic, rng)
    again = [replace(content.messages[number], log_ns=content.messages[number].log_ns + 5 * MS) for number in doubled]
    content.messages += again
    return f"{len(again)} messages twice"


def late(content: Content, topic: str, rng: np.random.Generator) -> str:
    delay_ns = round(10 ** rng.uniform(-1, 0.6) * S)
    for number in some(content, topic, rng):
        content.messages[number].log_ns += delay_ns
    return f"messages {delay_ns / S:g} s late"


def empty_topic(content: Content, topic: str, rng: np.random.Generator) -> str:
    content.messages = [each for each in content.messages if each.topic != topic]
    content.also_topics.append(topic)
    return "a topic without messages"


def renamed(content: Content, topic: str, rng: np.random.Generator) -> str:
    for number in of(content, topic):
        content.messages[number].topic += "_raw"
    return "a topic of another name"


def other_types(content: Content, topic: str, rng: np.random.Generator) -> str:
    corrupted = some(content, topic, rng)
    for number in corrupted:
        each = content.messages[number]
        content.messages[number] = Logged(topic, STRING, each.log_ns, TYPESTORE.types[STRING]("scan"))
    return f"{len(corrupted)} messages of another type"


def _scans(change: Callable[[Any, np.random.Generator], Any], what: str) -> Fault:
    def damage(content: Content, topic: str, rng: np.random.Generator) -> str:
        corrupted = some(content, topic, rng)
        for number in corrupted:
            each = content.messages[number]
            content.messages[number] = replace(each, message=change(each.message, rng))
        return f"{len(corrupted)} scans {what}"

    return damage


def _without_readings(scan: Any, rng: np.random.Generator) -> Any:
    lost = rng.random(scan.ranges.size) < rng.choice([1.0, 0.8])
    return replace(scan, ranges=np.where(lost, np.float32(np.nan), scan.ranges).astype(np.float32))


def _framed(scan: Any, rng: np.random.Generator) -> Any:
    return replace(scan, header=replace(scan.header, frame_id="elsewhere"))


def all_millimetres(content: Content, topic: str, rng: np.random.Generator) -> str:
    for number in of(content, topic):
        each = content.messages[number]
        content.messages[number] = replace(
            each, message=replace(each.message, ranges=each.message.ranges * np.float32(1000))
        )
    return "ranges in millimetres"


def frozen(content: Content, topic: str, rng: np.random.Generator) -> str:
    numbers = of(content, topic)
    first = int(rng.integers(10, 80))
    for number in numbers[first : first + 30]:
        header = content.messages[number].message.header
        content.messages[number].message = replace(content.messages[numbers[first]].message, header=header)
    return "a scanner that hangs for 3 s"


def cut(content: Content, topic: str, rng: np.random.Generator) -> str:
    share = rng.uniform(0.1, 0.99)

    def damage(path: Path) -> None:
        data = path.read_bytes()
        path.write_bytes(data[: int(len(data) * share)])

    content.damage = damage
    return "a file that is cut"


def bytes_lost(content: Content, topic: str, rng: np.random.Generator) -> str:
    place = rng.uniform(0.02, 0.95)

    def damage(path: Path) -> None:
        data = path.read_bytes()
        start = int(len(data) * place)
        path.write_bytes(data[:start] + bytes(200) + data[start + 200 :])

    content.damage = damage
    return "200 bytes overwritten"


def looped(content: Content, topic: str, rng: np.random.Generator) -> str:
    content.messages += [replace(each, log_ns=each.log_ns + 12 * S) for each in content.messages]
    return "played twice"


def stepped_with_its_log(content: Content, topic: str, rng: np.random.Generator) -> str:
    at_ns, by_ns = EPOCH_NS + round(rng.uniform(2, 10) * S), round(rng.uniform(0.5, 8) * S)
    for number, each in enumerate(content.messages):
        if each.log_ns >= at_ns:
            content.messages[number] = replace(each.stamped(each.stamp_ns - by_ns), log_ns=each.log_ns - by_ns)
    return f"the recorder's clock set back by {by_ns / S:.1f} s too"


def log_times_lost(content: Content, topic: str, rng: np.random.Generator) -> str:
    for number, each in enumerate(content.messages):
        each.log_ns = EPOCH_NS + number * 1000
    return "log times written later"


def log_times_shuffled(content: Content, topic: str, rng: np.random.Generator) -> str:
    times = [each.log_ns for each in content.messages]
    content.messages = [
        replace(content.messages[k], log_ns=log_ns)
        for k, log_ns in zip(rng.permutation(len(times)), times, strict=True)
    ]
    return "log times shuffled"


def sectors(content: Content, topic: str, rng: np.random.Generator) -> str:
    n_sector = int(rng.integers(2, 13))
    found = [each for each in content.messages if each.topic != topic]
    for each in content.messages:
        scan = each.message
        for number, part in enumerate(
            np.array_split(np.arange(scan.ranges.size), n_sector) if each.topic == topic else ()
        ):
            after_ns = round(number * 90 * MS / n_sector)
            start_rad = scan.angle_min + part[0] * scan.angle_increment
            sector = replace(scan, ranges=scan.ranges[part], angle_min=start_rad)
            found.append(replace(each, log_ns=each.log_ns + after_ns, message=sector).stamped(each.stamp_ns + after_ns))
    content.messages = sorted(found, key=lambda each: each.log_ns)
    return f"each turn in {n_sector} messages"


def nothing(content: Content, topic: str, rng: np.random.Generator) -> str:
    return "nothing wrong"


FAULTS: tuple[Fault, ...] = (
    drop,
    silence,
    unset,
    all_unset,
    jump,
    jump,
    drift,
    other_clock,
    other_clock,
    twice,
    late,
    empty_topic,
    renamed,
    other_types,
    _scans(
        lambda scan, rng: replace(scan, angle_increment=float(rng.choice([0, np.nan, np.inf]))), "without an increment"
    ),
    _scans(lambda scan, rng: replace(scan, ranges=np.zeros(0, np.float32)), "without ranges"),
    _scans(lambda scan, rng: replace(scan, range_max=-1.0), "with limits that exclude each other"),
    _scans(_without_readings, "without readings"),
    _scans(_framed, "of another frame"),
    all_millimetres,
    frozen,
    cut,
    bytes_lost,
    looped,
    stepped_with_its_log,
    log_times_lost,
    log_times_shuffled,
    sectors,
    nothing,
)
_HARMLESS = (log_times_lost, sectors, other_clock, drift, late, bytes_lost, nothing)
"""Nothing need be reported of these where the tracks are as good: the fault may be too small to harm."""
_OF_ALL = (looped, stepped_with_its_log, log_times_lost, log_times_shuffled, cut, bytes_lost)


@cache
def clean_recording() -> Clean:
    """The twin's own run, as a robot would have recorded it."""
    with tempfile.TemporaryDirectory() as made:
        out = Path(made) / "run"
        scenario = load_scenario("lab-five-people", ["duration_s=12", "seed=5"])
        run_scenario(scenario, trackers=[], out=out, video=False, images=False)
        rig = Recording(out / "recording.mcap").rig
        rig = rig.model_copy(update={"sensors": rig.lasers()})
        with open_bag(out / "recording.mcap") as bag:
            topics = [sensor.topic for sensor in rig.sensors.values()]
            messages = [
                Logged(topic, LASER_SCAN, log_ns + EPOCH_NS, message).stamped(
                    message.header.stamp.sec * S + message.header.stamp.nanosec + EPOCH_NS
                )
                for topic, log_ns, message in bag.messages(topics)
            ]
        truth = read_truth(out / "truth.csv")
        unmeasured = Clean(messages, rig, truth, 0.0)
        folder = Path(made) / "clean"
        folder.mkdir()
        tracks, _, _ = _tracked(Content(list(messages), ".mcap"), rig, folder)
        return replace(unmeasured, score=_score(truth, tracks, 0))


def drill(seed: int, folder: Path) -> Outcome:
    """Make the mutant of this seed in `folder`, track it, and judge what became of it."""
    clean, rng = clean_recording(), np.random.default_rng((35, seed))
    fault = FAULTS[seed % len(FAULTS)]
    topics = [sensor.topic for sensor in clean.rig.sensors.values()]
    corrupted = [str(rng.choice(topics))] if rng.random() < 0.7 or fault in _OF_ALL else topics
    content = Content([replace(each) for each in clean.messages], str(rng.choice(_SUFFIXES)))
    what = "; ".join(fault(content, topic, rng) for topic in corrupted)
    names = [name for name, sensor in clean.rig.sensors.items() if sensor.topic in corrupted or fault in _OF_ALL]
    try:
        tracks, reported, shift_ns = _tracked(content, clean.rig, folder)
    except InputError as error:
        sentence = str(error)
        return Outcome(what, 0.0, (sentence,), "" if "\n" not in sentence.strip() else "refused in several lines")
    score = _score(clean.truth, tracks, shift_ns)
    is_shorter = (
        fault is silence and max(each.log_ns for each in content.messages) < clean.messages[-1].log_ns - S
    )  # it ends, all of it
    if fault not in _HARMLESS and not reported and not is_shorter:
        return Outcome(what, score, reported, "nothing reported")
    named = is_shorter or any(re.search(rf"\b{name}\b", line) for line in reported for name in names)
    if score < clean.score - _NEARLY and not named:
        return Outcome(what, score, reported, f"lost in silence: {score:.2f} in place of {clean.score:.2f}")
    if fault is nothing and reported:
        return Outcome(what, score, reported, f"warned of nothing: {reported[0]}")
    return Outcome(what, score, reported, "")


def _tracked(content: Content, rig: Rig, folder: Path) -> tuple[TrackTable, tuple[str, ...], int]:
    """The tracks of the bag, what was reported, and how far t = 0 is from the clean bag's start [ns]."""
    path, rig_path = folder / f"mutant{content.suffix}", folder / "rig.yaml"
    rig_path.write_text(rig.dump_yaml())
    write(content, path)
    reported: list[str] = []
    result = track_recording(
        path,
        trackers=["sort"],
        rig_path=rig_path,
        out=folder / "out",
        video=False,
        report=False,
        on_warning=reported.append,
    )
    first_ns = min(each.log_ns for each in content.messages[:2])
    return read_tracks(result.files["tracks sort"]), tuple(reported), first_ns - EPOCH_NS


def write(content: Content, path: Path) -> None:
    """Write a bag of the kind that its name says, and damage it."""
    messages = content.messages
    if path.suffix == ".bag":
        with rosbag1.Writer(path) as writer:
            _write(writer, messages, content.also_topics, _ROS1, "serialize_ros1")
    else:
        plugin = rosbag2.StoragePlugin.MCAP if path.suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
        with rosbag2.Writer(path.with_suffix(""), version=9, storage_plugin=plugin) as writer:
            _write(writer, messages, content.also_topics, TYPESTORE, "serialize_cdr")
        next(path.with_suffix("").glob(f"*{path.suffix}")).rename(path)
    if content.damage is not None:
        content.damage(path)


def _write(writer: Any, messages: list[Logged], also: list[str], store: Any, serialize: str) -> None:
    connections = {(topic, LASER_SCAN): writer.add_connection(topic, LASER_SCAN, typestore=store) for topic in also}
    for each in messages:
        key = each.topic, each.msgtype
        if key not in connections:
            connections[key] = writer.add_connection(*key, typestore=store)
        message = each.message
        if store is _ROS1 and each.msgtype == LASER_SCAN:
            kinds = _ROS1.types
            stamp = kinds["builtin_interfaces/msg/Time"](message.header.stamp.sec, message.header.stamp.nanosec)
            header = kinds["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id=message.header.frame_id)
            fields = {name: value for name, value in vars(message).items() if not name.startswith("__")}
            message = kinds[LASER_SCAN](**(fields | {"header": header}))
        elif store is _ROS1:
            message = _ROS1.types[each.msgtype](each.message.data)
        writer.write(connections[key], each.log_ns, getattr(store, serialize)(message, each.msgtype))


def _score(truth: TruthTable, tracks: TrackTable, shift_ns: int) -> float:
    """Twice the people tracked over people and tracks (F1), at each time of the truth's, without the first second."""
    matched = owed = reported = 0
    frames = tracks.frame_stamps_ns + shift_ns
    for stamp_ns in truth.frame_stamps_ns[truth.frame_stamps_ns >= S]:
        here = (truth.stamps_ns == stamp_ns) & truth.in_area
        people = np.column_stack([truth.x[here], truth.y[here]])
        owed += len(people)
        if not frames.size or np.abs(frames - stamp_ns).min() > _SLACK_NS:
            continue
        own = tracks.stamps_ns == tracks.frame_stamps_ns[np.abs(frames - stamp_ns).argmin()]
        found = np.column_stack([tracks.x[own], tracks.y[own]])
        reported += len(found)
        gaps = np.linalg.norm(people[:, None] - found, axis=-1)
        while gaps.size and gaps.min() <= _GATE_M:
            row, column = np.unravel_index(gaps.argmin(), gaps.shape)
            gaps[row], gaps[:, column] = np.inf, np.inf
            matched += 1
    return 2 * matched / max(owed + reported, 1)


def measure() -> Iterator[Figure]:
    """Two hundred mutants: how many lost something in silence; each is reported on stderr."""
    silent = refused = 0
    for seed in range(MUTANTS):
        with tempfile.TemporaryDirectory(prefix="bags-") as folder:
            outcome = drill(seed, Path(folder))
        refused += outcome.score == 0.0 and bool(outcome.said)
        if outcome.fault:
            silent += 1
            print(f"bags {seed}: {outcome.what}: {outcome.fault} {outcome.said}", file=sys.stderr, flush=True)
    yield Figure(f"bags: silent of {MUTANTS} mutants", silent, "", "<= 0")
    yield Figure("bags: refused in a sentence", refused / MUTANTS, "", "")
    yield Figure("bags: F1 of the clean bag", clean_recording().score, "", ">= 0.9")


def main() -> None:
    """Print what becomes of the mutants of these seeds: `python -m benchmarks.bag_drill FIRST LAST`."""
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        with tempfile.TemporaryDirectory(prefix="bags-") as folder:
            outcome = drill(seed, Path(folder))
        print(seed, outcome.what, f"{outcome.score:.3f}", outcome.fault or "well", *outcome.said, sep=" | ")


if __name__ == "__main__":
    main()
