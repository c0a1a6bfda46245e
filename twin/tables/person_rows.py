"""Rows of people over time: one reader for truth, tracks and recorded paths."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.tables.columns import (
    MISSING,
    Cells,
    CsvColumns,
    columns_of,
    is_number,
    read_cells,
    split_line,
)
from twin.tables.contents import EXPECTED_COLUMNS, PersonRows, label_order, mot_columns, name_columns

_NAMES = {
    "t": ("t", "time", "timestamp", "stamp", "headerstampsec", "headerstampsecs", "stampsec", "datetime",
          "seconds", "secs", "sec"),
    "frame": ("frame", "frames", "frameid", "framenumber", "framenr", "frameno", "framenum", "fr"),
    "id": ("id", "trackid", "personid", "persid", "pid", "pedid", "pedestrian", "pedestrianid", "agentid", "agent",
           "objectid", "objid", "person", "ped", "targetid", "trackingid", "subjectid", "participantid"),
    **{axis: tuple(form.replace("?", axis) for form in ("?", "pos?", "?pos", "world?", "?world", "?coord", "position?",
       "posepos?", "poseposition?", "poseposeposition?", "location?", "translation?")) for axis in "xyz"},
}  # fmt: skip
"""Other names of a column, without case, blanks, points, dashes and underscores, and the prefix `field.` of `rostopic echo`."""
_LABELS = ("name", "label", "track", "uuid", "uid", "subject", "participant", "target", "object")
"""Names of the column of people in a table that has none of those above."""
_NANOSECONDS = re.compile(r"(?:t|time|timestamp|stamp|headerstamp|)(?:nanosecs?|nanoseconds?|nsecs?)")
_LENGTHS = {"m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1000.0}
_TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e3, "us": 1e6, "µs": 1e6, "ns": 1e9}
_UNIT_WORDS = {
    "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "msecs": "ms", "millisecond": "ms", "milliseconds": "ms",
    "usec": "us", "usecs": "us", "microsecond": "us", "microseconds": "us",
    "centimetre": "cm", "centimetres": "cm", "centimeter": "cm", "centimeters": "cm",
    "millimetre": "mm", "millimetres": "mm", "millimeter": "mm", "millimeters": "mm",
}  # fmt: skip
"""Other names of units."""
_NO_UNIT = ("", "-", "1", "#", "none")
_WITH_UNIT = re.compile(r"(.+?)\s*(?:/\s*|[\[(]\s*|_)([a-zµ]+)\s*[\])]?", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"(.+?)\s*[\[(]\s*(.*?)\s*[\])]")
_RATE = re.compile(
    r"(?:frame\s*_?rate|fps)\s*(?:\[\w+\]|\(\w+\))?\s*[:=]?\s*(\d+(?:\.\d+)?)|(\d+(?:\.\d+)?)\s*fps", re.IGNORECASE
)
_UNIT = re.compile(
    r"(?:units?|coordinates|\bx\b.*\by\b).*?(?:\bin\b|:|=)\s*[\[(]?\s*(mm|cm|dm|m|met(?:er|re)s?)\b", re.IGNORECASE
)
_LENGTH_COLUMNS = ("x", "y", "z", "head_x", "head_y", "head_z", "vx", "vy")


def read_person_rows(
    path: Path,
    what: str,
    most_bytes: int | None = None,
    frame_rate_hz: float | None = None,
    rate_field: str = "",
    mot: str | None = None,
) -> PersonRows:
    """Read a table of people over time; `what` names its kind, `rate_field` the field in which a user gives `frame_rate_hz`.

    With a header its columns may be in any order; a unit may follow a name (x/cm, t [ms]) or stand in a row below. Without
    one it is frame (whole numbers) or t, then id, x, y; of 5 to 8 columns also a height: x, z, y (ETH, UCY) or x, y, z. A
    row with only its time has no person, and a row without x and y says nothing of its person. A row written twice counts
    once. Raises InputError naming file, line, column and value, or the ambiguity of a table without a header.
    `mot`: 'truth' or 'tracks' for MOT text (`mot_columns`), whose frame 1 is at t = 0.
    """
    found = read_cells(path, what, most_bytes)
    if mot is None and found.header is None and not found.rows:
        raise InputError(f"{path}: is empty and holds no rows; {what} with the {EXPECTED_COLUMNS} is expected")
    notes: list[str] = []
    comment_unit = next((m[1].lower() for _, text in found.comments if (m := _UNIT.search(text))), None)
    units: dict[str, float] = {}
    if mot is not None:
        names = mot_columns(path, mot, found)
    elif found.header is not None:
        names, units, found = _by_header(path, found)
    else:
        names = name_columns(path, found, _LENGTHS.get(comment_unit or "m", 1.0))
        notes.append(f"{path}: has no header; its columns are read as {', '.join(n for n in names if n[0] != '?')}")
    lengths = units.get("x", _LENGTHS.get(comment_unit or "m", 1.0))
    if units.get("x", lengths) != units.get("y", lengths):
        raise InputError(f"{path}: line {found.header_line}: x and y have different units; one for both is expected")
    if (comment_unit is not None and "x" not in units and found.header is None) or lengths != 1.0:
        notes.append(
            f"{path}: lengths are read in {'m' if lengths == 1 else {10: 'dm', 100: 'cm', 1000: 'mm'}[int(lengths)]}"
        )
    units = {**{name: lengths for name in _LENGTH_COLUMNS}, **units}
    columns, start_ns = columns_of(str(path), names, found, units), 0
    if "t" not in names:
        like = "the seqinfo.ini of a MOT sequence says them" if mot else "15 for the ETH file, 25 for UCY's"
        rate_hz = _rate(path, found, frame_rate_hz, rate_field, notes, like)
        columns = replace(columns, cells={**columns.cells, "t": columns.cells["frame"]}, units={**units, "t": rate_hz})
        start_ns = mot_stamp_ns(0, rate_hz) if mot else 0
    elif (
        rest := next((name for name in columns.cells if _NANOSECONDS.fullmatch(_bare(name.lower()))), None)
    ) is not None:
        whole, part = columns.integers("t", 0).tolist(), columns.integers(rest, 0).tolist()
        t = [f"{s + ns // NS_PER_S}.{ns % NS_PER_S:09d}" for s, ns in zip(whole, part, strict=True)]
        columns = replace(columns, cells={**columns.cells, "t": t})
    if "t" in names and frame_rate_hz is not None:
        notes.append(f"{path}: holds seconds (t); {rate_field} {frame_rate_hz:g} is not used")
    rows = _ordered(columns, [*notes, *_rows_in_comments(path, found, len(names))])
    return replace(rows, frame_stamps_ns=rows.frame_stamps_ns + start_ns, stamps_ns=rows.stamps_ns + start_ns)


def mot_stamp_ns(frame: int, rate_hz: float) -> int:
    """Return the stamp of a frame of MOT text [ns]: frames count from 1, and the first is at 0."""
    return round(NS_PER_S * frame / rate_hz) - round(NS_PER_S / rate_hz)


def exported_stamps_ns(info: Path, n_frame: int) -> NDArray[np.int64] | None:
    """Read the stamps of a sequence's frames (n,) [ns] from the frames.csv that `twin export` writes beside its seqinfo.ini.

    None without one. Raises InputError for other frames than 1 to n in order.
    """
    path = info.with_name("frames.csv")
    if not path.is_file():
        return None
    found = read_cells(path, "the times of a sequence's frames (frame,t)", None)
    if found.header != ["frame", "t"]:
        return None  # of another program
    columns = columns_of(str(path), ["frame", "t"], found)
    numbers, stamps = columns.integers("frame", 1), columns.stamps_ns("t")
    if numbers.tolist() != list(range(1, n_frame + 1)) or (np.diff(stamps) <= 0).any():
        raise InputError(
            f"{path}: holds {len(numbers)} frames; 1 to {n_frame}, as {info.name} says, at ascending times are expected"
        )
    return stamps


def _rows_in_comments(path: Path, found: Cells, width: int) -> list[str]:
    """Describe comments below the header that look like rows."""
    first = min(found.lines, default=found.header_line)
    rows = [
        line
        for line, text in found.comments
        if line > first
        and any(len(row := split_line(text, mark)) == width and any(map(is_number, row)) for mark in " ,;\t|")
    ]
    if not rows:
        return []
    return [
        f"{path}: lines that begin with #, % or // are not read; {len(rows)} of them, the first line {rows[0]}, look like rows"
    ]


def _by_header(path: Path, found: Cells) -> tuple[list[str], dict[str, float], Cells]:
    """Return our names of the columns, the units of some, and the table without a row of units."""
    assert found.header is not None
    names: list[str] = []
    units: dict[str, float] = {}
    below = found.rows[0] if found.rows and not any(map(is_number, found.rows[0])) else []
    below_units = [_UNIT_WORDS.get(unit, unit) for unit in (cell.strip("[]()/ ").lower() for cell in below)]
    known = {*_LENGTHS, *_TIMES, *_NO_UNIT, "m/s", "cm/s", "rad", "deg"}
    is_units = bool(below) and any(below_units) and all(cell in known for cell in below_units)
    for place, cell in enumerate(found.header):
        name, unit = _column(cell)
        if is_units and unit is None and name in ("t", *_LENGTH_COLUMNS):
            unit = below_units[place]
        valid = _TIMES if name == "t" else _LENGTHS
        if unit is not None and unit not in _NO_UNIT and name in ("t", "x", "y", "z"):
            if unit not in valid:
                where = f"{path}: line {found.header_line}: column {cell!r}"
                raise InputError(f"{where}: {unit!r} is no unit of it; one of {', '.join(valid)} is expected")
            units[name] = valid[unit]
        names.append(name)
    for missing, others in (("t", _NANOSECONDS.fullmatch), ("id", _LABELS.__contains__)):
        places = [place for place, cell in enumerate(names) if others(_bare(cell.lower()))]
        if missing not in names and len(places) == 1:
            names[places[0]] = missing
            units |= {"t": _TIMES["ns"]} if missing == "t" else {}
    for name in names:
        if name and names.count(name) > 1:
            twice = [repr(cell) for cell, own in zip(found.header, names, strict=True) if own == name]
            fault = f"columns {' and '.join(twice)} both say {name}"
            fault = f"column {name!r} stands there twice" if len(set(twice)) == 1 else fault
            raise InputError(f"{path}: line {found.header_line}: {fault}; each column name once is expected")
    for name in ("t", "id", "x", "y"):
        if name not in names and not (name == "t" and "frame" in names):
            odd = "".join(f" ({c!r}: no such unit)" for c in found.header if re.match(rf"{name} *[\[(]", c, re.I))
            raise InputError(
                f"{path}: line {found.header_line}: column {name!r} is missing among {','.join(found.header)}{odd}; "
                f"{EXPECTED_COLUMNS} are expected, with units of {', '.join((*_LENGTHS, *_TIMES))}"
            )
    return names, units, replace(found, rows=found.rows[1:], lines=found.lines[1:]) if is_units else found


def _column(cell: str) -> tuple[str, str | None]:
    """Return our name of a column and its unit, if any; the cell itself for an unknown column."""
    plain = cell.strip().lower()
    bracketed = _IN_BRACKETS.fullmatch(plain)
    if bracketed is not None and _bare(bracketed[1]) in _NAMES["id"]:
        return "id", None  # whatever is said of it, as [-]
    split = bracketed or _WITH_UNIT.fullmatch(plain)
    said = None if split is None else _UNIT_WORDS.get(split[2], split[2])
    unit = said if said in (*_LENGTHS, *_TIMES) else None
    word = split[1] if split is not None and unit is not None else plain
    for name, others in _NAMES.items():
        if _bare(word) in others:
            return name, unit
    return (plain if plain in (*_LENGTH_COLUMNS, "yaw", "head_yaw", "in_area", "status") else cell.strip()), None


def _bare(word: str) -> str:
    return re.sub(r"^field\.|[\s._-]", "", word)


def _rate(path: Path, found: Cells, given: float | None, field: str, notes: list[str], like: str) -> float:
    """Return the frame rate: as given, else from the file's comments; `like`: what tells it, for the error."""
    said = {float(m[1] or m[2]): line for line, text in found.comments if (m := _RATE.search(text))}
    if len(said) > 1 and given is None:
        rates = " and ".join(f"{rate:g} (line {line})" for rate, line in said.items())
        raise InputError(f"{path}: says {rates} frames a second; {field} is expected to choose")
    if given is None and not said:
        raise InputError(
            f"{field}: is missing and {path} counts frames; the recording's frames a second are expected ({like})"
        )
    rate = given if given is not None else next(iter(said))
    if not 0.01 <= rate <= 1000:
        raise InputError(f"{path}: a frame rate of {rate:g} Hz is none; 0.01 to 1000 Hz are expected")
    if given is None:
        notes.append(f"{path}: {rate:g} frames a second, as its line {said[rate]} says")
    elif said and given not in said:
        notes.append(
            f"{path}: line {min(said.values())} says {next(iter(said)):g} frames a second; {field} {given:g} is used"
        )
    return rate


