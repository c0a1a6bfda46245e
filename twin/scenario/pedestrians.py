"""Recorded paths of pedestrians, read from a file: they become people of the scenario, each with a path as script."""

from __future__ import annotations

from itertools import pairwise
from math import cos, hypot, isfinite, radians, sin
from pathlib import Path as FilePath
from statistics import median
from typing import Any

from pydantic import Field, FiniteFloat

from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.rig import Point2
from trackers.text_file import read_text
from twin.scenario.behaviour import JUMP_M_S

_HEADER = ["t", "id", "x", "y"]
_SLOWEST_S = 10.0
"""Rows further apart than this say nothing of how somebody walked."""
_FURTHEST_M = 1e6
_HIGHEST_NUMBER = 2**53
_GAP = 3.0
"""A hole in a path longer than this many of the file's usual intervals is an error of the recording."""

Row = tuple[float, float, float]
"""t [s], x, y [m]."""


class Pedestrians(Strict):
    """People who keep the paths in a file: one person each, called `prefix` and the number in the file.

    The file has rows of `frame id x z y ...` parted by blanks (ETH BIWI's and UCY's layout; y is the fifth column, and
    `frame_rate_hz` turns frames into seconds), or a header `t,id,x,y` and rows parted by commas. Its first moment is
    t = 0; `start_s` into it the scenario begins. `turn_deg` about the file's origin, then `shift_m`, bring its
    places into the room's frame. They carry no bags. Everybody who is there between the start and the scenario's end
    comes, or only `ids`.
    """

    file: str = Field(
        description="path of the file, relative to the scenario: rows of frame, id, x, z, y ..., or a table t,id,x,y [s, m]"
    )
    frame_rate_hz: float | None = Field(
        default=None,
        ge=0.01,
        le=1000,
        description="frames a second, for a file that counts frames [Hz]; none: the file holds seconds",
    )
    start_s: float = Field(
        default=0.0, ge=0, description="how long after the file's first moment the scenario begins [s]"
    )
    shift_m: Point2 = Field(
        default=(0.0, 0.0), description="moves the paths into the room frame, after `turn_deg`: x, y [m]"
    )
    turn_deg: FiniteFloat = Field(
        default=0.0, description="turns the paths about the file's origin, counter-clockwise [deg]"
    )
    ids: tuple[int, ...] | None = Field(
        default=None, description="numbers of the people to take; none: everybody who is there during the run"
    )
    prefix: str = Field(
        default="walker-",
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*$",
        description="what a person's name begins with, before the number in the file",
    )


