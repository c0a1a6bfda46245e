"""The tables `truth.csv` and `tracks/<tracker>.csv`: written row by row, read whole and checked.

Both have one row per person (or track) and frame. A frame without people (without tracks) is one row with only `t` filled: it
says that the frame was evaluated. `t` is in seconds with nine decimals, so that the nanosecond stamps survive; all other
numbers are the shortest decimals that read back to the same float. Room frame, metres, radians, metres per second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, isfinite, isnan, nan
from numbers import Integral
from operator import attrgetter
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.tracks import Track, TrackFrame, listed
from trackers.user_input.text_file import AnyPath, as_path
from twin.recording.atomic_file import open_atomic
from twin.tables.columns import LARGEST, MAX_INT64, CsvColumns
from twin.tables.contents import StampedRows, check_plausibility
from twin.tables.person_rows import read_person_rows
from twin.truth.truth_types import PersonTruth, TruthFrame

TRUTH_NUMBERS = ("x", "y", "z", "yaw", "head_x", "head_y", "head_z", "head_yaw", "vx", "vy")
_TRACK_NUMBERS = ("x", "y", "z", "vx", "vy", "head_x", "head_y", "head_z", "head_yaw")
TRUTH_COLUMNS = ("t", "id", *TRUTH_NUMBERS, "in_area")
TRACK_COLUMNS = ("t", "id", *_TRACK_NUMBERS, "status", "radius95_m")
STATUSES = ("confirmed", "coasting")
FOOT_NUMBERS = ("x", "y", "z", "yaw", "load_n", "pressure_x", "pressure_y")
_truth_numbers, _track_numbers, _foot_numbers = (
    attrgetter(*names) for names in (TRUTH_NUMBERS, (*_TRACK_NUMBERS, "radius95_m"), FOOT_NUMBERS)
)

_VISIBLE = "visible_"
_Ns = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TruthTable(StampedRows):
    """Truth as columns, one element per person and frame, ordered by stamp, then id; units as in `PersonTruth`."""

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_frame,) each frame once, those without people too, ascending
    stamps_ns: NDArray[np.int64]  # (n,)
    id: NDArray[np.int64]  # (n,)
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    yaw: NDArray[np.float64]
    head_x: NDArray[np.float64]
    head_y: NDArray[np.float64]
    head_z: NDArray[np.float64]
    head_yaw: NDArray[np.float64]
    vx: NDArray[np.float64]
    vy: NDArray[np.float64]
    in_area: NDArray[np.bool_]
    visible: dict[str, NDArray[np.float64]]  # by sensor
    notes: tuple[str, ...] = ()  # what was guessed in reading it
    labels: Mapping[int, str] = field(default_factory=dict)  # the table's own id of each person who was counted


@dataclass(frozen=True, eq=False)
class TrackTable(StampedRows):
    """Tracks as columns, one element per track and frame, ordered by stamp, then id; units as in `Track`."""

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_frame,) each frame once, those without tracks too, ascending
    stamps_ns: NDArray[np.int64]  # (n,)
    id: NDArray[np.int64]  # (n,)
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    vx: NDArray[np.float64]
    vy: NDArray[np.float64]
    head_x: NDArray[np.float64]
    head_y: NDArray[np.float64]
    head_z: NDArray[np.float64]
    head_yaw: NDArray[np.float64]
    status: NDArray[np.str_]  # (n,) of STATUSES; "": not said
    radius95_m: NDArray[np.float64]  # NaN: not stated
    notes: tuple[str, ...] = ()  # what was guessed in reading it


def person_columns(sensors: Iterable[str]) -> tuple[str, ...]:
    """Return the columns of `truth.csv`, with visible_<sensor> per sensor."""
    return (*TRUTH_COLUMNS, *(_VISIBLE + sensor for sensor in sensors))


class FrameText:
    """A frame of the truth and its numbers as text, which table and message share: they are formatted once, when asked for."""

    def __init__(self, frame: TruthFrame) -> None:
        self.frame = frame

    @cached_property
    def people(self) -> list[list[str]]:
        """Cells of each person: `TRUTH_NUMBERS`, and the shares that its `visible` holds."""
        return [number_cells((*_truth_numbers(each), *each.visible.values())) for each in self.frame.people]

    @cached_property
    def feet(self) -> list[list[str]]:
        """Cells of each foot, person by person: `FOOT_NUMBERS`."""
        return [number_cells(_foot_numbers(foot)) for person in self.frame.people for foot in person.feet]

    def people_rows(self, sensors: Sequence[str]) -> list[list[str]]:
        """Return the cells of `truth.csv` after id, with a column visible_<sensor> per sensor."""
        n, rows = len(TRUTH_NUMBERS), []
        for person, cells in zip(self.frame.people, self.people, strict=True):
            shown = dict(zip(person.visible, cells[n:], strict=True))
            rows.append([*cells[:n], str(int(person.in_area)), *(shown.get(sensor, "") for sensor in sensors)])
        return rows


def track_cells(track: Track) -> list[str]:
    """Return the cells of a track's row of `tracks/<tracker>.csv` after id."""
    *numbers, radius95_m = number_cells(_track_numbers(track))
    return [*numbers, track.status, radius95_m]


