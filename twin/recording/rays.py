"""The truth about scans: the table `truth_rays.csv` and the string on `/truth/rays`.

Whom the beams of a scan meet: one row for each run of beams that follow one another and meet the same person, beams
counted from 0 in the order of the scan's ranges, scans in the order in which they were taken. Beams in no run meet the
room or nothing within range. A scan that meets nobody is one row with only `t` and `sensor`. It is the ideal scan's truth,
at the moment at which it was truly taken: noise and faults change ranges and stamps, not whom a beam meets. A scan that
the scanner loses (its `dropout`) has no row; one that a fault loses on its way may have.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.recording.detail_rows import DetailWriter, FrameRows, detail_writer, frame_json, frames_once, split_frames
from twin.tables.columns import CsvColumns, StampedRows, read_csv_columns
from twin.truth.frames import RayFrame

RAY_COLUMNS = ("t", "sensor", "id", "first_beam", "last_beam")


@dataclass(frozen=True, eq=False)
class RayTable(StampedRows):
    """Runs of beams as columns, one element a run, in the order of the file."""

    source: str
    frame_stamps_ns: NDArray[np.int64]  # (n_scan,) every scan once, those that met nobody too
    frame_sensor: NDArray[np.str_]  # (n_scan,)
    stamps_ns: NDArray[np.int64]  # (n,)
    sensor: NDArray[np.str_]  # (n,)
    id: NDArray[np.int64]
    first_beam: NDArray[np.int64]
    last_beam: NDArray[np.int64]

    def person_of_ray(self, sensor: str, stamp_ns: int, n_beam: int) -> NDArray[np.int16]:
        """The id of the person whom each beam of a scan meets, 0 for nobody, (n_beam,).

        Raises KeyError where the table does not hold that scan.
        """
        if not ((self.frame_stamps_ns == stamp_ns) & (self.frame_sensor == sensor)).any():
            raise KeyError(f"{self.source}: no scan of {sensor!r} at {stamp_ns} ns")
        person = np.zeros(n_beam, dtype=np.int16)
        for row in np.flatnonzero((self.stamps_ns == stamp_ns) & (self.sensor == sensor)):
            person[self.first_beam[row] : self.last_beam[row] + 1] = self.id[row]
        return person


def ray_writer(path: Path) -> AbstractContextManager[DetailWriter[RayFrame]]:
    """A writer of `truth_rays.csv`, see `detail_writer`."""
    return detail_writer(path, RAY_COLUMNS, _rows)


def read_rays(path: Path) -> RayTable:
    """Read a `truth_rays.csv`; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, RAY_COLUMNS, "table of rays")
    stamps, sensors, somebody = split_frames(columns, "sensor", RAY_COLUMNS[2:])
    rows = columns.take(somebody)
    table = RayTable(
        str(path),
        *frames_once(stamps, sensors),
        stamps[somebody],
        sensors[somebody],
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
    """A `std_msgs/String` (CDR) with a JSON list: one object a run, the columns of truth_rays.csv."""
    return frame_json(_rows(frame), RAY_COLUMNS)


def _rows(frame: RayFrame) -> FrameRows:
    names = RAY_COLUMNS[2:]
    return frame.stamp_ns, frame.sensor, [{name: int(getattr(run, name)) for name in names} for run in frame.runs]
