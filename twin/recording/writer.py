"""Write a run as a ROS 2 bag: one MCAP file that appears when it is complete."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from trackers.area import quaternion_of
from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics
from trackers.observations import NS_PER_S, Observation, Odometry
from trackers.rig import CameraSensor, OdometrySensor, Rig, RigSensor, StereoSensor
from twin.recording.bags.bag_files import McapFile
from twin.recording.ros import topics
from twin.recording.ros.message_types import (
    TYPESTORE,
    CameraInfo,
    Header,
    Quaternion,
    RegionOfInterest,
    String,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)
from twin.recording.ros.ros_messages import COMPRESSED_IMAGE, MSGTYPES, STRING, Encoded, time_message
from twin.recording.tables import FrameText
from twin.recording.truth_messages import MARKER_ARRAY, PeopleMarkers, encode_outline, encode_people
from twin.recording.truth_tables import DETAIL_TOPICS, encode_detail, encode_feet
from twin.truth.truth_types import TruthDetail

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"

_FOREVER = QosTime(9223372036, 854775807)  # ROS's RMW_DURATION_INFINITE


class BagWriter(McapFile):
    """Writer of observations, backgrounds and truth to `path` (a `.mcap`) as they come; a context manager.

    Memory holds one chunk (1 MiB) and an index entry per chunk and message type.

    Content for the whole bag (the rig, the scenario, `/tf_static`, the backgrounds) is logged at time 0, an observation on
    arrival, truth at its stamp. All methods raise InputError where the disk is full or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        rig: Rig,
        *,
        scenario_yaml: str | None = None,
        names: Mapping[int, str] | None = None,
        outline: Sequence[NDArray[np.float64]] = (),
        positions_only: bool = False,
    ) -> None:
        """Prepare the bag; `scenario_yaml` is the resolved scenario's text, `names`, by id, label the people's markers.

        `outline`: the room's plan, convex outlines (k, 2) [m]. `positions_only`: no topics for feet, markers and details.

        Messages are written with their own stamps: a reader adds the rig's time offsets. Raises ValueError for a path without
        `.mcap`.
        """
        super().__init__(path)
        self._rig = rig
        self._scenario_yaml = scenario_yaml
        self._markers = PeopleMarkers(names or {})
        self._outline = outline
        self._positions_only = positions_only
        self._camera_infos = {
            name: bytearray(TYPESTORE.serialize_cdr(_camera_info(name, camera.intrinsics), CAMERA_INFO))
            for name, camera in rig.cameras().items()
        }
        self._last_arrival_ns = 0

    def __enter__(self) -> Self:
        super().__enter__()
        try:
            self._write_head()
        except BaseException:
            self.discard()
            raise
        return self

    def observation(self, encoded: Encoded, arrival_ns: int) -> None:
        """Write an observation that arrives (stamp and delay) at this time [ns] since the start.

        Raises ValueError where it arrives before the last one: a replay goes in order of arrival and would differ.
        """
        if arrival_ns < self._last_arrival_ns:
            raise ValueError(
                f"observation of {encoded.observation.sensor!r} arrives at {arrival_ns} ns, "
                f"after one that arrived at {self._last_arrival_ns} ns; order of arrival is needed"
            )
        self._last_arrival_ns = arrival_ns
        sensor = encoded.observation.sensor
        if sensor in self._camera_infos:
            # image_proc and Foxglove pair an image with the camera_info of its stamp.
            self.write(
                topics.sensor_topic(sensor, topics.CAMERA_INFO), arrival_ns, self._camera_info_at(encoded.observation)
            )
        self.write(self._rig.sensors[sensor].topic, arrival_ns, encoded.data)
        if isinstance(encoded.observation, Odometry):
            self.write(topics.TF, arrival_ns, _moved(encoded.observation))
        for part in encoded.more:
            self.write(self._topic(sensor, part.topic_suffix), arrival_ns, part.data)

    def background(self, encoded: Encoded) -> None:
        """Write an observation of the empty room."""
        for part in (encoded, *encoded.more):
            self.write(topics.background_topic(encoded.observation.sensor, part.topic_suffix), 0, part.data)

    def truth(self, text: FrameText) -> None:
        """Write the truth at a stamp, for programs and for the eye."""
        frame = text.frame
        self.write(topics.TRUTH_PEOPLE, frame.stamp_ns, encode_people(text))
        if self._positions_only:
            return
        self.write(topics.TRUTH_FEET, frame.stamp_ns, encode_feet(text))
        self.write(topics.TRUTH_MARKERS, frame.stamp_ns, self._markers.encode(frame.stamp_ns, frame.people))

    def detail(self, detail: TruthDetail) -> None:
        """Write the truth of an image, a scan, the bases or a situation."""
        self.write(*encode_detail(detail))

    def _write_head(self) -> None:
        held = ((topics.RIG, STRING), (topics.SCENARIO, STRING), (topics.TF_STATIC, TF_MESSAGE))
        for topic, msgtype in held:
            self.connect(topic, msgtype, latched(depth=1))
        for name, sensor in self._rig.sensors.items():
            msgtype = MSGTYPES[sensor.kind][0]
            self.connect(sensor.topic, msgtype)
            if isinstance(sensor, OdometrySensor):
                self.connect(topics.TF, TF_MESSAGE)
                continue
            background = topics.background_topic(name, topics.SUFFIXES[sensor.kind])
            self.connect(background, msgtype, latched(depth=1000))
            if isinstance(sensor, StereoSensor):
                self.connect(sensor.depth_topic, COMPRESSED_IMAGE)
                self.connect(topics.background_topic(name, topics.DEPTH), COMPRESSED_IMAGE, latched(depth=1000))
            if isinstance(sensor, CameraSensor):
                self.connect(topics.sensor_topic(name, topics.CAMERA_INFO), CAMERA_INFO)
        self.connect(topics.TRUTH_PEOPLE, STRING)
        if not self._positions_only:
            self.connect(topics.TRUTH_FEET, STRING)
            self.connect(topics.TRUTH_MARKERS, MARKER_ARRAY)
            for topic in (*DETAIL_TOPICS, *[topics.TRUTH_BASES] * bool(self._rig.odometry())):
                self.connect(topic, STRING)
        self.write(topics.RIG, 0, TYPESTORE.serialize_cdr(String(self._rig.dump_yaml()), STRING))
        if self._scenario_yaml is not None:
            self.write(topics.SCENARIO, 0, TYPESTORE.serialize_cdr(String(self._scenario_yaml), STRING))
        transforms = [_hung(name, sensor) for name, sensor in self._rig.sensors.items()]
        self.write(topics.TF_STATIC, 0, TYPESTORE.serialize_cdr(TFMessage(transforms), TF_MESSAGE))
        write_outline(self, self._outline)

    def _topic(self, sensor: str, suffix: str) -> str:
        """Return the topic of a further message of an observation."""
        on_rig = self._rig.sensors[sensor]
        is_depth = isinstance(on_rig, StereoSensor) and suffix == topics.DEPTH
        return on_rig.depth_topic if is_depth else topics.sensor_topic(sensor, suffix)

    def _camera_info_at(self, observation: Observation) -> bytes:
        message = self._camera_infos[observation.sensor]
        # The header comes first in the message, and its stamp first in the header, after CDR's four bytes.
        struct.pack_into("<iI", message, 4, *divmod(observation.stamp_ns, NS_PER_S))
        return bytes(message)


