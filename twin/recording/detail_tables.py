"""Truth about pictures and scans: `truth_boxes.csv`, `truth_rays.csv`, and the strings on `/truth/boxes`, `/truth/rays`.

Both tables begin with t and the sensor's name. A frame (picture or scan) that holds no person is one row with these two alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TextIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.recording import topics
from twin.recording.atomic_file import open_atomic
from twin.recording.messages import string_message
from twin.recording.situation_table import encode_situation, situation_writer
from twin.recording.tables import seconds_cell
from twin.tables.columns import CsvColumns, StampedRows, read_csv_columns
from twin.truth.frames import BoxFrame, RayFrame, Situation, TruthDetail

Cells = Mapping[str, int]
Frame = TypeVar("Frame")
FrameRows = tuple[int, str, Sequence[Cells]]
"""A frame as rows of a table that begins with t and the sensor's name: stamp [ns], sensor, the cells after these."""


class _TableWriter(Generic[Frame]):
    """Takes frames; made by `_table_writer`."""

    def __init__(self, stream: TextIO, columns: Sequence[str], rows_of: Callable[[Frame], FrameRows]) -> None:
        self._stream, self._rows_of, self._rest = stream, rows_of, "," * (len(columns) - 2)
        stream.write(",".join(columns) + "\n")

    def write(self, frame: Frame) -> None:
        """Write the lines of one frame; a frame without people is one line with t and sensor alone."""
        stamp_ns, sensor, rows = self._rows_of(frame)
        head = f"{seconds_cell(stamp_ns)},{sensor}"
        lines = [",".join([head, *map(str, row.values())]) + "\n" for row in rows]
        self._stream.write("".join(lines) or f"{head}{self._rest}\n")


@contextmanager
def _table_writer(
    path: Path, columns: Sequence[str], rows_of: Callable[[Frame], FrameRows]
) -> Iterator[_TableWriter[Frame]]:
    """Open a writer of such a table; the file appears when the block ends well.

    Raises InputError where the file cannot be written.
    """
    with open_atomic(path) as stream:
        yield _TableWriter(stream, columns, rows_of)


