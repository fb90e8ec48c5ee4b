"""Chains of a robot's URDF agree with its own forward kinematics, and move as differences say."""

from pathlib import Path

import numpy as np
import pytest

import skinmap
from calibration.mount.chains import Chain, robot_chain
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.robot import Robot, common_ancestor

# A slide with an axis that is not of length 1, a joint that mimics it, one that mimics a turn
# backwards, and a turn about an oblique axis that is not of length 1.
URDF = """<robot name="test">
  <link name="base"/><link name="slide"/><link name="follower"/><link name="arm"/>
  <link name="hand"/><link name="finger"/>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="slide"/>
    <origin xyz="0.1 0 0.2" rpy="0.3 -0.2 0.1"/><axis xyz="0 0.6 0.3"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="lift2" type="prismatic"><parent link="slide"/><child link="follower"/>
    <origin xyz="0 0.1 0"/><axis xyz="1 0 0"/>
    <mimic joint="lift" multiplier="-0.5" offset="0.02"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="turn" type="revolute"><parent link="follower"/><child link="arm"/>
    <origin xyz="0 0 0.3" rpy="0 1 0"/><axis xyz="1 2 -0.5"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="arm"/><child link="hand"/>
    <origin xyz="0 0.05 0.1" rpy="0.2 0 0.4"/></joint>
  <joint name="curl" type="continuous"><parent link="hand"/><child link="finger"/>
    <origin xyz="0.02 0 0"/><axis xyz="0 1 0"/>
    <mimic joint="turn" multiplier="-2" offset="0.1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def odd(tmp_path_factory) -> Robot:
    path: Path = tmp_path_factory.mktemp("robot") / "odd.urdf"
    path.write_text(URDF)
    return Robot("odd", UrdfBody(path), {})


@pytest.fixture(scope="module")
def icub() -> Robot:
    return skinmap.load_robot("icub")


def drawn(robot: Robot, rng, m: int) -> tuple[list[str], np.ndarray]:
    """Names of all joints, shuffled, and angles (m, joints) between -1 and 1."""
    names = rng.permutation(list(robot.body.joints)).tolist()
    return names, rng.uniform(-1, 1, (m, len(names)))


def own_poses(robot: Robot, names, angles) -> list[dict[str, np.ndarray]]:
    return [robot.body.poses(dict(zip(names, row, strict=True))) for row in angles.tolist()]


@pytest.mark.parametrize("which", ["icub", "odd"])
def test_frames_agree_with_the_robots_own_kinematics_for_every_link(which, request, rng):
    robot = request.getfixturevalue(which)
    names, angles = drawn(robot, rng, 3)
    poses = own_poses(robot, names, angles)
    root = next(link for link in robot.body.links if link not in robot.body.tree)
    for link in robot.body.links:
        T = robot_chain(robot, link, names).frames(angles)
        np.testing.assert_allclose(T, [one[link] for one in poses], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(robot_chain(robot, root, names).frames(angles)[0], np.eye(4))


@pytest.mark.parametrize(
    ("which", "base", "link"),
    [("icub", "chest", "r_forearm"), ("icub", "l_hand", "r_forearm"), ("odd", "finger", "base")],
)
def test_frames_from_any_link_to_any_other(which, base, link, request, rng):
    """Up against the joints to the common ancestor, then down."""
    robot = request.getfixturevalue(which)
    names, angles = drawn(robot, rng, 4)
    wanted = [np.linalg.inv(one[base]) @ one[link] for one in own_poses(robot, names, angles)]
    chain = robot_chain(robot, link, names, base=base)
    np.testing.assert_allclose(chain.frames(angles), wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("which", "base", "link"),
    [("icub", "root_link", "l_hand"), ("icub", "l_hand", "r_forearm"),
     ("odd", "base", "finger"), ("odd", "finger", "base")],
)  # fmt: skip
def test_slopes_agree_with_differences(which, base, link, request, rng):
    robot = request.getfixturevalue(which)
    names, angles = drawn(robot, rng, 4)
    chain = robot_chain(robot, link, names, base=base)
    point, step = np.array([0.03, -0.02, 0.05]), 1e-6
    T, axes, origins = chain.motion(angles)
    slopes = chain.slopes(axes, origins, T[:, :3, :3] @ point + T[:, :3, 3])
    assert len(slopes) == len(chain.joints) > 1
    for column in range(len(names)):
        bump = np.zeros(len(names))
        bump[column] = step
        after, before = (chain.frames(angles, sign * bump) for sign in (1, -1))
        moved = (after - before)[:, :3] @ np.append(point, 1.0) / (2 * step)
        # Central differences: step squared, and 1e-16 / step of rounding.
        own = slopes[chain.joints == column].sum(axis=0)
        np.testing.assert_allclose(own, moved, rtol=0, atol=1e-8)


def test_joints_that_no_column_tells_may_be_held(icub, rng):
    names, angles = drawn(icub, rng, 3)
    held = {"torso_pitch": 0.3, "torso_yaw": -0.2}
    kept = [name for name in names if name not in held]
    wanted = [
        icub.body.poses(dict(zip(kept, row, strict=True)) | held)["r_hand"]
        for row in angles[:, : len(kept)].tolist()
    ]
    chain = robot_chain(icub, "r_hand", kept, held=held)
    np.testing.assert_allclose(chain.frames(angles[:, : len(kept)]), wanted, rtol=0, atol=1e-9)


def test_a_chain_of_rows_agrees_with_the_same_rows_as_a_urdf(tmp_path, rng):
    """Denavit and Hartenberg: fixed rows first, then one joint a row."""
    dh = np.array([[0.1, 0.2, 0.3, 0.4], [0, 0.1, -1.2, 0.5], [0.05, 0, 0.7, -0.1]])
    chain = Chain.from_dh("arm", dh, [1, 0])
    angles = rng.uniform(-1, 1, (5, 2))
    wanted = np.tile(np.eye(4), (5, 1, 1))
    for (a, d, alpha, offset), column in zip(dh, (None, 1, 0), strict=True):
        theta = offset + (0.0 if column is None else angles[:, column])
        turn, twist = np.tile(np.eye(4), (2, 5, 1, 1))
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(theta)
        turn[:, 1, 0], turn[:, 0, 1] = np.sin(theta), -np.sin(theta)
        turn[:, 2, 3] = d
        twist[:, 1, 1] = twist[:, 2, 2] = np.cos(alpha)
        twist[:, 2, 1], twist[:, 1, 2], twist[:, 0, 3] = np.sin(alpha), -np.sin(alpha), a
        wanted = wanted @ turn @ twist
    np.testing.assert_allclose(chain.frames(angles), wanted, rtol=0, atol=1e-12)


def test_the_deepest_common_link_is_found(icub):
    tree = icub.body.tree
    assert common_ancestor(tree, ["r_hand", "r_forearm"]) == "r_forearm"
    shared = common_ancestor(tree, ["r_hand", "l_hand"])
    assert shared == "chest"
    assert common_ancestor(tree, ["r_hand", "l_foot"]) == "root_link"


def test_wrong_names_are_told_with_those_that_exist(icub, odd):
    joints = list(odd.body.joints)
    with pytest.raises(UnknownNameError, match=r"no link 'r_forarm'.*r_forearm"):
        robot_chain(icub, "r_forarm", [])
    with pytest.raises(UnknownNameError, match="no link 'bottom'; the links are: base, slide"):
        robot_chain(odd, "finger", joints, base="bottom")
    with pytest.raises(UnknownNameError, match="no joint 'bend'; the joints are: lift, turn"):
        robot_chain(odd, "finger", ["lift", "bend"])
    with pytest.raises(UnknownNameError, match="no joint 'curl'; the joints are: lift, turn"):
        robot_chain(odd, "finger", joints, held={"curl": 0.1})
    with pytest.raises(InvalidArrayError, match="'lift' is named twice, as column 0 and 2"):
        robot_chain(odd, "finger", ["lift", "turn", "lift"])
    with pytest.raises(InvalidArrayError, match="not given: turn; given are: lift"):
        robot_chain(odd, "finger", ["lift"])
    with pytest.raises(InvalidArrayError, match="common link of no links"):
        common_ancestor(odd.body.tree, [])


def test_a_chain_is_frozen_and_checked(odd):
    chain = robot_chain(odd, "finger", ["turn", "lift"])
    with pytest.raises(ValueError, match="read-only"):
        chain.before[0, 0, 0] = 2.0
    np.testing.assert_allclose(np.linalg.norm(chain.axes, axis=1)[~chain.sliding], 1, rtol=1e-15)
    parts = {"before": np.eye(4)[None], "axes": [[0, 0, 1.0]], "sliding": [False], "joints": [0],
             "factors": [1.0], "shifts": [0.0]}  # fmt: skip
    Chain("fine", **parts)
    for name, value, words in (
        ("before", 2 * np.eye(4)[None], "before is not rigid"),
        ("before", np.zeros((0, 4, 4)), "before of 'bad' must have shape"),
        ("axes", [[0, 0, 0.0]], "joint 0 of 'bad' has no axis"),
        ("axes", [[0, np.nan, 0.0]], "axes of 'bad'"),
        ("sliding", [False, True], "2 of sliding for 1 joints of 'bad'"),
        ("joints", [-1], "are columns from 0"),
        ("factors", [1.0, 2.0], "factors of 'bad'"),
        ("taxels", [[1.0, 2.0]], "taxels of 'bad' must be numbers"),
    ):
        with pytest.raises(InvalidArrayError, match=words):
            Chain("bad", **{**parts, name: value})
