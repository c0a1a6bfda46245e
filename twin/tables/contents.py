"""Rows of people, judged by their contents: columns without a header named, heights and walking speeds checked.

People's paths are smooth, and heights vary little; a table with several plausible readings is rejected.
"""

from __future__ import annotations

import configparser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.user_input.text_file import check_limit, read_text
from twin.tables.columns import MAX_INT64, Cells, CsvColumns, columns_of, is_number


class StampedRows:
    """Base of tables in columns, ordered by stamp: each frame once, also those without rows, and the stamp of each row."""

    frame_stamps_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]

    @property
    def t(self) -> NDArray[np.float64]:
        """Stamps [s], (n,)."""
        return self.stamps_ns / NS_PER_S

    def frames(self) -> Iterator[tuple[int, range]]:
        """Yield the stamp of each frame [ns], and its rows."""
        starts = np.searchsorted(self.stamps_ns, self.frame_stamps_ns).tolist()
        ends = np.searchsorted(self.stamps_ns, self.frame_stamps_ns, side="right").tolist()
        yield from zip(self.frame_stamps_ns.tolist(), map(range, starts, ends), strict=True)


@dataclass(frozen=True)
class PersonRows:
    """Rows of a table with a person, by stamp, then in the file's order; and notes on guesses in reading them."""

    frame_stamps_ns: NDArray[np.int64]  # (f,) all distinct stamps, ascending, also those without people
    rows: CsvColumns  # n rows; lengths in metres by their units
    stamps_ns: NDArray[np.int64]  # (n,)
    labels: list[str]  # n: the person of each row
    notes: tuple[str, ...]

    def ids(self) -> NDArray[np.int64]:
        """Return a number per row's person (n,), from 1 on: the labels if all are such numbers, else counted by label."""
        counted = {label: number for number, label in self.counted().items()}
        return np.array([counted.get(label) or int(label) for label in self.labels], dtype=np.int64)

    def counted(self) -> dict[int, str]:
        """Return the label of each number that `ids` counts; none where the labels are numbers from 1 on."""
        labels = sorted(set(self.labels), key=label_order)
        numbers = {int(label) for label in labels if label.isdecimal()}  # those of 7 and 07 are one
        whole = len(numbers) == len(labels) and all(0 < number <= MAX_INT64 for number in numbers)
        return {} if whole else dict(enumerate(labels, start=1))


def label_order(label: str) -> tuple[int, int, str]:
    """Return the sort key of a label: numbers first, by value."""
    return (0, int(label), "") if label.isdecimal() else (1, 0, label)


HEIGHT_SPREAD_M = 0.6
"""Range of heads, pelvises or floors: a column that varies less may be a height [m]."""
_LEVEL_M = 0.02
"""Range and distance from 0 of a level floor's heights [m]."""
_HEIGHTS_M = (0.5, 2.2)
"""Range of heads and pelvises above the floor [m]."""
_APART_M = 0.3
"""Least distance between people's middles [m]."""
_LONG = 5
"""Rows of a person that make a path; fewer in a line may be people side by side."""
_CLEARER = 0.5
"""Ratio of the paths' roughness between two orders of columns below which the order is certain."""
MOST_FRAMES = 10_000_000
"""Greatest number of frames of a sequence, a hundred hours of 25 Hz; each takes some 20 bytes at work."""
EXPECTED_COLUMNS = "columns t (or frame), id, x, y"


_MOT_WIDTH = 10
MOT_COLUMNS = {
    "truth": ("frame", "id", "?left", "?top", "?width", "?height", "in_area", "x", "y", "?z"),
    "tracks": ("frame", "id", "?left", "?top", "?width", "?height", "?confidence", "x", "y", "?z"),
}
"""Columns of 3D MOT 2015; a confidence of 0 in the truth marks a person who is not evaluated."""


def mot_columns(path: Path, kind: str, found: Cells) -> list[str]:
    """Name the columns of MOT text ('truth' or 'tracks'); raises InputError for text without ground positions."""
    expected = "frame,id,-1,-1,-1,-1,confidence,x,y,z as in 3D MOT 2015, x and y in metres, is expected"
    if found.header is not None:
        raise InputError(f"{path}: line {found.header_line}: has a header; {expected}")
    if not found.rows or len(found.rows[0]) != _MOT_WIDTH:
        raise InputError(f"{path}: has {len(found.rows[0]) if found.rows else 0} columns; {expected}")
    if all(is_number(x) and is_number(y) and float(x) == float(y) == -1 for *_, x, y, _ in found.rows):
        raise InputError(f"{path}: holds boxes in pictures alone, x and y are -1; {expected}")
    return list(MOT_COLUMNS[kind])


