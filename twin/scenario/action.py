"""Base of all actions of people (start, duration, and wait conditions), and recorded paths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from trackers.area import Coordinate, Point3
from trackers.configuration import Strict
from trackers.errors import text_near_bound
from trackers.rig import Name, Point2

TOP_WALK_M_S = 2.5
"""Greatest walking speed [m/s]; from about 2.2 m/s on people run."""
TOP_RUN_M_S = 5.0
"""Greatest running speed of this model's people [m/s]."""
JUMP_M_S = 12.0
"""Speed above which a recorded path has an error, beyond human running [m/s]."""

NEAREST_M = 0.7
"""Approximate least distance between walking people [m]."""

SLOWEST_WALK_M_S = 0.05
"""Least walking speed [m/s]; somebody slower stands."""
WalkSpeed = Annotated[float, Field(ge=SLOWEST_WALK_M_S, le=TOP_WALK_M_S)]
RunSpeed = Annotated[float, Field(ge=2.0, le=TOP_RUN_M_S)]
Spacing = Annotated[float, Field(ge=0.45, le=1.5)]
"""Distance between people who walk together [m], at least what their shoulders need."""
Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=86_400)]
Target = Name | Point3 | Point2
"""A person by name, or a place in the room frame: [x, y] on the floor or [x, y, z] [m]."""


class WaitCondition(Strict):
    """Something to wait for: `near` a person or a place within `within_m`, or `person` doing (`does`) an action."""

    near: Target | None = Field(
        default=None,
        description="somebody by name, or a place [x, y] or [x, y, z] in the room frame [m]; needs `within_m`",
    )
    within_m: float | None = Field(
        default=None, gt=0, le=1000, description="how close to `near` the person must be [m]"
    )
    person: Name | None = Field(default=None, description="name of the person who is watched; needs `does`")
    does: (
        Literal[
            "wander", "stand", "walk", "run", "turn", "sit", "lie", "bend", "reach", "follow", "meet", "lead",
            "join", "path", "leave",
        ]
        | None
    ) = Field(default=None, description="the action that `person` must be doing")  # fmt: skip

    @model_validator(mode="after")
    def _one_of_two(self) -> WaitCondition:
        near, does = (self.near, self.within_m), (self.person, self.does)
        complete = [None not in pair for pair in (near, does)]
        if sum(complete) != 1 or any(pair != (None, None) for pair in (near, does) if None in pair):
            raise ValueError(
                "is not a condition; {near: NAME or [x, y], within_m: M} or {person: NAME, does: ACTION} is expected"
            )
        if isinstance(self.near, str) and self.within_m is not None and self.within_m < NEAREST_M:
            raise ValueError(
                f"within_m {self.within_m:g} is closer than people come to each other; more than {NEAREST_M:g} is expected"
            )
        return self


class TimedAction(Strict):
    at_s: Seconds | None = Field(default=None, description="not before this time since the start [s]")
    when: WaitCondition | None = Field(default=None, description="not before this holds")


class LastingAction(TimedAction):
    for_s: Seconds | None = Field(default=None, description="how long [s]; none: to the end of the run")


_RecordedTime = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
"""Time of a recording [s], which may have started years before the scenario."""


class RecordedPath(TimedAction):
    """Keep a recorded path: rows of t [s], x, y [m]; the person enters with its first row and leaves with its last.

    Rows may begin before t = 0. Given as `points`, or read from `file` (see `Pedestrians`).
    """

    kind: Literal["path"] = Field(default="path", description="the action: keep a recorded path")
    points: tuple[tuple[_RecordedTime, Coordinate, Coordinate], ...] = Field(
        min_length=2,
        description="rows [t, x, y] in order of time: t since the start [s], x and y in the room frame [m]",
    )

    @model_validator(mode="after")
    def _walkable(self) -> RecordedPath:
        for number, ((t, x, y), (t2, x2, y2)) in enumerate(pairwise(self.points), start=1):
            if t2 <= t:
                raise ValueError(f"point {number} at {t2:g} s does not come after {t:g} s; growing times are expected")
            speed = hypot(x2 - x, y2 - y) / (t2 - t)
            if speed > JUMP_M_S:
                by = text_near_bound(speed, JUMP_M_S, ".1f")
                raise ValueError(
                    f"point {number} at {t2:g} s is a jump of {by} m/s; at most {JUMP_M_S:g} m/s is expected"
                )
        if self.points[-1][0] <= 0:
            raise ValueError(
                f"ends at {self.points[-1][0]:g} s, before the start; a path that reaches t > 0 is expected"
            )
        return self


def check_ranges(**ranges: tuple[float, float]) -> None:
    """Raise ValueError for a range (low, high), named by its field, that is reversed or negative."""
    for name, (low, high) in ranges.items():
        if not 0 <= low <= high:
            raise ValueError(f"{name} [{low:g}, {high:g}] is not a range; the smaller number first, none negative")


def check_repeat(waypoints: Sequence[Point2], repeat: bool) -> None:
    """Raise ValueError for a way that is to be repeated, and leads nowhere else."""
    if repeat and len(set(waypoints)) == 1:
        raise ValueError(f"repeat: {list(waypoints[0])} is the only waypoint; two or more, or no repeat, are expected")
