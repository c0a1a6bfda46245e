"""Columns of a CSV file: each cell checked, each fault reported with file, line, column and value.

The dialect is found first: separator, quotes, comments, header, and decimal commas.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from itertools import chain
from math import isfinite, nan
from pathlib import Path
from typing import NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.user_input.text_file import check_limit, read_text, refuse_unless_lifted

LONGEST_LINE = 100_000
"""Greatest number of characters of a row: each of its cells takes some sixty bytes."""
MOST_LINES = 5_000_000
_COMMENTS = ("#", "%", "//")
_SEPARATORS = (";", "\t", "|", ",")
_QUOTED = re.compile(r'"[^"]*"')
_WORDS = re.compile(r'"([^"]*)"|(\S+)')
_UNIT = re.compile(r"\s+([\[(][^\s\])]*[\])])")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)


@dataclass(frozen=True)
class Cells:
    """A table as text: its comments, its header (None: it has none), and its rows, each with its line number."""

    comments: list[tuple[int, str]]
    header: list[str] | None
    header_line: int
    rows: list[list[str]]
    lines: list[int]


class _Lines:
    """Lines of a text except comments; `number` is that of the last one taken. Raises InputError for an endless line."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self.number = path, 0
        self.comments: list[tuple[int, str]] = []
        self._lines = enumerate(_split(text), start=1)

    def __iter__(self) -> Iterator[str]:
        for number, line in self._lines:
            self.number = number
            if number > MOST_LINES:
                refuse_unless_lifted(f"{self._path}: has more than {MOST_LINES} lines", "a shorter table")
            check_limit(len(line), LONGEST_LINE, f"{self._path}: line {number}: has", "characters")
            if line.lstrip().startswith(_COMMENTS):
                self.comments.append((self.number, line.lstrip().lstrip("#%/").strip()))
            elif line.strip():
                yield line


def read_cells(path: Path, expected: str, most_bytes: int | None) -> Cells:
    """Read a table of at most `most_bytes`, whose kind `expected` names in errors.

    The separator is the first of semicolon, tab, bar, comma or blank in its first row; cells may be quoted; lines after #, % or
    // are comments, the last one before the first row is the header if that has none. A header is a row without a number.
    Where no number has a point, a comma in a number is the decimal point. Raises InputError naming
    file and line for any other file.
    """
    text = read_text(path, expected, most_bytes).removeprefix("\ufeff")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(
            f"{path}: line {line}: holds NUL characters: a damaged file, or text in UTF-16; {expected} in UTF-8 is expected"
        )
    source = _Lines(path, text)
    lines = iter(source)
    first = next(lines, None)
    given = _SEPARATOR_LINE.fullmatch(first.strip()) if first is not None else None
    if given is not None:  # a spreadsheet's own first line
        first = next(lines, None)
    if first is None:
        return Cells(source.comments, None, 0, [], [])
    plain = _QUOTED.sub("", first).strip()
    separator = given[1] if given is not None else next((mark for mark in _SEPARATORS if mark in plain), " ")
    if separator == "\t" and all(map(_is_localized_number, plain.split())):
        separator = " "  # numbers aligned with tabs and blanks
    comments = list(source.comments)
    first_line = source.number
    rows, numbers = [split_line(first, separator)], [first_line]
    try:
        if separator == " ":
            for line in lines:
                rows.append(split_line(line, separator))
                numbers.append(source.number)
        else:
            rows = []
            numbers = []
            for row in csv.reader(chain([first], lines), delimiter=separator, strict=True, skipinitialspace=True):
                rows.append([cell.strip() for cell in row])
                numbers.append(source.number)
    except csv.Error as error:
        raise InputError(
            f"{path}: line {source.number}: is no row of a table ({error}); {expected} is expected"
        ) from error
    header, header_line = None, 0
    if not any(map(_is_localized_number, rows[0])) and any(rows[0]):
        header, header_line = rows.pop(0), numbers.pop(0)
    elif comments:
        header = split_line(comments[-1][1], separator if separator in comments[-1][1] else " ")
        is_prose = any(not cell or cell.endswith((",", ":", ".")) for cell in header)
        header, header_line = (header, comments[-1][0]) if len(header) == len(rows[0]) and not is_prose else (None, 0)
    if not any("." in cell and _is_localized_number(cell) for row in rows for cell in row):
        rows = [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows]
    _check_widths(path, header, rows, numbers)
    return Cells(source.comments, header, header_line, rows, numbers)