def person_of(row: Mapping[str, Any]) -> PersonTruth:
    """Convert such a row in JSON, null for an unknown number, to a person; raises as a mapping or number does."""

    def number(name: str) -> float:
        return nan if row[name] is None else float(row[name])

    return PersonTruth(
        id=int(row["id"]),
        **dict[str, Any]({name: number(name) for name in TRUTH_NUMBERS}),
        in_area=bool(row["in_area"]),
        visible={name.removeprefix(_VISIBLE): number(name) for name in row if name.startswith(_VISIBLE)},
    )


@contextmanager
def truth_writer(path: Path, sensors: Sequence[str] = ()) -> Iterator[Callable[[FrameText], None]]:
    """Open `truth.csv` with a column visible_<sensor> per sensor; yield a function that writes a frame, in order of time.

    The file appears when the block ends well. Raises InputError where the file cannot be written; the function raises
    ValueError for a stamp not later than the last, a repeated id or a bad number.
    """
    with open_atomic(path) as stream:
        rows = _RowWriter(stream, person_columns(sensors))
        yield lambda text: rows.write(text.frame.stamp_ns, text.frame.people, lambda: text.people_rows(sensors))


@contextmanager
def track_writer(path: Path) -> Iterator[Callable[[TrackFrame], None]]:
    """Open `tracks/<tracker>.csv`; yield a function that writes a frame, as `truth_writer` does."""
    with open_atomic(path) as stream:
        rows = _RowWriter(stream, TRACK_COLUMNS)
        yield lambda frame: rows.write(frame.stamp_ns, frame.tracks, lambda: map(_checked_cells, frame.tracks))


def _checked_cells(track: Track) -> list[str]:
    if track.status not in STATUSES:
        raise ValueError(f"track {track.id}: status {track.status!r} is none of {STATUSES}")
    if track.radius95_m <= 0:
        raise ValueError(f"track {track.id}: radius95_m is {track.radius95_m}; above 0 m, or NaN, is expected")
    return track_cells(track)


