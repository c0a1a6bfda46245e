"""Tables of the truth beyond `truth.csv`, and the strings of the same columns in a bag.

- `truth_people.csv`: the name of each id.
- `truth_feet.csv` and `/truth/feet`: one row per foot and frame, left before right, people by id. `cells_<floor>` holds the
  numbers of the cells that a foot loads, separated by blanks, counted row by row from 0, at stamps of that floor; it is empty
  at others.
- `truth_boxes.csv` and `/truth/boxes`: one row per person and image, in the order in which images were taken, people by id;
  columns as in `twin.truth.truth_types.Box`. Images without a row were not looked at: boxes are made for a few images per
  second. A person hidden from the camera altogether has no row. The share of each person that a camera sees, by rays, is in
  truth.csv at the same `t`: visible_<camera>.
- `truth_rays.csv` and `/truth/rays`: one row per run of consecutive beams that meet the same person, counted from 0 in the
  order of the scan's ranges. Beams in no run meet the room, or nothing within range. It is the truth of the ideal scan at its
  true time: noise and faults change ranges and stamps, not the person that a beam meets. A scan that the scanner loses (its
  `dropout`) has no row; one that a fault loses on its way may have.
- `truth_bases.csv` and `/truth/bases`, where a housing drives: one row per such housing and stamp, its true pose.
- `truth_situations.csv` and `/truth/situations`: see `twin.recording.situation_table`.

A frame without people is one row with its stamp (and its sensor) alone. Numbers are written as in `truth.csv`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np

from trackers.area import Area
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.user_input.plain_data import parse_json
from trackers.user_input.text_file import read_text
from twin.recording.atomic_file import open_atomic, write_atomic
from twin.recording.ros import topics
from twin.recording.ros.ros_messages import json_object, rows_message
from twin.recording.situation_table import SITUATION_COLUMNS, encode_situation, situation_line
from twin.recording.tables import (
    FOOT_NUMBERS,
    TRUTH_NUMBERS,
    FrameText,
    TrackTable,
    TruthTable,
    number_cell,
    read_truth,
    seconds_cell,
)
from twin.truth.truth_types import (
    BasesFrame,
    BaseTruth,
    Box,
    BoxFrame,
    FootTruth,
    PersonTruth,
    RayFrame,
    Situation,
    TruthDetail,
    TruthFrame,
)

if TYPE_CHECKING:
    from twin.recording.reader import Recording

MOST_TABLE_BYTES = 256 * 1024 * 1024
"""A table larger than this takes gigabytes to read, and is refused unless asked for."""
PEOPLE_COLUMNS = ("id", "name")
FEET_COLUMNS = ("t", "id", "foot", *FOOT_NUMBERS, "contact")
_CELLS = "cells_"
BOX_COLUMNS = ("t", "camera", "id", "left", "top", "width", "height", "visible_px", "truncated")
RAY_COLUMNS = ("t", "sensor", "id", "first_beam", "last_beam")
BASE_COLUMNS = ("t", "base", "x", "y", "z", "yaw")
BASES_FILE = "truth_bases.csv"
ABOUT = "recording.json"
"""Facts of a recording not in the tables of tracks: the stamp of t = 0, and losses; written by `twin track`."""
DETAIL_FILES = ("truth_boxes.csv", "truth_rays.csv", "truth_situations.csv")
TRUTH_FILES = ("truth.csv", "truth_people.csv", "truth_feet.csv", BASES_FILE, *DETAIL_FILES)
DETAIL_TOPICS = (topics.TRUTH_BOXES, topics.TRUTH_RAYS, topics.TRUTH_SITUATIONS)


def write_names(path: Path, names: Mapping[int, str]) -> None:
    """Write `truth_people.csv`: one row per person of the scenario by id, present in the run or not.

    Raises InputError where the file cannot be written.
    """
    lines = [",".join(PEOPLE_COLUMNS), *(f"{number},{name}" for number, name in sorted(names.items()))]
    write_atomic(path, "\n".join(lines) + "\n")


@contextmanager
def feet_writer(path: Path, floors: Sequence[str] = ()) -> Iterator[Callable[[FrameText], None]]:
    """Open `truth_feet.csv` with a column cells_<floor> per floor; yield a function that writes a frame, in order of time.

    The file appears when the block ends well. Raises InputError where the file cannot be written; the function raises
    ValueError for a number that is infinite.
    """
    columns = _foot_columns(floors)
    with open_atomic(path) as stream:
        stream.write(",".join(columns) + "\n")

        def write(text: FrameText) -> None:
            lines = []
            for person, foot, cells in _feet(text):
                loaded = [" ".join(map(str, foot.cells.get(floor, ()))) for floor in floors]
                lines.append(",".join([str(person.id), foot.side, *cells, str(int(foot.contact)), *loaded]))
            _write_lines(stream, seconds_cell(text.frame.stamp_ns), lines, len(columns))

        yield write


def encode_feet(text: FrameText) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR): a JSON list with one object per foot, null where unknown."""
    rows = []
    for person, foot, cells in _feet(text):
        loaded = [f"[{', '.join(map(str, each))}]" for each in foot.cells.values()]
        row = [str(person.id), f'"{foot.side}"', *cells, str(int(foot.contact)), *loaded]
        rows.append(json_object(_foot_columns(foot.cells), text.frame.stamp_ns, row))
    return rows_message(rows)