def sequence_info_of(text: Path) -> Path | None:
    """Find the seqinfo.ini of a MOT sequence from one of its files; None without it.

    Beside the file; above its folder (gt/gt.txt, det/det.txt); or, of a tracker's BENCHMARK/TRACKER/data/SEQUENCE.txt, in
    gt/BENCHMARK/SEQUENCE as TrackEval has them.
    """
    path = text.resolve()
    folders = [path.parent, path.parent.parent]
    if path.parent.name == "data" and len(path.parents) > 4:
        folders.append(path.parents[4] / "gt" / path.parents[2].name / path.stem)
    return next((each / "seqinfo.ini" for each in folders if (each / "seqinfo.ini").is_file()), None)


def sequence_info(path: Path) -> tuple[float, int]:
    """Read frame rate [Hz] and number of frames in a seqinfo.ini. Raises InputError for a file that lacks them."""
    parser = configparser.ConfigParser()
    try:
        parser.read_string(read_text(path, "a seqinfo.ini"))
        rate_hz, n_frame = parser.getfloat("Sequence", "frameRate"), parser.getint("Sequence", "seqLength")
    except (configparser.Error, ValueError) as error:
        raise InputError(
            f"{path}: {str(error).splitlines()[0]}; frameRate and seqLength of [Sequence] are expected"
        ) from error
    if n_frame < 1:
        raise InputError(f"{path}: seqLength is {n_frame}; the number of frames, 1 or more, is expected")
    check_limit(n_frame, MOST_FRAMES, f"{path}: seqLength is", "frames")
    if not isfinite(rate_hz) or rate_hz <= 0:
        raise InputError(f"{path}: frameRate is {rate_hz:g}; a number of frames per second above 0 is expected")
    return rate_hz, n_frame


def name_columns(path: Path, found: Cells, per_m: float) -> list[str]:
    """Name the columns of a table without a header, by their number and content; '?' for unused ones.

    per_m: units of length per metre. Raises InputError for several plausible readings.
    """
    width = len(found.rows[0])
    if not 4 <= width <= 8:
        mot = "; MOT text is read by `twin evaluate --format mot`" if width in (_MOT_WIDTH - 1, _MOT_WIDTH) else ""
        raise InputError(
            f"{path}: has no header and {width} columns; frame,id,x,y without a header, or a header with the {EXPECTED_COLUMNS}, "
            f"is expected{mot}"
        )
    columns = columns_of(str(path), [f"column {place}" for place in range(1, width + 1)], found)
    first, second = columns.cells["column 1"], columns.cells["column 2"]
    held = range(3, min(width, 5) + 1)
    places = np.stack([columns.numbers(f"column {place}", may_be_empty=False) for place in held], axis=-1)
    places = places / per_m
    id_first = _is_id_first(path, columns, places)
    times = second if id_first else first
    named = ["frame" if all(_is_whole(cell) for cell in times) else "t", "id"]
    names = named[::-1] if id_first else named
    if width == 4:
        return [*names, "x", "y"]
    people = np.unique(np.array(first if id_first else second), return_inverse=True)[1]
    height_last = _is_height_last(path, people, places[:, 1:])
    return [*names, *(("x", "y", "z") if height_last else ("x", "z", "y")), *(f"?{k}" for k in range(5, width))]


