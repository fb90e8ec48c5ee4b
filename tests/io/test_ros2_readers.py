"""One recorded file in three readers that nobody here wrote, against what our own objects say."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags import rosbag2, typesys
from rosbags.highlevel import AnyReader

from skinmap.errors import MessageError
from skinmap.geometry.rigid import transform_points
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.ros2.messages import (
    TouchMarker,
    definition,
    full_name,
    read_joints,
    read_text,
    text_message,
    type_hash,
)

PARTS = ("left_forearm", "left_hand")
EQUAL = 1e-6  # asked for; float32 keeps places of a metre to 6e-8
STEPS, RATE = 25, 50.0


@dataclass
class Seen:
    """What a reader made of the file: messages of each topic with their times [ns]."""

    topics: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)

    def add(self, topic: str, stamp: int, message: Any) -> None:
        self.topics.setdefault(topic, []).append((stamp, message))


@pytest.fixture(scope="module")
def values(icub):
    width = sum(len(icub.skin(part)) for part in PARTS)
    whole = np.random.default_rng(0).integers(0, 256, (STEPS, width)).astype(np.float32)
    whole[10:] += 0.25  # no longer whole: sent in four bytes
    return whole


@pytest.fixture(scope="module")
def angles(icub):
    joints = [name for name in icub.body.joints if "elbow" in name or "shoulder" in name]
    steps = np.linspace(0.0, 0.4, STEPS)
    return [{name: float(step) for name in joints} for step in steps]


@pytest.fixture(scope="module")
def file(tmp_path_factory, icub, values, angles):
    path = tmp_path_factory.mktemp("bag") / "touch.mcap"
    skins = {part: icub.skin(part) for part in PARTS}
    recording = McapRecording(
        path,
        parts=PARTS,
        widths={"pressure": [len(skin) for skin in skins.values()]},
        rate=RATE,
        skins=skins,
        robot=icub.name,
        model=icub,
        points_hz=float("inf"),
    )
    for step, (row, told) in enumerate(zip(values, angles, strict=True)):
        recording.add_angles(step / RATE, told)
        recording.add("pressure", step / RATE, row)
        touches = [TouchMarker(7, "l_forearm", np.array([0.01, 0.02, 0.03]), "poke")]
        recording.show_touches(step / RATE, touches if 5 <= step < 8 else [])
    recording.mark("left_forearm", 7, "poke", began=0.1, ended=0.14)
    recording.close()
    return path


def by_rosbags(file) -> Seen:
    seen = Seen()
    with AnyReader([file]) as reader:
        for connection, stamp, data in reader.messages():
            seen.add(connection.topic, stamp, reader.deserialize(data, connection.msgtype))
    return seen


def by_mcap_ros2(file) -> Seen:
    ros2 = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    seen = Seen()
    for one in ros2.read_ros2_messages(str(file)):
        seen.add(one.channel.topic, one.log_time_ns, one.ros_msg)
    return seen


def by_foxglove(file) -> Seen:
    """By the reader of data sets in foxglove-sdk, over a store of objects that is a folder."""
    reader = pytest.importorskip("foxglove.datasets.reader", reason="foxglove-sdk is not installed")
    storage = pytest.importorskip("foxglove.datasets.storage")
    ros2 = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")

    class Folder:
        def open(self, location):
            return (file.parent / location.path).open("rb")

    with file.open("rb") as opened:
        topics = tuple(one.topic for one in make_reader(opened).get_summary().channels.values())
    began = datetime(1970, 1, 1, tzinfo=UTC)
    where = (storage.ObjectLocation("", file.name),)
    episode = reader._Episode("", began, began + timedelta(hours=1), {}, where)
    seen = Seen()
    found = reader.EpisodeReader(episode, topics, None, Folder())
    for _, channel, message, decoded in found.iter_messages(
        decoder_factories=[ros2.DecoderFactory()]
    ):
        seen.add(channel.topic, message.log_time, decoded)
    return seen


READERS = {
    "rosbags": by_rosbags,
    "mcap-ros2-support": by_mcap_ros2,
    "foxglove-sdk": by_foxglove,
}


@pytest.fixture(scope="module", params=READERS)
def seen(request, file):
    return READERS[request.param](file)


def points_of(cloud: Any) -> np.ndarray:
    """(n, 4) x, y, z and value, by what the message says of its own fields."""
    data = np.frombuffer(bytes(cloud.data), np.uint8).reshape(cloud.width, cloud.point_step)
    columns = [
        data[:, one.offset : one.offset + 4].copy().view("<f4")[:, 0] for one in cloud.fields
    ]
    assert [one.name for one in cloud.fields] == ["x", "y", "z", "pressure"]
    assert {one.datatype for one in cloud.fields} == {7}
    return np.column_stack(columns).astype(np.float64)


def matrix_of(one: Any) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    T_parent_child = np.eye(4)
    place, turn = one.transform.translation, one.transform.rotation
    T_parent_child[:3, 3] = place.x, place.y, place.z
    turned = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
    T_parent_child[:3, :3] = turned.as_matrix()
    return T_parent_child


def poses_of(tree: dict[str, tuple[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """T_root_link of every link, from parent to child."""
    poses: dict[str, np.ndarray] = {}

    def pose(link: str) -> np.ndarray:
        if link not in tree:
            return np.eye(4)
        if link not in poses:
            parent, T_parent_link = tree[link]
            poses[link] = pose(parent) @ T_parent_link
        return poses[link]

    for link in tree:
        pose(link)
    return poses


def test_every_sample_is_that_of_ours(seen, values, file):
    samples = sorted(
        [*seen.topics["/skin/pressure"], *seen.topics["/skin/pressure_float"]],
        key=lambda pair: pair[0],
    )
    np.testing.assert_allclose([s / 1e9 for s, _ in samples], np.arange(STEPS) / RATE, atol=1e-9)
    got = np.array([list(one.data) for _, one in samples], np.float64)
    np.testing.assert_allclose(got, values, rtol=0, atol=EQUAL)
    np.testing.assert_array_equal(read_track(file).values[:], values)


def test_every_transform_and_every_taxel_is_where_our_body_has_it(seen, icub, angles, values):
    tree = {}
    ((_, still),) = seen.topics["/tf_static"]
    for one in still.transforms:
        tree[one.child_frame_id] = (one.header.frame_id, matrix_of(one))
    moving = {stamp: message for stamp, message in seen.topics["/tf"]}
    clouds = seen.topics["/skin/points"]
    assert len(clouds) == STEPS
    for step in (0, 11, STEPS - 1):
        stamp = round(step / RATE * 1e9)
        for one in moving[stamp].transforms:
            tree[one.child_frame_id] = (one.header.frame_id, matrix_of(one))
        poses = poses_of(tree)
        ours = icub.body.poses({**icub.pose, **angles[step]})
        assert set(poses) == set(icub.body.tree)
        for link, T_root_link in poses.items():
            np.testing.assert_allclose(T_root_link, ours[link], rtol=0, atol=EQUAL)
        places = [
            transform_points(ours[icub.skin(part).link], icub.skin(part).positions)
            for part in PARTS
        ]
        (cloud,) = [message for when, message in clouds if when == stamp]
        points = points_of(cloud)
        np.testing.assert_allclose(points[:, :3], np.concatenate(places), rtol=0, atol=EQUAL)
        np.testing.assert_allclose(points[:, 3], values[step], rtol=0, atol=EQUAL)
        assert cloud.header.frame_id not in icub.body.tree


def test_a_wrong_joint_shows(seen, icub, angles):
    # The control: the same comparison with angles of another step must not pass.
    ours = icub.body.poses({**icub.pose, **angles[3]})
    other = icub.body.poses({**icub.pose, **angles[20]})
    assert np.abs(ours["l_forearm"] - other["l_forearm"]).max() > 1000 * EQUAL


def test_touches_description_and_joints_are_read(seen, icub, angles):
    shown = [message for _, message in seen.topics["/skin/markers"]]
    assert [[one.action for one in message.markers] for message in shown] == [
        [0, 0], [0, 0], [0, 0], [2, 2],
    ]  # fmt: skip
    ball, name = shown[0].markers
    assert (ball.header.frame_id, name.text, ball.type, name.type) == ("l_forearm", "poke", 2, 9)
    np.testing.assert_allclose(
        [ball.pose.position.x, ball.pose.position.y, ball.pose.position.z],
        [0.01, 0.02, 0.03],
        atol=EQUAL,
    )
    ((_, urdf),) = seen.topics["/robot_description"]
    assert urdf.data == icub.body.path.read_text()
    told = [json.loads(message.data) for _, message in seen.topics["/skin/touches"]]
    assert [(one["label"], one["event"]) for one in told] == [("poke", 7)]
    last = seen.topics["/joint_states"][-1][1]
    assert dict(zip(last.name, np.asarray(last.position).tolist(), strict=True)) == angles[-1]


def test_file_has_the_profile_and_the_latched_topics_of_ros2(file):
    with file.open("rb") as opened:
        reader = make_reader(opened, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        channels = {one.topic: one for one in reader.get_summary().channels.values()}
    assert {one.message_encoding for one in channels.values()} == {"cdr"}
    for topic, channel in channels.items():
        latched = topic in ("/tf_static", "/robot_description")
        assert ("durability: 1" in channel.metadata["offered_qos_profiles"]) == latched


def test_bag_folder_opens_with_its_metadata(file, tmp_path):
    with file.open("rb") as opened:
        told = {one.name: one.metadata for one in make_reader(opened).iter_metadata()}
    (tmp_path / "touch.mcap").write_bytes(file.read_bytes())
    (tmp_path / "metadata.yaml").write_text(told["rosbag2"]["serialized_metadata"])
    with rosbag2.Reader(tmp_path) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        assert counts["/skin/pressure"] + counts["/skin/pressure_float"] == STEPS
        assert reader.duration == pytest.approx((STEPS - 1) / RATE * 1e9, abs=2)
        qos = {one.topic: one.ext.offered_qos_profiles for one in reader.connections}
        assert qos["/tf_static"][0].durability.name == "TRANSIENT_LOCAL"


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


@pytest.mark.parametrize("store", ["ROS2_HUMBLE", "ROS2_JAZZY", "ROS2_KILTED"])
def test_definitions_and_hashes_are_those_of_ros2(store):
    types = typesys.get_typestore(typesys.Stores[store])
    for kind, hashed in HASHES.items():
        assert type_hash(kind) == types.hash_rihs01(full_name(kind)) == hashed
        own = typesys.get_types_from_msg(definition(kind).decode(), full_name(kind))
        for name, (constants, fields) in own.items():
            told = types.fielddefs[name]
            assert fields == told[1]
            assert set(told[0]) <= set(constants)  # Humble's markers know no strip of arrows


@pytest.mark.parametrize("count", [2**31, 2**32 - 1])
def test_a_message_that_promises_more_than_it_holds_is_refused_at_once(count):
    lies = b"\0\1\0\0" + struct.pack("<iII4sI", 0, 0, 1, b"", count)
    for data in (lies, lies + bytes(40), lies[:9], b"", b"\0\2\0\0"):
        with pytest.raises(MessageError):
            read_joints(data)
    with pytest.raises(MessageError, match="a text of"):
        read_text(text_message("x" * 2**24))
