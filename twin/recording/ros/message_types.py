"""Message types of ROS 2 that occur here: their definitions, classes, and the store that encodes and decodes them.

`rosbags` makes a class of every type of a distribution when it is imported, which takes a tenth of the start of a run. Types
that do not stand here are taken from there when they are first asked for.
"""

from __future__ import annotations

from dataclasses import make_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

# Humble's definitions are the oldest still maintained; these are the same in every ROS 2 distribution.
_DEFINITIONS = """
builtin_interfaces/Duration: int32 sec, uint32 nanosec
builtin_interfaces/Time: int32 sec, uint32 nanosec
geometry_msgs/Point: float64 x, float64 y, float64 z
geometry_msgs/Pose: geometry_msgs/Point position, geometry_msgs/Quaternion orientation
geometry_msgs/PoseStamped: std_msgs/Header header, geometry_msgs/Pose pose
geometry_msgs/PoseWithCovariance: geometry_msgs/Pose pose, float64[36] covariance
geometry_msgs/Quaternion: float64 x, float64 y, float64 z, float64 w
geometry_msgs/Transform: geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation
geometry_msgs/TransformStamped: std_msgs/Header header, string child_frame_id, geometry_msgs/Transform transform
geometry_msgs/Twist: geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular
geometry_msgs/TwistWithCovariance: geometry_msgs/Twist twist, float64[36] covariance
geometry_msgs/Vector3: float64 x, float64 y, float64 z
nav_msgs/Odometry: std_msgs/Header header, string child_frame_id, geometry_msgs/PoseWithCovariance pose,
 geometry_msgs/TwistWithCovariance twist
sensor_msgs/CameraInfo: std_msgs/Header header, uint32 height, uint32 width, string distortion_model, float64[] d,
 float64[9] k, float64[9] r, float64[12] p, uint32 binning_x, uint32 binning_y, sensor_msgs/RegionOfInterest roi
sensor_msgs/CompressedImage: std_msgs/Header header, string format, uint8[] data
sensor_msgs/Image: std_msgs/Header header, uint32 height, uint32 width, string encoding, uint8 is_bigendian, uint32 step,
 uint8[] data
sensor_msgs/LaserScan: std_msgs/Header header, float32 angle_min, float32 angle_max, float32 angle_increment,
 float32 time_increment, float32 scan_time, float32 range_min, float32 range_max, float32[] ranges, float32[] intensities
sensor_msgs/PointCloud2: std_msgs/Header header, uint32 height, uint32 width, sensor_msgs/PointField[] fields,
 bool is_bigendian, uint32 point_step, uint32 row_step, uint8[] data, bool is_dense
sensor_msgs/PointField: uint8 INT8=1, uint8 UINT8=2, uint8 INT16=3, uint8 UINT16=4, uint8 INT32=5, uint8 UINT32=6,
 uint8 FLOAT32=7, uint8 FLOAT64=8, string name, uint32 offset, uint8 datatype, uint32 count
sensor_msgs/RegionOfInterest: uint32 x_offset, uint32 y_offset, uint32 height, uint32 width, bool do_rectify
std_msgs/ColorRGBA: float32 r, float32 g, float32 b, float32 a
std_msgs/Header: builtin_interfaces/Time stamp, string frame_id
std_msgs/String: string data
tf2_msgs/TFMessage: geometry_msgs/TransformStamped[] transforms
visualization_msgs/Marker: int32 ARROW=0, int32 CUBE=1, int32 SPHERE=2, int32 CYLINDER=3, int32 LINE_STRIP=4,
 int32 LINE_LIST=5, int32 CUBE_LIST=6, int32 SPHERE_LIST=7, int32 POINTS=8, int32 TEXT_VIEW_FACING=9,
 int32 MESH_RESOURCE=10, int32 TRIANGLE_LIST=11, int32 ADD=0, int32 MODIFY=0, int32 DELETE=2, int32 DELETEALL=3,
 std_msgs/Header header, string ns, int32 id, int32 type, int32 action, geometry_msgs/Pose pose,
 geometry_msgs/Vector3 scale, std_msgs/ColorRGBA color, builtin_interfaces/Duration lifetime, bool frame_locked,
 geometry_msgs/Point[] points, std_msgs/ColorRGBA[] colors, string texture_resource, sensor_msgs/CompressedImage texture,
 visualization_msgs/UVCoordinate[] uv_coordinates, string text, string mesh_resource,
 visualization_msgs/MeshFile mesh_file, bool mesh_use_embedded_materials
visualization_msgs/MarkerArray: visualization_msgs/Marker[] markers
visualization_msgs/MeshFile: string filename, uint8[] data
visualization_msgs/UVCoordinate: float32 u, float32 v
"""

TRANSFORM_MESSAGES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of `/tf` and `/tf_static`: of tf2, and of ROS 1's tf, with the same fields."""

TYPESTORE = Typestore()
"""Store of the types above."""


def typestore(msgtype: str) -> Typestore:
    """Return the store of a type: of those above, else of everything in ROS 2 Humble, whether it has the type or not."""
    return TYPESTORE if msgtype in TYPESTORE.types else _whole_typestore()


@cache
def _whole_typestore() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


def normal_type(name: str) -> str:
    """Return a type in ROS 2 notation (`sensor_msgs/msg/LaserScan`); ROS 1 may leave out `msg`."""
    package, _, own = name.partition("/")
    return name if "/" in own or not own else f"{package}/msg/{own}"


def _full_name(short: str) -> str:
    return short.replace("/", "/msg/")


def _field(kind: str) -> tuple[Nodetype, Any]:
    """Return a type as `rosbags` describes it: `uint8[]` as a sequence of a base type, for example."""
    element, bracket, length = kind.partition("[")
    described = (Nodetype.NAME, _full_name(element)) if "/" in element else (Nodetype.BASE, (element, 0))
    if not bracket:
        return described
    return (Nodetype.SEQUENCE, (described, 0)) if length == "]" else (Nodetype.ARRAY, (described, int(length[:-1])))


def _register(definition: str) -> None:
    """Add a type to the store, with the class of its messages."""
    short, members = definition.split(": ")
    pairs = [member.split(" ") for member in members.split(", ")]
    constants: list[Any] = []
    for kind, pair in pairs:
        name, _, value = pair.partition("=")
        constants += [(name, kind, int(value))] if value else []
    fields: list[Any] = [(name, _field(kind)) for kind, name in pairs if "=" not in name]
    own = {"__doc__": definition, "__msgtype__": _full_name(short), **{name: value for name, _, value in constants}}
    TYPESTORE.types[_full_name(short)] = make_dataclass(
        short.rpartition("/")[2], [(name, Any) for name, _ in fields], namespace=own, eq=False, match_args=False
    )
    TYPESTORE.fielddefs[_full_name(short)] = constants, fields


for _definition in _DEFINITIONS.replace("\n ", " ").strip().splitlines():
    _register(_definition)

if TYPE_CHECKING:
    pass
else:
    globals().update({name.rpartition("/")[2]: kind for name, kind in TYPESTORE.types.items()})
