"""Distributions of rooms, people and rigs. Every range is uniform and every share a probability, unless stated otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from pydantic import AfterValidator, Field, FiniteFloat, model_validator

from trackers.configuration import Strict
from trackers.errors import valid_names

Share = Annotated[float, Ge(0), Le(1)]


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError(f"[{bounds[0]:g}, {bounds[1]:g}] is not a range; the smaller number comes first")
    return bounds


Range = Annotated[tuple[FiniteFloat, FiniteFloat], AfterValidator(_ordered)]
Size = tuple[Annotated[int, Ge(16), Le(4096)], Annotated[int, Ge(16), Le(4096)]]
Count = Annotated[tuple[int, int], AfterValidator(_ordered)]


def draw_from(bounds: tuple[float, float], rng: np.random.Generator, digits: int) -> float:
    """Draw a number from a range, rounded to so many digits after the point."""
    return round(float(rng.uniform(*bounds)), digits)


def draw_count(bounds: tuple[int, int], rng: np.random.Generator) -> int:
    """Draw a whole number from a range, both ends included."""
    return int(rng.integers(bounds[0], bounds[1] + 1))


class DrawnRoom(Strict):
    """Building of one or several rooms: walls, doors, pillars, furniture, materials and lights.

    The lengths are those of offices, flats and small halls: 5–14 m by 4–10 m with 0–12 pieces of furniture.
    """

    kind: Literal["drawn"] = Field(description="the room is drawn at random")
    seed: int | None = Field(default=None, ge=0, lt=2**63, description="seed of the room; none: the scenario's")
    length_m: Range = Field(default=(5.0, 14.0), description="length of the outline [m], 3 to 60")
    width_m: Range = Field(default=(4.0, 10.0), description="width of the outline [m], 3 to 60")
    height_m: Range = Field(default=(2.5, 3.4), description="height of the ceiling [m], 2.2 to 12")
    turned_deg: Range = Field(
        default=(0.0, 0.0), description="angle by which the building lies turned in its frame [deg]"
    )
    l_shape: Share = Field(default=0.35, description="share of outlines with a corner cut out")
    rooms: Count = Field(default=(1, 3), description="number of rooms, joined by doors, where there is space for them")
    least_room_m: float = Field(default=2.8, ge=2.0, le=20, description="least side of a room behind a partition [m]")
    doorway_m: Range = Field(default=(0.9, 1.3), description="width of doorways between rooms [m], 0.85 to 1.4")
    doors: Count = Field(default=(1, 3), description="number of doors that lead out, by which people come and go")
    pillars: Count = Field(default=(0, 3), description="number of pillars")
    pillar_m: Range = Field(default=(0.25, 0.6), description="width of a pillar [m]")
    glass: Share = Field(
        default=0.15, description="share of partitions made of glass, which lasers pass and cameras see through"
    )
    furniture_per_m2: Range = Field(default=(0.0, 0.12), description="pieces of furniture per square metre of floor")
    furniture: dict[str, Annotated[float, Ge(0)]] = Field(
        default={"table": 2, "desk": 2, "cupboard": 3, "shelf": 2, "sofa": 1.5, "bed": 0.5, "plant": 1, "counter": 1},
        description="how often each kind of furniture is drawn, relative to the others",
    )
    dim: Share = Field(default=0.15, description="share of rooms with little light")

    @model_validator(mode="after")
    def _buildable(self) -> DrawnRoom:
        for name, (low, high) in (
            ("length_m", (3, 60)), ("width_m", (3, 60)), ("height_m", (2.2, 12)), ("turned_deg", (-360, 360)),
            ("doorway_m", (0.85, 1.4)), ("doors", (1, 8)), ("rooms", (1, 12)), ("pillars", (0, 50)),
            ("pillar_m", (0.1, 2)), ("furniture_per_m2", (0, 1)),
        ):  # fmt: skip
            bounds = getattr(self, name)
            if not low <= bounds[0] <= bounds[1] <= high:
                raise ValueError(f"{name} {list(bounds)} cannot be built; {low:g} to {high:g} is valid")
        if unknown := set(self.furniture) - set(FURNITURE):
            raise ValueError(
                f"furniture: {sorted(unknown)[0]!r} is no kind of furniture; {valid_names(sorted(unknown)[0], FURNITURE)}"
            )
        return self


FURNITURE = ("table", "desk", "cupboard", "shelf", "sofa", "bed", "plant", "counter")
"""Kinds of furniture that can be drawn."""


class DrawnPeople(Strict):
    """People who live in the room, come and go by its doors, alone or in groups.

    About 70 % of pedestrians walk in groups (Moussaïd et al. 2010); indoors the default is lower. How many come is limited by
    the floor: one for each `least_floor_m2`.
    """

    kind: Literal["drawn"] = Field(description="the people are drawn at random")
    seed: int | None = Field(default=None, ge=0, lt=2**63, description="seed of the people; none: the scenario's")
    count: Count = Field(default=(2, 9), description="number of people, 1 to 60")
    least_floor_m2: float = Field(
        default=2.5, ge=1, description="free floor for each person [m²]; fewer people where it is short"
    )
    in_groups: Share = Field(default=0.3, description="share of people who belong to a group of two to four")
    abreast: Share = Field(default=0.7, description="share of group members who walk beside the first, not behind")
    shoulder_to_shoulder: Share = Field(
        default=0.0, description="share of those beside the first who walk shoulder to shoulder, at 0.5 to 0.6 m"
    )
    led: Share = Field(
        default=0.0,
        description="share of groups whose first member leads them about: they change sides, talk in a ring and part",
    )
    group_slowdown_m_s: float = Field(
        default=0.0,
        ge=0,
        le=0.3,
        description="how much slower a group walks for each member beyond the first [m/s]; Moussaïd et al. measured 0.04 at "
        "low density, 0.08 at moderate density",
    )
    arriving: Share = Field(default=0.25, description="share of people who come by a door during the run")
    leaving: Share = Field(default=0.25, description="share of people who leave by a door before the end")
    children: Share = Field(default=0.08, description="share of people who are children")
    activities: dict[str, Annotated[float, Ge(0)]] = Field(
        default={
            **{"wander": 4, "walk": 4, "stand": 1.5, "sit": 2, "lie": 0.3},
            **{"look": 0.5, "bend": 0.4, "reach": 0.3, "meet": 0.8, "run": 0.2},
        },
        description="how often each activity is drawn, relative to the others",
    )
    speed_m_s: Range = Field(default=(0.6, 1.5), description="walking speeds [m/s], 0.3 to 2.5")

    @model_validator(mode="after")
    def _possible(self) -> DrawnPeople:
        if not 1 <= self.count[0] <= self.count[1] <= 60:
            raise ValueError(f"count {list(self.count)} is not drawn; 1 to 60 people are valid")
        if not 0.3 <= self.speed_m_s[0] <= self.speed_m_s[1] <= 2.5:
            raise ValueError(f"speed_m_s {list(self.speed_m_s)} is no walking speed; 0.3 to 2.5 m/s is valid")
        if unknown := set(self.activities) - set(ACTIVITIES):
            raise ValueError(
                f"activities: {sorted(unknown)[0]!r} is not drawn; {valid_names(sorted(unknown)[0], ACTIVITIES)}"
            )
        if not any(self.activities.values()):
            raise ValueError("activities: none has a share; at least one above 0 is expected")
        return self


ACTIVITIES = ("wander", "walk", "stand", "sit", "lie", "look", "bend", "reach", "meet", "run")
"""Activities that can be drawn."""


class DrawnSensors(Strict):
    """Rig as mounted by installers: scanners on walls at knee or waist height, cameras under the ceiling and in corners."""

    kind: Literal["drawn"] = Field(description="the sensors are drawn at random")
    seed: int | None = Field(default=None, ge=0, lt=2**63, description="seed of the rig; none: the scenario's")
    scanners: Count = Field(default=(1, 3), description="number of laser scanners")
    waist: Share = Field(default=0.5, description="share of scanners at waist height; the others scan knees")
    scanner_hz: Range = Field(default=(10.0, 25.0), description="rate of a scanner [Hz], 1 to 100")
    resolution_deg: tuple[float, ...] = Field(
        default=(0.25, 0.5), min_length=1, description="resolutions of scanners [deg]"
    )
    field_of_view_deg: tuple[float, ...] = Field(
        default=(180.0, 270.0), min_length=1, description="fields of view of scanners [deg]"
    )
    range_m: Range = Field(default=(8.0, 30.0), description="longest range of a scanner [m], 2 to 100")
    range_10_percent_m: Range | None = Field(
        default=None,
        description="range of a surface that reflects 10 % [m], 1 to 100, drawn by its logarithm for each scanner; none: dark "
        "surfaces return echoes like others",
    )
    robots: Count = Field(
        default=(0, 0), description="number of robots that wander about, each with a low scanner and odometry"
    )
    fisheyes: Count = Field(
        default=(0, 0), description="number of fisheye cameras, at head height on a wall or under the ceiling"
    )
    cameras: Count = Field(default=(0, 0), description="number of pinhole cameras in the corners under the ceiling")
    stereos: Count = Field(default=(0, 0), description="number of stereo cameras in the corners under the ceiling")
    fisheye_px: Size = Field(
        default=(480, 480), description="width and height of a fisheye camera's pictures, 16 to 4096 [px]"
    )
    camera_px: Size = Field(
        default=(480, 360), description="width and height of a pinhole camera's pictures, 16 to 4096 [px]"
    )
    stereo_px: Size = Field(
        default=(320, 240), description="width and height of a stereo camera's pictures, 16 to 4096 [px]"
    )
    camera_hz: Range = Field(
        default=(5.0, 15.0), description="rate of a camera [Hz], 1 to 60; of a stereo camera 8 at most"
    )
    floor: Share = Field(default=0.0, description="share of rigs with a pressure floor under the largest room")
    noise: tuple[Literal["off", "default", "worse"], ...] = Field(
        default=("default",), min_length=1, description="noise of sensors"
    )
    faults: Share = Field(default=0.0, description="share of sensors that drop observations for part of the run")

    @model_validator(mode="after")
    def _possible(self) -> DrawnSensors:
        for name, (low, high) in (
            ("scanners", (0, 12)), ("robots", (0, 4)), ("fisheyes", (0, 12)), ("cameras", (0, 12)), ("stereos", (0, 12)),
            ("scanner_hz", (1, 100)), ("camera_hz", (1, 60)), ("range_m", (2, 100)), ("range_10_percent_m", (1, 100)),
        ):  # fmt: skip
            bounds = getattr(self, name)
            if bounds is not None and not low <= bounds[0] <= bounds[1] <= high:
                raise ValueError(f"{name} {list(bounds)} is not drawn; {low:g} to {high:g} is valid")
        least = sum(getattr(self, kind)[0] for kind in ("scanners", "robots", "fisheyes", "cameras", "stereos"))
        if least == 0 and self.floor < 1:
            raise ValueError(
                "scanners, robots, fisheyes, cameras and stereos may all be 0; at least one sensor is expected"
            )
        return self


def drawn_fields(content: Mapping[str, Any]) -> list[str]:
    """List the fields of a scenario's content that are a mapping with `kind: drawn`; a person named kind is no text."""
    entries = {name: content.get(name) for name in ("room", "people", "sensors")}
    return [name for name, entry in entries.items() if isinstance(entry, Mapping) and entry.get("kind") == "drawn"]
