"""Truth in a bag: the tables' columns for programs, markers for the eye."""

from __future__ import annotations

import json
from math import isnan, nan

import pytest
from recorded import a_truth

from trackers.errors import InputError
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import STRING
from twin.recording.tables import FrameText
from twin.recording.truth_messages import MARKER_ARRAY, PeopleMarkers, decode_people, encode_people
from twin.truth.truth_types import PersonTruth, TruthFrame


def text_of(frame: TruthFrame) -> str:
    return TYPESTORE.deserialize_cdr(encode_people(FrameText(frame)), STRING).data


def test_truth_survives_to_the_bit():
    frame = a_truth(123_456_789_012)
    assert decode_people(text_of(frame), frame.stamp_ns) == frame
    assert decode_people(text_of(TruthFrame(5, ())), 5) == TruthFrame(5, ())


def test_the_columns_are_those_of_the_table():
    columns = "t,id,x,y,z,yaw,head_x,head_y,head_z,head_yaw,vx,vy,in_area,visible_waist"
    rows = json.loads(text_of(a_truth(1_500_000_000)))
    assert [",".join(row) for row in rows] == [columns, columns]
    assert [row["t"] for row in rows] == [1.5, 1.5]
    assert [row["in_area"] for row in rows] == [1, 0]


def test_unknown_is_null():
    text = text_of(TruthFrame(0, (PersonTruth(1, 0.0, 1.0, visible={"waist": nan}),)))
    row = json.loads(text)[0]
    assert row["head_x"] is None
    assert row["visible_waist"] is None
    assert isnan(decode_people(text, 0).people[0].visible["waist"])


@pytest.mark.parametrize("text", ["", "{}x", "[1]", '[{"id": 1}]', "3"])
def test_other_strings_are_refused(text):
    with pytest.raises(InputError, match="a JSON list of objects with t,id,x"):
        decode_people(text, 0)


def drawn(markers: PeopleMarkers, frame: TruthFrame) -> list:
    return TYPESTORE.deserialize_cdr(markers.encode(frame.stamp_ns, frame.people), MARKER_ARRAY).markers


def test_a_cylinder_and_a_name_a_person():
    markers = PeopleMarkers({1: "ada"})
    for stamp_ns in (0, 2_000_000_003):
        cylinder, name, *rest = drawn(markers, a_truth(stamp_ns))
        assert len(rest) == 2
        assert (cylinder.type, cylinder.action, cylinder.ns, cylinder.id) == (3, 0, "people", 1)
        assert cylinder.header.frame_id == name.header.frame_id == "room"
        assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in (cylinder, name, *rest)} == {
            divmod(stamp_ns, 10**9)
        }
        at = cylinder.pose.position
        assert (at.x, at.y, at.z, cylinder.scale.z) == pytest.approx((0.1, 1 / 3, 0.86, 1.72), rel=1e-12)
        assert (name.type, name.text, rest[1].text) == (9, "ada", "2")
        assert (name.pose.position.x, name.pose.position.y) == (0.2, 0.4)
        assert name.pose.position.z > 1.72
        assert cylinder.pose.orientation.w == 1.0


def test_who_has_left_is_taken_away_once():
    markers = PeopleMarkers({})
    drawn(markers, a_truth(0, (1, 2)))
    left = drawn(markers, a_truth(1, (1,)))
    assert [(m.ns, m.id, m.action) for m in left] == [
        ("people", 1, 0),
        ("names", 1, 0),
        ("people", 2, 2),
        ("names", 2, 2),
    ]
    assert [m.id for m in drawn(markers, a_truth(2, (1,)))] == [1, 1]
    assert [m.id for m in drawn(markers, a_truth(3, (3, 1)))] == [3, 3, 1, 1]
    assert [m.action for m in drawn(markers, a_truth(4, ()))] == [2, 2, 2, 2]
    assert drawn(markers, a_truth(5, ())) == []


def test_a_person_of_unknown_height_stands_where_they_are():
    cylinder, name = drawn(PeopleMarkers({}), TruthFrame(0, (PersonTruth(1, 0.5, 1.5),)))
    assert cylinder.scale.z == 1.7
    assert (name.pose.position.x, name.pose.position.y) == (0.5, 1.5)
