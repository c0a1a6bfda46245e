"""What the tables of truth details have in common: rows as text and as JSON, frames in which nobody is met."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, TextIO, TypeVar

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores.ros2_humble import std_msgs__msg__String as String

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.recording.messages import STRING, TYPESTORE
from twin.recording.tables import seconds_cell
from twin.recording.whole_file import whole_file
from twin.tables.columns import CsvColumns

Cells = Mapping[str, int]


Frame = TypeVar("Frame")
FrameRows = tuple[int, str, Sequence[Cells]]
"""A frame as rows of a table that begins with t and the sensor's name: stamp [ns], sensor, the cells after these."""


class DetailWriter(Generic[Frame]):
    """Takes frames; made by `detail_writer`."""

    def __init__(self, stream: TextIO, columns: Sequence[str], rows_of: Callable[[Frame], FrameRows]) -> None:
        self._stream, self._rows_of, self._rest = stream, rows_of, "," * (len(columns) - 2)
        stream.write(",".join(columns) + "\n")

    def write(self, frame: Frame) -> None:
        """Write the lines of one frame; one without anybody is one line of which all but t and sensor is empty."""
        stamp_ns, sensor, rows = self._rows_of(frame)
        head = f"{seconds_cell(stamp_ns)},{sensor}"
        lines = [",".join([head, *map(str, row.values())]) + "\n" for row in rows]
        self._stream.write("".join(lines) or f"{head}{self._rest}\n")


@contextmanager
def detail_writer(
    path: Path, columns: Sequence[str], rows_of: Callable[[Frame], FrameRows]
) -> Iterator[DetailWriter[Frame]]:
    """A writer of such a table; the file is there when the block has ended well.

    Raises InputError where the file cannot be written.
    """
    with whole_file(path) as stream:
        yield DetailWriter(stream, columns, rows_of)


def frame_json(frame: FrameRows, columns: Sequence[str]) -> memoryview:
    """The same as a `std_msgs/String` (CDR) with a JSON list of objects, null for an empty cell."""
    stamp_ns, sensor, rows = frame
    head = {columns[0]: stamp_ns / NS_PER_S, columns[1]: sensor}
    nobody = dict.fromkeys(columns[2:])
    return json_string([head | dict(row) for row in rows] or [head | nobody])


def json_string(content: object) -> memoryview:
    """A `std_msgs/String` (CDR) of JSON."""
    return TYPESTORE.serialize_cdr(String(json.dumps(content, allow_nan=False)), STRING)


def split_frames(
    columns: CsvColumns, name: str, rest: Sequence[str]
) -> tuple[NDArray[np.int64], NDArray[np.str_], NDArray[np.intp]]:
    """Stamps [ns] and sensors of all rows, (n,), and the places of those that are about somebody.

    `name` is the column of the sensor's name, `rest` those that are empty in a frame without anybody. Raises InputError
    for a row without a sensor, and for a frame without anybody that has other rows.
    """
    stamps = columns.stamps_ns("t")
    sensors = columns.cells[name]
    for row, sensor in enumerate(sensors):
        if not sensor:
            columns.refuse(row, name, "the name of a sensor")
    somebody = columns.filled(rest) if len(columns) else np.zeros(0, dtype=np.bool_)
    seen = {(int(stamps[row]), sensors[row]): row for row in np.flatnonzero(~somebody).tolist()}
    for row, key in enumerate(zip(stamps.tolist(), sensors, strict=True)):
        empty = seen.get(key)
        if empty is not None and row != empty:
            raise InputError(
                f"{columns.source}: line {columns.lines[row]}: t {columns.cells['t'][row]}, {name} {key[1]} contradicts "
                f"line {columns.lines[empty]}, where nobody is met; one of them is expected"
            )
    return stamps, np.array(sensors, dtype=np.str_), np.flatnonzero(somebody)


def frames_once(stamps_ns: NDArray[np.int64], sensors: NDArray[np.str_]) -> tuple[NDArray[np.int64], NDArray[np.str_]]:
    """Every frame once, in the order of the rows: its stamp [ns] and its sensor, (n_frame,) each."""
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
