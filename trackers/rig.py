"""The rig: its sensors by name, the tracked area, and what trackers may know beforehand.

Written by users as `rig.yaml`, resolved from a scenario's sensors by the twin, carried in every bag.
"""

from __future__ import annotations

import hashlib
import reprlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from trackers.area import Point2, Polygon, Pose
from trackers.configuration import Strict, validate
from trackers.errors import InputError, raise_faults, valid_names
from trackers.rig_sensors import (
    CameraSensor,
    DepthMode,
    FisheyeSensor,
    FloorSensor,
    LaserSensor,
    Name,
    OdometrySensor,
    PinholeSensor,
    RigSensor,
    Role,
    StereoSensor,
    placed_camera,
)
from trackers.user_input.plain_data import dump_yaml, parse_yaml
from trackers.user_input.text_file import AnyPath, as_path, is_file, read_text

__all__ = [
    "NO_PRIOR",
    "CameraSensor",
    "DepthMode",
    "FisheyeSensor",
    "FloorSensor",
    "LaserSensor",
    "Name",
    "OdometrySensor",
    "PinholeSensor",
    "Point2",
    "Pose",
    "PriorFiles",
    "Rig",
    "RigSensor",
    "Role",
    "StereoSensor",
    "files_within",
    "missing_file",
    "normal_topic",
    "placed_camera",
]


def normal_topic(name: str) -> str:
    """Return a topic's name with one slash in front, as ROS 1 and ROS 2 may or may not write it."""
    return "/" + name.strip("/")


