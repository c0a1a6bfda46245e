"""Scenario: the typed and checked description of everything on which a run depends."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import PurePath
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict, Field, JsonValue, PrivateAttr, model_serializer, model_validator

from trackers.area import Polygon
from trackers.configuration import Strict, Typed
from trackers.errors import valid_names
from trackers.rig import NO_PRIOR, Name, PriorFiles
from twin.scenario.behaviour import Follow, companions
from twin.scenario.housings import (
    Housing,
    check_assumed_sensor,
    check_calibration_error,
    check_drives,
    check_on_housing,
    check_place,
)
from twin.scenario.person import STEADY, Person, Randomize
from twin.scenario.sensor_descriptions import SensorDescription
from twin.sensors.fault_kinds import FaultDescription, check_fault

EVERY_LIGHT = "all"
"""Name that stands for all lights of the room."""


class Flicker(Strict):
    """Flicker: a cosine of frequency `hz` multiplies the brightness by factors from 1 − `depth` to 1.

    A lamp on 50 Hz mains flickers at 100 Hz. A camera's pictures are instants, so they show it as a slow beat.
    """

    hz: float = Field(gt=0, le=1000, description="swings of the brightness a second [Hz]")
    depth: float = Field(gt=0, le=1, description="share of the brightness that is missing where it is least, 0 to 1")


class LightChange(Strict):
    """Change of a light: from `at_s` on, over `over_s` (0: at once), to `brightness` times its brightness in the room's file.

    `name`: a light of the room's MJCF, or 'all'. The change starts from the present brightness. `flicker` lasts until the
    light's next change. A lamp switched off has brightness 0; a cloud lowers the daylight for some seconds. Emission (a lit
    screen, the glow of a lamp itself) stays.
    """

    at_s: float = Field(ge=0, description="time since the start at which the light begins to change [s]")
    name: str = Field(
        default=EVERY_LIGHT,
        min_length=1,
        description="name of a light of the room's MJCF file; 'all': every light of the room",
    )
    brightness: float = Field(
        default=1.0, ge=0, le=10, description="what the light's brightness goes to, times the room's own; 0: off"
    )
    over_s: float = Field(default=0.0, ge=0, le=86_400, description="how long the change takes [s]; 0: at once")
    flicker: Flicker | None = Field(
        default=None, description="how the light flickers from then on, until its next change; none: it does not"
    )


class Rendering(Strict):
    """Switches of the renderer for all cameras. With all off, rendering is fastest."""

    shadows: bool = Field(
        default=False,
        description="whether lamps throw shadows: those of the room that may, else the one that shines most steeply down",
    )
    samples: int = Field(
        default=0, ge=0, le=16, description="samples a pixel, which soften edges; 0: one, at its middle"
    )

    def __str__(self) -> str:
        """Name the options switched on, in words; empty if none is."""
        messages = ["shadows"] if self.shadows else []
        return " and ".join([*messages, *([f"{self.samples} samples a pixel"] if self.samples else [])])


PLAIN = Rendering()


def _without_classes(value: object) -> object:
    """Raise ValueError where options stand under a class, whose name is no name of a field."""
    for key in value if isinstance(value, dict) else ():
        if isinstance(key, str) and ":" in key:
            raise ValueError(
                f"options of {key} stand under a name of your own, as {{mine: {{preset: '{key}'}}}}, by which it is then run "
                "(--tracker mine); such a name is expected"
            )
    return value


class TrackerChoice(Typed):
    """A tracker as a scenario defines it: the name of a preset or class, and changed options beside it.

    `preset` is the name of a preset or 'module:Class'; default: the entry's own name. The tracker checks the options.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, JsonValue] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    preset: str | None = Field(
        default=None, description="name of a preset, whose options the other entries change; none: the entry's own name"
    )

    @property
    def options(self) -> dict[str, JsonValue]:
        """Changed options by name."""
        return dict(self.__pydantic_extra__ or {})

    @model_serializer
    def _written(self) -> dict[str, JsonValue]:
        """Serialize for a file; options with value None are kept."""
        return ({} if self.preset is None else {"preset": self.preset}) | self.options


class TruthOptions(Strict):
    """Rates of truth that is costly to compute."""

    boxes_hz: float = Field(
        default=2.0,
        ge=0,
        le=1000,
        description="pictures a second of each camera in which people's boxes are kept [Hz]; 0: none",
    )