def _ordered(columns: CsvColumns, notes: list[str]) -> PersonRows:
    """Order the rows with a person by stamp and person; raise InputError for a repeated pair with other values."""
    frame_stamps = np.unique(columns.stamps_ns("t"))
    columns = _with_positions(columns, notes)
    all_stamps = columns.stamps_ns("t")
    own = [name for name in columns.cells if name not in ("t", "frame") and name[:1] != "?"]
    filled = columns.filled(own) if len(columns) else np.zeros(0, dtype=np.bool_)
    with_person = np.flatnonzero(filled)
    labels = [""] * len(columns)  # "": a row without a person
    for row, label in zip(with_person.tolist(), columns.take(with_person).labels("id"), strict=True):
        labels[row] = label
    rank = {label: place for place, label in enumerate(sorted(set(labels) - {""}, key=label_order), start=1)}
    ids = np.array([rank.get(label, 0) for label in labels], dtype=np.int64)
    order = _without_repeats(columns, np.lexsort((ids, all_stamps)), ids, all_stamps, notes)
    stamps, ids = all_stamps[order], ids[order]
    for fault in np.flatnonzero((stamps[1:] == stamps[:-1]) & ((ids[1:] == ids[:-1]) | (ids[:-1] == 0)))[:1]:
        first, second = sorted((int(order[fault]), int(order[fault + 1])))
        what = f"t {columns.cells['t'][second]}, id {columns.cells['id'][second] or 'empty'}"
        where = f"{columns.source}: line {columns.lines[second]}"
        if ids[fault] == ids[fault + 1]:
            raise InputError(f"{where}: {what} stands on line {columns.lines[first]} too; each pair once is expected")
        raise InputError(
            f"{where}: {what} contradicts line {columns.lines[first]}; only t filled says that no person is there"
        )
    kept = order[filled[order]]
    return PersonRows(
        frame_stamps, columns.take(kept), all_stamps[kept], [labels[row] for row in kept.tolist()], tuple(notes)
    )


