"""Situations of two people: the table `truth_situations.csv` and the string on `/truth/situations`.

One row per situation, in the order in which they end; the kinds are explained in `twin.truth.situations`. `start_t` is the
first frame in which it holds, `end_t` the first in which it no longer does; where `complete` is 0 the run ended before that,
and `end_t` is its end. `sensor` is empty but for merged; `how` says in which way a merged pair, of one scanner or of the rig,
is not separated; `least_m` is the least distance, or gap (correlated), during it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from math import nan
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.recording.ros.ros_messages import string_message
from twin.recording.tables import number_cell, seconds_cell
from twin.tables.columns import read_csv_columns
from twin.truth.truth_types import Separation, Situation, SituationKind

SITUATION_COLUMNS = ("kind", "first_id", "second_id", "sensor", "start_t", "end_t", "complete", "how", "least_m")
KINDS: tuple[SituationKind, ...] = ("interaction", "correlated", "merged", "merged_rig")
HOW: tuple[Separation, ...] = ("", "joined", "hidden", "both")

Word = TypeVar("Word", bound=str)


@dataclass(frozen=True, eq=False)
class SituationTable:
    """Situations as columns, one element a situation, in the order of the file."""

    source: str
    kind: NDArray[np.str_]  # (n,) of KINDS
    first_id: NDArray[np.int64]
    second_id: NDArray[np.int64]
    sensor: NDArray[np.str_]
    start_ns: NDArray[np.int64]
    end_ns: NDArray[np.int64]
    complete: NDArray[np.bool_]
    how: NDArray[np.str_]  # (n,) of HOW
    least_m: NDArray[np.float64]  # NaN where unknown

    def __len__(self) -> int:
        return self.kind.size

    def select(self, kind: SituationKind, sensor: str | None = None) -> SituationTable:
        """Return the situations of one kind, and of one sensor."""
        rows = self.kind == kind if sensor is None else (self.kind == kind) & (self.sensor == sensor)
        columns = {field.name: getattr(self, field.name)[rows] for field in fields(self)[1:]}
        return SituationTable(self.source, **columns)

    def frames(self, stamps_ns: NDArray[np.int64], after_s: float = 0.0) -> NDArray[np.bool_]:
        """Return which of these frames (k,) lie in each situation, (n, k): from its start up to, not at, its end.

        With `after_s` the time after the end counts too, in which a tracking error on either person means that the situation
        is not disposed of.
        """
        stamps_ns = np.asarray(stamps_ns)
        late_ns = self.end_ns[:, None] + round(after_s * NS_PER_S)
        return (stamps_ns >= self.start_ns[:, None]) & (stamps_ns < late_ns)

    def pair_frames(self, stamps_ns: NDArray[np.int64]) -> int:
        """Count the pairs of people in such a situation over these frames.

        For situations of one kind and sensor, which do not overlap.
        """
        return int(np.count_nonzero(self.frames(stamps_ns)))


def situation_line(situation: Situation) -> str:
    """Format the line of a situation in `truth_situations.csv`; raises ValueError for a number that is infinite."""
    values = ("" if each is None else each for each in _row(situation, seconds_cell).values())
    return ",".join([number_cell(each) if isinstance(each, float) else str(each) for each in values]) + "\n"


def read_situations(path: Path) -> SituationTable:
    """Read a `truth_situations.csv`; raises InputError naming file, line, column and value."""
    columns = read_csv_columns(path, SITUATION_COLUMNS, "table of situations")
    table = SituationTable(
        str(path),
        kind=columns.words("kind", KINDS),
        first_id=columns.integers("first_id", minimum=1),
        second_id=columns.integers("second_id", minimum=1),
        sensor=_words(columns.cells["sensor"]),
        start_ns=columns.stamps_ns("start_t"),
        end_ns=columns.stamps_ns("end_t"),
        complete=columns.flags("complete"),
        how=columns.words("how", HOW),
        least_m=columns.numbers("least_m", may_be_empty=True),
    )
    for row in np.flatnonzero(table.second_id <= table.first_id)[:1]:
        columns.refuse(int(row), "second_id", f"an id above first_id, {table.first_id[row]},")
    for row in np.flatnonzero(table.end_ns < table.start_ns)[:1]:
        columns.refuse(int(row), "end_t", f"a time from start_t, {columns.cells['start_t'][row]}, on")
    by_sensor = table.kind == "merged"
    for row in np.flatnonzero(by_sensor != (table.sensor != ""))[:1]:
        columns.refuse(int(row), "sensor", "the name of a scanner" if by_sensor[row] else "an empty cell")
    for row in np.flatnonzero(table.least_m < 0)[:1]:
        columns.refuse(int(row), "least_m", "0 or more, or an empty cell,")
    return table


def situation_table(situations: Iterable[Situation], source: str = "situations") -> SituationTable:
    """Convert situations to a table, as read from their file."""
    rows = list(situations)
    return SituationTable(
        source,
        kind=_words([row.kind for row in rows], KINDS),
        first_id=np.array([row.first_id for row in rows], dtype=np.int64),
        second_id=np.array([row.second_id for row in rows], dtype=np.int64),
        sensor=_words([row.sensor for row in rows]),
        start_ns=np.array([row.start_ns for row in rows], dtype=np.int64),
        end_ns=np.array([row.end_ns for row in rows], dtype=np.int64),
        complete=np.array([row.complete for row in rows], dtype=np.bool_),
        how=_words([row.how for row in rows], HOW),
        least_m=np.array([row.least_m for row in rows], dtype=np.float64),
    )


def encode_situation(situation: Situation) -> memoryview:
    """Encode a `std_msgs/String` (CDR): a JSON list of one object, the columns of truth_situations.csv, null where unknown."""
    row = _row(situation, lambda ns: ns / NS_PER_S)
    return string_message(
        [{name: None if value != value else value for name, value in row.items()}]
    )  # NaN alone differs


def _row(situation: Situation, time: Callable[[int], float | str]) -> dict[str, float | str | None]:
    """Return the situation's row, stamps [ns] written by `time`."""
    return {
        "kind": situation.kind,
        "first_id": situation.first_id,
        "second_id": situation.second_id,
        "sensor": situation.sensor or None,
        "start_t": time(situation.start_ns),
        "end_t": time(situation.end_ns),
        "complete": int(situation.complete),
        "how": situation.how or None,
        "least_m": float(situation.least_m),
    }


def decode_situation(text: str) -> Situation:
    """Decode the situation in such a string; raises InputError for another text."""
    try:
        (row,) = json.loads(text)
        return Situation(
            _one_of(row["kind"], KINDS),
            int(row["first_id"]),
            int(row["second_id"]),
            row["sensor"] or "",
            round(row["start_t"] * NS_PER_S),
            round(row["end_t"] * NS_PER_S),
            bool(row["complete"]),
            _one_of(row["how"] or "", HOW),
            nan if row["least_m"] is None else float(row["least_m"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        columns = ",".join(SITUATION_COLUMNS)
        raise InputError(f"holds {text[:60]!r}; a JSON list of one object with {columns} is expected") from error


def _one_of(word: str, choice: Sequence[Word]) -> Word:
    return choice[choice.index(word)]  # pyright: ignore[reportArgumentType]


def _words(words: Sequence[str], choice: Sequence[str] = ()) -> NDArray[np.str_]:
    longest = max((len(word) for word in (*words, *choice)), default=1)
    return np.array(words, dtype=f"<U{max(longest, 1)}")
