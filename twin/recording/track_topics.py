"""Tracks in bags: the columns of `tracks/*.csv` as JSON, cylinders and ids as markers, and a recording's copy that holds them.

The copy is a ROS 2 bag, whatever the recording was, so that scans and tracks can be shown together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from trackers.errors import InputError
from trackers.presets import available
from trackers.tracks import TrackFrame
from twin.messages import OnWarning
from twin.recording.atomic_file import check_writable
from twin.recording.bags.bag_files import McapFile
from twin.recording.ros import topics
from twin.recording.ros.message_types import (
    TRANSFORM_MESSAGES,
    TYPESTORE,
    Header,
    Quaternion,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
    normal_type,
)
from twin.recording.ros.ros_messages import STRING, json_object, rows_message, string_message
from twin.recording.tables import TRACK_COLUMNS, FrameText, TruthTable, track_cells
from twin.recording.truth_messages import MARKER_ARRAY, MarkerStyle, PeopleMarkers, encode_people
from twin.recording.truth_tables import DETAIL_TOPICS, truth_frames
from twin.recording.writer import TF_MESSAGE, latched, transform_message

if TYPE_CHECKING:  # a run without a recording to read imports no reader: a tenth of its start
    from twin.recording.bags.bag import Bag
    from twin.recording.reader import Recording
    from twin.recording.rig_of_bag.transforms import Edge

_STYLE = MarkerStyle("tracks", "ids", width_m=0.3, opacity=0.8, id_prefix="#")  # within the truth's cylinders


def track_topics(trackers: Sequence[str]) -> dict[str, str]:
    """Name the topic of each tracker's tracks: `/tracks/laser_imm` (ROS allows letters, digits, underscores); markers below."""
    found: dict[str, str] = {}
    for name in trackers:
        topic = "/tracks/" + re.sub(r"\W|^(?=\d)", "_", name, flags=re.ASCII)
        while topic in found.values():
            topic += "_"
        found[name] = topic
    return found


def tracker_names(topics: Iterable[str]) -> dict[str, str]:
    """Return the tracker of each topic: the known one whose tracks go by it, as `laser-imm`; else the topic's last part."""
    known = {topic: name for name, topic in track_topics(list(available())).items()}
    return {topic: known.get(topic, topic.rpartition("/")[2]) for topic in topics}


def markers_topic(topic: str) -> str:
    """Return the topic of the markers of a topic of tracks."""
    return f"{topic}/markers"


def encode_tracks(frame: TrackFrame) -> memoryview:
    """Encode a `std_msgs/String` (CDR): a JSON list with one object per track, the table's columns, null where not estimated."""
    rows = []
    for track in frame.tracks:
        *numbers, status, radius95_m = track_cells(track)
        cells = [str(int(track.id)), *numbers, f'"{status}"', radius95_m]
        rows.append(json_object(TRACK_COLUMNS, frame.stamp_ns, cells))
    return rows_message(rows)


class TrackTopics:
    """Writes the tracks of several trackers into an open bag, each frame logged at its stamp."""

    def __init__(
        self,
        bag: McapFile,
        trackers: Sequence[str],
        start_ns: int = 0,
        logged_after_ns: int = 0,
        frame_ids: Mapping[str, str] | None = None,
    ) -> None:
        """Connect the topics; `start_ns` is added to stamps, for a clock that does not start at 0, and both to log times.

        frame_ids: of the markers, by tracker (default: the room).
        """
        self._bag = bag
        self._logged_after_ns = logged_after_ns
        self._start_ns = start_ns
        self._topics = track_topics(trackers)
        self._markers = {
            name: PeopleMarkers({}, _STYLE, (frame_ids or {}).get(name, topics.ROOM_FRAME)) for name in trackers
        }
        for topic in self._topics.values():
            bag.connect(topic, STRING)
            bag.connect(markers_topic(topic), MARKER_ARRAY)

    def write(self, tracker: str, frame: TrackFrame) -> None:
        """Write one frame of a tracker, for programs and for the eye."""
        stamp_ns, topic = frame.stamp_ns + self._start_ns, self._topics[tracker]
        log_time_ns = max(
            stamp_ns + self._logged_after_ns, 0
        )  # a clock that is behind the start; a log has no time before 0
        self._bag.write(topic, log_time_ns, encode_tracks(frame))
        coasting = frozenset(track.id for track in frame.tracks if track.status == "coasting")
        markers = self._markers[tracker].encode(stamp_ns, frame.tracks, coasting)
        self._bag.write(markers_topic(topic), log_time_ns, markers)