def _with_positions(columns: CsvColumns, notes: list[str]) -> CsvColumns:
    """Leave out the rows with an id whose x and y have no value, as NaN."""
    cells = (columns.cells[name] for name in ("id", "x", "y"))
    unknown = [bool(i) and x.lower() in MISSING and y.lower() in MISSING for i, x, y in zip(*cells, strict=True)]
    if not any(unknown):
        return columns
    rows = np.flatnonzero(unknown)
    notes.append(
        f"{columns.source}: {rows.size} of {len(columns)} rows, the first on line {columns.lines[int(rows[0])]}, have neither "
        "x nor y and are not read"
    )
    return columns.take(np.flatnonzero(~np.array(unknown)))


def _without_repeats(
    columns: CsvColumns, order: NDArray[np.intp], ids: NDArray[np.int64], stamps: NDArray[np.int64], notes: list[str]
) -> NDArray[np.intp]:
    """Leave out of the order (n,) rows that repeat the one before, cell by cell."""
    pairs = np.flatnonzero((np.diff(stamps[order]) == 0) & (np.diff(ids[order]) == 0))
    repeats = [k + 1 for k in pairs.tolist() if all(c[order[k]] == c[order[k + 1]] for c in columns.cells.values())]
    if repeats:
        line = columns.lines[int(order[repeats[0]])]
        notes.append(f"{columns.source}: {len(repeats)} rows, as that on line {line}, stand there twice and count once")
    return np.delete(order, repeats)
