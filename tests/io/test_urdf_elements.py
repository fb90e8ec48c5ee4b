"""Poses, joints, shapes and masses of URDFs beside those of a general reader, yourdfpy."""

from __future__ import annotations

import logging
import warnings

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


SHAPES = {
    "collision": ("", '<collision>{box}</collision>', "has no visual mesh", [1, 2, 3]),
    "capsule": ("", '<visual><geometry><capsule radius="1" length="2"/></geometry></visual>', "",
                [2, 2, 4]),
    "lost": ("", '<visual>{box}</visual><visual>{lost}</visual>', "without some of its meshes",
             [1, 2, 3]),
    "package": ("<package><name>acme</name></package>", '<visual>{mesh}</visual>', "", [2, 3, 4]),
    "ROS": ("", '<visual>{mesh}</visual>', "", [2, 3, 4]),
}  # fmt: skip


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_that_other_readers_know_are_read(kind, tmp_path, monkeypatch):
    import trimesh

    from skinmap.io.robots.urdf import UrdfBody

    package, link, warning, size = SHAPES[kind]
    home = tmp_path / "repository"
    (home / "urdf").mkdir(parents=True)
    meshes = (tmp_path / "elsewhere" / "acme" if kind == "ROS" else home) / "meshes"
    meshes.mkdir(parents=True)
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'no'}:{tmp_path / 'elsewhere'}")
    trimesh.creation.box(extents=[2, 3, 4]).export(meshes / "b.stl")
    (home / "package.xml").write_text(package)
    shapes = {
        "box": '<geometry><box size="1 2 3"/></geometry>',
        "lost": '<geometry><mesh filename="lost.stl"/></geometry>',
        "mesh": '<geometry><mesh filename="package://acme/meshes/b.stl"/></geometry>',
    }
    text = f'<robot name="r"><link name="a">{link.format(**shapes)}</link></robot>'
    (home / "urdf" / "r.urdf").write_text(text)
    body = UrdfBody(home / "urdf" / "r.urdf")
    assert body.visible_links == ("a",)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = body.mesh("a")
    assert [warning in str(one.message) for one in told] == [True] * bool(warning)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), size, rtol=0.01)


def test_a_shape_that_nobody_knows_leaves_the_other_links(tmp_path):
    from skinmap.errors import DataFormatError
    from skinmap.io.robots.urdf import UrdfBody

    text = ROBOT.replace('<link name="c"/>', '<link name="c"><visual><geometry><cone/></geometry>'
                         "</visual></link>")  # fmt: skip
    (tmp_path / "r.urdf").write_text(text)
    body = UrdfBody(tmp_path / "r.urdf")
    assert len(body.mesh("b").faces) == 12
    with pytest.raises(DataFormatError, match="a geometry <cone>; known are mesh, box"):
        body.mesh("c")
    (tmp_path / "m.xml").write_text("<mujoco/>")
    with pytest.raises(DataFormatError, match="an MJCF model: convert it, or give a mesh"):
        UrdfBody(tmp_path / "m.xml")