def _check_widths(path: Path, header: list[str] | None, rows: list[list[str]], numbers: list[int]) -> None:
    """Remove empty cells after the last separator; raise InputError where rows differ in length."""
    width = len(header if header is not None else rows[0])
    what = "the header" if header is not None else "the first row"
    for row, line in zip(rows, numbers, strict=True):
        if len(row) == width + 1 and not row[-1]:
            row.pop()
        if len(row) != width:
            raise InputError(f"{path}: line {line}: has {len(row)} cells; {width} as in {what} are expected")


def _split(text: str) -> Iterator[str]:
    """Yield the lines of a text with their ends; io.StringIO would take four bytes a character."""
    start = 0
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end]
        start = end


def split_line(line: str, separator: str) -> list[str]:
    """Split one line into its cells."""
    if separator == " ":
        return [quoted or word for quoted, word in _WORDS.findall(_UNIT.sub(r"\1", line))]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def is_number(text: str) -> bool:
    """Return whether a cell holds a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _is_localized_number(text: str) -> bool:
    """Return whether a cell holds a number, with a point or a comma."""
    return is_number(text.replace(",", "."))


MAX_INT64 = int(np.iinfo(np.int64).max)
MISSING = ("", "nan", "na", "n/a", "null", "none")
"""Cells without a value, in lower case."""
LARGEST = 1e12
"""Greatest number: squares and sums of larger ones are not exact, and no place is so far."""
_MAX_STAMP_S = Decimal(MAX_INT64 // NS_PER_S)
_LONGEST_LABEL = 100
_SHOWN = 60
"""Characters of a cell in an error."""
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class CsvColumns:
    """Cells of a CSV file by column, as text, with the line of each row."""

    source: str
    cells: Mapping[str, Sequence[str]]
    lines: Sequence[int]
    units: Mapping[str, float] = field(default_factory=dict)
    """Units of a column per metre or second; 1 for other columns."""

    def __len__(self) -> int:
        return len(self.lines)

    def take(self, rows: NDArray[np.intp]) -> CsvColumns:
        """Select the rows with these indices."""
        wanted: list[int] = rows.tolist()
        cells = {name: [column[row] for row in wanted] for name, column in self.cells.items()}
        return CsvColumns(self.source, cells, [self.lines[row] for row in wanted], self.units)

    def filled(self, names: Iterable[str]) -> NDArray[np.bool_]:
        """Return which rows have any of these cells filled, (n,)."""
        return np.array([any(row) for row in zip(*(self.cells[name] for name in names), strict=True)], dtype=np.bool_)

    def stamps_ns(self, name: str) -> NDArray[np.int64]:
        """Convert decimal seconds to integer nanoseconds, to the nearest, (n,); exact, unlike via a float."""
        unit = Decimal(repr(self.units.get(name, 1.0)))
        first = "".join(self.cells[name][:1]).strip()
        other = ", or a header with the unit, as t_ms," if first.isdecimal() else ""
        other = ", or a date and time as 2024-03-01T12:00:00.5Z," if ":" in first else other
        valid = f"a time in seconds{other}" if unit == 1 else "a time"
        return np.array(self._convert(name, lambda text: _stamp_ns(text, unit), valid), dtype=np.int64)

    def labels(self, name: str) -> list[str]:
        """Read the label of each row's person, n: a whole number from 0 on without leading zeros or decimals, or a name."""

        def convert(text: str) -> str:
            try:
                number = float(_plain(text))
            except ValueError:
                if not text.strip():
                    raise
                return text.strip()
            if text.strip().isdecimal() and len(text.strip()) < _LONGEST_LABEL:
                return str(int(text))  # a float holds no whole number beyond 2⁵³
            if not (number.is_integer() and 0 <= number <= MAX_INT64):
                raise ValueError
            return str(int(number))

        return self._convert(name, convert, "a whole number from 0 on, or a name,")

    def integers(self, name: str, minimum: int) -> NDArray[np.int64]:
        """Read integers of at least `minimum`, (n,); "3.0" counts as 3, as often saved in tables with empty cells."""

        def convert(text: str) -> int:
            number = Decimal(_plain(text.strip()))
            if number != number.to_integral_value() or not minimum <= number <= MAX_INT64:
                raise ValueError
            return int(number)

        return np.array(self._convert(name, convert, f"an integer of at least {minimum}"), dtype=np.int64)

    def flags(self, name: str) -> NDArray[np.bool_]:
        """Read flags as 1 or 0, true or false, (n,)."""
        words = {"0": False, "1": True, "false": False, "true": True}

        def convert(text: str) -> bool:
            if text.lower() not in words:
                raise ValueError
            return words[text.lower()]

        return np.array(self._convert(name, convert, "0 or 1"), dtype=np.bool_)

    def words(self, name: str, valid: Sequence[str]) -> NDArray[np.str_]:
        """Read words of a fixed choice, (n,)."""
        cells = self.cells[name]
        for text in dict.fromkeys(cells):
            if text not in valid:
                self.refuse(cells.index(text), name, " or ".join(repr(word) for word in valid))
        return np.array(cells, dtype=f"<U{max(len(word) for word in valid)}")

    def numbers(self, name: str, *, may_be_empty: bool) -> NDArray[np.float64]:
        """Read finite numbers, (n,); NaN for an empty cell where one is allowed."""
        valid = "a finite number or an empty cell" if may_be_empty else "a finite number"
        cells = self.cells[name]
        if may_be_empty:
            cells = ["" if cell.lower() in MISSING else cell for cell in cells]
        try:
            values = np.array([float(cell) if cell else nan for cell in cells], dtype=np.float64)
        except ValueError:
            values = None
        n_empty = cells.count("") if may_be_empty else 0
        if values is not None and np.count_nonzero(~(abs(values) <= LARGEST)) == n_empty and "_" not in "".join(cells):
            return values / self.units.get(name, 1.0)
        # Some cell is invalid: check cell by cell to report it.
        filled = (row for row, cell in enumerate(cells) if cell or not may_be_empty)
        fault = next(row for row in filled if not (_is_finite_number(cells[row]) and abs(float(cells[row])) <= LARGEST))
        self.refuse(fault, name, f"a number of at most {LARGEST:g}" if _is_finite_number(cells[fault]) else valid)

    def refuse(self, row: int, name: str, valid: str) -> NoReturn:
        """Raise the InputError with this cell and the valid values."""
        value = self.cells[name][row]
        found = f"is {value[:_SHOWN]!r}{'…' * (len(value) > _SHOWN)}" if value else "is empty"
        raise InputError(f"{self.source}: line {self.lines[row]}: {name} {found}; {valid} is expected")

    def _convert(self, name: str, convert: Callable[[str], _Value], valid: str) -> list[_Value]:
        cells = self.cells[name]
        known: dict[str, _Value] = {}
        for text in dict.fromkeys(cells):
            try:
                known[text] = convert(text)
            except (ValueError, ArithmeticError):  # a decimal's own errors among the latter
                self.refuse(cells.index(text), name, valid)
        return [known[text] for text in cells]


