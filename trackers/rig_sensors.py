"""The sensors of a rig: where each is and how it projects, all that a message cannot say, and what no sensor can be."""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PositiveInt, StringConstraints, ValidationInfo, model_validator

from trackers.area import Pose
from trackers.cameras.intrinsics import FisheyeIntrinsics, PinholeIntrinsics
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.errors import text_near_bound
from trackers.observations import ForceCurve

Role = Literal["waist", "knee"]

WAIST_FROM_M = 0.7
"""A scanner without a role mounted at least this high [m] is taken for a waist scanner."""

DepthMode = Literal["matched", "ideal", "disparity-noise"]
"""Ways in which the twin makes depth: two pictures matched; the true depth; the true depth with noise on its disparity."""

_IMAGE, _DEPTH = "image/compressed", "depth/compressed"
MOST_TILT_DEG = 45.0
"""A scanner tilted further than this scans no layer of the people, neither waists nor knees."""
WIDEST_BASELINE_M = 2.0
"""Views of a stereo camera further apart than this do not see the same people [m]."""
MOST_CELLS = 40_000
"""Elements of a floor: a message of this size at 10 Hz is that of a small camera."""
_LEVEL = 1e-6
"""A floor whose z axis leaves the vertical by less than this is level (sine of the angle)."""
_FARTHEST_CLOCK_S = 4.3e9
"""ROS stamps hold 32 bits of seconds: no two clocks are further apart [s]."""


def check_height(pose: Pose) -> None:
    """Raise ValueError for what hangs below the floor of the room, z = 0."""
    z = pose.xyz[2]
    if z < 0:
        raise ValueError(f"hangs {-z:g} m below the floor of the room (z = 0); z from 0 on is expected")


def check_layer(role: Role, room_from_sensor: Pose) -> None:
    """Raise ValueError for a scanner that is tilted too far to scan the layer of its role."""
    tilt_deg = float(np.degrees(np.arccos(min(1.0, abs(room_from_sensor.rotation[2, 2])))))
    if round(tilt_deg, 6) > MOST_TILT_DEG:
        tilt = text_near_bound(tilt_deg, MOST_TILT_DEG, ".4g")
        raise ValueError(
            f"role: a {role} scanner scans level, and this one is tilted by {tilt}°; at most {MOST_TILT_DEG:g}°, "
            "or no role, is valid"
        )


def check_cells(rows: int, columns: int) -> None:
    """Raise ValueError for a pressure floor of more elements than MOST_CELLS."""
    if rows * columns > MOST_CELLS:
        raise ValueError(
            f"rows {rows} x columns {columns} are {rows * columns} elements; at most {MOST_CELLS} are valid"
        )


def _above_the_floor(pose: Pose, info: ValidationInfo) -> Pose:
    if info.data.get("mounted_on") is None:
        check_height(pose)
    return pose


def _in_the_floor(pose: Pose) -> Pose:
    """Return the pose of a floor's grid; its z axis may point down, where rows follow each other the other way."""
    if pose.xyz[2] != 0 or np.hypot(*pose.rotation[:2, 2]) > _LEVEL:
        raise ValueError(
            f"xyz {list(pose.xyz)}, rpy {list(pose.rpy)} does not lie in the room's floor; z = 0 and a roll and pitch of 0 "
            "(or π) are valid"
        )
    return pose


Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100)]
"""A name: it becomes a topic, a file name and a column, so letters, digits, '-' and '_' only, a letter first."""
MountedOn = Annotated[
    Name | None,
    Field(
        description="name of the rig's odometry whose moving base carries the sensor: room_from_sensor is its pose in the "
        "frame of that base then; none: it stands in the room"
    ),
]
Topic = Annotated[str, StringConstraints(pattern=r"^/*[^/\s][^\s]*$")]
Lens = TypeVar("Lens", FisheyeIntrinsics, PinholeIntrinsics)


def _seeing(lens: Lens) -> Lens:
    """Return the lens; raises InputError for an impossible one."""
    lens.check_view()
    return lens