def _is_id_first(path: Path, columns: CsvColumns, places: NDArray[np.float64]) -> bool:
    """Return whether id, time come first rather than time, id: people's paths are smooth, positions (n, 2 or 3) of mixed
    people are not.

    Raises InputError where both readings give about equally smooth paths.
    """
    first, second = columns.cells["column 1"], columns.cells["column 2"]
    if not all(_is_whole(cell) for cell in first):
        return False
    if not all(_is_whole(cell) for cell in second):
        return all(is_number(cell) for cell in second) and len(set(second)) > 1
    columns.labels("column 2")
    by_second, by_first = _paths(second, first, places), _paths(first, second, places)
    if by_first is None:
        return False
    if by_second is None:  # the first column has one value: a person's id, or a stamp
        if by_first.step_m < _APART_M or by_first.is_smooth:
            return True
    elif by_first.is_clearer_than(by_second) or by_second.is_clearer_than(by_first):
        return by_first.off_m < by_second.off_m
    elif by_second.step_m <= by_first.step_m:
        is_far_shorter = by_second.step_m < _CLEARER * by_first.step_m
        if by_second.is_smooth or (is_far_shorter and not by_first.is_smooth):
            return False
    elif by_first.is_smooth and not by_second.is_smooth:
        return True
    raise InputError(
        f"{path}: has no header, and its first two columns may be frame, id or id, frame; a header with the {EXPECTED_COLUMNS} "
        "is expected"
    )


@dataclass(frozen=True)
class _Paths:
    """Medians over people's rows: distance to the next, distance from the line between those before and after, their number."""

    step_m: float
    off_m: float  # NaN where no person has three rows
    n_row: float

    @property
    def is_smooth(self) -> bool:
        return self.n_row >= _LONG and (self.off_m < _CLEARER * self.step_m or self.off_m == 0)

    def is_clearer_than(self, other: _Paths) -> bool:
        """Return True where these paths are smoother, and are no short lines, as of people side by side, beside long paths."""
        return self.off_m < _CLEARER * other.off_m and (self.n_row >= _LONG or other.n_row < _LONG)


def _paths(people: Sequence[str], times: Sequence[str], places: NDArray) -> _Paths | None:
    """Measure the paths of people over positions (n, 2 or 3) [m]; None where no person has two rows."""
    who = np.array([float(cell) for cell in people])
    when = np.array([float(cell) for cell in times])
    order = np.lexsort((when, who))
    who, when, places = who[order], when[order], places[order]
    follows = (np.diff(who) == 0) & (np.diff(when) > 0)
    if not follows.any():
        return None
    step_m = float(np.median(np.hypot.reduce(np.diff(places, axis=0)[follows], axis=-1)))
    n_row = float(np.median(np.unique(who, return_counts=True)[1]))
    inner = np.flatnonzero(follows[1:] & follows[:-1]) + 1
    if not inner.size:
        return _Paths(step_m, nan, n_row)
    share = ((when[inner] - when[inner - 1]) / (when[inner + 1] - when[inner - 1]))[:, None]
    between = (1 - share) * places[inner - 1] + share * places[inner + 1]
    return _Paths(step_m, float(np.median(np.hypot.reduce(places[inner] - between, axis=-1))), n_row)


def _is_height_last(path: Path, people: NDArray[np.intp], last: NDArray[np.float64]) -> bool:
    """Return whether the second of two columns (n, 2) is the height: it varies little, and clearly less than the other.

    Raises InputError where neither may be one, and where both may and neither holds only heights of people or of the floor.
    """
    low, high = np.quantile(last, [0.05, 0.95], axis=0)
    flat = high - low < HEIGHT_SPREAD_M
    if not flat.any():
        raise InputError(
            f"{path}: has no header, and neither its column 4 nor 5 looks like a height; a header with the {EXPECTED_COLUMNS} "
            "is expected"
        )
    if flat.all() and not np.array_equal(*last.T):
        own = [np.max([np.ptp(column[people == who]) for who in np.unique(people)]) for column in last.T]
        middle = np.abs(np.median(last, axis=0))
        on_floor = (high - low < _LEVEL_M) & (middle < _LEVEL_M)
        of_people = (_HEIGHTS_M[0] <= low) & (high <= _HEIGHTS_M[1]) & (np.array(own) < HEIGHT_SPREAD_M)
        flat = on_floor | of_people
    if not flat.any() or (flat.all() and not np.array_equal(*last.T)):
        raise InputError(
            f"{path}: has no header, and its columns 4 and 5 may both be heights; a header with the {EXPECTED_COLUMNS} is "
            "expected"
        )
    return bool(flat[1])


def _is_whole(text: str) -> bool:
    return is_number(text) and float(text).is_integer()