def read_csv_columns(path: Path, required: Sequence[str], what: str, most_bytes: int | None = None) -> CsvColumns:
    """Read a CSV file with a header, of at most `most_bytes`; `what` names the kind of table in errors.

    Raises InputError for a file that cannot be read, is no CSV, lacks a required column, repeats one or has a row of another
    length than the header.
    """
    found = read_cells(path, f"a {what}", most_bytes)
    expected = ",".join(required)
    header = found.header
    if header is None:
        why = "has no header" if found.rows else "is empty"
        raise InputError(f"{path}: {why}; a {what} with the columns {expected} is expected")
    where = f"{path}: line {found.header_line}: column"
    for name in required:
        if name not in header:
            raise InputError(f"{where} {name!r} is missing; a {what} has the columns {expected}")
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{where} {name!r} stands there twice; each column name once is expected")
    return columns_of(str(path), header, found)


def columns_of(source: str, names: Sequence[str], found: Cells, units: Mapping[str, float] | None = None) -> CsvColumns:
    """Arrange the cells by these names of their columns."""
    columns = list(zip(*found.rows, strict=True)) if found.rows else [()] * len(names)
    return CsvColumns(source, dict(zip(names, columns, strict=True)), found.lines, units or {})


_DATE = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d(?::\d\d)?)(?:[.,](\d+))? ?(Z|[+-]\d\d(?::?\d\d)?)?", re.IGNORECASE)
"""A date and time of ISO 8601: day, clock, fraction of a second, zone (UTC without)."""


def _stamp_ns(text: str, unit: Decimal) -> int:
    if (date := _DATE.fullmatch(text.strip())) is not None:
        day, clock, fraction, zone = date.groups()
        whole = datetime.fromisoformat(f"{day}T{clock}{(zone or 'Z').upper()}") - datetime(1970, 1, 1, tzinfo=UTC)
        text, unit = f"{whole // timedelta(seconds=1)}.{fraction or 0}", Decimal(1)
        if whole < timedelta(0):
            raise ValueError
    seconds = Decimal(_plain(text.strip())) if unit == 1 else Decimal(_plain(text.strip())) / unit
    if not seconds.is_finite() or abs(seconds) > _MAX_STAMP_S:
        raise ValueError
    return int((seconds * NS_PER_S).to_integral_value())


def _plain(text: str) -> str:
    return text.replace("_", "?")  # Python takes 1_000 for a number


def _is_finite_number(text: str) -> bool:
    return is_number(_plain(text)) and isfinite(float(text))