def _foot_columns(floors: Iterable[str]) -> tuple[str, ...]:
    return (*FEET_COLUMNS, *(_CELLS + floor for floor in floors))


def _feet(text: FrameText) -> Iterator[tuple[PersonTruth, FootTruth, list[str]]]:
    """Yield each foot with its person and the cells of its numbers."""
    feet = ((person, foot) for person in text.frame.people for foot in person.feet)
    return ((person, foot, cells) for (person, foot), cells in zip(feet, text.feet, strict=True))


@contextmanager
def detail_writer(folder: Path, *, with_bases: bool = False) -> Iterator[Callable[[TruthDetail], None]]:
    """Open the tables of boxes, rays and situations, and of bases if some drive; yield a function that writes a detail.

    The files appear when the block ends well. Raises InputError where a file cannot be written.
    """
    bases: TextIO | None = None
    with ExitStack() as stack:
        boxes, rays, situations = (stack.enter_context(open_atomic(folder / name)) for name in DETAIL_FILES)
        for stream, columns in ((boxes, BOX_COLUMNS), (rays, RAY_COLUMNS), (situations, SITUATION_COLUMNS)):
            stream.write(",".join(columns) + "\n")
        if with_bases:
            bases = stack.enter_context(open_atomic(folder / BASES_FILE))
            bases.write(",".join(BASE_COLUMNS) + "\n")

        def write(detail: TruthDetail) -> None:
            match detail:
                case BasesFrame():
                    if bases is not None:
                        t = seconds_cell(detail.stamp_ns)
                        bases.writelines(f"{t},{each.base},{','.join(cells)}\n" for each, cells in _bases(detail))
                case BoxFrame():
                    _write_frame(boxes, detail, BOX_COLUMNS)
                case RayFrame():
                    _write_frame(rays, detail, RAY_COLUMNS)
                case Situation():
                    situations.write(situation_line(detail))

        yield write


def encode_detail(detail: TruthDetail) -> tuple[str, int, memoryview]:
    """Return topic, log time [ns] (of a situation its end) and message (CDR) of a detail."""
    match detail:
        case BasesFrame():
            rows = [[json.dumps(each.base), *cells] for each, cells in _bases(detail)]
            message = rows_message(json_object(BASE_COLUMNS, detail.stamp_ns, row) for row in rows)
            return topics.TRUTH_BASES, detail.stamp_ns, message
        case BoxFrame():
            return topics.TRUTH_BOXES, detail.stamp_ns, _encode_frame(detail, BOX_COLUMNS)
        case RayFrame():
            return topics.TRUTH_RAYS, detail.stamp_ns, _encode_frame(detail, RAY_COLUMNS)
        case Situation():
            return topics.TRUTH_SITUATIONS, detail.end_ns, encode_situation(detail)


def _bases(frame: BasesFrame) -> Iterator[tuple[BaseTruth, list[str]]]:
    """Yield each base with the cells of its numbers."""
    return ((each, [number_cell(getattr(each, name)) for name in BASE_COLUMNS[2:]]) for each in frame.bases)


def decode_boxes(text: str, stamp_ns: int) -> BoxFrame:
    """Decode the boxes of a picture that `encode_detail` wrote; raises InputError for another text."""
    try:
        rows = json.loads(text)
        boxes = [{name: row[name] for name in BOX_COLUMNS[2:]} for row in rows if row["id"] is not None]
        return BoxFrame(
            stamp_ns, rows[0]["camera"], tuple(Box(**row | {"truncated": bool(row["truncated"])}) for row in boxes)
        )
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(
            f"topic {topics.TRUTH_BOXES}: holds {text[:60]!r}; a JSON list of objects with {','.join(BOX_COLUMNS)} is expected"
        ) from error


def _write_frame(stream: TextIO, frame: BoxFrame | RayFrame, columns: Sequence[str]) -> None:
    sensor, rows = _frame_rows(frame, columns)
    lines = [",".join(map(str, row)) for row in rows]
    _write_lines(stream, f"{seconds_cell(frame.stamp_ns)},{sensor}", lines, len(columns) - 1)


def _encode_frame(frame: BoxFrame | RayFrame, columns: tuple[str, ...]) -> memoryview:
    """Encode a frame as a `std_msgs/String` (CDR): a JSON list with one object per row, null for an empty cell."""
    sensor, rows = _frame_rows(frame, columns)
    name, empty = json.dumps(sensor), [[""] * (len(columns) - 2)]
    cells = [[str(number) for number in row] for row in rows] or empty
    return rows_message(json_object(columns, frame.stamp_ns, [name, *row]) for row in cells)


