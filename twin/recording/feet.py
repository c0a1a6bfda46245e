"""The truth about feet: the table `truth_feet.csv` and the string on `/truth/feet`.

One row a foot and moment, left before right, people in the order of their ids; a moment at which nobody is there is one
row with only `t`. `cells_<floor>` holds the numbers of the cells a foot loads, parted by blanks, counted row by row from
0, at stamps of that floor; it is empty at others. Numbers are written as in `truth.csv`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rosbags.typesys.stores.ros2_humble import std_msgs__msg__String as String

from trackers.observations import NS_PER_S
from twin.recording.messages import STRING, TYPESTORE
from twin.recording.tables import Row, cell, plain, seconds_cell
from twin.recording.whole_file import whole_file
from twin.truth.frames import FootTruth, PersonTruth, TruthFrame

_NUMBERS = ("x", "y", "z", "yaw", "load_n", "pressure_x", "pressure_y")
FEET_COLUMNS = ("t", "id", "foot", *_NUMBERS, "contact")
_CELLS = "cells_"


class FeetWriter:
    """Takes truth frames in order of time; made by `feet_writer`."""

    def __init__(self, stream: TextIO, floors: Sequence[str]) -> None:
        self._stream = stream
        self._floors = tuple(floors)
        columns = (*FEET_COLUMNS, *(_CELLS + floor for floor in floors))
        self._empty_cells = "," * (len(columns) - 1)
        stream.write(",".join(columns) + "\n")

    def write(self, frame: TruthFrame) -> None:
        """Write one frame; raises ValueError for a number that is infinite."""
        t = seconds_cell(frame.stamp_ns)
        rows = [_row(person, foot, self._floors) for person in frame.people for foot in person.feet]
        lines = [",".join([t, *map(cell, row.values())]) + "\n" for row in rows]
        self._stream.write("".join(lines) or t + self._empty_cells + "\n")


@contextmanager
def feet_writer(path: Path, floors: Sequence[str] = ()) -> Iterator[FeetWriter]:
    """A writer of `truth_feet.csv` with a column cells_<floor> each; the file is there when the block has ended well.

    Raises InputError where the file cannot be written.
    """
    with whole_file(path) as stream:
        yield FeetWriter(stream, floors)


def encode_feet(frame: TruthFrame) -> memoryview:
    """A `std_msgs/String` (CDR) with a JSON list: one object a foot, the columns of truth_feet.csv, null where unknown."""
    t = frame.stamp_ns / NS_PER_S
    feet = [{"t": t} | plain(_row(person, foot, foot.cells)) for person in frame.people for foot in person.feet]
    return TYPESTORE.serialize_cdr(String(json.dumps(feet, allow_nan=False)), STRING)


def _row(person: PersonTruth, foot: FootTruth, floors: Iterable[str]) -> Row:
    """A foot's row after t, with a column cells_<floor> each."""
    numbers = {name: float(getattr(foot, name)) for name in _NUMBERS}
    loaded = {_CELLS + floor: foot.cells.get(floor, ()) for floor in floors}
    return {"id": person.id, "foot": foot.side, **numbers, "contact": int(foot.contact), **loaded}