START = "/tracks/start"
"""JSON in a std_msgs/String: the stamp that is t = 0 of the tables."""
_RENAMED = {"tf/msg/tfMessage": TF_MESSAGE}
_TRUTH = (topics.TRUTH_PEOPLE, topics.TRUTH_MARKERS, topics.TRUTH_FEET, topics.TRUTH_BASES, *DETAIL_TOPICS)
_HEADER = "std_msgs/msg/Header"
_Convert = Callable[[bytes], bytes | memoryview]


def copy_with_tracks(
    recording: Recording,
    target: Path,
    trackers: Sequence[str],
    frames: Iterable[tuple[str, TrackFrame]],
    on_warning: OnWarning = lambda warning: None,
    add: Callable[[McapFile], object] = lambda bag: None,
    truth: TruthTable | None = None,
    frame_ids: Mapping[str, str] | None = None,
) -> None:
    """Copy a recording to `target` (a `.mcap`) with these frames by tracker's name, the truth, and what `add` writes.

    Messages of a ROS 2 bag are copied as they are, those of ROS 1 as ROS 2 encodes them, by the definitions in the bag. Log
    times go on where the recorder's clock was set back. A robot's bag gets the start stamp (`START`), and in `/tf_static` the
    transforms from the frame of the room to those of its sensors as the rig has them: one latched message with all of the bag's
    own, so that a late reader has them all, unless those change. Markers of tracks are in `frame_ids`, by tracker (default: the
    room). Tracks of the same trackers that the bag already holds are left out, and its own truth where `truth` takes its place.
    Raises InputError for a damaged bag and for a target that cannot be written.
    """
    from twin.recording.bags.bag import open_bag
    from twin.recording.sensor_clock import Unwound

    own = [each for topic in track_topics(trackers).values() for each in (topic, markers_topic(topic))]
    own += [START, *(_TRUTH if truth is not None else ())]
    with open_bag(recording.path) as original, McapFile(target) as bag:
        copies: dict[int, tuple[Connection, _Convert]] = {}
        lost = []
        placed = [] if recording.is_twin else _room_transforms(original, recording, target, on_warning)
        merged = _static_transforms(original) if placed else None
        own += [topics.TF_STATIC] if merged is not None else []
        for each in original.connections:
            if each.topic in own:
                continue
            if not original.is_ros1_encoded(each):
                copies[each.id] = bag.connect_as(each), bytes
            elif (store := _store_for(each)) is not None:
                copies[each.id] = _as_ros2(bag, each, store)
            else:
                lost.append(f"{each.topic} ({each.msgtype})")
        if lost:
            on_warning(f"--bag {target}: without {', '.join(lost)}, whose definitions in the bag cannot be used")
        tracks = TrackTopics(bag, trackers, recording.start_ns, recording.logged_after_ns, frame_ids)
        if not recording.is_twin:
            _write_start(bag, recording)
        if placed:
            if merged is None:
                on_warning(
                    f"--bag {target}: {topics.TF_STATIC} has two channels, its own and one for room, as its own "
                    "tells two poses of a frame, or cannot be read"
                )
            _write_static(bag, [*placed, *(merged or ())], recording)
        kept = [each for each in original.connections if each.id in copies]
        goes_on = Unwound()
        for connection, log_time_ns, data in original.raw_messages(kept, in_file_order=recording.is_as_written):
            copy, convert = copies[connection.id]
            log_ns = goes_on(connection.topic, log_time_ns) if recording.is_as_written else log_time_ns
            bag.write_on(copy, log_ns, convert(data))
        add(bag)
        if truth is not None:
            _write_truth(bag, truth, recording)
        for tracker, frame in frames:
            tracks.write(tracker, frame)