class Scenario(Strict):
    """A room, its people, its sensors, and the duration of the run."""

    former_names: ClassVar = {"vary": "randomize", "knowledge": "prior"}

    name: Name = Field(description="name of the scenario; it becomes the name of a folder")
    description: str = Field(default="", description="what the scenario is about, for readers")
    room: str = Field(description="name of a shipped room, or path of an MJCF file relative to the scenario")
    area: Polygon | None = Field(
        default=None, description="tracked area, polygon in the room frame [m]; none: the room's walkable area"
    )
    duration_s: float = Field(gt=0, le=86_400, description="length of the run [s]")
    seed: int = Field(
        default=0, ge=0, lt=2**63, description="what all randomness comes from; the same seed gives the same bits"
    )
    background: Literal["captured", "none"] = Field(
        default="captured", description="whether each sensor's view of the empty room is recorded before people enter"
    )
    background_frames: int = Field(
        default=10, ge=1, le=1000, description="observations a sensor takes of the empty room"
    )
    lights: tuple[LightChange, ...] = Field(default=(), description="how the room's light changes during the run")
    rendering: Rendering = Field(
        default=PLAIN,
        description="how pictures are drawn: with shadows, with several samples a pixel; none: plainly and fast",
        exclude_if=lambda rendering: rendering == PLAIN,
    )
    people: dict[Name, Person] = Field(description="who is in the room, by name")
    clearance_m: float = Field(
        default=0.35,
        ge=0.35,
        le=0.38,
        description="least distance of people's middles from furniture and walls [m]; 0.38 spares wide skirts and the arms of "
        "broad people",
        exclude_if=lambda clearance_m: clearance_m == 0.35,
    )
    randomize: Randomize = Field(
        default=STEADY,
        description="how far starts, times and speeds of people differ from seed to seed; none: not at all",
        exclude_if=lambda randomize: randomize == STEADY,
    )
    sensors: dict[Name, SensorDescription] = Field(description="what watches the room, by name")
    main_sensor: Name | None = Field(
        default=None,
        description="name of the sensor at whose stamps trackers report, written into the rig; none: the rig's rule",
    )
    housings: dict[Name, Housing] = Field(
        default={}, description="bodies that carry several sensors, which name theirs"
    )
    faults: dict[Name, FaultDescription] = Field(
        default={}, description="what goes wrong with which sensor, and from when to when"
    )
    trackers: Annotated[dict[Name, TrackerChoice], BeforeValidator(_without_classes)] = Field(
        default={}, description="trackers with changed options, by the name to call them by"
    )
    prior: PriorFiles = Field(
        default=NO_PRIOR,
        description="files of what trackers may know beforehand, relative to this file; none: they go on without",
        exclude_if=lambda files: files == NO_PRIOR,
    )
    truth: TruthOptions = Field(default=TruthOptions(), description="what is kept of the truth")
    warnings: tuple[str, ...] = Field(
        default=(), description="what to tell with every run of the scenario", exclude_if=lambda messages: not messages
    )

    _file: str = PrivateAttr(default="")
    """The user's file that it was read from, with overrides; "" for a shipped one, and one made otherwise."""

    @property
    def source(self) -> str:
        """The start of sentences on it: its file, or its name."""
        return self._file or f"scenario {self.name!r}"

    def of_file(self, source: str) -> Scenario:
        """Return a copy whose errors name this file."""
        copy = self.model_copy()
        copy._file = source
        return copy

    def __eq__(self, other: object) -> bool:
        """Return True for the same content, whatever the file."""
        return type(self) is type(other) and vars(self) == vars(other)

    @property
    def room_name(self) -> str:
        """Name of the room in a rig and in the file of its environment: the stem of its MJCF file."""
        return PurePath(self.room).stem

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if not self.sensors:
            raise ValueError("sensors is empty; a scenario needs at least one sensor")
        if self.main_sensor is not None and self.main_sensor not in self.sensors:
            raise ValueError(
                f"main_sensor: {self.main_sensor!r} is no sensor; {valid_names(self.main_sensor, self.sensors)}"
            )
        for name, person in self.people.items():
            self._check_companions(name, person)
        for name, sensor in self.sensors.items():
            _under(f"sensors.{name}.", lambda sensor=sensor: check_on_housing(sensor, self.housings))
            _under(f"sensors.{name}.", lambda sensor=sensor: check_calibration_error(sensor))
            _under(f"sensors.{name}.", lambda name=name: check_place(self, name))
            _under(f"sensors.{name}.", lambda name=name: check_assumed_sensor(self, name))
        check_drives(self)
        for name, fault in self.faults.items():
            _under(f"faults.{name}.", lambda fault=fault: check_fault(fault, self.sensors))
        return self

    def _check_companions(self, name: str, person: Person) -> None:
        for place, action in enumerate(person.script):
            when = action.when
            if when is not None and when.person in self.people:
                done = dict.fromkeys(each.kind for each in self.people[when.person].script) | {"stand": None}
                if when.does not in done:
                    raise ValueError(
                        f"people.{name}.script.{place}.when.does: {when.person!r} never does {when.does!r}; "
                        f"{valid_names(when.does, done)}"
                    )
            for field, other in companions(action):
                if other == name or other not in self.people:
                    others = valid_names(
                        other,
                        [each for each in self.people if each != name],
                        none="nobody, as there is no other person",
                    )
                    what = "is the person themselves" if other == name else "is nobody in people"
                    raise ValueError(f"people.{name}.script.{place}.{field}: {other!r} {what}; {others}")


