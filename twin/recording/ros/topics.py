"""Names in a bag: topics and frames."""

from __future__ import annotations

SCAN = "scan"
IMAGE = "image/compressed"
DEPTH = "depth/compressed"
FLOOR = "floor"
CAMERA_INFO = "camera_info"
ODOMETRY = "odom"

SUFFIXES = {
    "laser": SCAN,
    "fisheye": IMAGE,
    "camera": IMAGE,
    "stereo": IMAGE,
    "floor": FLOOR,
    "odometry": ODOMETRY,
}
"""The last part of a sensor's topic, by its kind on the rig; a stereo camera has DEPTH besides."""

RIG = "/rig"
SCENARIO = "/scenario"
TF_STATIC = "/tf_static"
TF = "/tf"
TRUTH_PEOPLE = "/truth/people"
TRUTH_FEET = "/truth/feet"
TRUTH_BOXES = "/truth/boxes"
TRUTH_RAYS = "/truth/rays"
TRUTH_BASES = "/truth/bases"
TRUTH_SITUATIONS = "/truth/situations"
TRUTH_MARKERS = "/truth/markers"
ROOM_MARKERS = "/room/markers"

ROOM_FRAME = "room"


def sensor_topic(sensor: str, suffix: str) -> str:
    """Return the topic of a sensor's messages: `/waist/scan`."""
    return f"/{sensor}/{suffix}"


def background_topic(sensor: str, suffix: str) -> str:
    """Return the topic of a sensor's observations of the empty room: `/waist/background/scan`."""
    return f"/{sensor}/background/{suffix}"


def odometry_frame(base: str) -> str:
    """Return the frame in which the poses of a moving base are, which itself is the frame of its name: `robot/odom`."""
    return f"{base}/{ODOMETRY}"
