"""Recordings to export: a bag with the people's names and the tracks of its run, with its truth on demand."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Nanoseconds
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.text_file import AnyPath
from twin.messages import OnWarning
from twin.recording import topics
from twin.recording.bag import open_bag
from twin.recording.reader import Recording
from twin.recording.ros_messages import STRING
from twin.recording.tables import STATUSES, TRACK_COLUMNS, TrackTable, read_tracks
from twin.run.inputs import scenario_of
from twin.scenario import Scenario
from twin.truth.frames import TruthFrame

RECORDING = "recording.mcap"
TRACK_NUMBERS = tuple(name for name in TRACK_COLUMNS[2:] if name != "status")
"""Numeric columns of a table of tracks, after t and id."""
_TRACKS = "/tracks/"
_TRUTH_WITHIN_NS = NS_PER_S // 1000
"""Greatest distance to a stamp of the truth, which exists at every stamp of every sensor."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recording, the name of its exported sequence, and the tracks of its run by tracker."""

    name: str
    recording: Recording
    tracks: Mapping[str, TrackTable] = field(default_factory=dict)
    rig_path: Path | None = None
    on_warning: OnWarning = lambda warning: None

    @cached_property
    def scenario(self) -> Scenario | None:
        """Scenario in a twin's bag; None in a robot's."""
        return scenario_of(self.recording)

    @property
    def has_truth(self) -> bool:
        """True for a bag with people's positions."""
        return topics.TRUTH_PEOPLE in self.recording.topics

    @property
    def person_names(self) -> dict[int, str]:
        """People's names by id, from the scenario; empty in a robot's bag."""
        return {} if self.scenario is None else dict(enumerate(self.scenario.people, start=1))

    def stamps_ns(self, sensor: str) -> Nanoseconds:
        """Return the stamps of a sensor's messages in order of arrival [ns]."""
        topic = {name: topic for topic, name in self.recording.sensor_topics.sensors.items()}.get(sensor)
        return np.zeros(0, dtype=np.int64) if topic is None else self.recording.stamps_ns[topic]


def open_recorded(
    path: AnyPath,
    rig: AnyPath | None = None,
    on_warning: OnWarning = lambda warning: None,
    *,
    name: str | None = None,
    tables: Mapping[str, Path] | None = None,
) -> Recorded:
    """Open a bag, or the folder of a run; its tracks are those of `tables` by tracker, else of the folder or the bag.

    `name`: of its sequence (default: that of the run or the bag). Raises InputError for a path that is neither.
    """
    path = Path(path)
    is_run = path.is_dir() and (path / RECORDING).is_file()
    recording = Recording(path / RECORDING if is_run else path, rig)
    if tables is None and is_run:
        tables = {each.stem: each for each in sorted((path / "tracks").glob("*.csv"))}
    tracks = _tracks_in(recording) if tables is None else {each: read_tracks(file) for each, file in tables.items()}
    name = name or (path.resolve().name if is_run else _bag_name(path.resolve()))
    return Recorded(name, recording, tracks, None if rig is None else Path(rig), on_warning)


def _bag_name(path: Path) -> str:
    return path.parent.name if path.name == RECORDING else path.stem


def _tracks_in(recording: Recording) -> dict[str, TrackTable]:
    """Read the tracks that a bag holds under `/tracks`, by tracker."""
    found: dict[str, list[dict[str, Any]]] = {
        name.removeprefix(_TRACKS): []
        for name, topic in recording.topics.items()
        if name.startswith(_TRACKS) and name.count("/") == 2 and name != "/tracks/start" and topic.msgtype == STRING
    }
    stamps: dict[str, list[int]] = {name: [] for name in found}
    with open_bag(recording.path) as bag:
        for topic, log_time_ns, message in bag.messages([_TRACKS + name for name in found]):
            name, stamp_ns = topic.removeprefix(_TRACKS), log_time_ns - recording.start_ns - recording.logged_after_ns
            try:
                rows = json.loads(message.data)
                found[name] += [{**row, "stamp_ns": stamp_ns} for row in rows if row["id"] is not None]
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(
                    f"{recording.path}: topic {topic}: holds {message.data[:60]!r}; a JSON list of tracks is expected"
                ) from error
            stamps[name].append(stamp_ns)
    return {name: _table(f"{recording.path}, {_TRACKS}{name}", stamps[name], rows) for name, rows in found.items()}


def _table(source: str, stamps: list[int], rows: list[dict[str, Any]]) -> TrackTable:
    return TrackTable(
        source,
        np.unique(np.array(stamps, dtype=np.int64)),
        np.array([row["stamp_ns"] for row in rows], dtype=np.int64),
        np.array([row["id"] for row in rows], dtype=np.int64),
        **dict[str, Any]({name: np.array([row.get(name) for row in rows], dtype=np.float64) for name in TRACK_NUMBERS}),
        status=np.array([row.get("status", STATUSES[0]) for row in rows], dtype="<U9"),
    )


class Truth:
    """Truth of a recording at stamps nearly in order: one pass over the bag, with a window of it in memory."""

    def __init__(self, frames: Iterator[TruthFrame], window_s: float = 3.0) -> None:
        """`window_s`: greatest delay of a stamp behind the latest one [s]."""
        self._frames = frames
        self._window_ns = round(window_s * NS_PER_S)
        self._held: deque[TruthFrame] = deque()

    def at(self, stamp_ns: int) -> TruthFrame | None:
        """Return the truth at a stamp [ns]; None if the bag lacks it."""
        while not self._held or self._held[-1].stamp_ns < stamp_ns:
            frame = next(self._frames, None)
            if frame is None:
                break
            self._held.append(frame)
            while self._held[0].stamp_ns < frame.stamp_ns - self._window_ns:
                self._held.popleft()
        nearest = min(self._held, key=lambda frame: abs(frame.stamp_ns - stamp_ns), default=None)
        return nearest if nearest is not None and abs(nearest.stamp_ns - stamp_ns) <= _TRUTH_WITHIN_NS else None


def frame_rate_hz(stamps_ns: Nanoseconds) -> float:
    """Return the rate of frames by the median gap of their stamps [Hz]; 1 for a single frame."""
    gaps = np.diff(np.unique(stamps_ns))
    return float(NS_PER_S / np.median(gaps)) if gaps.size else 1.0
