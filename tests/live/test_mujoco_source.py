"""A stepped MuJoCo model as a live source."""

from pathlib import Path

import numpy as np
import pytest

from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    SkinError,
    SkinMismatchError,
    UnknownNameError,
)
from skinmap.geometry.proximity import median_spacing
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mjcf import write_mjcf
from skinmap.io.robots.urdf import UrdfBody
from skinmap.live.sources.mujoco_source import MujocoSource, MujocoTouching
from skinmap.live.sources.open_source import open_source
from skinmap.live.sources.source import Source
from skinmap.physics.robot_model import FIRM, RobotModel
from skinmap.skin.robot import Part, Robot
from skinmap.skin.taxels import TaxelTable

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")
PART = "left_forearm"


@pytest.fixture(scope="module")
def icub() -> Robot:
    return load_robot("icub")


@pytest.fixture(scope="module")
def path(icub: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("mjcf") / "icub.xml"
    write_mjcf(icub, file, parts=[PART, "torso"])
    return file


def test_touching_is_felt_where_it_touches(icub: Robot, path: Path) -> None:
    touching = MujocoTouching(icub, path, parts=[PART], seed=0)
    values = touching.make(400)
    assert values.shape == (400, len(icub.skin(PART)))
    assert touching.model.rate >= 50.0
    felt = (values > 12).any(axis=1)
    times = np.arange(400) / touching.model.rate
    touched = np.zeros(400, bool)
    for touch in touching.truth:
        assert touch.part == PART
        touched |= (times >= touch.began - 0.2) & (times <= touch.ended + 0.2)
    assert felt.any()
    assert not felt[~touched].any()  # nothing is felt between touches


def test_touching_same_seed_same_samples(icub: Robot, path: Path) -> None:
    one, two = (MujocoTouching(icub, path, parts=[PART], seed=3).make(60) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def with_ball(path: Path, folder: Path, icub: Robot) -> Path:
    """The user's own: a ball that is pressed a little into the middle of the forearm's skin."""
    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    skin = icub.skin(PART)
    body = data.body(skin.link)
    middle = skin.positions.mean(axis=0)
    taxel = int(np.argmin(np.linalg.norm(skin.positions - middle, axis=1)))
    place = skin.positions[taxel] + 7e-3 * skin.normals[taxel]
    ball = spec.worldbody.add_body(
        name="mine", pos=body.xpos + body.xmat.reshape(3, 3) @ place, gravcomp=1.0
    )
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[8e-3, 0, 0], mass=0.3)
    spec.compile()
    own = folder / "own.xml"
    own.write_text(spec.to_xml())
    return own


def test_a_users_own_bodies_touch(icub: Robot, path: Path, tmp_path: Path) -> None:
    own = with_ball(path, tmp_path, icub)
    touching = MujocoTouching(icub, own, parts=[PART], seed=0)
    assert touching.model.own
    assert not touching.model.pressers
    assert (touching.make(3) > 12).any()


def test_loads_add_up_to_the_contact_force(icub: Robot, path: Path, tmp_path: Path) -> None:
    own = with_ball(path, tmp_path, icub)
    model = RobotModel(own, icub, parts=[PART], rng=np.random.default_rng(0))
    (loads,) = model.felt()
    pushed, wrench = 0.0, np.zeros(6)
    for row in range(model.data.ncon):
        mujoco.mj_contactForce(model.model, model.data, row, wrench)
        pushed += wrench[0]
    area = median_spacing(icub.skin(PART).positions) ** 2
    assert pushed > 0
    np.testing.assert_allclose(loads.sum() * FIRM * area, pushed, rtol=1e-9)


def barrel(folder: Path, channels: np.ndarray) -> Robot:
    """A fixed barrel of 50 mm radius with 8 mm between its taxels, in this order of channels."""
    body = "<visual><geometry><cylinder radius='.05' length='.1'/></geometry></visual>"
    text = f"<robot name='barrel'><link name='barrel'>{body}</link></robot>"
    (folder / "barrel.urdf").write_text(text)
    rows, columns = np.divmod(np.arange(168), 14)
    angle = (columns - 6.5 + 0.5 * (rows % 2)) * 8e-3 / 0.05
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(168)])
    places = 0.05 * normals + np.outer((rows - 5.5) * 7e-3, [0, 0, 1])
    modules = rows // 4 * 10 + columns // 4
    table = TaxelTable(np.arange(168), modules[channels], places[channels], normals[channels])
    part = Part("p", "barrel", lambda: table, frame="barrel")
    return Robot("barrel", UrdfBody(folder / "barrel.urdf"), {"p": part})


