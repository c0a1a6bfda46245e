"""The types of messages that stand in the twin are those of ROS 2, and others are found."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from twin.recording.ros.message_types import TYPESTORE, typestore

HUMBLE = get_typestore(Stores.ROS2_HUMBLE)


def constants(kind: type) -> dict[str, object]:
    return {name: value for name, value in vars(kind).items() if name.isupper()}


@pytest.mark.parametrize("msgtype", sorted(TYPESTORE.types))
def test_a_type_is_as_rosbags_has_it(msgtype: str) -> None:
    assert TYPESTORE.fielddefs[msgtype] == HUMBLE.fielddefs[msgtype]
    assert TYPESTORE.hash_rihs01(msgtype) == HUMBLE.hash_rihs01(msgtype)
    assert constants(TYPESTORE.types[msgtype]) == constants(HUMBLE.types[msgtype])


def test_a_type_that_is_not_there_is_in_the_store_of_all() -> None:
    assert "sensor_msgs/msg/Imu" not in TYPESTORE.types
    assert typestore("sensor_msgs/msg/Imu").fielddefs["sensor_msgs/msg/Imu"] == HUMBLE.fielddefs["sensor_msgs/msg/Imu"]
    assert typestore("std_msgs/msg/String") is TYPESTORE