class PriorFiles(Strict):
    """Files of what trackers may know of a room; relative to the file that names them, absolute once that is loaded."""

    environment: str | None = Field(
        default=None,
        description="file of the empty room's walls and furniture, as `twin environment` writes; none: unknown",
    )
    learned: dict[str, str] = Field(
        default={}, description="files that trackers have learned beforehand, by the name that they ask for"
    )

    background: dict[str, str] = Field(
        default={},
        description="pictures of the empty room (PNG or JPEG) by camera, for recordings without any; none: those recorded",
        exclude_if=lambda pictures: not pictures,
    )

    def within(self, folder: AnyPath) -> Self:
        """Return the files with absolute paths; they were named in `folder`."""
        return type(self).model_validate(files_within(self.model_dump(), folder))

    def paths(self) -> dict[str, Path]:
        """Return the files by their field: 'environment', 'learned.NAME', 'background.CAMERA'."""
        environment = {} if self.environment is None else {"environment": Path(self.environment)}
        learned = {f"learned.{name}": Path(each) for name, each in self.learned.items()}
        return environment | learned | {f"background.{name}": Path(each) for name, each in self.background.items()}

    def missing(self) -> dict[str, Path]:
        """Return the files, by their field, that do not exist."""
        return {field: path for field, path in self.paths().items() if not is_file(path)}

    def without(self, fields: Iterable[str]) -> Self:
        """Return the files but for those of these fields."""
        left_out = set(fields)
        learned = {name: each for name, each in self.learned.items() if f"learned.{name}" not in left_out}
        pictures = {name: each for name, each in self.background.items() if f"background.{name}" not in left_out}
        environment = None if "environment" in left_out else self.environment
        return self.model_copy(update={"environment": environment, "learned": learned, "background": pictures})

    def check(self, source: str) -> None:
        """Raise InputError, one line per file that does not exist, naming `source` and the field."""
        raise_faults(f"{source}: {missing_file(f'prior.{field}', path)}" for field, path in self.missing().items())

    def digest(self) -> str:
        """Digest the contents of the files, 16 hexadecimal digits; '' where there are none. All of them must exist."""
        whole = hashlib.sha256()
        for field, path in sorted(self.paths().items()):
            with path.open("rb") as stream:
                whole.update(f"{field} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode())
        return whole.hexdigest()[:16] if self.paths() else ""


NO_PRIOR = PriorFiles()


def files_within(content: Any, folder: AnyPath) -> Any:
    """Make every path in `prior`, or a part of it, as plain data, absolute; they are relative to `folder`."""
    if isinstance(content, dict):
        return {key: files_within(value, folder) for key, value in content.items()}
    return str((Path(folder) / content).absolute()) if isinstance(content, str) else content


def missing_file(field: str, path: AnyPath) -> str:
    """Say in a clause that the file of a field does not exist, and what is expected."""
    expected = "one that `twin environment` wrote" if field.endswith("environment") else "what a tracker has learned"
    if ".background." in f".{field}":
        expected = "a picture of the empty room"
    return f"{field}: there is no file {path}; {expected} is expected"


_OF_SCENARIOS = {"people", "extends", "duration_s"}
"""Keys of a scenario that a rig has not."""


class Rig(Strict):
    """Every sensor by name, and the tracked area as a polygon in the room frame [m] (None: everywhere).

    `room` names the room they are in, so that the environment of another is refused (None: not said).
    """

    former_names: ClassVar[Mapping[str, str]] = {"knowledge": "prior"}

    sensors: dict[Name, RigSensor] = Field(description="every sensor, by name")
    area: Polygon | None = Field(
        default=None, description="tracked area, polygon of [x, y] in the room frame [m]; none: everywhere"
    )
    room: str | None = Field(default=None, description="name of the room the sensors are in; none: not said")
    main: str | None = Field(
        default=None,
        description="name of the sensor at whose stamps trackers report; none: a waist scanner before a knee scanner, a "
        "fisheye, a camera, a stereo camera, a floor, the first by name",
    )
    prior: PriorFiles = Field(
        default=NO_PRIOR,
        description="files of what trackers may know beforehand, relative to this file; none: they go on without",
        exclude_if=lambda files: files == NO_PRIOR,
    )

    @model_validator(mode="after")
    def _has_sensors(self) -> Rig:
        if not self.sensors:
            raise ValueError("sensors is empty; a rig needs at least one sensor")
        if len(self.odometry()) == len(self.sensors):
            raise ValueError("sensors has odometry alone; a rig needs at least one sensor that sees people")
        return self

    @model_validator(mode="after")
    def _bases_are_there(self) -> Rig:
        bases = self.odometry()
        for name, base in self.mounted().items():
            if base not in bases:
                valid = valid_names(base, bases) if bases else "the rig has none, and one of kind odometry is expected"
                raise ValueError(f"sensors.{name}.mounted_on is {base!r}, which is no odometry; {valid}")
        return self

    @model_validator(mode="after")
    def _topics_are_their_own(self) -> Rig:
        owners: dict[str, str] = {}
        for name, sensor in self.sensors.items():
            if isinstance(sensor, OdometrySensor) and sensor.frame is not None:
                continue  # any number of bases may be in the same transforms
            for part in ("topic", "depth_topic"):
                topic = getattr(sensor, part, None)
                if topic is None:
                    continue
                if (owner := owners.get(normal_topic(topic))) is not None:
                    raise ValueError(
                        f"sensors.{name}.{part} is {topic!r}, as is that of {owner!r}; a topic of its own is expected"
                    )
                owners[normal_topic(topic)] = name
        return self

    @model_validator(mode="after")
    def _main_is_there(self) -> Rig:
        valid = [name for name in self.sensors if name not in self.odometry()]
        if self.main is not None and self.main not in valid:
            raise ValueError(f"main is {self.main!r}, which is no sensor; {valid_names(self.main, valid)}")
        return self

    def lasers(self) -> dict[str, LaserSensor]:
        """Return the scanners by name."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, LaserSensor)}

    def cameras(self) -> dict[str, CameraSensor]:
        """Return the cameras by name, of any kind."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, CameraSensor)}

    def floors(self) -> dict[str, FloorSensor]:
        """Return the pressure floors by name."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, FloorSensor)}

    def odometry(self) -> dict[str, OdometrySensor]:
        """Return the odometry of moving bases by name."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, OdometrySensor)}

    def topics(self) -> list[str]:
        """Return the topics of the sensors, with a slash in front."""
        return [normal_topic(each.topic) for each in self.sensors.values()]

    def mounted(self) -> dict[str, str]:
        """Return the name of the odometry on whose base a sensor moves, by sensor; those that stand are left out."""
        bases = {name: getattr(sensor, "mounted_on", None) for name, sensor in self.sensors.items()}
        return {name: base for name, base in bases.items() if base is not None}

    def pose_at(self, name: str, frame_from_base: NDArray[np.float64] | None = None) -> Pose:
        """Return the pose of a sensor in the room: where it stands, or where it is on its base at a pose (4, 4) of that.

        frame_from_base: of the base in its odometry frame (`trackers.observations.Odometry`); None: that frame's origin.
        """
        base = self.mounted().get(name)
        if base is None:
            return self.sensors[name].room_from_sensor
        moved = np.eye(4) if frame_from_base is None else frame_from_base
        room_from_frame = self.sensors[base].room_from_sensor.matrix
        return Pose.from_transform(room_from_frame @ moved @ self.sensors[name].room_from_sensor.matrix)

    @property
    def main_sensor(self) -> str:
        """The sensor at whose stamps trackers report: `main`, else by what the sensors are, whatever their order.

        A waist scanner comes before a knee scanner, a fisheye, a camera, a stereo camera and a floor; among several alike the
        first by name.
        """
        if self.main is not None:
            return self.main
        ranks = ("waist", "knee", "fisheye", "camera", "stereo", "floor")
        parts = {
            name: each.layer if isinstance(each, LaserSensor) else each.kind
            for name, each in self.sensors.items()
            if not isinstance(each, OdometrySensor)
        }
        return min(parts, key=lambda name: (ranks.index(parts[name]), name))

    def dump_yaml(self) -> str:
        """Write the rig as the text of a `rig.yaml`."""
        return dump_yaml(self.model_dump(mode="json", exclude_none=True))

    @classmethod
    def load(cls, path: AnyPath, complete: Callable[[Any], Any] = lambda content: content) -> Rig:
        """Load a `rig.yaml`; paths in it become absolute. Raises InputError naming every invalid field.

        complete: makes of the file's plain content that of a whole rig, by what else is known of its sensors.
        """
        path = as_path(path, "rig")
        rig = cls.parse(read_text(path, "a rig.yaml"), str(path), complete)
        return rig.model_copy(update={"prior": rig.prior.within(path.parent)})

    @classmethod
    def parse(cls, text: str, source: str, complete: Callable[[Any], Any] = lambda content: content) -> Rig:
        """Parse the text of a `rig.yaml`; `source` names the text in errors (InputError); complete: as for `load`."""
        content = parse_yaml(text, source, "a mapping with 'sensors:'")
        if isinstance(content, dict) and _OF_SCENARIOS & content.keys():
            raise InputError(
                f"{source}: is a scenario; a rig.yaml with the topic and the pose of each sensor is expected, none for a bag "
                "that the twin wrote"
            )
        return validate(cls, complete(content), source)


@runtime_checkable
class Updated(Protocol):
    """Object that takes observations."""

    def update(self, observation: Any) -> Any: ...


_ARGUMENTS: dict[str, tuple[type | tuple[type, ...], str]] = {
    "rig": (Rig, "a trackers.rig.Rig, as Rig.load('rig.yaml') gives it,"),
    "name": (str, "the name of a tracker"),
    "options": ((Mapping, type(None)), "a mapping of the tracker's options by name"),
    "background": (Iterable, "an iterable of observations, or a trackers.prior.Prior,"),
    "rng": (
        (np.random.Generator, type(None)),
        "a numpy.random.Generator, as twin.stream(seed, 'tracker', name) gives it,",
    ),
    "tracker": (Updated, "an object with update(observation), as make_tracker gives it,"),
    "observations": (Iterable, "an iterable of observations, as observations() of a recording gives it,"),
}


def check_arguments(rig: object, **others: object) -> None:
    """Raise InputError for arguments of another type than trackers are made and fed with; others: by name."""
    for name, given in {"rig": rig, **others}.items():
        valid, expected = _ARGUMENTS[name]
        if not isinstance(given, valid) or isinstance(given, type):
            raise InputError(f"{name} is {reprlib.repr(given)}; {expected} is expected")