def write_outline(bag: McapFile, outline: Sequence[NDArray[np.float64]]) -> None:
    """Write the room's plan, convex outlines (k, 2) [m], as markers that late viewers get too; nothing for an empty plan."""
    if len(outline):
        bag.connect(topics.ROOM_MARKERS, MARKER_ARRAY, latched(depth=1))
        bag.write(topics.ROOM_MARKERS, 0, encode_outline(outline))


def latched(depth: int) -> tuple[Qos, ...]:
    """Return the quality of service under which a late subscriber still gets the last `depth` messages."""
    return (
        Qos(
            QosHistory.KEEP_LAST,
            depth,
            QosReliability.RELIABLE,
            QosDurability.TRANSIENT_LOCAL,
            _FOREVER,
            _FOREVER,
            QosLiveliness.AUTOMATIC,
            _FOREVER,
            False,
        ),
    )


def _hung(name: str, sensor: RigSensor) -> TransformStamped:
    """Return the pose of a sensor in the room or on its base; of odometry, that of its frame in the room."""
    child = topics.odometry_frame(name) if isinstance(sensor, OdometrySensor) else name
    return transform_message(child, sensor.room_from_sensor.matrix, parent=getattr(sensor, "mounted_on", None))


def _moved(odometry: Odometry) -> memoryview:
    """Encode the pose of a base in its odometry frame as a transform for `/tf`."""
    base = odometry.sensor
    transform = transform_message(
        base, odometry.frame_from_base, parent=topics.odometry_frame(base), stamp_ns=odometry.stamp_ns
    )
    return TYPESTORE.serialize_cdr(TFMessage([transform]), TF_MESSAGE)


def transform_message(
    child: str, parent_from_child: NDArray[np.float64], *, parent: str | None = None, stamp_ns: int = 0
) -> TransformStamped:
    """Return a frame's pose (4, 4) in its parent's, by default the room's, as a transform for `/tf` or `/tf_static`."""
    place = (float(each) for each in parent_from_child[:3, 3])
    return TransformStamped(
        header=Header(time_message(stamp_ns), topics.ROOM_FRAME if parent is None else parent),
        child_frame_id=child,
        transform=Transform(Vector3(*place), Quaternion(*quaternion_of(parent_from_child[:3, :3]))),
    )


def _camera_info(sensor: str, lens: FisheyeIntrinsics | PinholeIntrinsics) -> CameraInfo:
    camera_matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    is_pinhole = isinstance(lens, PinholeIntrinsics)
    return CameraInfo(
        header=Header(time_message(0), sensor),
        height=lens.height,
        width=lens.width,
        distortion_model="plumb_bob" if is_pinhole else "equidistant",
        d=np.array(lens.distortion if is_pinhole else lens.k),
        k=camera_matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([camera_matrix, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=RegionOfInterest(0, 0, 0, 0, False),
    )