def _frame_rows(frame: BoxFrame | RayFrame, columns: Sequence[str]) -> tuple[str, list[tuple[int, ...]]]:
    """Return the sensor of a frame, and its rows after t and the sensor."""
    sensor, entries = (frame.camera, frame.boxes) if isinstance(frame, BoxFrame) else (frame.sensor, frame.runs)
    read = attrgetter(*columns[2:])
    return sensor, [tuple(map(int, read(entry))) for entry in entries]


def _write_lines(stream: TextIO, head: str, lines: Sequence[str], n_column: int) -> None:
    """Write the lines of a frame that begin with `head`; `n_column`: columns, those of the head counted as one."""
    whole = [f"{head},{line}\n" for line in lines]
    stream.write("".join(whole) or head + "," * (n_column - 1) + "\n")


def truth_frames(table: TruthTable) -> Iterator[TruthFrame]:
    """Yield a table's frames, in order of time."""
    columns = {name: getattr(table, name).tolist() for name in ("id", *TRUTH_NUMBERS, "in_area")}
    shown = {sensor: shares.tolist() for sensor, shares in table.visible.items()}
    for stamp_ns, rows in table.frames():
        people = (
            PersonTruth(
                **{name: values[row] for name, values in columns.items()},
                visible={sensor: shares[row] for sensor, shares in shown.items()},
            )
            for row in rows
        )
        yield TruthFrame(stamp_ns, tuple(people))


def read_own_truth(path: Path, recording: Recording) -> TruthTable:
    """Read the user's table of truth of a recording, on the recording's clock, within its area; raises as `read_truth`."""
    area = Area(np.array(recording.rig.area)) if recording.rig.area is not None else None
    table = read_truth(path, MOST_TABLE_BYTES, area=area)
    return on_clock_of(table, recording.start_ns, recording.duration_s, str(recording.path))


_QUARTER_NS = 900 * NS_PER_S
_MOST_HOURS = 14
"""Greatest offset of a time zone; all are quarters of an hour."""


def on_clock_of(table: TruthTable, start_ns: int, duration_s: float, recording: str) -> TruthTable:
    """Return a table on the clock of a recording that begins at the stamp `start_ns` [ns], which is t = 0 there.

    t counts from the recording's start, or is the stamp itself (seconds since 1970, say). Raises InputError where the
    table covers no part of the recording either way.
    """
    end_ns = round(duration_s * NS_PER_S)
    stamps = table.frame_stamps_ns
    if not stamps.size:
        return table
    for moved_ns in (0, start_ns):
        if stamps[-1] >= moved_ns and stamps[0] <= moved_ns + end_ns:
            moved = {"frame_stamps_ns": stamps - moved_ns, "stamps_ns": table.stamps_ns - moved_ns}
            return replace(table, **moved) if moved_ns else table
    by_stamp = f", or by its stamps from {start_ns / NS_PER_S:.3f} s on" if start_ns else ""
    hours = round((stamps[0] - start_ns) / _QUARTER_NS) / 4
    moved_ns = start_ns + round(4 * hours) * _QUARTER_NS
    if start_ns and 0 < abs(hours) <= _MOST_HOURS and stamps[-1] >= moved_ns and stamps[0] <= moved_ns + end_ns:
        by_stamp += f", {abs(hours):g} h {'before' if hours > 0 else 'after'} that, as in another time zone"
    raise InputError(
        f"{table.source}: t is from {stamps[0] / NS_PER_S:.3f} to {stamps[-1] / NS_PER_S:.3f} s, and {recording} goes from 0 to "
        f"{duration_s:.3f} s{by_stamp}; t on the recording's clock is expected"
    )


def on_clock_of_tracks(truth: TruthTable, tracks: TrackTable, path: Path) -> TruthTable:
    """Return truth on the clock of the tracks in `path`, which `twin track` wrote: by the recording's first stamp, if it is
    of that time.

    The stamp stands in `recording.json`, in the folder above that of the tracks. Without that file the truth stays as it is.
    Raises InputError for a file without it.
    """
    about = path.resolve().parent.parent / ABOUT
    ends = tracks.frame_stamps_ns[[0, -1]] if tracks.frame_stamps_ns.size else None
    stamps = truth.frame_stamps_ns
    if ends is None or not stamps.size or stamps[0] <= ends[1] or not about.is_file():
        return truth
    expected = "the start_stamp_ns [ns] that `twin track` writes there"
    content = parse_json(read_text(about, expected), str(about), expected)
    start_ns = content.get("start_stamp_ns") if isinstance(content, dict) else None
    if not isinstance(start_ns, int):
        raise InputError(f"{about}: start_stamp_ns: is {start_ns!r}; {expected} is expected")
    return on_clock_of(truth, start_ns, int(ends[1]) / NS_PER_S, str(path))
