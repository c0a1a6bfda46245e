"""An observation from its message."""

from trackers.observations import Observation
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import from_message


def decode(data: bytes | memoryview, msgtype: str, sensor: str, *, kind: str | None = None) -> Observation:
    """Decode the observation in a serialized ROS 2 message (CDR)."""
    return from_message(TYPESTORE.deserialize_cdr(data, msgtype), sensor, kind=kind)
