"""The ROS 2 message types that are written: their text in full, and the hashes of their types.

The types are those of Humble to Jazzy; a test compares text and hashes with the package `rosbags`.
"""

from __future__ import annotations

import re

RULE = "=" * 80
DEFINITIONS: dict[str, str] = {
    "std_msgs/String": "string data",
    "std_msgs/UInt8MultiArray": """\
std_msgs/MultiArrayLayout layout
uint8[] data""",
    "std_msgs/MultiArrayLayout": """\
std_msgs/MultiArrayDimension[] dim
uint32 data_offset""",
    "std_msgs/MultiArrayDimension": """\
string label
uint32 size
uint32 stride""",
    "std_msgs/Float32MultiArray": """\
std_msgs/MultiArrayLayout layout
float32[] data""",
    "sensor_msgs/PointCloud2": """\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense""",
    "std_msgs/Header": """\
builtin_interfaces/Time stamp
string frame_id""",
    "builtin_interfaces/Time": """\
int32 sec
uint32 nanosec""",
    "sensor_msgs/PointField": """\
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count""",
    "sensor_msgs/JointState": """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort""",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "geometry_msgs/TransformStamped": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform""",
    "geometry_msgs/Transform": """\
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation""",
    "geometry_msgs/Vector3": """\
float64 x
float64 y
float64 z""",
    "geometry_msgs/Quaternion": """\
float64 x
float64 y
float64 z
float64 w""",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "visualization_msgs/Marker": """\
int32 ARROW=0
int32 CUBE=1
int32 SPHERE=2
int32 CYLINDER=3
int32 LINE_STRIP=4
int32 LINE_LIST=5
int32 CUBE_LIST=6
int32 SPHERE_LIST=7
int32 POINTS=8
int32 TEXT_VIEW_FACING=9
int32 MESH_RESOURCE=10
int32 TRIANGLE_LIST=11
int32 ARROW_STRIP=12
int32 ADD=0
int32 MODIFY=0
int32 DELETE=2
int32 DELETEALL=3
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials""",
    "geometry_msgs/Pose": """\
geometry_msgs/Point position
geometry_msgs/Quaternion orientation""",
    "geometry_msgs/Point": """\
float64 x
float64 y
float64 z""",
    "std_msgs/ColorRGBA": """\
float32 r
float32 g
float32 b
float32 a""",
    "builtin_interfaces/Duration": """\
int32 sec
uint32 nanosec""",
    "sensor_msgs/CompressedImage": """\
std_msgs/Header header
string format
uint8[] data""",
    "visualization_msgs/UVCoordinate": """\
float32 u
float32 v""",
    "visualization_msgs/MeshFile": """\
string filename
uint8[] data""",
}
HASHES: dict[str, str] = {
    "std_msgs/String": ("RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
    "std_msgs/UInt8MultiArray": (
        "RIHS01_5687e861b8d307a5e48b7515467ae7a5fc2daf805bd0ce6d8e9e604bade9f385"
    ),
    "std_msgs/Float32MultiArray": (
        "RIHS01_0599f6f85b4bfca379873a0b4375a0aca022156bd2d7021275d116ed1fa8bfe0"
    ),
    "sensor_msgs/PointCloud2": (
        "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"
    ),
    "sensor_msgs/JointState": (
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    ),
    "tf2_msgs/TFMessage": (
        "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
    ),
    "visualization_msgs/MarkerArray": (
        "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
    ),
}


def definition(kind: str) -> bytes:
    """A message type as text, with all types that it holds (MCAP's encoding `ros2msg`).

    Parameters
    ----------
    kind : str
        Such as "std_msgs/String".
    """
    held: list[str] = []
    _gather(kind, held)
    blocks = [DEFINITIONS[kind], *(f"MSG: {one}\n{DEFINITIONS[one]}" for one in held)]
    return f"\n{RULE}\n".join(blocks).encode() + b"\n"


def full_name(kind: str) -> str:
    """The name as ROS 2 writes it: std_msgs/msg/String."""
    return kind.replace("/", "/msg/")


def dds_name(kind: str) -> str:
    """The name as it stands in keys of rmw_zenoh: std_msgs::msg::dds_::String_."""
    return kind.replace("/", "::msg::dds_::") + "_"


def _gather(kind: str, held: list[str]) -> None:
    """Types that a type holds, each once, the outer before the inner."""
    for inner in re.findall(r"^(\w+/\w+)", DEFINITIONS[kind], flags=re.MULTILINE):
        if inner not in held:
            held.append(inner)
            _gather(inner, held)
