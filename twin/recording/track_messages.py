"""Tracks as messages: the columns of `tracks/*.csv` as JSON for programs, cylinders and ids for the eye."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from rosbags.typesys.stores.ros2_humble import std_msgs__msg__String as String

from trackers.observations import NS_PER_S
from trackers.tracks import TrackFrame
from twin.recording.mcap_file import McapFile
from twin.recording.messages import STRING, TYPESTORE
from twin.recording.tables import plain, track_row
from twin.recording.truth_messages import MARKER_ARRAY, MarkerStyle, PeopleMarkers

_STYLE = MarkerStyle("tracks", "ids", width_m=0.3, opacity=0.8, id_prefix="#")  # within the truth's cylinders


def track_topics(trackers: Sequence[str]) -> dict[str, str]:
    """The topic of each tracker's tracks: `/tracks/laser_imm` (ROS allows letters, digits and underscores); markers below."""
    found: dict[str, str] = {}
    for name in trackers:
        topic = "/tracks/" + re.sub(r"\W|^(?=\d)", "_", name, flags=re.ASCII)
        while topic in found.values():
            topic += "_"
        found[name] = topic
    return found


def markers_topic(topic: str) -> str:
    """Where the markers of a topic of tracks go."""
    return f"{topic}/markers"


def encode_tracks(frame: TrackFrame) -> memoryview:
    """A `std_msgs/String` (CDR) with a JSON list: one object a track, the columns of the table, null where not estimated."""
    t = frame.stamp_ns / NS_PER_S
    rows = [{"t": t} | plain(track_row(track)) for track in frame.tracks]
    return TYPESTORE.serialize_cdr(String(json.dumps(rows, allow_nan=False)), STRING)


class TrackTopics:
    """Writes the tracks of several trackers into an open bag, each frame logged at its stamp."""

    def __init__(self, bag: McapFile, trackers: Sequence[str], start_ns: int = 0, logged_after_ns: int = 0) -> None:
        """`start_ns` is added to stamps, for a bag whose clock does not start at 0, and both to log times."""
        self._bag = bag
        self._logged_after_ns = logged_after_ns
        self._start_ns = start_ns
        self._topics = track_topics(trackers)
        self._markers = {name: PeopleMarkers({}, _STYLE) for name in trackers}
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