@pytest.mark.parametrize(
    "geom",
    [
        'type="sphere" size=".02" pos=".073 0 0"',
        'type="box" size=".005 .03 .02" pos=".058 0 0"',
        'type="capsule" size=".01 .05" pos=".063 0 0" euler="1.5707963 0 0"',  # rests between rows
    ],
)
def test_the_weight_of_a_users_body_is_felt(tmp_path: Path, geom: str) -> None:
    robot, path = barrel(tmp_path, np.arange(168)), tmp_path / "barrel.xml"
    write_mjcf(robot, path)
    own = path.read_text().replace('integrator="', 'gravity="-9.81 0 0" integrator="')
    thing = f'<body><freejoint/><geom {geom} mass=".5"/></body></worldbody>'
    path.write_text(own.replace("</worldbody>", thing))
    model = RobotModel(path, robot, rng=np.random.default_rng(0))
    loads = np.array([model.sample()[0] for _ in range(30)])[10:]
    force = loads.sum(axis=1) * FIRM * median_spacing(robot.skin("p").positions) ** 2
    assert np.median(force) == pytest.approx(0.5 * 9.81, rel=0.05)


def test_a_model_of_another_skin_is_refused(tmp_path: Path) -> None:
    write_mjcf(barrel(tmp_path, np.arange(168)), tmp_path / "barrel.xml")
    other = barrel(tmp_path, np.random.default_rng(0).permutation(168))
    with pytest.raises(SkinMismatchError, match="mm from those of the part"):
        RobotModel(tmp_path / "barrel.xml", other, rng=np.random.default_rng(0))


def test_open_source_gives_blocks_and_angles(icub: Robot, path: Path) -> None:
    source = open_source(f"mujoco:{path}", robot=icub, speed=float("inf"))
    try:
        assert isinstance(source, MujocoSource)
        assert isinstance(source, Source)
        assert source.info.parts == ("torso", PART)
        block = source.read(20.0)
        assert block is not None
        assert block.values.shape[1] == source.info.channels
        assert set(source.angles_at(0.0)) == set(icub.body.joints)
    finally:
        source.close()


def broken(folder: Path, text: str) -> Path:
    path = folder / "model.xml"
    path.write_text(text)
    return path


SENSOR = """<mujoco><asset><mesh name="t" inertia="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><body><geom name="g" type="mesh" mesh="t"/></body></worldbody>
<sensor><tactile name="{name}" geom="g" mesh="t"/></sensor></mujoco>"""


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("<mujoco", DataFormatError, "not a model that MuJoCo reads"),
        ("<robot name='r'/>", SkinError, "r"),
        ("<mujoco/>", SkinMismatchError, "no tactile sensor is called like a part of iCub"),
        (SENSOR.format(name="x"), SkinMismatchError, "the sensors are x"),
        (SENSOR.format(name="torso"), SkinMismatchError, "4 taxels, the part has 430"),
    ],
)
def test_open_source_refuses_other_models(
    icub: Robot, tmp_path: Path, text: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        open_source(f"mujoco:{broken(tmp_path, text)}", robot=icub)


def test_open_source_names_what_is_missing(icub: Robot, path: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="a robot's MJCF"):
        open_source(f"mujoco:{tmp_path / 'no.xml'}", robot=icub)
    with pytest.raises(InvalidArrayError, match="names its model"):
        open_source("mujoco:", robot=icub)
    with pytest.raises(UnknownNameError, match="no tactile sensor 'left_foot'"):
        open_source(f"mujoco:{path}", robot=icub, parts=["left_foot"])