WALKING_M_S = (0.5, 2.5)
"""Range of median walking speeds of a recording of pedestrians [m/s]."""
WALKING_WARNING = "in the median, where"
"""Words of a warning about walking speeds."""
IMPOSSIBLE_M_S = 12.0
"""Speed that no runner reaches [m/s]."""
_LEAST_WAY_M = 1.0
_MOVING_SHARE = 0.2
"""Share of a person's greatest speed below which they stand, at any unit and rate."""
_SPAN_S = 0.5
"""Least time span of speeds: noise of positions does not count as walking [s]."""


def check_plausibility(found: PersonRows) -> tuple[str, ...]:
    """Return warnings about a table of people; raise InputError where its layout cannot be as guessed."""
    source = found.rows.source
    x, y = (found.rows.numbers(name, may_be_empty=False) for name in "xy")
    z = found.rows.numbers("z", may_be_empty=True) if "z" in found.rows.cells else np.zeros(0)
    notes = [_height(source, x, y, z[np.isfinite(z)], len(set(found.labels)))]
    speed = walking_speed(found, x, y)
    slowest, fastest = WALKING_M_S
    if speed is not None and not slowest <= speed <= fastest:
        text = f"{source}: people walk at {speed:.3g} m/s {WALKING_WARNING} {slowest:g} to {fastest:g} m/s are usual"
        text += f"; {_remedy(speed, found)}"
        if speed > IMPOSSIBLE_M_S:
            raise InputError(f"{text} are expected")
        notes.append(f"{text} may be wrong")
    return tuple(note for note in notes if note)


def walking_speed(found: PersonRows, x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Compute the median over walking people of their median speed while they move [m/s]; None without any."""
    number = found.ids()
    order = np.lexsort((found.stamps_ns, number))
    medians = []
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        speed = speed_along(found.stamps_ns[rows] / NS_PER_S, x[rows], y[rows])
        if speed is not None:
            medians.append(speed)
    return float(np.median(medians)) if medians else None


def speed_along(t: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Compute the median speed of a path [s], [m] while the person moves [m/s]; None for one who goes nowhere."""
    if t.size < 2:
        return None
    apart = max(1, min(t.size - 1, round(_SPAN_S / float(np.median(np.diff(t))))))
    speeds = np.hypot(x[apart:] - x[:-apart], y[apart:] - y[:-apart]) / (t[apart:] - t[:-apart])
    moving = speeds[speeds > _MOVING_SHARE * np.quantile(speeds, 0.95)]
    is_walk = moving.size and max(np.ptp(x), np.ptp(y)) >= _LEAST_WAY_M
    return float(np.median(moving)) if is_walk else None


def _remedy(speed: float, found: PersonRows) -> str:
    """Name the unit or rate that would make the speed usual."""
    slowest, fastest = WALKING_M_S
    for unit, size in (("cm", 100.0), ("mm", 1000.0)):
        if slowest <= speed / size <= fastest:
            return f"lengths in {unit} would fit: a header that says so, as x/{unit}, or another unit of time"
    if found.rows.cells.get("frame") == found.rows.cells["t"]:
        rate_hz = found.rows.units["t"] * 1.3 / speed
        return f"a frame rate of about {rate_hz:.2g} Hz would fit: the rate {found.rows.units['t']:g} Hz, or the unit of x and y,"
    return "the unit of t, or of x and y,"


def _height(source: str, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], n_person: int) -> str:
    """Warn where x or y varies like heights; raise InputError where the column z varies like coordinates instead."""
    if x.size < 2:
        return ""
    wide = {name: float(np.ptp(np.quantile(each, [0.05, 0.95]))) for name, each in (("x", x), ("y", y))}
    flat, other = ("x", "y") if wide["x"] < wide["y"] else ("y", "x")
    if wide[flat] >= HEIGHT_SPREAD_M or wide[other] < 3 * HEIGHT_SPREAD_M or n_person < 2:
        return ""
    text = f"{source}: {flat} looks like a height: it varies by {wide[flat]:.2g} m where {other} varies by {wide[other]:.3g} m"
    if z.size > 1 and (across := float(np.ptp(np.quantile(z, [0.05, 0.95])))) > 3 * HEIGHT_SPREAD_M:
        raise InputError(
            f"{text} and z by {across:.3g} m; a header that calls the two coordinates of the floor x and y is expected"
        )
    return f"{text}; if it is one, a header that calls the two coordinates of the floor x and y is needed"