def read_truth(
    path: AnyPath,
    most_bytes: int | None = None,
    frame_rate_hz: float | None = None,
    rate_field: str = "frame_rate_hz",
    *,
    mot: bool = False,
    area: Area | None = None,
) -> TruthTable:
    """Read a `truth.csv` of no more than `most_bytes` (None: any size).

    t (or frame, with `frame_rate_hz`, which `rate_field` says), id, x and y suffice; see `read_person_rows` for the layouts. Ids
    that are not all whole numbers from 1 on are counted from 1. Without in_area, people within `area` are inside (None: all).
    Columns visible_<sensor> are kept by sensor, others ignored. `mot`: MOT text with places on the ground. Raises InputError
    naming file, line, column and value.
    """
    path, own = as_path(path, "a truth table"), "truth" if mot else None
    found = read_person_rows(path, "a truth table", most_bytes, frame_rate_hz, rate_field, own)
    rows = found.rows
    visible = {}
    for name in rows.cells:
        if name.startswith(_VISIBLE):
            share = rows.numbers(name, may_be_empty=True)
            for row in np.flatnonzero((share < 0) | (share > 1))[:1]:
                rows.refuse(int(row), name, "a share from 0 to 1 or an empty cell")
            visible[name.removeprefix(_VISIBLE)] = share
    numbers = {name: _numbers(rows, name) for name in TRUTH_NUMBERS}
    within = np.ones(len(rows), bool) if area is None else area.contains(np.column_stack([numbers["x"], numbers["y"]]))
    in_area = rows.flags("in_area") if "in_area" in rows.cells else within
    notes = found.notes if set(TRUTH_COLUMNS) <= set(rows.cells) else (*found.notes, *check_plausibility(found))
    if "status" in rows.cells:
        notes += (
            f"{path}: is read as truth and holds tracks by its column status; unless that is meant, truth comes first",
        )
    return TruthTable(
        str(path),
        found.frame_stamps_ns,
        found.stamps_ns,
        found.ids(),
        **numbers,
        in_area=in_area,
        visible=visible,
        notes=notes,
        labels=found.counted(),
    )


def read_tracks(
    path: AnyPath,
    most_bytes: int | None = None,
    frame_rate_hz: float | None = None,
    rate_field: str = "frame_rate_hz",
    *,
    mot: bool = False,
) -> TrackTable:
    """Read a `tracks/<tracker>.csv` of no more than `most_bytes` (None: any size).

    t (or frame), id, x and y suffice, as in `read_truth`; status is "" where the table has none. Columns that the
    contract does not name are passed over. `mot` as in `read_truth`. Raises InputError naming file, line, column and value.
    """
    what, own = "a tracks table", "tracks" if mot else None
    path = as_path(path, what)
    found = read_person_rows(path, what, most_bytes, frame_rate_hz, rate_field, own)
    rows = found.rows
    numbers = {name: _numbers(rows, name) for name in _TRACK_NUMBERS}
    status = rows.words("status", STATUSES) if "status" in rows.cells else np.zeros(len(rows), dtype="<U9")
    radius = _numbers(rows, "radius95_m")
    for row in np.flatnonzero(radius <= 0)[:1]:
        rows.refuse(int(row), "radius95_m", "a radius above 0 [m] or an empty cell")
    index = found.frame_stamps_ns, found.stamps_ns, found.ids()
    return TrackTable(str(path), *index, **numbers, status=status, radius95_m=radius, notes=found.notes)


def truth_table(frames: Iterable[TruthFrame], source: str = "truth") -> TruthTable:
    """Convert truth frames to the table that reading their file would give; raises InputError for a repeated (stamp, id)."""
    frames = listed(frames, TruthFrame)
    people = [(frame.stamp_ns, person) for frame in frames for person in frame.people]
    frame_stamps, stamps, ids, order = _memory_index([f.stamp_ns for f in frames], [(s, p.id) for s, p in people])
    ordered = [people[i][1] for i in order]
    sensors = sorted({sensor for person in ordered for sensor in person.visible})
    return TruthTable(
        source,
        frame_stamps,
        stamps,
        ids,
        **dict[str, Any](_memory_numbers(ordered, TRUTH_NUMBERS)),
        in_area=np.array([person.in_area for person in ordered], dtype=np.bool_),
        visible={s: np.array([person.visible.get(s, nan) for person in ordered], dtype=np.float64) for s in sensors},
    )


def track_table(frames: Iterable[TrackFrame], source: str = "tracks") -> TrackTable:
    """Track frames as the table that reading their file would give; raises InputError for a repeated (stamp, id)."""
    frames = listed(frames, TrackFrame)
    tracks = [(frame.stamp_ns, track) for frame in frames for track in frame.tracks]
    at, stamps, ids, order = _memory_index([f.stamp_ns for f in frames], [(s, _id(s, t.id)) for s, t in tracks])
    ordered = [tracks[i][1] for i in order]
    status = np.array([track.status for track in ordered], dtype="<U9")
    numbers: dict[str, Any] = dict(_memory_numbers(ordered, (*_TRACK_NUMBERS, "radius95_m")))
    return TrackTable(source, at, stamps, ids, **numbers, status=status)