def people_from(
    pedestrians: Pedestrians, duration_s: float, source: str
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """The people as entries of a scenario's `people:`, by name, in the order of their numbers; and what to warn of.

    Somebody with a single row has no path: they are left out, with a warning. Raises InputError naming file, line and
    value for what is no path: gaps, repeated stamps, jumps, NaN, nobody there.
    """
    path = FilePath(pedestrians.file)
    paths = _read(path, pedestrians.frame_rate_hz, f"{source}: pedestrians.frame_rate_hz")
    seen_once = [number for number, rows in paths.items() if len(rows) < 2]
    for number in seen_once:
        del paths[number]
    if not paths:
        raise InputError(f"{path}: nobody has more than one row; paths of two rows at least are expected")
    usual_s = median(after[0] - row[0] for rows in paths.values() for row, after in pairwise(rows))
    if usual_s > _SLOWEST_S:
        raise InputError(
            f"{path}: rows of a person come every {usual_s:g} s, too rarely for a path; at most {_SLOWEST_S:g} s between "
            "rows, and the recording's own frame_rate_hz where it counts frames, are expected"
        )
    first_s = min(rows[0][0] for rows in paths.values()) + pedestrians.start_s
    for number in pedestrians.ids or ():
        if number not in paths:
            what = (
                f"has one row of number {number}, no path"
                if number in seen_once
                else f"holds nobody of number {number}"
            )
            raise InputError(f"{source}: pedestrians.ids: {path} {what}; one of {_some(sorted(paths))} is expected")
    people = {}
    angle = radians(pedestrians.turn_deg)
    for number in sorted(paths if pedestrians.ids is None else set(pedestrians.ids)):
        rows = paths[number]
        _check_gaps(rows, usual_s, f"{path}: person {number}")
        if not (rows[-1][0] > first_s and rows[0][0] < first_s + duration_s):
            if pedestrians.ids is None:
                continue
            raise InputError(
                f"{source}: pedestrians.ids: person {number} of {path} is there from {rows[0][0] - first_s:g} to "
                f"{rows[-1][0] - first_s:g} s, not during the scenario's 0 to {duration_s:g} s; "
                "another number, start_s or duration_s is expected"
            )
        points = [
            [
                round(t - first_s, 9),
                x * cos(angle) - y * sin(angle) + pedestrians.shift_m[0],
                x * sin(angle) + y * cos(angle) + pedestrians.shift_m[1],
            ]
            for t, x, y in rows
        ]
        # where a bag is carried, and kept out of others' way, a path does not say
        people[f"{pedestrians.prefix}{number}"] = {"bag": "none", "script": [{"kind": "path", "points": points}]}
    if not people:
        last = max(rows[-1][0] for rows in paths.values()) - first_s + pedestrians.start_s
        raise InputError(
            f"{source}: pedestrians.start_s: nobody of {path} is there from {pedestrians.start_s:g} s on for "
            f"{duration_s:g} s; a moment from 0 to {last:g} s at which somebody walks is expected"
        )
    return people, _warnings(path, seen_once if pedestrians.ids is None else [])


def _warnings(path: FilePath, seen_once: list[int]) -> list[str]:
    if not seen_once:
        return []
    who = f"person {seen_once[0]} has" if len(seen_once) == 1 else f"people {_some(sorted(seen_once))} have"
    return [
        f"pedestrians: {who} one row in {path.name}, which is no path, and {'is' if len(seen_once) == 1 else 'are'} left out"
    ]


def _read(path: FilePath, frame_rate_hz: float | None, rate_field: str) -> dict[int, list[Row]]:
    """The rows of each person in order of time."""
    text = read_text(path, "a file of paths (rows of 'frame id x z y' or a table t,id,x,y)")
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    is_table = bool(lines) and "," in lines[0][1]
    if is_table:
        header = [cell.strip() for cell in lines[0][1].split(",")]
        if header[:4] != _HEADER:
            raise InputError(f"{path}: line 1: the header is {lines[0][1]!r}; t,id,x,y is expected")
        lines, columns, times = lines[1:], (0, 1, 2, 3), 1.0
    else:
        if frame_rate_hz is None and lines:
            raise InputError(
                f"{rate_field}: is missing and {path} counts frames; the recording's frames a second are expected "
                "(15 for the ETH file, 25 for UCY's)"
            )
        columns, times = (0, 1, 2, 4), 1.0 / (frame_rate_hz or 1.0)
    paths: dict[int, dict[float, Row]] = {}
    for number, line in lines:
        where = f"{path}: line {number}"
        cells = line.split(",") if is_table else line.split()
        if len(cells) <= columns[-1]:
            layout = "t,id,x,y" if is_table else "frame id x z y"
            raise InputError(f"{where}: has {len(cells)} columns; {layout} is expected")
        t, who, x, y = (_number(cells[column], where) for column in columns)
        if who != int(who) or not 0 <= who <= _HIGHEST_NUMBER:
            raise InputError(
                f"{where}: {cells[columns[1]]!r} is no person's number; a whole number from 0 on is expected"
            )
        if max(abs(x), abs(y)) > _FURTHEST_M:
            raise InputError(f"{where}: [{x:g}, {y:g}] is out of the world; at most {_FURTHEST_M:g} m are expected")
        rows = paths.setdefault(int(who), {})
        if t * times in rows:
            raise InputError(f"{where}: person {int(who)} stands there twice at {cells[0].strip()}; once is expected")
        rows[t * times] = (t * times, x, y)
    if not paths:
        raise InputError(f"{path}: holds no rows; 'frame id x z y' or a table t,id,x,y is expected")
    return {who: _ordered(rows, f"{path}: person {who}") for who, rows in paths.items()}


def _ordered(rows: dict[float, Row], where: str) -> list[Row]:
    ordered = [rows[t] for t in sorted(rows)]
    for (t, x, y), (t2, x2, y2) in pairwise(ordered):
        speed = hypot(x2 - x, y2 - y) / (t2 - t)
        if speed > JUMP_M_S:
            raise InputError(
                f"{where}: jumps from [{x:g}, {y:g}] to [{x2:g}, {y2:g}] at {t2:g} s of the file, {speed:.1f} m/s; "
                f"at most {JUMP_M_S:g} m/s is expected"
            )
    return ordered


def _check_gaps(rows: list[Row], usual_s: float, where: str) -> None:
    for (t, _, _), (t2, _, _) in pairwise(rows):
        if t2 - t > _GAP * usual_s:
            raise InputError(
                f"{where}: has a gap of {t2 - t:g} s after {t:g} s of the file, where rows come every {usual_s:g} s; "
                "a path without gaps, or two numbers for the two parts, is expected"
            )


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputError(f"{where}: {text.strip()!r} is not a finite number; one is expected")
    return value


def _some(numbers: list[int]) -> str:
    shown = ", ".join(str(number) for number in numbers[:10])
    return shown if len(numbers) <= 10 else f"{shown}, ... {numbers[-1]}"
