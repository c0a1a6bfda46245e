"""Recorded paths of pedestrians from a file, as people of the scenario with a path as script."""

from __future__ import annotations

import re
from itertools import pairwise
from math import cos, hypot, radians, sin
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import numpy as np
from pydantic import Field, FiniteFloat

from trackers.configuration import Strict
from trackers.errors import InputError, text_near_bound
from trackers.observations import NS_PER_S
from trackers.rig import Point2
from trackers.user_input.text_file import MOST_TEXT_BYTES
from twin.scenario.action import JUMP_M_S
from twin.tables.columns import MAX_INT64
from twin.tables.contents import check_plausibility, label_order
from twin.tables.person_rows import read_person_rows

_SLOWEST_S = 10.0
"""Greatest gap between rows from which walking can be interpolated."""
_FURTHEST_M = 1e6
_GAP = 3.0
"""Greatest gap in a path, in the file's usual intervals, without an error."""

Row = tuple[float, float, float]
"""t [s], x, y [m]."""


class Pedestrians(Strict):
    """People who keep the paths in a file: one person each, called `prefix` and the number in the file.

    The file is a table with the columns t or frame, id, x, y in any layout that `twin.tables.person_rows` reads, ETH's, UCY's,
    TrajNet's and PeTrack's among them; `frame_rate_hz` turns frames into seconds. Its first time is
    t = 0; `start_s` into it the scenario begins. `turn_deg` about the file's origin, then `shift_m`, bring its
    places into the room's frame. They carry no bags. Everybody who is there between the start and the scenario's end
    comes, or only `ids`.
    """

    file: str = Field(
        description="path of the file, relative to the scenario: a table with columns t or frame, id, x, y [s, m]"
    )
    frame_rate_hz: float | None = Field(
        default=None,
        ge=0.01,
        le=1000,
        description="frames a second, for a file that counts frames [Hz]; none: the file holds seconds",
    )
    start_s: float = Field(
        default=0.0, ge=0, description="how long after the file's first time the scenario begins [s]"
    )
    shift_m: Point2 = Field(
        default=(0.0, 0.0), description="moves the paths into the room frame, after `turn_deg`: x, y [m]"
    )
    turn_deg: FiniteFloat = Field(
        default=0.0, description="turns the paths about the file's origin, counter-clockwise [deg]"
    )
    ids: tuple[Annotated[int, Field(ge=0, le=MAX_INT64)] | str, ...] | None = Field(
        default=None, description="ids of the people to take; none: everybody who is there during the run"
    )
    prefix: str = Field(
        default="walker-",
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*$",
        description="what a person's name begins with, before the number in the file",
    )