def _under(path: str, check: Callable[[], None]) -> None:
    """Prefix an error's sentence with the path of the field."""
    try:
        check()
    except ValueError as error:
        raise ValueError(f"{path}{error}") from error


def describe_conditions(scenario: Scenario) -> list[str]:
    """Describe faults, changes of light, rendering and calibration errors, one sentence each."""
    messages = []
    if scenario.faults:
        faults = (
            f"{fault.kind.replace('_', ' ')} of {_listed(fault.sensor)} {_span(fault.from_s, fault.to_s)}"
            for fault in scenario.faults.values()
        )
        messages.append(f"Faults: {'; '.join(faults)}.")
    if scenario.lights:
        changes = (f"{change.name} to {change.brightness:g} from {change.at_s:g} s" for change in scenario.lights)
        messages.append(f"Light: {'; '.join(changes)}.")
    if str(scenario.rendering):
        messages.append(f"Pictures are drawn with {scenario.rendering}.")
    misled = [name for name, sensor in scenario.sensors.items() if sensor.calibration_error is not None]
    if misled:
        messages.append(f"Trackers assume another pose, lens or clock than the true one of: {', '.join(misled)}.")
    return messages


def describe_late_starts(scenario: Scenario, there: Collection[str]) -> list[str]:
    """Describe faults, changes of light and sensors that begin only after the end of the run, one sentence each, and faults of
    sensors that are not `there`, as without images.
    """
    end_s = scenario.duration_s
    times = [
        *((f"sensors.{name}.phase_s", sensor.phase_s, "never looks") for name, sensor in scenario.sensors.items()),
        *((f"faults.{name}.from_s", fault.from_s, "never begins") for name, fault in scenario.faults.items()),
        *((f"lights.{n}.at_s", change.at_s, "never comes") for n, change in enumerate(scenario.lights)),
    ]
    left_out = {name: [each for each in fault.sensor if each not in there] for name, fault in scenario.faults.items()}
    return [
        f"faults.{name}: does not show in {', '.join(each)}, which the run leaves out"
        for name, each in left_out.items()
        if each
    ] + [
        f"{field}: {at_s:g} s is not before the end at {end_s:g} s: {never}"
        for field, at_s, never in times
        if at_s >= end_s
    ]


def describe_circles(scenario: Scenario) -> list[str]:
    """Describe people who follow each other to the end of the run, so that none of them walks: one sentence a circle."""
    follows = {
        name: (f"people.{name}.script.{place}", action.person)
        for name, person in scenario.people.items()
        for place, action in enumerate(person.script)
        if isinstance(action, Follow) and (action.for_s is None or action.for_s >= scenario.duration_s)
    }
    described, seen = [], set[str]()
    for name in follows:
        circle = [name]
        while circle[-1] in follows and (after := follows[circle[-1]][1]) not in circle:
            circle.append(after)
        if circle[-1] in follows and follows[circle[-1]][1] == name and not seen & set(circle):
            seen |= set(circle)
            words = ", who follows ".join([*circle, name])
            described.append(f"{follows[name][0]}: {words}: none of them walks; one who leads is expected")
    return described


def _listed(sensors: str | tuple[str, ...]) -> str:
    return sensors if isinstance(sensors, str) else " and ".join(sensors)


def _span(from_s: float, to_s: float | None) -> str:
    if to_s is None:
        return f"from {from_s:g} s on" if from_s else "throughout"
    return f"from {from_s:g} to {to_s:g} s"
