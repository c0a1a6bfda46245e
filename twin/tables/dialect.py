"""Dialect of a table: separator, quotes, comments, header, and decimal commas; from text to cells."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from trackers.errors import InputError
from trackers.text_file import read_text

_COMMENTS = ("#", "%", "//")
_SEPARATORS = (";", "\t", ",")
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
    """Lines of a text except comments; `number` is that of the last one taken."""

    def __init__(self, text: str) -> None:
        self.number = 0
        self.comments: list[tuple[int, str]] = []
        self._lines = enumerate(io.StringIO(text), start=1)

    def __iter__(self) -> Iterator[str]:
        for number, line in self._lines:
            self.number = number
            if line.lstrip().startswith(_COMMENTS):
                self.comments.append((self.number, line.lstrip().lstrip("#%/").strip()))
            elif line.strip():
                yield line


def read_cells(path: Path, expected: str, most_bytes: int | None) -> Cells:
    """Read a table of at most `most_bytes`, whose kind `expected` names in errors.

    The separator is the first of semicolon, tab, comma or blank in its first row; cells may be quoted; lines after #, % or
    // are comments, the last one before the first row is the header if that has none. A header is a row without a number.
    With semicolons or tabs and no number with a point, a comma in a number is the decimal point. Raises InputError naming
    file and line for any other file.
    """
    text = read_text(path, expected, most_bytes).removeprefix("\ufeff")
    if "\0" in text[:4096]:
        raise InputError(f"{path}: is text in UTF-16, or none at all; {expected} in UTF-8 is expected")
    source = _Lines(text)
    lines = iter(source)
    first = next(lines, None)
    given = _SEPARATOR_LINE.fullmatch(first.strip()) if first is not None else None
    if given is not None:  # a spreadsheet's own first line
        first = next(lines, None)
    if first is None:
        return Cells(source.comments, None, 0, [], [])
    plain = _QUOTED.sub("", first).strip()
    separator = given[1] if given is not None else next((mark for mark in _SEPARATORS if mark in plain), " ")
    if separator == "\t" and all(_is_number(cell) for cell in plain.split()):
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
            for row in csv.reader(_chained(first, lines), delimiter=separator, strict=True, skipinitialspace=True):
                rows.append([cell.strip() for cell in row])
                numbers.append(source.number)
    except csv.Error as error:
        raise InputError(
            f"{path}: line {source.number}: is no row of a table ({error}); {expected} is expected"
        ) from error
    header, header_line = None, 0
    if not any(_is_number(cell) for cell in rows[0]) and any(rows[0]):
        header, header_line = rows.pop(0), numbers.pop(0)
    elif comments:
        header = split_line(comments[-1][1], separator if separator in comments[-1][1] else " ")
        is_prose = any(not cell or cell.endswith((",", ":", ".")) for cell in header)
        header, header_line = (header, comments[-1][0]) if len(header) == len(rows[0]) and not is_prose else (None, 0)
    if separator in ";\t" and not any("." in cell and _is_number(cell) for row in rows for cell in row):
        rows = [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows]
    width = len(header if header is not None else rows[0])
    what = "the header" if header is not None else "the first row"
    for row, line in zip(rows, numbers, strict=True):
        if len(row) == width + 1 and not row[-1]:
            row.pop()  # a separator after the last cell
        if len(row) != width:
            raise InputError(f"{path}: line {line}: has {len(row)} cells; {width} as in {what} are expected")
    return Cells(source.comments, header, header_line, rows, numbers)


def split_line(line: str, separator: str) -> list[str]:
    """Split one line into its cells."""
    if separator == " ":
        return [quoted or word for quoted, word in _WORDS.findall(_UNIT.sub(r"\1", line))]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _chained(first: str, rest: Iterator[str]) -> Iterator[str]:
    yield first
    yield from rest


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
