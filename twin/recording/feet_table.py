"""Names and feet of people: the tables `truth_people.csv` and `truth_feet.csv`, and the string on `/truth/feet`.

`truth_feet.csv` has one row per foot and frame, left before right, people by id; a frame without people is one row with only
`t`. `cells_<floor>` holds the numbers of the cells that a foot loads, separated by blanks, counted row by row from 0, at stamps
of that floor; it is empty at others. Numbers are written as in `truth.csv`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from trackers.observations import NS_PER_S
from twin.recording.atomic_file import open_atomic
from twin.recording.messages import string_message
from twin.recording.tables import Row, cell, plain, seconds_cell
from twin.truth.frames import FootTruth, PersonTruth, TruthFrame

_NUMBERS = ("x", "y", "z", "yaw", "load_n", "pressure_x", "pressure_y")
FEET_COLUMNS = ("t", "id", "foot", *_NUMBERS, "contact")
PEOPLE_COLUMNS = ("id", "name")
_CELLS = "cells_"


def write_names(path: Path, names: Mapping[int, str]) -> None:
    """Write `truth_people.csv`: one row per person of the scenario by id, present in the run or not.

    Raises InputError where the file cannot be written.
    """
    with open_atomic(path) as stream:
        stream.write(",".join(PEOPLE_COLUMNS) + "\n")
        for number, name in sorted(names.items()):
            stream.write(f"{number},{name}\n")


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
    """Open a writer of `truth_feet.csv` with a column cells_<floor> per floor; the file appears when the block ends well.

    Raises InputError where the file cannot be written.
    """
    with open_atomic(path) as stream:
        yield FeetWriter(stream, floors)


def encode_feet(frame: TruthFrame) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR): a JSON list with one object per foot, null where unknown."""
    t = frame.stamp_ns / NS_PER_S
    feet = [{"t": t} | plain(_row(person, foot, foot.cells)) for person in frame.people for foot in person.feet]
    return string_message(feet)


def _row(person: PersonTruth, foot: FootTruth, floors: Iterable[str]) -> Row:
    """Return a foot's row after t, with a column cells_<floor> per floor."""
    numbers = {name: float(getattr(foot, name)) for name in _NUMBERS}
    loaded = {_CELLS + floor: foot.cells.get(floor, ()) for floor in floors}
    return {"id": person.id, "foot": foot.side, **numbers, "contact": int(foot.contact), **loaded}