def frame_json(frame: FrameRows, columns: Sequence[str]) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR) with a JSON list of objects, null for an empty cell."""
    stamp_ns, sensor, rows = frame
    head = {columns[0]: stamp_ns / NS_PER_S, columns[1]: sensor}
    empty = dict.fromkeys(columns[2:])
    return string_message([head | dict(row) for row in rows] or [head | empty])


def split_frames(
    columns: CsvColumns, name: str, rest: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.str_], NDArray[np.intp]]:
    """Return stamps [ns] and sensors of all rows, (n,), and the indices of the rows with a person.

    `name` is the column of the sensor's name, `rest` the columns that are empty in a frame without people. Raises InputError
    for a row without a sensor, and for a frame without people that has other rows.
    """
    stamps = columns.stamps_ns("t")
    sensors = columns.cells[name]
    for row, sensor in enumerate(sensors):
        if not sensor:
            columns.refuse(row, name, "the name of a sensor")
    with_person = columns.filled(rest) if len(columns) else np.zeros(0, dtype=np.bool_)
    seen = {(int(stamps[row]), sensors[row]): row for row in np.flatnonzero(~with_person).tolist()}
    for row, key in enumerate(zip(stamps.tolist(), sensors, strict=True)):
        empty = seen.get(key)
        if empty is not None and row != empty:
            raise InputError(
                f"{columns.source}: line {columns.lines[row]}: t {columns.cells['t'][row]}, {name} {key[1]} contradicts "
                f"line {columns.lines[empty]}, where empty is met; one of them is expected"
            )
    return stamps, np.array(sensors, dtype=np.str_), np.flatnonzero(with_person)


def unique_frames(
    stamps_ns: NDArray[np.int64], sensors: NDArray[np.str_]
) -> tuple[NDArray[np.int64], NDArray[np.str_]]:
    """Return each frame once, in the order of the rows: its stamp [ns] and its sensor, (n_frame,) each."""
    first = list(dict.fromkeys(zip(stamps_ns.tolist(), sensors.tolist(), strict=True)))
    return np.array([stamp for stamp, _ in first], dtype=np.int64), np.array([name for _, name in first], dtype=np.str_)


def refuse_repeats(columns: CsvColumns, what: Sequence[str]) -> None:
    """Raise InputError where two rows agree in the columns `what`."""
    seen: dict[tuple[str, ...], int] = {}
    for row, key in enumerate(zip(*(columns.cells[name] for name in what), strict=True)):
        if key in seen:
            said = ", ".join(f"{name} {value}" for name, value in zip(what, key, strict=True))
            raise InputError(
                f"{columns.source}: line {columns.lines[row]}: {said} stands on line {columns.lines[seen[key]]} too; "
                "each once is expected"
            )
        seen[key] = row


BOX_COLUMNS = ("t", "camera", "id", "left", "top", "width", "height", "visible_px", "truncated")
_LEAST = {"id": 1, "left": 0, "top": 0, "width": 1, "height": 1, "visible_px": 1}


@dataclass(frozen=True, eq=False)
class BoxTable(StampedRows):
    """Boxes as columns, one element per person and picture, in the order of the file; units as in `twin.truth.frames.Box`.

    Pictures come in the order in which they were taken, people by id. Pictures without a row were not looked at: boxes are
    made for a few pictures per second. A person hidden from the camera altogether has no row. The share of each person that a
    camera sees, by rays, is in truth.csv at the same `t`: visible_<camera>.
    """

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_picture,) every picture that was looked at once, those without people too
    frame_camera: NDArray[np.str_]  # (n_picture,)
    stamps_ns: NDArray[np.int64]  # (n,)
    camera: NDArray[np.str_]  # (n,)
    id: NDArray[np.int64]
    left: NDArray[np.int64]
    top: NDArray[np.int64]
    width: NDArray[np.int64]
    height: NDArray[np.int64]
    visible_px: NDArray[np.int64]
    truncated: NDArray[np.bool_]


def box_writer(path: Path) -> AbstractContextManager[_TableWriter[BoxFrame]]:
    """Open a writer of `truth_boxes.csv`, see `_table_writer`."""
    return _table_writer(path, BOX_COLUMNS, _box_rows)


def read_boxes(path: Path) -> BoxTable:
    """Read a `truth_boxes.csv`; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, BOX_COLUMNS, "table of boxes")
    stamps, cameras, with_person = split_frames(columns, "camera", BOX_COLUMNS[2:])
    rows = columns.take(with_person)
    numbers = {name: rows.integers(name, minimum=least) for name, least in _LEAST.items()}
    area = numbers["width"] * numbers["height"]
    for row in np.flatnonzero(numbers["visible_px"] > area)[:1]:
        rows.refuse(int(row), "visible_px", f"at most the box's {area[row]} pixels")
    refuse_repeats(rows, ("t", "camera", "id"))
    return BoxTable(
        str(path),
        *unique_frames(stamps, cameras),
        stamps[with_person],
        cameras[with_person],
        **numbers,
        truncated=rows.flags("truncated"),
    )


