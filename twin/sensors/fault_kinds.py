"""Kinds of sensor faults and their times, as a scenario describes them."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, FiniteFloat, NonNegativeInt, PositiveFloat, model_validator

from trackers.configuration import Strict
from trackers.errors import valid_names
from trackers.observations import NS_PER_S

_CAMERAS = ("fisheye", "camera", "stereo")
_EVERY_KIND = ("laser", *_CAMERAS, "floor")

Share = Annotated[float, Field(ge=0, le=1)]
Byte = Annotated[int, Field(ge=0, le=255)]
Sensors = Annotated[
    tuple[str, ...],
    BeforeValidator(
        lambda value: (value,) if isinstance(value, str) else value, json_schema_input_type=str | list[str]
    ),
    Field(min_length=1),
]


class _Fault(Strict):
    """A fault of one sensor, or of each of several: at the stamps from `from_s` up to, not at, `to_s` [s]; none: to the end.

    Outside these times the sensor reports what it would have reported without the fault, to the bit. The truth knows of
    no fault, and the empty room is recorded before any.
    """

    fits: ClassVar[tuple[str, ...]] = _EVERY_KIND
    """The kinds of sensor that can have it."""

    sensor: Sensors = Field(description="name of the sensor at fault, or a list of names")
    from_s: float = Field(
        default=0.0, ge=0, le=86_400, description="first time since the start at which the fault is there [s]"
    )
    to_s: float | None = Field(
        default=None,
        gt=0,
        le=86_400,
        description="time since the start from which the fault is over again [s]; none: it stays to the end",
    )

    @model_validator(mode="after")
    def _to_s_after_from_s(self) -> _Fault:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(
                f"to_s {self.to_s:g} is not after from_s {self.from_s:g}; a later time is valid, or none for the end"
            )
        return self

    def holds(self, stamp_ns: int) -> bool:
        """Return True while the fault is present at this time since the start [ns]."""
        return self.from_ns <= stamp_ns and (self.to_s is None or stamp_ns < round(self.to_s * NS_PER_S))

    @property
    def from_ns(self) -> int:
        """Start of the fault [ns]."""
        return round(self.from_s * NS_PER_S)

    def check(self, description: Any) -> None:
        """Raise ValueError where it does not fit this sensor, of a kind that can have it."""


class Dropout(_Fault):
    """Observations are lost on the way with this probability, each by itself; 1: the sensor is silent."""

    kind: Literal["dropout"] = Field(description="the fault: observations are lost")
    probability: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="probability that an observation is lost, each by itself; 1: the sensor is silent",
    )


class Freeze(_Fault):
    """The values of the last observation before the fault come again and again, under new stamps."""

    kind: Literal["freeze"] = Field(description="the fault: the last values come again and again")


class Delay(_Fault):
    """Observations arrive `delay_s` later than they would, and up to `jitter_s` later still, drawn evenly.

    Their stamps stay. Later ones may overtake the last delayed ones, as on a network.
    """

    kind: Literal["delay"] = Field(description="the fault: observations arrive late")
    delay_s: float = Field(default=0.0, ge=0, le=60, description="how much later than usual observations arrive [s]")
    jitter_s: float = Field(
        default=0.0, ge=0, le=60, description="longest further delay, drawn evenly from 0 up for each observation [s]"
    )

    @model_validator(mode="after")
    def _delays(self) -> Delay:
        if self.delay_s == 0 and self.jitter_s == 0:
            raise ValueError("delay_s and jitter_s are both 0; a time above 0 is expected in one of them")
        return self


class ClockError(_Fault):
    """The clock that stamps is off by `offset_s`, and gains `drift_ppm` microseconds per second from `from_s` on.

    Stamps alone are wrong: the sensor looks when it always did, by the pace of its motor or its shutter. Within the fault
    stamps rise as ever. Where it begins and ends the clock is set, as by a time server, and steps: stamps may go back once
    there, which a tracker has to bear. Several faults of one clock add up.
    """

    kind: Literal["clock"] = Field(description="the fault: the clock that stamps is wrong")
    offset_s: float = Field(
        default=0.0, ge=-3600, le=3600, description="how far the clock is off, stamp minus true time [s]"
    )
    drift_ppm: float = Field(
        default=0.0,
        ge=-100_000,
        le=100_000,
        description="how fast the clock gains from `from_s` on [microseconds per second]",
    )

    @model_validator(mode="after")
    def _is_off(self) -> ClockError:
        if self.offset_s == 0 and self.drift_ppm == 0:
            raise ValueError("offset_s and drift_ppm are both 0; one of them other than 0 is expected")
        return self


class LensOcclusion(_Fault):
    """Something on or right before the lens: a soft-edged blob over part of the picture, too near to be in focus.

    `at` is its middle and `size` its diameter, in shares of the picture's width (from the left) and height (from above),
    and of its height. `look`: 'cover' hides what is behind in the colour `rgb` (a hand, dirt), 'smear' blurs it (grease, a
    drop of water). `opacity`: how much of it; `softness`: the share of its radius over which it fades; `irregularity`: how
    far its outline leaves the circle, drawn once.

    It lies before the sensor, whose noise comes on top. Depth is missing where a stereo camera's view is covered.
    Simplified: exposure takes no notice of it; it covers both views of a stereo camera at the same place.
    """

    fits: ClassVar[tuple[str, ...]] = _CAMERAS

    kind: Literal["occlusion"] = Field(description="the fault: something is on or right before the lens")
    at: tuple[Share, Share] = Field(
        default=(0.5, 0.5),
        description="middle of what covers the picture, in shares of its width (from the left) and height (from above)",
    )
    size: float = Field(
        default=0.4, gt=0, le=5, description="diameter of what covers the picture, in shares of the picture's height"
    )
    look: Literal["cover", "smear"] = Field(
        default="cover",
        description="cover hides what is behind (a hand, dirt), smear blurs it (grease, a drop of water)",
    )
    opacity: float = Field(default=1.0, gt=0, le=1, description="how much is hidden in the middle, 0 to 1")
    softness: float = Field(
        default=0.4, gt=0, le=1, description="share of the radius over which the edge fades, 0 to 1"
    )
    irregularity: float = Field(
        default=0.2,
        ge=0,
        le=0.5,
        description="how far the outline leaves the circle, in shares of the radius; drawn once",
    )
    rgb: tuple[Byte, Byte, Byte] = Field(
        default=(24, 20, 18), description="colour of a cover: red, green, blue, 0 to 255 each"
    )


class BlockedSector(_Fault):
    """Something right before a scanner's window, `at_m` from its middle, takes the beams between two bearings [deg].

    Bearings are in the scanner's frame, 0 ahead, counter-clockwise, first to last. A beam that met something nearer keeps
    it. Below the scanner's range_min_m it reads NaN, as ever.
    """

    fits: ClassVar[tuple[str, ...]] = ("laser",)

    kind: Literal["blocked_sector"] = Field(
        description="the fault: something before a scanner's window blocks a sector"
    )
    bearings_deg: tuple[FiniteFloat, FiniteFloat] = Field(
        description="first and last bearing of the sector, counter-clockwise, 0 straight ahead [deg]"
    )
    at_m: PositiveFloat = Field(default=0.1, description="distance of what blocks from the scanner's middle [m]")

    @model_validator(mode="after")
    def _in_order(self) -> BlockedSector:
        _check_bearings(self.bearings_deg)
        return self

    def check(self, description: Any) -> None:
        """Raise ValueError where the sector lies outside what the scanner sees."""
        if self.at_m >= description.range_max_m:
            raise ValueError(
                f"at_m {self.at_m:g} is beyond the scanner's range; below {description.range_max_m:g} is valid"
            )
        _check_in_field(self.bearings_deg, description.field_of_view_deg)


class DeadBeams(_Fault):
    """Beams of a scanner that report nothing: between two bearings [deg], of these numbers, and a `share` of the rest.

    `beams` are ranges [first, last] or single [number], counted from 0; the share is drawn once. `reads`: what such a beam
    says, 'invalid' (NaN, as drivers turn error codes) or 'no_return' (+inf, as if there were nothing).
    """

    fits: ClassVar[tuple[str, ...]] = ("laser",)

    kind: Literal["dead_beams"] = Field(description="the fault: beams of a scanner report nothing")
    beams: tuple[tuple[NonNegativeInt] | tuple[NonNegativeInt, NonNegativeInt], ...] = Field(
        default=(), description="dead beams as ranges [first, last] or single [number], counted from 0"
    )
    bearings_deg: tuple[FiniteFloat, FiniteFloat] | None = Field(
        default=None,
        description="first and last bearing between which beams are dead, 0 straight ahead [deg]; none: no such sector",
    )
    share: Share = Field(default=0.0, description="share of the other beams that are dead, 0 to 1; drawn once")
    reads: Literal["invalid", "no_return"] = Field(
        default="invalid", description="what a dead beam reads: invalid is NaN, no_return is +inf"
    )

    @model_validator(mode="after")
    def _names_some(self) -> DeadBeams:
        if not (self.beams or self.bearings_deg or self.share):
            raise ValueError("names no beam; beams: [[40, 44]], bearings_deg: [-10, 10] or share: 0.05 is expected")
        for each in self.beams:
            if each[0] > each[-1]:
                raise ValueError(f"beams has {list(each)}, which goes down; [first, last] is valid")
        if self.bearings_deg is not None:
            _check_bearings(self.bearings_deg)
        return self

    def check(self, description: Any) -> None:
        """Raise ValueError where it names beams that the scanner does not have."""
        for each in self.beams:
            if each[-1] >= description.n_beam:
                raise ValueError(f"beams has {list(each)}; the scanner's are 0 to {description.n_beam - 1}")
        if self.bearings_deg is not None:
            _check_in_field(self.bearings_deg, description.field_of_view_deg)


class DeadCells(_Fault):
    """Elements of a floor that always read the same: `cells` [row, column], whole `rows` and `columns`, a `share` of the rest.

    A line that is broken takes its row or column with it. The share is drawn once. `reads`: the 8-bit value, 0 for dead.
    """

    fits: ClassVar[tuple[str, ...]] = ("floor",)

    kind: Literal["dead_cells"] = Field(description="the fault: elements of a pressure floor always read the same")
    cells: tuple[tuple[NonNegativeInt, NonNegativeInt], ...] = Field(
        default=(), description="dead elements as [row, column], counted from 0"
    )
    rows: tuple[NonNegativeInt, ...] = Field(default=(), description="rows that are dead as a whole, counted from 0")
    columns: tuple[NonNegativeInt, ...] = Field(
        default=(), description="columns that are dead as a whole, counted from 0"
    )
    share: Share = Field(default=0.0, description="share of the other elements that are dead, 0 to 1; drawn once")
    reads: Byte = Field(default=0, description="the 8-bit value that a dead element reads, 0 to 255")

    @model_validator(mode="after")
    def _names_some(self) -> DeadCells:
        if not (self.cells or self.rows or self.columns or self.share):
            raise ValueError("names no element; cells: [[3, 4]], rows: [2], columns: [5] or share: 0.05 is expected")
        return self

    def check(self, description: Any) -> None:
        """Raise ValueError where it names elements that the floor does not have."""
        rows, columns = description.rows, description.columns
        for row, column in self.cells:
            if row >= rows or column >= columns:
                raise ValueError(
                    f"cells has [{row}, {column}]; [0, 0] to [{rows - 1}, {columns - 1}] are valid on this grid"
                )
        for what, named, count in (("rows", self.rows, rows), ("columns", self.columns, columns)):
            if max(named, default=0) >= count:
                raise ValueError(f"{what} has {max(named)}; the floor's are 0 to {count - 1}")


Fault = Dropout | Freeze | Delay | ClockError | LensOcclusion | BlockedSector | DeadBeams | DeadCells
FaultDescription = Annotated[Fault, Field(discriminator="kind")]

FAULT_KINDS: dict[str, type[Fault]] = {
    "dropout": Dropout,
    "freeze": Freeze,
    "delay": Delay,
    "clock": ClockError,
    "occlusion": LensOcclusion,
    "blocked_sector": BlockedSector,
    "dead_beams": DeadBeams,
    "dead_cells": DeadCells,
}
"""The kinds of fault by name."""


def check_fault(fault: Fault, sensors: dict[str, Any]) -> None:
    """Raise ValueError where the fault is of a sensor that is not there, or that cannot have it; `sensors`: descriptions."""
    for name in fault.sensor:
        if name not in sensors:
            raise ValueError(f"sensor: {name!r} is not one of the sensors; {valid_names(name, sensors)}")
        description = sensors[name]
        if description.kind not in fault.fits:
            valid = [kind for kind, each in FAULT_KINDS.items() if description.kind in each.fits]
            raise ValueError(
                f"kind: {fault.kind!r} does not fit sensor {name!r}, a {description.kind}; "
                f"valid for it are {', '.join(valid)}"
            )
        fault.check(description)


def _check_bearings(bearings_deg: tuple[float, float]) -> None:
    if not bearings_deg[0] < bearings_deg[1]:
        raise ValueError(f"bearings_deg {list(bearings_deg)} do not rise; [first, last], counter-clockwise, is valid")


def _check_in_field(bearings_deg: tuple[float, float], field_of_view_deg: float) -> None:
    half = field_of_view_deg / 2
    if bearings_deg[1] < -half or bearings_deg[0] > half:
        raise ValueError(
            f"bearings_deg {list(bearings_deg)} are outside the field of view; {-half:g} to {half:g} is valid"
        )
