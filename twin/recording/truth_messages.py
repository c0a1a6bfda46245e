"""Truth as messages: the columns of `truth.csv` as JSON for programs, cylinders and names for the eye."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.tracks import Track
from twin.recording.ros.message_types import (
    TYPESTORE,
    ColorRGBA as Color,
    CompressedImage,
    Duration,
    Header,
    Marker,
    MarkerArray,
    MeshFile,
    Point,
    Pose as PoseMessage,
    Quaternion,
    Vector3,
)
from twin.recording.ros.ros_messages import json_object, rows_message, time_message
from twin.recording.ros.topics import ROOM_FRAME
from twin.recording.tables import TRUTH_COLUMNS, TRUTH_NUMBERS, FrameText, person_columns, person_of
from twin.tables.columns import MAX_INT64
from twin.truth.truth_types import PersonTruth, TruthFrame

MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"

_HEAD_TOP_M = 0.12  # from the centre of the head to its top
_UNKNOWN_HEIGHT_M = 1.7  # drawn without a known head
_NAME_ABOVE_M = 0.15
_N = len(TRUTH_NUMBERS)
_SLOTS = 7  # a person: middle of the cylinder x, y, z and its height; the name's x, y, z
_COLORS = ((0.12, 0.47, 0.71), (1.0, 0.5, 0.05), (0.17, 0.63, 0.17), (0.84, 0.15, 0.16), (0.58, 0.4, 0.74))


@dataclass(frozen=True)
class MarkerStyle:
    """Style of people's markers: namespaces of cylinders and labels, the cylinder's width [m], the prefix of an id."""

    bodies: str
    labels: str
    width_m: float
    opacity: float
    id_prefix: str = ""


TRUTH_STYLE = MarkerStyle("people", "names", width_m=0.45, opacity=0.4)


def encode_people(text: FrameText) -> memoryview:
    """Encode a `std_msgs/String` (CDR): a JSON list with one object per person, the columns of truth.csv, null where unknown."""
    people, rows = text.frame.people, []
    for person, cells in zip(people, text.people, strict=True):
        row = [str(int(person.id)), *cells[:_N], str(int(person.in_area)), *cells[_N:]]
        rows.append(json_object(person_columns(person.visible), text.frame.stamp_ns, row))
    return rows_message(rows)


def decode_people(text: str, stamp_ns: int) -> TruthFrame:
    """Decode the truth in such a string; raises InputError for another text."""
    try:
        people = tuple(person_of(row) for row in json.loads(text))
        ids = [person.id for person in people]
        if len(set(ids)) < len(ids) or not all(1 <= each <= MAX_INT64 for each in ids):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        columns = ",".join(TRUTH_COLUMNS)
        raise InputError(
            f"holds {text[:60]!r}; a JSON list of objects with {columns}, each id once, is expected"
        ) from error
    return TruthFrame(stamp_ns, people)


_MOST_MARKERS = 2**31 - 1
"""Greatest number of a marker, an int32; larger ids may collide."""


_MOST_LAYOUTS = 64


class _Layout(NamedTuple):
    """A serialized message with marks where numbers go: those of stamps in 4-byte words, of positions in 8-byte ones."""

    message: bytes
    doubles_at: NDArray[np.intp]
    seconds_at: NDArray[np.intp]


class PeopleMarkers:
    """Encoder of truth, or tracks, as a `visualization_msgs/MarkerArray`: a cylinder and a name per person, in a frame.

    Serializing ten markers field by field costs more than a laser scan. Only stamps, positions and heights change between
    frames, so the message is serialized once for the same people, drawn alike, and those numbers are written into it.
    """

    def __init__(self, names: Mapping[int, str], style: MarkerStyle = TRUTH_STYLE, frame_id: str = ROOM_FRAME) -> None:
        self._names = names
        self._frame_id = frame_id
        self._style = style
        self._shown: tuple[int, ...] = ()
        self._layouts: dict[tuple[tuple[int, ...], frozenset[int]], _Layout] = {}

    def encode(self, stamp_ns: int, people: Sequence[PersonTruth | Track], faint: Collection[int] = ()) -> bytes:
        """Encode the markers (CDR) at a stamp; people drawn before and not among these are deleted.

        `faint`: the ids to draw with half the opacity.
        """
        ids, faint = tuple(person.id for person in people), frozenset(faint)
        left = [id_ for id_ in self._shown if id_ not in ids]
        self._shown = ids
        layout = None if left else self._layouts.get((ids, faint))
        if layout is None:
            layout = self._layout(ids, faint, left)
        if not left:  # a frame that deletes is of no use again
            if len(self._layouts) >= _MOST_LAYOUTS:
                self._layouts.clear()
            self._layouts[ids, faint] = layout
        buffer = np.frombuffer(bytearray(layout.message), dtype=np.uint8)
        words, doubles = _words_and_doubles(buffer)
        doubles[layout.doubles_at] = [value for person in people for value in self._place(person)]
        words[layout.seconds_at], words[layout.seconds_at + 1] = divmod(stamp_ns, NS_PER_S)
        return buffer.tobytes()

    @staticmethod
    def _place(person: PersonTruth | Track) -> tuple[float, ...]:
        unknown = isnan(person.head_z)
        height = _UNKNOWN_HEIGHT_M if unknown else person.head_z + _HEAD_TOP_M
        name_x, name_y = (person.x, person.y) if unknown else (person.head_x, person.head_y)
        return person.x, person.y, height / 2, height, name_x, name_y, height + _NAME_ABOVE_M

    def _layout(self, ids: tuple[int, ...], faint: frozenset[int], left: list[int]) -> _Layout:
        """Serialize the message with marks where numbers go, and note their positions."""
        markers = []
        for id_ in ids:
            markers += [self._cylinder(id_, id_ in faint), self._name(id_)]
        for id_ in left:
            markers += [_marker(self._style.bodies, id_, Marker.CYLINDER, action=Marker.DELETE)]
            markers += [_marker(self._style.labels, id_, Marker.TEXT_VIEW_FACING, action=Marker.DELETE)]
        for each in markers:
            each.header.frame_id = self._frame_id
        message = bytes(TYPESTORE.serialize_cdr(MarkerArray(markers), MARKER_ARRAY, little_endian=True))
        words, doubles = _words_and_doubles(np.frombuffer(message, dtype=np.uint8))
        layout = _Layout(message, np.flatnonzero(doubles == _MARK), np.flatnonzero(words == _STAMP_MARK_S))
        if layout.doubles_at.size != len(ids) * _SLOTS or layout.seconds_at.size != len(markers):
            raise RuntimeError("the places of stamps and positions in a MarkerArray were not found")
        return layout

    def _cylinder(self, id_: int, is_faint: bool) -> Marker:
        style = self._style
        color = Color(*_COLORS[id_ % len(_COLORS)], style.opacity / (2 if is_faint else 1))
        return _marker(style.bodies, id_, Marker.CYLINDER, Vector3(style.width_m, style.width_m, _MARK), color)

    def _name(self, id_: int) -> Marker:
        text = self._names.get(id_, f"{self._style.id_prefix}{id_}")
        # Of a text's scale only z, the height of its letters, has an effect.
        return _marker(
            self._style.labels, id_, Marker.TEXT_VIEW_FACING, Vector3(0.0, 0.0, 0.2), Color(1.0, 1.0, 1.0, 1.0), text
        )


def encode_outline(outlines: Sequence[NDArray[np.float64]]) -> memoryview:
    """Encode the room's plan, convex outlines (k, 2) [m], as a MarkerArray (CDR): their edges on the floor, at stamp 0."""
    edges = [
        (a, b) for each in outlines for a, b in zip(each.tolist(), np.roll(each, -1, axis=0).tolist(), strict=True)
    ]
    marker = replace(
        _marker("room", 1, Marker.LINE_LIST, Vector3(0.03, 0.0, 0.0), Color(0.7, 0.7, 0.7, 1.0)),
        header=Header(time_message(0), ROOM_FRAME),
        pose=PoseMessage(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)),
        points=[Point(x, y, 0.0) for edge in edges for x, y in edge],
    )
    return TYPESTORE.serialize_cdr(MarkerArray([marker]), MARKER_ARRAY)  # pyright: ignore[reportArgumentType]