def _write_truth(bag: McapFile, truth: TruthTable, recording: Recording) -> None:
    """Write truth on the recording's clock, for programs and for the eye."""
    bag.connect(topics.TRUTH_PEOPLE, STRING)
    bag.connect(topics.TRUTH_MARKERS, MARKER_ARRAY)
    markers = PeopleMarkers(truth.labels)
    for frame in truth_frames(truth):
        stamp_ns = frame.stamp_ns + recording.start_ns
        log_ns = max(stamp_ns + recording.logged_after_ns, 0)
        bag.write(topics.TRUTH_PEOPLE, log_ns, encode_people(FrameText(frame)))
        bag.write(topics.TRUTH_MARKERS, log_ns, markers.encode(stamp_ns, frame.people))


def check_copy(source: Path, target: Path) -> None:
    """Raise InputError where tracks cannot be added to a copy of `source` under this name."""
    if target.suffix != ".mcap":
        raise InputError(f"--bag {target}: is not the name of a recording; a name ending in .mcap is expected")
    if target.exists() and (not target.is_file() or target.resolve() == source.resolve()):
        raise InputError(f"--bag {target}: is the recording itself or a folder; the name of another file is expected")
    if target.exists() and not _is_copy(target):
        raise InputError(
            f"--bag {target}: is there already, and no copy with tracks; the name of a new file is expected"
        )
    check_writable(target)


def _is_copy(path: Path) -> bool:
    """Return True for a bag with topics of tracks, as an earlier run leaves it."""
    from twin.recording.bags.bag import open_bag

    try:
        with open_bag(path) as bag:
            return any(name.startswith("/tracks/") for name in bag.topics)
    except InputError:
        return False


def _store_for(connection: Connection) -> Typestore | None:
    """Return the types of a ROS 1 connection's messages, with ROS 2's header; None where neither it nor ROS 1 defines them."""
    msgtype, store = normal_type(connection.msgtype), get_typestore(Stores.EMPTY)
    header = {_HEADER: TYPESTORE.fielddefs[_HEADER]}
    try:
        types = get_types_from_msg(connection.msgdef.data, msgtype)
        store.register({**types, **header})
        store.generate_msgdef(msgtype, ros_version=2)
    except (TypesysError, KeyError, ValueError):
        known = get_typestore(Stores.ROS1_NOETIC).fielddefs
        if msgtype not in known:
            return None
        store = get_typestore(Stores.EMPTY)
        store.register({**known, **header})
    return store


def _as_ros2(bag: McapFile, connection: Connection, store: Typestore) -> tuple[Connection, _Convert]:
    msgtype = normal_type(connection.msgtype)
    definition, _ = store.generate_msgdef(msgtype, ros_version=2)
    copy = bag.connect_text(connection.topic, _RENAMED.get(msgtype, msgtype), definition, store.hash_rihs01(msgtype))
    return copy, lambda data: store.ros1_to_cdr(data, msgtype)


def _write_start(bag: McapFile, recording: Recording) -> None:
    """Write the stamp of t = 0."""
    bag.connect(START, STRING, latched(depth=1))
    start = {"start_stamp_ns": recording.start_ns}
    bag.write(START, max(recording.start_ns + recording.logged_after_ns, 0), string_message(start))


def _write_static(bag: McapFile, transforms: Sequence[TransformStamped], recording: Recording) -> None:
    """Write transforms that stand as one message, for readers that come late."""
    bag.connect(topics.TF_STATIC, TF_MESSAGE, latched(depth=1))
    log_ns = max(recording.start_ns + recording.logged_after_ns, 0)
    bag.write(topics.TF_STATIC, log_ns, TYPESTORE.serialize_cdr(TFMessage([*transforms]), TF_MESSAGE))