class _RowWriter:
    """The shared part of both writers: the header, the order of time, the frames without rows."""

    def __init__(self, stream: TextIO, columns: Sequence[str]) -> None:
        self._stream = stream
        self._empty_cells = "," * (len(columns) - 1)
        self._last_stamp_ns: float = -inf
        stream.write(",".join(columns) + "\n")

    def write(self, stamp_ns: int, entries: Sequence[Any], rows: Callable[[], Iterable[list[str]]]) -> None:
        if not isinstance(stamp_ns, Integral) or stamp_ns <= self._last_stamp_ns:
            raise ValueError(f"frame at {stamp_ns} ns after {self._last_stamp_ns} ns; whole stamps must grow")
        ids = [_id(stamp_ns, entry.id) for entry in entries]
        if len(set(ids)) < len(ids):
            raise ValueError(f"frame at {stamp_ns} ns: an id is repeated in {ids}")
        for id_, entry in zip(ids, entries, strict=True):
            if not (isfinite(entry.x) and isfinite(entry.y)):
                raise ValueError(f"frame at {stamp_ns} ns: id {id_} is at ({entry.x}, {entry.y}); a place is needed")
        t = seconds_cell(stamp_ns)
        lines = [",".join([t, str(id_), *cells]) + "\n" for id_, cells in zip(ids, rows(), strict=True)]
        self._stream.write("".join(lines) or t + self._empty_cells + "\n")
        self._last_stamp_ns = stamp_ns


def _id(stamp_ns: int, value: object) -> int:
    if isinstance(value, Integral) and 1 <= int(value) <= MAX_INT64:
        return int(value)
    raise ValueError(f"frame at {stamp_ns} ns: id {value!r}; a whole number from 1 to 2**63 - 1 is expected")


def seconds_cell(stamp_ns: int) -> str:
    """Format a stamp [ns] as seconds with nine decimals."""
    return f"{'-' if stamp_ns < 0 else ''}{abs(int(stamp_ns)) // NS_PER_S}.{abs(int(stamp_ns)) % NS_PER_S:09d}"


def number_cell(value: float) -> str:
    """Format a number: empty for NaN; raises ValueError for one that no table is read with."""
    if abs(value) <= LARGEST:
        return repr(float(value))
    if isnan(value):
        return ""
    raise ValueError(f"{value} in a table; finite, at most {LARGEST:g}, or NaN if not known, is needed")


def number_cells(numbers: Iterable[float]) -> list[str]:
    """Format numbers as `number_cell` does."""
    floats = list(map(float, numbers))
    if max(map(abs, floats), default=nan) <= LARGEST:  # false too where the first is NaN
        return repr(floats)[1:-1].replace("nan", "").split(", ")
    return [number_cell(each) for each in floats]


def _numbers(rows: CsvColumns, name: str) -> NDArray[np.float64]:
    """Return a column's numbers; NaN where the table has no such column."""
    known = name in rows.cells
    return rows.numbers(name, may_be_empty=name not in ("x", "y")) if known else np.full(len(rows), nan)


def _memory_index(frame_stamps: list[int], keys: list[tuple[int, int]]) -> tuple[_Ns, _Ns, _Ns, list[int]]:
    for key, n in Counter([*((stamp,) for stamp in frame_stamps), *keys]).items():
        if n > 1:
            where = f"frame at {key[0]} ns" + "".join(f", id {each}" for each in key[1:])
            raise InputError(f"{where} stands there {n} times; each stamp, and each id within it, once is expected")
    order = sorted(range(len(keys)), key=keys.__getitem__)
    index = np.array([keys[i] for i in order], dtype=np.int64).reshape(-1, 2)
    return np.array(sorted(frame_stamps), dtype=np.int64), index[:, 0], index[:, 1], order


def _memory_numbers(entries: Sequence, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    return {name: np.array([getattr(entry, name) for entry in entries], dtype=np.float64) for name in names}