# Values that no position, size, colour or string of ours can hold.
_STAMP_MARK_S = 0x5EC0DE01
_MARK = 1.2345678e200


def _words_and_doubles(message: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """View a message as aligned 4-byte integers and 8-byte floats; CDR aligns to the end of its four-byte head."""
    payload = message[4:]
    return payload[: payload.size // 4 * 4].view("<i4"), payload[: payload.size // 8 * 8].view("<f8")


def _marker(
    namespace: str,
    id_: int,
    kind: int,
    scale: Vector3 | None = None,
    color: Color | None = None,
    text: str = "",
    action: int = Marker.ADD,
) -> Marker:
    place = _MARK if action == Marker.ADD else 0.0
    nothing: NDArray[np.uint8] = np.zeros(0, dtype=np.uint8)
    return Marker(
        header=Header(time_message(_STAMP_MARK_S * NS_PER_S), ROOM_FRAME),
        ns=namespace,
        id=(id_ - 1) % _MOST_MARKERS + 1,
        type=kind,
        action=action,
        pose=PoseMessage(Point(place, place, place), Quaternion(0.0, 0.0, 0.0, 1.0)),
        scale=scale or Vector3(0.0, 0.0, 0.0),
        color=color or Color(0.0, 0.0, 0.0, 0.0),
        lifetime=Duration(0, 0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=CompressedImage(Header(time_message(0), ""), "", nothing),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=MeshFile("", nothing),
        mesh_use_embedded_materials=False,
    )
