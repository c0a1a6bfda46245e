"""What the tables of truth details have in common: rows as text and as JSON, frames in which nobody is met."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.stores.ros2_humble import std_msgs__msg__String as String

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.recording.csv_columns import CsvColumns
from twin.recording.messages import STRING, TYPESTORE
from twin.recording.tables import seconds_cell

Cells = Mapping[str, int]


def frame_rows(stamp_ns: int, sensor: str, rows: Sequence[Cells], n_column: int) -> str:
    """Lines of a table that begins with t and sensor; a frame without anybody is one line of which the rest is empty."""
    head = f"{seconds_cell(stamp_ns)},{sensor}"
    lines = [",".join([head, *map(str, row.values())]) + "\n" for row in rows]
    return "".join(lines) or head + "," * (n_column - 2) + "\n"


def frame_json(stamp_ns: int, name: str, sensor: str, rows: Sequence[Cells], columns: Sequence[str]) -> memoryview:
    """The same as a `std_msgs/String` (CDR) with a JSON list of objects, null for an empty cell."""
    head = {"t": stamp_ns / NS_PER_S, name: sensor}
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
