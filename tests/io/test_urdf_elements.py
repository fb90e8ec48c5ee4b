"""Poses, joints, shapes and masses of URDFs beside those of a general reader, yourdfpy."""

from __future__ import annotations

import logging

import numpy as np
import pytest

import skinmap

ROBOT = """<robot name="r">
  <link name="a"><inertial><origin xyz="0.1 0 0" rpy="0.3 -0.2 0.9"/><mass value="2"/>
    <inertia ixx="1" iyy="2" izz="3" ixy="0.1"/></inertial></link>
  <link name="b"><visual><origin rpy="1 2 3" xyz="1 2 3"/><geometry><box size="1 2 3"/></geometry>
  </visual></link><link name="c"/><link name="d"/><link name="e"/>
  <joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="1 2 0.5"/>
    <origin xyz="1 0 0.5" rpy="0.1 0.7 -2"/><limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 2"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j3" type="continuous"><parent link="c"/><child link="d"/>
    <mimic joint="j1" multiplier="-0.5" offset="0.2"/></joint>
  <joint name="j4" type="floating"><parent link="c"/><child link="e"/></joint>
</robot>"""


def peer(path):
    yourdfpy = pytest.importorskip("yourdfpy")
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    return yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)


@pytest.mark.parametrize("robot", ["icub", "kaspar", "made"])
def test_poses_are_those_of_another_reader(robot, tmp_path, rng):
    from skinmap.io.robots.urdf import UrdfBody

    if robot == "made":
        (tmp_path / "r.urdf").write_text(ROBOT)
        body = UrdfBody(tmp_path / "r.urdf")
    else:
        body = skinmap.load_robot(robot).body
    other = peer(body.path)
    moving = [name for name in other.actuated_joint_names if name != "j4"]
    assert set(moving) <= set(body.joints)
    angles = {
        name: float(angle) for name, angle in zip(moving, rng.normal(size=len(moving)), strict=True)
    }
    other.update_cfg(dict(angles, **({"j4": 0.0} if robot == "made" else {})))
    poses = body.poses(angles)
    assert set(poses) == set(other.link_map)
    for link, pose in poses.items():
        np.testing.assert_allclose(pose, other.get_transform(link), atol=1e-12)
    for name in moving:
        limit = other.joint_map[name].limit
        if limit is not None and limit.lower is not None:
            assert body.joints[name] == (limit.lower, limit.upper)


def test_masses_are_those_of_another_reader(tmp_path):
    from skinmap.io.robots.urdf import UrdfBody

    (tmp_path / "r.urdf").write_text(ROBOT)
    mass, centre, tensor = UrdfBody(tmp_path / "r.urdf").inertia("a")
    said = peer(tmp_path / "r.urdf").link_map["a"].inertial
    turn = said.origin[:3, :3]
    assert mass == said.mass == 2.0
    np.testing.assert_allclose(centre, said.origin[:3, 3])
    np.testing.assert_allclose(tensor, turn @ said.inertia @ turn.T, atol=1e-15)


def test_a_shape_lies_where_its_origin_says(tmp_path):
    from skinmap.io.robots.urdf import UrdfBody

    (tmp_path / "r.urdf").write_text(ROBOT)
    mesh = UrdfBody(tmp_path / "r.urdf").mesh("b")
    origin = peer(tmp_path / "r.urdf").link_map["b"].visuals[0].origin
    own = (mesh.vertices - origin[:3, 3]) @ origin[:3, :3]
    np.testing.assert_allclose(np.ptp(own, axis=0), [1, 2, 3], atol=1e-12)


@pytest.mark.parametrize(("scale", "size"), [("-1 1 1", 24), ("-0.5", 3), ("-1 -1 2", 48)])
def test_a_mesh_with_a_mirrored_scale_keeps_its_outside_out(scale, size, tmp_path):
    import trimesh

    from skinmap.io.robots.urdf import UrdfBody

    trimesh.creation.box(extents=[2, 3, 4]).export(tmp_path / "b.stl")
    shape = f'<geometry><mesh filename="b.stl" scale="{scale}"/></geometry>'
    (tmp_path / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><visual>{shape}</visual></link></robot>'
    )
    mesh = UrdfBody(tmp_path / "r.urdf").mesh("a")
    # The volume is negative where the normals point inward.
    assert trimesh.Trimesh(mesh.vertices, mesh.faces).volume == pytest.approx(size)