FisheyeLens = Annotated[FisheyeIntrinsics, AfterValidator(_seeing)]
PinholeLens = Annotated[PinholeIntrinsics, AfterValidator(_seeing)]
HungPose = Annotated[Pose, AfterValidator(_above_the_floor)]
FloorPose = Annotated[Pose, AfterValidator(_in_the_floor)]
OpticalPose = Annotated[HungPose, Field(description="pose in the room of its optical frame: x right, y down, z ahead")]
TimeOffset = Annotated[
    float,
    Field(
        ge=-_FARTHEST_CLOCK_S,
        le=_FARTHEST_CLOCK_S,
        allow_inf_nan=False,
        description="what is added to its stamps to bring them on the rig's clock [s]",
    ),
]
Baseline = Annotated[float, Field(gt=0, le=WIDEST_BASELINE_M, allow_inf_nan=False)]
Pitch = Annotated[float, Field(ge=0.01, le=2, allow_inf_nan=False)]


class LaserSensor(Strict):
    """A planar scanner on the rig; `room_from_sensor` takes its frame (x ahead, y left, z up) to the room's.

    `time_offset_s` is added to the stamps of its messages when they are read, to bring them on the rig's clock.
    """

    kind: Literal["laser"] = Field(default="laser", description="the kind of sensor: a planar laser scanner")
    topic: Topic = Field(description="topic of its scans (LaserScan)")
    mounted_on: MountedOn = None
    room_from_sensor: HungPose = Field(
        default=Pose(), description="pose in the room of its frame: x ahead, y left, z up"
    )
    role: Role | None = Field(
        default=None,
        description="the layer that trackers use it for; none: waist from a height of 0.7 m on, knee below",
    )
    time_offset_s: TimeOffset = 0.0

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
    topic: Topic = Field(description="topic of its pictures (CompressedImage)")
    mounted_on: MountedOn = None
    room_from_sensor: OpticalPose = Pose()
    intrinsics: FisheyeLens = Field(
        description="how its lens projects; may be left out for a bag that has its CameraInfo"
    )
    time_offset_s: TimeOffset = 0.0


