"""Devices of a study: sensors, candidate poses, kinds, prices, and the constraints on a placement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, FiniteFloat, model_validator

from trackers.area import Point3
from trackers.configuration import Strict
from trackers.rig import Point2
from twin.suites.spec import Overrides, OwnName, Text

if TYPE_CHECKING:
    from twin.scenario import Scenario

Metres = Annotated[FiniteFloat, Field(ge=0, le=1000)]


def _one_is_both(value: object) -> object:
    """Turn 0.9, or `[0.9]`, into the range from and to it; raise ValueError for a list of more than two."""
    if isinstance(value, list) and len(value) > 2 and all(type(each) in (int, float) for each in value):
        raise ValueError(f"the first and the last alone, as [{min(value):g}, {max(value):g}], are expected")
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [value, value]
    return [value[0], value[0]] if isinstance(value, list | tuple) and len(value) == 1 else value


Range = Annotated[tuple[FiniteFloat, FiniteFloat], BeforeValidator(_one_is_both)]
"""From and to; one value is both."""
CountRange = Annotated[
    tuple[Annotated[int, Field(ge=0, le=32)], Annotated[int, Field(ge=1, le=32)]], BeforeValidator(_one_is_both)
]
"""Least and most; one number is both."""


def format_price(value: float) -> str:
    """Format a price to the hundredth, whole ones without."""
    return f"{value:.2f}".removesuffix(".00")


_COUNTLESS = 1e15
"""Number of steps that stands for any larger one."""


def steps(low_high: Range, every: float) -> list[float]:
    """Return evenly spaced values from the first to the second, at most `every` apart."""
    return np.linspace(*low_high, n_steps(low_high, every)).tolist()


def n_steps(low_high: Range, every: float) -> int:
    """Return the number of values that `steps` makes."""
    return 1 + int(np.ceil(min((low_high[1] - low_high[0]) / every - 1e-9, _COUNTLESS)))


def _ascending(name: str, low_high: Range | None) -> None:
    if low_high is not None and low_high[0] > low_high[1]:
        raise ValueError(
            f"{name}: {low_high[0]:g} to {low_high[1]:g} is upside down; the lower end first is expected, "
            f"as in [{low_high[1]:g}, {low_high[0]:g}]"
        )


class FixedPose(Strict):
    """One pose: position and direction."""

    xyz: Point3 = Field(description="x, y, z in the room frame [m]")
    yaw_deg: FiniteFloat = Field(default=0.0, description="turn about z, counter-clockwise from the room's x [deg]")
    pitch_deg: FiniteFloat = Field(default=0.0, description="positive looks down [deg]")


class WallPoses(Strict):
    """Poses along the walls, facing into the room."""

    height_m: Range = Field(description="lowest and highest place, or one height [m]")
    height_every_m: float = Field(default=0.25, gt=0, description="largest step between heights [m]")
    off_m: Metres = Field(default=0.1, description="how far off the wall [m]")
    every_m: float = Field(default=1.0, gt=0, description="largest step along the wall [m]")

    @model_validator(mode="after")
    def _ordered(self) -> WallPoses:
        _ascending("height_m", self.height_m)
        return self


class CeilingPoses(Strict):
    """Poses below the ceiling, on a grid. A room without a geom above 2 m has none: name heights in a `box`."""

    every_m: float = Field(default=1.0, gt=0, description="largest step of the grid [m]")
    off_m: Metres = Field(default=0.1, description="how far below the ceiling [m]")


class BoxPoses(Strict):
    """Poses on a grid in a box."""

    x_m: Range = Field(description="from and to [m]")
    y_m: Range = Field(description="from and to [m]")
    z_m: Range = Field(description="from and to [m]")
    every_m: float = Field(default=0.5, gt=0, description="largest step of the grid [m]")

    @model_validator(mode="after")
    def _ordered(self) -> BoxPoses:
        for name in ("x_m", "y_m", "z_m"):
            _ascending(name, getattr(self, name))
        return self


class DeviceKind(Strict):
    """One kind of a device to choose from."""

    name: OwnName = Field(description="what to call it in tables")
    set: Overrides = Field(
        default={}, description="changes to the sensor, by field: role, rate_hz, field_of_view_deg ..."
    )
    price: float | None = Field(default=None, ge=0, description="what one costs; none: the entry's price")


UNCHANGED = (DeviceKind(name="as-is"),)


class MirrorLine(Strict):
    """Line across the room at which every pose is mirrored; both are occupied."""

    x_m: FiniteFloat | None = Field(default=None, description="the line x = this [m]")
    y_m: FiniteFloat | None = Field(default=None, description="the line y = this [m]")

    @model_validator(mode="after")
    def _one(self) -> MirrorLine:
        if (self.x_m is None) == (self.y_m is None):
            raise ValueError("one line is expected, as in {x_m: 0} or {y_m: 0}")
        return self


class Device(Strict):
    """Device to place: the scenario's sensors it stands for, candidate poses, count and price.

    `sensors`: similar devices of one sensor each; `together`: one device of several sensors, which keep their poses relative
    to the first; `housing`: one device with all sensors on it.
    """

    sensors: tuple[str, ...] = Field(default=(), description="sensors of the scenario that are such devices, one each")
    together: tuple[str, ...] = Field(default=(), description="sensors of the scenario that are moved as one")
    housing: str | None = Field(default=None, description="the housing of the scenario that is moved")
    places: tuple[FixedPose, ...] = Field(default=(), description="places to choose from")
    walls: WallPoses | None = Field(default=None, description="places along the walls; none: not there")
    ceiling: CeilingPoses | None = Field(default=None, description="places below the ceiling; none: not there")
    box: BoxPoses | None = Field(default=None, description="places in a box; none: not there")
    yaw_deg: Range | None = Field(
        default=None,
        description="directions to try, relative to the place's own (of a wall: into the room) [deg]; none: the place's own",
    )
    yaw_every_deg: float = Field(default=15.0, gt=0, description="largest step between turns [deg]")
    tilt_deg: Range | None = Field(
        default=None, description="how far down to look, from and to [deg]; 90: straight down; none: the place's own"
    )
    tilt_every_deg: float = Field(default=15.0, gt=0, description="largest step between tilts [deg]")
    aim: Literal["area"] | None = Field(
        default=None, description="'area': turned to the middle of the tracked area, cameras tilted to it too"
    )
    kinds: Annotated[tuple[DeviceKind, ...], Field(min_length=1)] = Field(
        default=UNCHANGED, description="devices to choose from; none: the scenario's own sensor"
    )
    mirrored: MirrorLine | None = Field(
        default=None, description="places in pairs on both sides of a line; none: single"
    )
    count: CountRange | None = Field(
        default=None,
        description="least and most of them, or one number (of pairs, where mirrored); none: as many as in the scenario",
    )
    price: float = Field(default=0.0, ge=0, description="what one costs")

    @model_validator(mode="after")
    def _consistent(self) -> Device:
        if sum(map(bool, (self.sensors, self.together, self.housing))) != 1:
            raise ValueError("one of sensors, together and housing is expected")
        if not (self.places or self.walls or self.ceiling or self.box):
            raise ValueError("no place is given; places, walls, ceiling or box is expected")
        for name in ("yaw_deg", "tilt_deg"):
            _ascending(name, getattr(self, name))
        if self.aim and (self.yaw_deg or self.tilt_deg):
            raise ValueError("aim and yaw_deg or tilt_deg are both given; one of them is expected")
        if self.count is not None and self.count[0] > self.count[1]:
            raise ValueError(
                f"count: {self.count[0]} to {self.count[1]} is upside down; the lower end first is expected"
            )
        if len({kind.name for kind in self.kinds}) < len(self.kinds):
            raise ValueError("kinds: two have the same name; each its own is expected")
        return self

    @property
    def counts(self) -> tuple[int, int]:
        """Least and greatest number of devices."""
        if self.count is not None:
            return self.count
        number = max(1, len(self.sensors) // (2 if self.mirrored else 1))
        return number, number

    def price_of(self, kind: DeviceKind) -> float:
        """Return the price of a device of this kind."""
        return self.price if kind.price is None else kind.price

    def sensors_in(self, scenario: Scenario) -> list[str]:
        """Return the names of a scenario's sensors that the device stands for; of a housing all on it."""
        if self.housing is not None:
            return [name for name, each in scenario.sensors.items() if getattr(each, "housing", None) == self.housing]
        return [*self.sensors, *self.together]


