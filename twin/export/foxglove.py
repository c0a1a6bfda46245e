"""Foxglove: a copy of the bag with scans as PointCloud2, the tracks, the room's outline, and a layout for them.

The copy holds the whole recording; `/NAME/points` is added for each scanner, in its frame, which `/tf_static` places in the
room. Points are x, y, z, three floats each. A point cloud is three times as large as its scan, so recordings themselves have
none.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trackers.observations import LaserScan
from trackers.tracks import Track, TrackFrame
from twin.export.pictures import TRACK_NUMBERS, Recorded
from twin.recording.bags.bag import open_bag
from twin.recording.bags.bag_files import McapFile
from twin.recording.reader import Recording
from twin.recording.ros import topics
from twin.recording.ros.message_types import TYPESTORE, Header, PointCloud2, PointField
from twin.recording.ros.ros_messages import time_message
from twin.recording.tables import TrackTable
from twin.recording.track_topics import copy_with_tracks, markers_topic, track_topics
from twin.recording.writer import write_outline
from twin.run.replay import plan_of

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_POINTS = "points"
_FIELDS = [PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate("xyz")]


def export_foxglove(recordings: Sequence[Recorded], out: Path) -> None:
    """Write `SEQUENCE.mcap` and `SEQUENCE.layout.json` per recording."""
    for recorded in recordings:
        names = list(recorded.tracks)
        frames = ((name, frame) for name, table in recorded.tracks.items() for frame in _track_frames(table))

        def add(bag: McapFile, recorded: Recorded = recorded) -> None:
            _add_points(bag, recorded.recording)
            if topics.ROOM_MARKERS not in recorded.recording.topics:
                write_outline(bag, plan_of(recorded.scenario)[0])

        target, own = out / f"{recorded.name}.mcap", recorded.own_truth
        copy_with_tracks(recorded.recording, target, names, frames, recorded.on_warning, add=add, truth=own)
        with open_bag(target) as copy:
            layout = json.dumps(foxglove_layout(recorded.recording, names, copy.topics), indent=2)
        (out / f"{recorded.name}.layout.json").write_text(layout + "\n", encoding="utf-8")


def _track_frames(table: TrackTable) -> Iterator[TrackFrame]:
    for stamp_ns, rows in table.frames():
        tracks = [
            Track(
                int(table.id[row]),
                **dict[str, Any]({name: float(getattr(table, name)[row]) for name in TRACK_NUMBERS}),
                status="coasting" if table.status[row] == "coasting" else "confirmed",
            )
            for row in rows
        ]
        yield TrackFrame(stamp_ns, tuple(tracks))


def _add_points(bag: McapFile, recording: Recording) -> None:
    lasers = recording.rig.lasers().keys() & set(recording.sensor_topics.sensors.values())
    frame_of = {name: next(iter(sorted(recording.frames.get(name, ()))), name) or name for name in lasers}
    for name in recording.rig.lasers():
        if name in lasers:
            bag.connect(topics.sensor_topic(name, _POINTS), POINT_CLOUD)
    for scan in recording.observations(only=lasers) if lasers else ():
        if isinstance(scan, LaserScan):
            stamp_ns = max(scan.stamp_ns + recording.start_ns, 0)
            log_ns = max(stamp_ns + recording.logged_after_ns, 0)
            bag.write(
                topics.sensor_topic(scan.sensor, _POINTS), log_ns, point_cloud(scan, frame_of[scan.sensor], stamp_ns)
            )


def point_cloud(scan: LaserScan, frame: str, stamp_ns: int) -> memoryview:
    """Encode a scan's returns as a PointCloud2 (CDR) in the scanner's frame."""
    points = scan.points.astype("<f4")
    message = PointCloud2(
        header=Header(time_message(stamp_ns), frame),
        height=1,
        width=len(points),
        fields=_FIELDS,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=np.frombuffer(points.tobytes(), dtype=np.uint8),
        is_dense=True,
    )
    return TYPESTORE.serialize_cdr(message, POINT_CLOUD)


def foxglove_layout(recording: Recording, trackers: Sequence[str], held: Collection[str]) -> dict[str, Any]:
    """Return a layout: the room in 3D with what the copy holds (`held`): points, truth, tracks, outline; and each camera."""
    shown: dict[str, Any] = {
        topics.sensor_topic(name, _POINTS): _points_style(n) for n, name in enumerate(recording.rig.lasers())
    }
    markers = [
        topics.ROOM_MARKERS,
        topics.TRUTH_MARKERS,
        *(markers_topic(each) for each in track_topics(trackers).values()),
    ]
    shown |= {topic: {"visible": True} for topic in markers}
    shown = {topic: style for topic, style in shown.items() if topic in held}
    room = {
        "cameraState": {
            "distance": 12, "perspective": True, "phi": 45, "thetaOffset": 45, "fovy": 45, "near": 0.5, "far": 5000,
            "targetOffset": [0, 0, 0], "target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1],
        },
        "followMode": "follow-none", "followTf": topics.ROOM_FRAME, "scene": {"backgroundColor": "#1c1c22"},
        "transforms": {}, "topics": shown, "publish": {}, "imageMode": {},
        "layers": {"grid": {"layerId": "foxglove.Grid", "instanceId": "grid", "visible": True, "size": 20, "divisions": 20,
                            "lineWidth": 1, "color": "#55555588", "frameId": topics.ROOM_FRAME}},
    }  # fmt: skip
    panels, places = {"3D!room": room}, []
    found = recording.sensor_topics
    for topic, name in {**found.sensors, **found.depths}.items():
        if name in recording.rig.cameras():
            panel = f"Image!{topic.strip('/').replace('/', '-')}"
            image = {"imageTopic": topic, "calibrationTopic": topics.sensor_topic(name, topics.CAMERA_INFO)}
            panels[panel] = {
                "imageMode": image,
                "topics": {},
                "layers": {},
                "transforms": {},
                "publish": {},
                "scene": {},
            }
            places.append(panel)
    column: Any = places[-1] if places else None
    for left, panel in enumerate(reversed(places[:-1]), start=1):
        column = {"direction": "column", "first": panel, "second": column, "splitPercentage": 100 / (left + 1)}
    layout = (
        "3D!room"
        if column is None
        else {"direction": "row", "first": "3D!room", "second": column, "splitPercentage": 65}
    )
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": layout,
    }


def _points_style(number: int) -> dict[str, Any]:
    colours = ("#e65a3cff", "#f0b428ff", "#3cb4dcff", "#a06edcff")
    return {"visible": True, "colorMode": "flat", "flatColor": colours[number % len(colours)], "pointSize": 4}