def encode_boxes(frame: BoxFrame) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR): a JSON list with one object per box, the columns of truth_boxes.csv."""
    return frame_json(_box_rows(frame), BOX_COLUMNS)


def _box_rows(frame: BoxFrame) -> FrameRows:
    names = BOX_COLUMNS[2:]
    return frame.stamp_ns, frame.camera, [{name: int(getattr(box, name)) for name in names} for box in frame.boxes]


RAY_COLUMNS = ("t", "sensor", "id", "first_beam", "last_beam")


@dataclass(frozen=True, eq=False)
class RayTable(StampedRows):
    """Runs of beams as columns, one element per run, in the order of the file.

    A run is consecutive beams that meet the same person, counted from 0 in the order of the scan's ranges. Beams in no run
    meet the room, or nothing within range. It is the truth of the ideal scan at its true time: noise and faults change ranges
    and stamps, not the person that a beam meets. A scan that the scanner loses (its `dropout`) has no row; one that a fault
    loses on its way may have.
    """

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_scan,) every scan once, those that met empty too
    frame_sensor: NDArray[np.str_]  # (n_scan,)
    stamps_ns: NDArray[np.int64]  # (n,)
    sensor: NDArray[np.str_]  # (n,)
    id: NDArray[np.int64]
    first_beam: NDArray[np.int64]
    last_beam: NDArray[np.int64]

    def person_of_ray(self, sensor: str, stamp_ns: int, n_beam: int) -> NDArray[np.int16]:
        """Return the id of the person that each beam of a scan meets, 0 for none, (n_beam,).

        Raises KeyError where the table does not hold that scan.
        """
        if not ((self.frame_stamps_ns == stamp_ns) & (self.frame_sensor == sensor)).any():
            raise KeyError(f"{self.source}: no scan of {sensor!r} at {stamp_ns} ns")
        person = np.zeros(n_beam, dtype=np.int16)
        for row in np.flatnonzero((self.stamps_ns == stamp_ns) & (self.sensor == sensor)):
            person[self.first_beam[row] : self.last_beam[row] + 1] = self.id[row]
        return person


def ray_writer(path: Path) -> AbstractContextManager[_TableWriter[RayFrame]]:
    """Open a writer of `truth_rays.csv`, see `_table_writer`."""
    return _table_writer(path, RAY_COLUMNS, _ray_rows)


def read_rays(path: Path) -> RayTable:
    """Read a `truth_rays.csv`; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, RAY_COLUMNS, "table of rays")
    stamps, sensors, with_person = split_frames(columns, "sensor", RAY_COLUMNS[2:])
    rows = columns.take(with_person)
    table = RayTable(
        str(path),
        *unique_frames(stamps, sensors),
        stamps[with_person],
        sensors[with_person],
        id=rows.integers("id", minimum=1),
        first_beam=rows.integers("first_beam", minimum=0),
        last_beam=rows.integers("last_beam", minimum=0),
    )
    for row in np.flatnonzero(table.last_beam < table.first_beam)[:1]:
        rows.refuse(int(row), "last_beam", f"a beam from first_beam, {table.first_beam[row]}, on")
    _check_apart(rows, table)
    return table


def _check_apart(rows: CsvColumns, table: RayTable) -> None:
    """Raise InputError where a beam belongs to two runs."""
    order = np.lexsort((table.first_beam, table.sensor, table.stamps_ns))
    before, after = order[:-1], order[1:]
    same_scan = (table.stamps_ns[before] == table.stamps_ns[after]) & (table.sensor[before] == table.sensor[after])
    for place in np.flatnonzero(same_scan & (table.first_beam[after] <= table.last_beam[before]))[:1]:
        first, second = sorted((int(before[place]), int(after[place])))
        raise InputError(
            f"{rows.source}: line {rows.lines[second]}: beams {table.first_beam[second]} to {table.last_beam[second]} "
            f"overlap those of line {rows.lines[first]}; runs of one scan that lie apart are expected"
        )


def encode_rays(frame: RayFrame) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR): a JSON list with one object per run, the columns of truth_rays.csv."""
    return frame_json(_ray_rows(frame), RAY_COLUMNS)


def _ray_rows(frame: RayFrame) -> FrameRows:
    names = RAY_COLUMNS[2:]
    return frame.stamp_ns, frame.sensor, [{name: int(getattr(run, name)) for name in names} for run in frame.runs]


DETAIL_FILES = ("truth_boxes.csv", "truth_rays.csv", "truth_situations.csv")
DETAIL_TOPICS = (topics.TRUTH_BOXES, topics.TRUTH_RAYS, topics.TRUTH_SITUATIONS)


@contextmanager
def detail_writer(folder: Path) -> Iterator[Callable[[TruthDetail], None]]:
    """Open the three detail tables and yield a function that writes a detail into its table.

    The files appear when the block ends well. Raises InputError where a file cannot be written.
    """
    with ExitStack() as stack:
        box_file, ray_file, situation_file = (folder / name for name in DETAIL_FILES)
        boxes = stack.enter_context(box_writer(box_file))
        rays = stack.enter_context(ray_writer(ray_file))
        situations = stack.enter_context(situation_writer(situation_file))

        def write(detail: TruthDetail) -> None:
            match detail:
                case BoxFrame():
                    boxes.write(detail)
                case RayFrame():
                    rays.write(detail)
                case Situation():
                    situations.write(detail)

        yield write


def encode_detail(detail: TruthDetail) -> tuple[str, int, memoryview]:
    """Return topic, log time [ns] (of a situation its end) and message (CDR) of a detail."""
    match detail:
        case BoxFrame():
            return topics.TRUTH_BOXES, detail.stamp_ns, encode_boxes(detail)
        case RayFrame():
            return topics.TRUTH_RAYS, detail.stamp_ns, encode_rays(detail)
        case Situation():
            return topics.TRUTH_SITUATIONS, detail.end_ns, encode_situation(detail)