class Cable(Strict):
    """Start, route, price and greatest length of the cable to each device."""

    start: Point3 = Field(alias="from", description="where the cables begin: x, y, z [m]")
    most_m: float | None = Field(default=None, gt=0, description="longest cable [m]; none: any")
    along: Literal["walls", "straight"] = Field(default="walls", description="along the walls, or straight")
    price_per_m: float = Field(default=0.0, ge=0, description="what a metre costs")


class KeepFreeZone(Strict):
    """Part of the room without devices: a polygon, or what is near the doors."""

    name: Text = Field(description="what it is, for errors and the plan")
    polygon: Annotated[tuple[Point2, ...], Field(min_length=3)] | None = Field(
        default=None, description="its corners on the floor [m]; none: by the doors"
    )
    doors_m: Metres | None = Field(
        default=None, description="all that is no farther than this from a doorway on the plan [m]; none: the polygon"
    )
    from_m: Metres = Field(default=0.0, description="lowest height [m]")
    to_m: Metres | None = Field(
        default=None, description="greatest height [m]; none: any height, by doors the height of the door"
    )

    @model_validator(mode="after")
    def _one(self) -> KeepFreeZone:
        if (self.polygon is None) == (self.doors_m is None):
            raise ValueError("one of polygon and doors_m is expected, as in {name: doors, doors_m: 1}")
        return self

    @property
    def highest_m(self) -> float:
        """The greatest height [m]; infinity: any."""
        return np.inf if self.to_m is None else self.to_m


class Constraints(Strict):
    """Constraints on every placement but the baseline."""

    budget: float | None = Field(
        default=None, ge=0, description="most that all moved devices and cables cost; none: any"
    )
    apart_m: Metres = Field(default=0.0, description="least distance between two devices [m]")
    cable: Cable | None = Field(default=None, description="cables to every device; none: they are not counted")
    keep_free: tuple[KeepFreeZone, ...] = Field(default=(), description="zones in which nothing may hang")
    walked_below_m: Metres = Field(
        default=2.2, description="nothing hangs lower than this where people walk [m]; 0: it may"
    )
