"""The rig: where each sensor is and how it projects, all that a message cannot say.

Written by users as `rig.yaml`, resolved from a scenario's sensors by the twin, carried in every bag.
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, PositiveInt, model_validator

from trackers.cameras.fisheye import FisheyeIntrinsics
from trackers.cameras.pinhole import PinholeIntrinsics
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.force_curve import ForceCurve
from trackers.knowledge_files import NO_FILES, KnowledgeFiles
from trackers.plain_data import parse_yaml
from trackers.pose import Coordinate, Pose
from trackers.text_file import AnyPath, read_text

Point2 = tuple[Coordinate, Coordinate]

Role = Literal["waist", "knee"]

MOST_TILT_DEG = 45.0
"""A scanner tilted further than this scans no layer of the people, neither waists nor knees."""
WAIST_FROM_M = 0.7
"""A scanner without a role mounted at least this high [m] is taken for a waist scanner."""

DepthMode = Literal["matched", "ideal", "disparity-noise"]
"""How the twin makes depth: two pictures matched; the true depth; the true depth with noise on its disparity."""

_IMAGE, _DEPTH = "image/compressed", "depth/compressed"


def check_layer(role: Role, room_from_sensor: Pose) -> None:
    """Raise ValueError for a scanner that cannot scan the layer of its role: below the floor (z = 0), or tilted."""
    height_m = room_from_sensor.xyz[2]
    if height_m < 0:
        raise ValueError(
            f"role: a {role} scanner {-height_m:g} m below the floor (z = 0) scans nobody; z from 0 on is valid"
        )
    tilt_deg = float(np.degrees(np.arccos(min(1.0, abs(room_from_sensor.rotation[2, 2])))))
    if tilt_deg > MOST_TILT_DEG:
        raise ValueError(
            f"role: a {role} scanner scans level, and this one is tilted by {tilt_deg:.4g}°; at most {MOST_TILT_DEG:g}°, "
            "or no role, is valid"
        )


class LaserSensor(Strict):
    """A planar scanner on the rig; `room_from_sensor` takes its frame (x ahead, y left, z up) to the room's.

    `time_offset_s` is added to the stamps of its messages when they are read, to bring them on the rig's clock.
    """

    kind: Literal["laser"] = Field(default="laser", description="the kind of sensor: a planar laser scanner")
    topic: str = Field(description="topic of its scans (LaserScan)")
    room_from_sensor: Pose = Field(default=Pose(), description="pose in the room of its frame: x ahead, y left, z up")
    role: Role | None = Field(
        default=None,
        description="the layer that trackers use it for; none: waist from a height of 0.7 m on, knee below",
    )
    time_offset_s: FiniteFloat = Field(
        default=0.0, description="what is added to its stamps to bring them on the rig's clock [s]"
    )

    @model_validator(mode="after")
    def _layer_is_level(self) -> LaserSensor:
        if self.role is not None:
            check_layer(self.role, self.room_from_sensor)
        return self

    @property
    def layer(self) -> Role:
        """Its role, stated or by its height."""
        return self.role or ("waist" if self.room_from_sensor.xyz[2] >= WAIST_FROM_M else "knee")


class FisheyeSensor(Strict):
    """A fisheye camera on the rig; `room_from_sensor` takes its optical frame (x right, y down, z ahead)."""

    kind: Literal["fisheye"] = Field(default="fisheye", description="the kind of sensor: a fisheye camera")
    topic: str = Field(description="topic of its pictures (CompressedImage)")
    room_from_sensor: Pose = Field(
        default=Pose(), description="pose in the room of its optical frame: x right, y down, z ahead"
    )
    intrinsics: FisheyeIntrinsics = Field(description="how its lens projects")
    time_offset_s: FiniteFloat = Field(
        default=0.0, description="what is added to its stamps to bring them on the rig's clock [s]"
    )

    @model_validator(mode="after")
    def _lens_does_not_fold(self) -> FisheyeSensor:
        self.intrinsics.check_growth()
        return self


class PinholeSensor(Strict):
    """A pinhole camera on the rig; `room_from_sensor` takes its optical frame (x right, y down, z ahead)."""

    kind: Literal["camera"] = Field(default="camera", description="the kind of sensor: a pinhole camera")
    topic: str = Field(description="topic of its pictures (CompressedImage)")
    room_from_sensor: Pose = Field(
        default=Pose(), description="pose in the room of its optical frame: x right, y down, z ahead"
    )
    intrinsics: PinholeIntrinsics = Field(description="how it projects")
    time_offset_s: FiniteFloat = Field(
        default=0.0, description="what is added to its stamps to bring them on the rig's clock [s]"
    )

    @model_validator(mode="after")
    def _lens_does_not_fold(self) -> PinholeSensor:
        self.intrinsics.edge_tangents()
        return self


class StereoSensor(Strict):
    """A stereo RGB-D camera on the rig: a colour picture and, for each of its pixels, the depth along the optical axis.

    `room_from_sensor` takes the optical frame (x right, y down, z ahead) of the left view, to which colour and depth
    both belong. `mode` says how depth was made (`trackers.rig.DepthMode`; None: a real device's own way), `baseline_m`
    how far apart the views are (None: unknown). `depth_topic` defaults to that beside the picture's:
    '/NAME/depth/compressed' for '/NAME/image/compressed'.
    """

    kind: Literal["stereo"] = Field(
        default="stereo", description="the kind of sensor: a stereo camera, colour and depth"
    )
    topic: str = Field(description="topic of its colour pictures (CompressedImage)")
    depth_topic: str = Field(
        default="",
        description="topic of its depth pictures (16-bit PNG, mm); empty: beside that of the colour pictures",
    )
    room_from_sensor: Pose = Field(
        default=Pose(), description="pose in the room of the left view's optical frame: x right, y down, z ahead"
    )
    intrinsics: PinholeIntrinsics = Field(description="how it projects, colour and depth alike")
    baseline_m: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="how far apart the two views are [m]; none: unknown"
    )
    mode: DepthMode | None = Field(default=None, description="how the twin made depth; none: a real device's own way")
    time_offset_s: FiniteFloat = Field(
        default=0.0, description="what is added to its stamps to bring them on the rig's clock [s]"
    )

    @model_validator(mode="before")
    @classmethod
    def _depth_beside_the_picture(cls, content: Any) -> Any:
        if not isinstance(content, dict) or content.get("depth_topic") or not isinstance(content.get("topic"), str):
            return content
        if not content["topic"].endswith(_IMAGE):
            raise ValueError(
                f"depth_topic is missing and cannot be told from topic {content['topic']!r}; "
                "the topic of the depth pictures is expected"
            )
        return content | {"depth_topic": content["topic"].removesuffix(_IMAGE) + _DEPTH}

    @model_validator(mode="after")
    def _lens_does_not_fold(self) -> StereoSensor:
        self.intrinsics.edge_tangents()
        return self

    def eyes_m(self) -> list[NDArray[np.float64]]:
        """Where the views look from in the room: the left one (3,), and the right one where the baseline is known [m]."""
        left, right_axis = self.room_from_sensor.translation, self.room_from_sensor.rotation[:, 0]
        return [left] if self.baseline_m is None else [left, left + self.baseline_m * right_axis]

    def points(self, depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """The point (height, width, 3) [m] in the room that each pixel of a depth picture shows; NaN where it is 0."""
        return placed_camera(self).points(depth_m)


@lru_cache
def _centres(rows: int, columns: int, pitch_m: float, room_from_sensor: Hashable) -> NDArray[np.float64]:
    """The middles of a floor's elements in the room, which nobody can change: every frame asks for them."""
    assert isinstance(room_from_sensor, Pose)
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    local = np.stack([x, y], axis=-1) * pitch_m
    centres = local @ room_from_sensor.rotation[:2, :2].T + room_from_sensor.translation[:2]
    centres.setflags(write=False)
    return centres


class FloorSensor(Strict):
    """A pressure floor: `rows` x `columns` square elements of side `pitch_m`, each with the same force curve.

    `room_from_sensor` takes its frame to the room's: origin at the outer corner of element (0, 0), x along a row (with
    the columns), y from row to row, z up.
    """

    kind: Literal["floor"] = Field(default="floor", description="the kind of sensor: a pressure floor")
    topic: str = Field(description="topic of its frames (Image, mono8, a pixel an element)")
    room_from_sensor: Pose = Field(
        default=Pose(),
        description="pose in the room of its grid: origin at the outer corner of element (0, 0), x along a row, z up",
    )
    rows: PositiveInt = Field(description="number of rows, which follow each other along the grid's y")
    columns: PositiveInt = Field(description="number of elements in a row, along the grid's x")
    pitch_m: float = Field(gt=0, allow_inf_nan=False, description="side of an element [m]")
    curve: ForceCurve = Field(default=ForceCurve(), description="what an element reads under a load")
    time_offset_s: FiniteFloat = Field(
        default=0.0, description="what is added to its stamps to bring them on the rig's clock [s]"
    )

    def load_n(self, values: NDArray[np.uint8]) -> NDArray[np.float64]:
        """The load on each element [N] that a frame's values (rows, columns) speak of, by the force curve."""
        return self.curve.load_n(values)

    @property
    def centres(self) -> NDArray[np.float64]:
        """The elements' middles in the room, (rows, columns, 2) x, y [m]."""
        return _centres(self.rows, self.columns, self.pitch_m, cast("Hashable", self.room_from_sensor))

    def cell_at(self, places: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """The element under each place (n, 2) [m] of the room, as its index along rows and columns (0 off the grid).

        And which places are on the grid, (n,). The way back of `centres`.
        """
        pose = self.room_from_sensor
        across, along = ((places - pose.translation[:2]) @ np.linalg.inv(pose.rotation[:2, :2]).T / self.pitch_m).T
        inside = (across >= 0) & (across < self.columns) & (along >= 0) & (along < self.rows)
        column, row = (np.where(inside, each, 0.0).astype(np.intp) for each in (across, along))
        return row * self.columns + column, inside

    @property
    def corners(self) -> NDArray[np.float64]:
        """The grid's corners in the room, counter-clockwise from the origin, (4, 2) [m]."""
        local = np.array([(0, 0), (self.columns, 0), (self.columns, self.rows), (0, self.rows)]) * self.pitch_m
        return local @ self.room_from_sensor.rotation[:2, :2].T + self.room_from_sensor.translation[:2]


CameraSensor = FisheyeSensor | PinholeSensor | StereoSensor
"""Whatever takes pictures."""


def placed_camera(sensor: CameraSensor) -> PlacedCamera:
    """The camera in the room; the same one for equal sensors, so that what it works out once is worked out once."""
    return _placed_camera(cast("Hashable", sensor))  # which pydantic makes of frozen models, unknown to type checkers


@lru_cache(maxsize=64)
def _placed_camera(sensor: Any) -> PlacedCamera:
    return PlacedCamera(sensor.intrinsics, sensor.room_from_sensor)


RigSensor = Annotated[
    LaserSensor | FisheyeSensor | PinholeSensor | StereoSensor | FloorSensor, Field(discriminator="kind")
]


class Rig(Strict):
    """Every sensor by name, and the tracked area as a polygon in the room frame [m] (None: everywhere).

    `room` names the room they are in, so that the environment of another is refused (None: not said).
    """

    sensors: dict[str, RigSensor] = Field(description="every sensor, by name")
    area: tuple[Point2, ...] | None = Field(
        default=None, description="tracked area, polygon of [x, y] in the room frame [m]; none: everywhere"
    )
    room: str | None = Field(default=None, description="name of the room the sensors are in; none: not said")
    main: str | None = Field(
        default=None,
        description="name of the sensor at whose stamps trackers report; none: a waist scanner before a knee scanner, a "
        "fisheye, a camera, a stereo camera, a floor, the first by name",
    )
    knowledge: KnowledgeFiles = Field(
        default=NO_FILES,
        description="files of what trackers may know beforehand, relative to this file; none: they go on without",
        exclude_if=lambda files: files == NO_FILES,
    )

    @model_validator(mode="after")
    def _area_is_a_polygon(self) -> Rig:
        if self.area is not None and len(self.area) < 3:
            raise ValueError(f"area has {len(self.area)} corners; a polygon needs at least 3")
        return self

    @model_validator(mode="after")
    def _main_is_there(self) -> Rig:
        if self.main is not None and self.main not in self.sensors:
            raise ValueError(f"main is {self.main!r}, which is no sensor; valid are {', '.join(self.sensors)}")
        return self

    def lasers(self) -> dict[str, LaserSensor]:
        """The scanners by name."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, LaserSensor)}

    def cameras(self) -> dict[str, CameraSensor]:
        """The cameras by name, of any kind."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, CameraSensor)}

    def floors(self) -> dict[str, FloorSensor]:
        """The pressure floors by name."""
        return {name: sensor for name, sensor in self.sensors.items() if isinstance(sensor, FloorSensor)}

    @property
    def main_sensor(self) -> str:
        """The sensor at whose stamps trackers report: `main`, else by what the sensors are, whatever their order.

        A waist scanner comes before a knee scanner, a fisheye, a camera, a stereo camera and a floor; among several alike the
        first by name. Raises InputError for a rig without sensors.
        """
        if not self.sensors:
            raise InputError("the rig has no sensors; at least one under 'sensors:' is needed")
        if self.main is not None:
            return self.main
        ranks = ("waist", "knee", "fisheye", "camera", "stereo", "floor")
        parts = {
            name: each.layer if isinstance(each, LaserSensor) else each.kind for name, each in self.sensors.items()
        }
        return min(parts, key=lambda name: (ranks.index(parts[name]), name))

    def dump_yaml(self) -> str:
        """The rig as the text of a `rig.yaml`."""
        return yaml.safe_dump(self.model_dump(mode="json", exclude_none=True), sort_keys=False)

    @classmethod
    def load(cls, path: AnyPath) -> Rig:
        """The rig in a `rig.yaml`, the files that it names absolute; raises InputError naming every field at fault."""
        path = Path(path)
        rig = cls.parse(read_text(path, "a rig.yaml"), str(path))
        return rig.model_copy(update={"knowledge": rig.knowledge.within(path.parent)})

    @classmethod
    def parse(cls, text: str, source: str) -> Rig:
        """The rig in the text of a `rig.yaml`; `source` names the text in errors (InputError)."""
        return validate(cls, parse_yaml(text, source, "a mapping with 'sensors:'"), source)