def people_from(
    pedestrians: Pedestrians, duration_s: float, source: str
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Read people as entries of a scenario's `people:`, by name, in the order of their numbers; and warnings.

    A person with a single row has no path and is left out, with a warning. Raises InputError naming file, line and value for
    an invalid path: gaps, repeated stamps, jumps, NaN, or no people.
    """
    path = Path(pedestrians.file)
    paths, notes = _read(path, pedestrians.frame_rate_hz, f"{source}: pedestrians.frame_rate_hz")
    wanted = None if pedestrians.ids is None else list(dict.fromkeys(str(number) for number in pedestrians.ids))
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
    for number in wanted or ():
        if number not in paths:
            what = (
                f"has one row of number {number}, no path"
                if number in seen_once
                else f"holds nobody of number {number}"
            )
            raise InputError(
                f"{source}: pedestrians.ids: {path} {what}; one of {_some(sorted(paths, key=label_order))} is expected"
            )
    people = {}
    for number in sorted(paths if wanted is None else wanted, key=label_order):
        rows = paths[number]
        _check_gaps(rows, usual_s, f"{path}: person {number}")
        if not (rows[-1][0] > first_s and rows[0][0] < first_s + duration_s):
            if wanted is None:
                continue
            raise InputError(
                f"{source}: pedestrians.ids: person {number} of {path} is there from {rows[0][0] - first_s:g} to "
                f"{rows[-1][0] - first_s:g} s, not during the scenario's 0 to {duration_s:g} s; "
                "another number, start_s or duration_s is expected"
            )
        points = _in_room(rows, pedestrians, first_s)
        # a path does not say where a bag is carried and kept out of others' way
        people[f"{pedestrians.prefix}{number}"] = {"bag": "none", "script": [{"kind": "path", "points": points}]}
    if not people:
        last = max(rows[-1][0] for rows in paths.values()) - first_s + pedestrians.start_s
        raise InputError(
            f"{source}: pedestrians.start_s: nobody of {path} is there from {pedestrians.start_s:g} s on for "
            f"{duration_s:g} s; a time from 0 to {last:g} s at which somebody walks is expected"
        )
    return people, [*(f"pedestrians: {note}" for note in notes), *_warnings(path, seen_once if wanted is None else [])]


def _in_room(rows: list[Row], pedestrians: Pedestrians, first_s: float) -> list[list[float]]:
    """Return rows t [s] since the scenario's start, at `first_s` of the file, and x, y [m] in the room's frame."""
    cosine, sine = cos(radians(pedestrians.turn_deg)), sin(radians(pedestrians.turn_deg))
    (right, up) = pedestrians.shift_m
    return [[round(t - first_s, 9), x * cosine - y * sine + right, x * sine + y * cosine + up] for t, x, y in rows]


def _warnings(path: Path, seen_once: list[str]) -> list[str]:
    if not seen_once:
        return []
    who = (
        f"person {seen_once[0]} has"
        if len(seen_once) == 1
        else f"people {_some(sorted(seen_once, key=label_order))} have"
    )
    return [
        f"pedestrians: {who} one row in {path.name}, which is no path, and {'is' if len(seen_once) == 1 else 'are'} left out"
    ]


def _read(path: Path, frame_rate_hz: float | None, rate_field: str) -> tuple[dict[str, list[Row]], list[str]]:
    """Read the rows of each person in order of time, by label; and notes on guesses."""
    found = read_person_rows(path, "a table of paths", MOST_TEXT_BYTES, frame_rate_hz, rate_field)
    x, y = (found.rows.numbers(name, may_be_empty=False) for name in "xy")
    for row in np.flatnonzero(np.maximum(np.abs(x), np.abs(y)) > _FURTHEST_M)[:1]:
        raise InputError(
            f"{path}: line {found.rows.lines[row]}: [{x[row]:g}, {y[row]:g}] is out of the world; at most {_FURTHEST_M:g} m "
            "are expected"
        )
    notes = [*found.notes, *check_plausibility(found)]
    paths: dict[str, list[Row]] = {}
    for who, stamp_ns, *place in zip(found.labels, found.stamps_ns.tolist(), x.tolist(), y.tolist(), strict=True):
        paths.setdefault(who, []).append((stamp_ns / NS_PER_S, place[0], place[1]))
    if not paths:
        raise InputError(f"{path}: holds no rows; a table with the columns t (or frame), id, x, y is expected")
    for who in paths:
        if re.fullmatch(r"[A-Za-z0-9_-]+", who) is None:
            raise InputError(f"{path}: id {who!r} makes no name of a person; letters, digits, _ and - are expected")
    for who, rows in paths.items():
        _check_jumps(rows, f"{path}: person {who}")
    return paths, notes


def _check_jumps(rows: list[Row], where: str) -> None:
    for (t, x, y), (t2, x2, y2) in pairwise(rows):
        speed = hypot(x2 - x, y2 - y) / (t2 - t)
        if speed > JUMP_M_S:
            by = text_near_bound(speed, JUMP_M_S, ".1f")
            raise InputError(
                f"{where}: jumps from [{x:g}, {y:g}] to [{x2:g}, {y2:g}] at {t2:g} s of the file, {by} m/s; "
                f"at most {JUMP_M_S:g} m/s is expected"
            )


def _check_gaps(rows: list[Row], usual_s: float, where: str) -> None:
    for (t, _, _), (t2, _, _) in pairwise(rows):
        if t2 - t > _GAP * usual_s:
            raise InputError(
                f"{where}: has a gap of {t2 - t:g} s after {t:g} s of the file, where rows come every {usual_s:g} s; "
                "a path without gaps, or two numbers for the two parts, is expected"
            )


def _some(labels: list[str]) -> str:
    shown = ", ".join(labels[:10])
    return shown if len(labels) <= 10 else f"{shown}, ... {labels[-1]}"