class PinholeSensor(Strict):
    """A pinhole camera on the rig; `room_from_sensor` takes its optical frame (x right, y down, z ahead)."""

    kind: Literal["camera"] = Field(default="camera", description="the kind of sensor: a pinhole camera")
    topic: Topic = Field(description="topic of its pictures (CompressedImage)")
    mounted_on: MountedOn = None
    room_from_sensor: OpticalPose = Pose()
    intrinsics: PinholeLens = Field(description="how it projects; may be left out for a bag that has its CameraInfo")
    time_offset_s: TimeOffset = 0.0


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
    topic: Topic = Field(description="topic of its colour pictures (CompressedImage)")
    depth_topic: str = Field(
        default="",
        description="topic of its depth pictures (16-bit PNG, mm); empty: beside that of the colour pictures",
    )
    mounted_on: MountedOn = None
    room_from_sensor: HungPose = Field(
        default=Pose(), description="pose in the room of the left view's optical frame: x right, y down, z ahead"
    )
    intrinsics: PinholeLens = Field(
        description="how it projects, colour and depth alike; may be left out for a bag that has its CameraInfo"
    )
    baseline_m: Baseline | None = Field(default=None, description="how far apart the two views are [m]; none: unknown")
    mode: DepthMode | None = Field(default=None, description="how the twin made depth; none: a real device's own way")
    time_offset_s: TimeOffset = 0.0

    @model_validator(mode="before")
    @classmethod
    def _depth_topic_of_the_picture(cls, content: Any) -> Any:
        if not isinstance(content, dict) or content.get("depth_topic") or not isinstance(content.get("topic"), str):
            return content
        if not content["topic"].endswith(_IMAGE):
            raise ValueError(
                f"depth_topic is missing and cannot be derived from topic {content['topic']!r}; "
                "the topic of the depth pictures is expected"
            )
        return content | {"depth_topic": content["topic"].removesuffix(_IMAGE) + _DEPTH}

    def eyes_m(self) -> list[NDArray[np.float64]]:
        """Return the places of the views in the room: the left one (3,), and the right one where the baseline is known [m]."""
        left, right_axis = self.room_from_sensor.translation, self.room_from_sensor.rotation[:, 0]
        return [left] if self.baseline_m is None else [left, left + self.baseline_m * right_axis]

    def points(self, depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Back-project a depth picture to points (height, width, 3) [m] in the room frame; NaN where it is 0."""
        return placed_camera(self).points(depth_m)


@lru_cache
def _centres(rows: int, columns: int, pitch_m: float, room_from_sensor: Hashable) -> NDArray[np.float64]:
    """Compute the centres of a floor's elements in the room, read-only as they are cached."""
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
    topic: Topic = Field(description="topic of its frames (Image, mono8, a pixel an element)")
    room_from_sensor: FloorPose = Field(
        default=Pose(),
        description="pose in the room of its grid: origin at the outer corner of element (0, 0), x along a row, z up",
    )
    rows: PositiveInt = Field(description="number of rows, which follow each other along the grid's y")
    columns: PositiveInt = Field(description="number of elements in a row, along the grid's x")
    pitch_m: Pitch = Field(description="side of an element [m]")
    curve: ForceCurve = Field(default=ForceCurve(), description="what an element reads under a load")
    time_offset_s: TimeOffset = 0.0

    @model_validator(mode="after")
    def _cells_are_few(self) -> FloorSensor:
        check_cells(self.rows, self.columns)
        return self

    def load_n(self, values: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Convert a frame's values (rows, columns) to the load on each element [N], by the force curve."""
        return self.curve.load_n(values)

    @property
    def centres(self) -> NDArray[np.float64]:
        """The elements' middles in the room, (rows, columns, 2) x, y [m]."""
        return _centres(self.rows, self.columns, self.pitch_m, cast("Hashable", self.room_from_sensor))

    @property
    def corners(self) -> NDArray[np.float64]:
        """The grid's corners in the room, counter-clockwise from the origin, (4, 2) [m]."""
        local = np.array([(0, 0), (self.columns, 0), (self.columns, self.rows), (0, self.rows)]) * self.pitch_m
        return local @ self.room_from_sensor.rotation[:2, :2].T + self.room_from_sensor.translation[:2]


class OdometrySensor(Strict):
    """The odometry of a moving base, on which other sensors of the rig are `mounted_on`.

    Its poses come from nav_msgs/Odometry, or from transforms (`/tf`), of which the two frames are named then.
    `room_from_sensor` is the pose in the room of the odometry frame; by default tracks leave in that frame itself.
    """

    kind: Literal["odometry"] = Field(default="odometry", description="the kind of sensor: odometry of a moving base")
    topic: Topic = Field(
        description="topic of its poses (Odometry), or of transforms (TFMessage) with both frames named"
    )
    frame: str | None = Field(
        default=None,
        min_length=1,
        description="with transforms: the frame that stands, like odom; none: as messages say",
    )
    base_frame: str | None = Field(
        default=None, min_length=1, description="with transforms: the frame that moves, like base_link"
    )
    room_from_sensor: Pose = Field(
        default=Pose(), description="pose in the room of its odometry frame; the origin: tracks leave in that frame"
    )
    time_offset_s: TimeOffset = 0.0

    @model_validator(mode="after")
    def _both_frames(self) -> OdometrySensor:
        if (self.frame is None) != (self.base_frame is None):
            raise ValueError("one of frame and base_frame is missing; both are expected with transforms, else none")
        if self.frame is not None and self.frame.strip("/") == (self.base_frame or "").strip("/"):
            raise ValueError(
                f"frame and base_frame are both {self.frame!r}; one that stands and one that moves are valid"
            )
        return self


CameraSensor = FisheyeSensor | PinholeSensor | StereoSensor
"""Whatever takes pictures."""


def placed_camera(sensor: CameraSensor) -> PlacedCamera:
    """Return the camera in the room; equal sensors share one, and its caches."""
    return _placed_camera(cast("Hashable", sensor))  # which pydantic makes of frozen models, unknown to type checkers


@lru_cache(maxsize=64)
def _placed_camera(sensor: Any) -> PlacedCamera:
    return PlacedCamera(sensor.intrinsics, sensor.room_from_sensor)


RigSensor = Annotated[
    LaserSensor | FisheyeSensor | PinholeSensor | StereoSensor | FloorSensor | OdometrySensor,
    Field(discriminator="kind"),
]
