"""A robot as MJCF: written without MuJoCo, read and touched with it."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skinmap.errors import InvalidMeshError
from skinmap.geometry.rigid import transform_points
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mjcf import PLATE_DEPTH, extreme_points, plates, write_mjcf
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.robot import Part, Robot
from skinmap.skin.taxels import TaxelTable

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")


@pytest.fixture(scope="module")
def icub() -> Robot:
    return load_robot("icub")


@pytest.fixture(scope="module")
def model(icub: Robot, tmp_path_factory: pytest.TempPathFactory) -> "mujoco.MjModel":
    path = tmp_path_factory.mktemp("mjcf") / "icub.xml"
    write_mjcf(icub, path)
    return mujoco.MjModel.from_xml_path(str(path))


def taxels_of(model: "mujoco.MjModel", data: "mujoco.MjData", part: str) -> np.ndarray:
    """Vertices of a part's sensor in the world."""
    geom, mesh = model.geom(part).id, model.mesh(part).id
    first = model.mesh_vertadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return data.geom_xpos[geom] + vertices @ data.geom_xmat[geom].reshape(3, 3).T


def test_write_mjcf_keeps_all_links_where_they_are(icub: Robot, model: "mujoco.MjModel") -> None:
    rng = np.random.default_rng(0)
    angles = {name: rng.uniform(*icub.body.joints[name]) for name in icub.body.joints}
    data = mujoco.MjData(model)
    for name, angle in angles.items():
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    poses = icub.body.poses(angles)
    assert len(poses) == 214
    for link, pose in poses.items():
        body = data.body(link)
        np.testing.assert_allclose(body.xpos, pose[:3, 3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(body.xmat.reshape(3, 3), pose[:3, :3], rtol=0, atol=1e-9)


def test_write_mjcf_keeps_taxels(icub: Robot, model: "mujoco.MjModel") -> None:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    poses = icub.body.poses({})
    for part in icub.parts:
        skin = icub.skin(part)
        wanted = transform_points(poses[skin.link], skin.positions)
        np.testing.assert_allclose(taxels_of(model, data, part), wanted, rtol=0, atol=1e-6)


@pytest.mark.parametrize("depth", [0.2e-3, 1e-3])
def test_tactile_sensor_feels_every_poke(icub: Robot, tmp_path: Path, depth: float) -> None:
    path, radius = tmp_path / "icub.xml", 8e-3
    write_mjcf(icub, path)
    spec = mujoco.MjSpec.from_file(str(path))
    ball = spec.worldbody.add_body(name="ball", pos=[0, 0, 9])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=0.05)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first = int(model.joint(int(model.body("ball").jntadr[0])).qposadr[0])
    rng = np.random.default_rng(0)
    for part in icub.parts:
        skin, places = icub.skin(part), taxels_of(model, data, part)
        turn = data.body(skin.link).xmat.reshape(3, 3).copy()
        for taxel in rng.integers(len(skin), size=15):
            centre = places[taxel] + (radius - depth) * (turn @ skin.normals[taxel])
            data.qpos[first : first + 3] = centre
            mujoco.mj_forward(model, data)
            felt = data.sensordata[model.sensor(part).adr[0] :][: len(skin)]
            assert felt[taxel] > 0, f"{part} {taxel}"
            wanted = np.maximum(radius - np.linalg.norm(places - centre, axis=1), 0.0)
            np.testing.assert_allclose(felt, wanted, rtol=0, atol=1e-7)


def test_robot_does_not_touch_itself(icub: Robot, model: "mujoco.MjModel") -> None:
    data = mujoco.MjData(model)
    for name, (low, high) in icub.body.joints.items():
        data.joint(name).qpos[0] = 0.5 * (low + high)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


URDF = """<robot name="box">
<link name="base">{base}</link><link name="arm">{arm}</link>
<joint name="j" type="{kind}"><parent link="base"/><child link="arm"/><origin xyz="0 0 .2"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
BOX = '<visual><geometry><box size=".1 .1 .1"/></geometry></visual>'
MOMENTS = 'ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"'
MASS = f'<inertial><mass value="2"/><inertia {MOMENTS}/></inertial>'


def flat_robot(
    folder: Path, *, base: str = BOX, arm: str = BOX, kind: str = "revolute", rows: int = 5
) -> Robot:
    (folder / "box.urdf").write_text(URDF.format(base=base, arm=arm, kind=kind))
    grid = np.array([(x, y, 0.05) for x in range(rows) for y in range(5)]) * [5e-3, 5e-3, 1.0]
    index = np.arange(len(grid))
    table = TaxelTable(index, np.zeros_like(index), grid, np.tile([0.0, 0, 1], (len(grid), 1)))
    return Robot(
        "box", UrdfBody(folder / "box.urdf"), {"p": Part("p", "arm", lambda: table, frame="arm")}
    )


def test_write_mjcf_flat_skin_without_mass(tmp_path: Path) -> None:
    robot = flat_robot(tmp_path)
    report = write_mjcf(robot, tmp_path / "box.xml")
    assert report.without_mass == ["arm"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))
    assert model.sensor("p").dim[0] == 3 * 25
    data = mujoco.MjData(model)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()


def test_write_mjcf_takes_the_mass_that_is_said(tmp_path: Path) -> None:
    report = write_mjcf(flat_robot(tmp_path, arm=BOX + MASS), tmp_path / "box.xml")
    assert report.without_mass == []
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))
    np.testing.assert_allclose(model.body("arm").mass, 2.0)
    np.testing.assert_allclose(model.body("arm").inertia, 0.1)


def test_write_mjcf_sliding_joint_slides(tmp_path: Path) -> None:
    robot = flat_robot(tmp_path, kind="prismatic")
    write_mjcf(robot, tmp_path / "box.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))
    data = mujoco.MjData(model)
    data.joint("j").qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.body("arm").xpos, robot.body.poses({"j": 0.3})["arm"][:3, 3])


def test_write_mjcf_names_links_without_and_with_unreadable_meshes(tmp_path: Path) -> None:
    broken = '<visual><geometry><mesh filename="no.stl"/></geometry></visual>'
    report = write_mjcf(flat_robot(tmp_path, base=broken), tmp_path / "box.xml")
    assert len(report.unreadable) == 1
    assert "base" in report.unreadable[0]
    assert "no.stl" in report.unreadable[0]
    mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))
    report = write_mjcf(flat_robot(tmp_path, base=""), tmp_path / "box.xml")
    assert report.without_mesh == ["base"]
    mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))


def test_write_mjcf_refuses_taxels_in_a_row(tmp_path: Path) -> None:
    robot = flat_robot(tmp_path, rows=3)
    apart = robot.skin("p")
    robot._skins["p"] = dataclasses.replace(apart, positions=apart.positions * [1.0, 0.0, 1.0])
    with pytest.raises(InvalidMeshError, match="part 'p' as MJCF"):
        write_mjcf(robot, tmp_path / "box.xml")


def test_plates_hold_each_taxel_once(icub: Robot) -> None:
    for part in icub.parts:
        rows = np.concatenate(plates(icub.skin(part)))
        np.testing.assert_array_equal(np.sort(rows), np.arange(len(icub.skin(part))))
    assert PLATE_DEPTH > 0


def test_extreme_points_keep_the_corners_of_a_box() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    inside = rng.uniform(-0.9, 0.9, (500, 3))
    found = extreme_points(np.concatenate([inside, corners]), 96)
    assert {tuple(one) for one in found} == {tuple(one) for one in corners}
    assert extreme_points(np.zeros((0, 3)), 96).shape == (0, 3)


def test_export_writes_without_mujoco(tmp_path: Path) -> None:
    script = (
        "import sys; sys.modules['mujoco'] = None; "
        "from skinmap.cli.main import main; sys.argv[0] = 'skinmap'; main()"
    )
    words = ["export", "kaspar", "--format", "mjcf", "-o", str(tmp_path / "kaspar.xml")]
    done = subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "kaspar.xml"))
    assert {model.sensor(k).name for k in range(model.nsensor)} == set(load_robot("kaspar").parts)