def _static_transforms(original: Bag) -> list[TransformStamped] | None:
    """Return the transforms of a bag that stand, each once; None where a frame has two poses, or a message cannot be read."""
    if topics.TF_STATIC not in original.topics:
        return []
    kind = original.topics[topics.TF_STATIC].type_among(TRANSFORM_MESSAGES)
    kinds = {normal_type(each.msgtype) for each in original.connections if each.topic == topics.TF_STATIC}
    if kind is None or len(kinds) > 1:
        return None
    from twin.recording.bags.bag import decoded

    held: dict[str, tuple[str, tuple[float, ...], TransformStamped]] = {}
    for _, _, data, is_ros1 in original.encoded_messages({topics.TF_STATIC: kind}):
        try:
            message = decoded(data, kind, is_ros1)
        except InputError:
            return None
        for each in message.transforms:
            moved, turned = each.transform.translation, each.transform.rotation
            pose = moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w
            stamp, parent, child = each.header.stamp, each.header.frame_id, each.child_frame_id
            whole = TransformStamped(
                Header(Time(stamp.sec, stamp.nanosec), parent),
                child,
                Transform(Vector3(*pose[:3]), Quaternion(*pose[3:])),
            )
            if held.setdefault(child.strip("/"), (parent.strip("/"), pose, whole))[:2] != (parent.strip("/"), pose):
                return None
    return [whole for *_, whole in held.values()]


def _room_transforms(
    original: Bag, recording: Recording, target: Path, on_warning: OnWarning
) -> list[TransformStamped]:
    """Return the transforms from the room to the roots of the sensors' frames; warn where a frame of tracks moves in its root."""
    from twin.recording.rig_of_bag.transforms import TransformTree

    tree = TransformTree.read(original)
    mounted = recording.rig.mounted()
    roots: dict[str, np.ndarray] = {}
    for name, frames in recording.frames.items():
        for frame in frames if name not in mounted else ():
            root, sensor_from_root, passed = _to_root(frame.strip("/"), tree.edges)
            if frame and root != topics.ROOM_FRAME and root not in roots:
                roots[root] = recording.rig.sensors[name].room_from_sensor.matrix @ sensor_from_root
                drifts = ", and ".join(_drift(edge) for edge in passed if edge.moves)
                if drifts:
                    is_base = name in recording.rig.odometry()
                    remedy = f"; `frame: {root}` of {name} in rig.yaml has tracks in {root}" if is_base else ""
                    on_warning(f"--bag {target}: {drifts}; room is placed in {root} by the first{remedy}")
    return [transform_message(root, room_from_root) for root, room_from_root in roots.items()]


def _drift(edge: Edge) -> str:
    """Say how far a frame moves in its parent, from its first pose on."""
    steps = np.linalg.inv(edge.parent_from_child[0]) @ edge.parent_from_child
    way_m = np.linalg.norm(steps[:, :3, 3], axis=1).max()
    turn_deg = np.degrees(np.abs(np.arctan2(steps[:, 1, 0], steps[:, 0, 0]))).max()
    return f"{edge.child} moves in {edge.parent} by up to {way_m:.2f} m and {turn_deg:.1f}°"


def _to_root(frame: str, edges: Mapping[str, Edge]) -> tuple[str, np.ndarray, list[Edge]]:
    """Return the root frame above this one, the first transform (4, 4) of its points to this one, and the edges between."""
    root, frame_from_root, passed = frame, np.eye(4), []
    while root in edges and edges[root].parent not in {frame, *(edge.child for edge in passed)}:
        passed.append(edges[root])
        frame_from_root = frame_from_root @ np.linalg.inv(passed[-1].parent_from_child[0])
        root = passed[-1].parent
    return root, frame_from_root, passed
