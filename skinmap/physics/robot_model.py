"""A robot's MuJoCo model that is stepped, touched, and felt by its skins.

A `tactile` sensor of a part's name gives the depth of each taxel in what it touches. That is depth,
not pressure: bodies are nearly rigid, and how soft a contact is, is the model's affair. So the
contact forces of the link are laid on its taxels in proportion to their depths, spread by the foam:
pressure times area adds up to the force, whatever the stiffness.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, MissingFileError, SkinMismatchError, check_known
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import rigid_fit, rigid_transform, transform_points
from skinmap.physics.bodies import PRESSERS, Presser
from skinmap.physics.pressing import full_forces, import_mujoco, pressers_xml, soften
from skinmap.physics.variants import DEFAULT, VARIANTS
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.touch.simulation.gestures import FOUR

RATE = 50.0  # least samples a second
SPREAD = 3.5e-3  # of the foam and of a fingertip between taxels [m]
FIRM = 32e3  # pressure of a load of 1, a firm finger [Pa]
SPRING = 80.0  # of a presser's contact, at first [N/m]
PARKED = 50.0  # height at which pressers wait [m]
PREFIX = "presser "


class RobotModel:
    """A model of a robot, with bodies of ours that press where it brings none of its own.

    Parameters
    ----------
    path : Path
        MJCF with a tactile sensor for each part, as `skinmap export --format mjcf` writes it.
    robot : Robot
        Whose taxels the sensors have.
    parts : sequence of str, optional
        Only these.
    hand : float
        Size of the pressing hands, 1 = adult.
    rng : numpy.random.Generator

    Attributes
    ----------
    parts : tuple of str
    rate : float
        Samples a second.
    own : bool
        Whether the model has bodies that move freely: then they touch, and nothing is added.

    Raises
    ------
    MissingLibraryError
        MuJoCo is not installed.
    MissingFileError, DataFormatError
        No such file, or not a model.
    UnknownNameError
        No tactile sensor of the name of a part.
    SkinMismatchError
        A sensor with other taxels than the part.
    """

    def __init__(
        self,
        path: Path,
        robot: Robot,
        *,
        parts: Sequence[str] | None = None,
        hand: float = 0.9,
        rng: np.random.Generator,
    ) -> None:
        self._mujoco = import_mujoco()
        spec = _read(self._mujoco, path)
        tactile = self._mujoco.mjtSensor.mjSENS_TACTILE
        sensors = [one.name for one in spec.sensors if one.type == tactile]
        self.parts = _parts(sensors, robot, parts)
        free = self._mujoco.mjtJoint.mjJNT_FREE
        self.own = any(joint.type == free for joint in spec.joints)
        self.pressers: dict[str, Presser] = {}
        step = float(spec.option.timestep)
        if not self.own:
            variant = VARIANTS[DEFAULT]
            self.pressers = {name: PRESSERS[name](rng, hand, variant) for name in FOUR}
            child = self._mujoco.MjSpec.from_string(
                pressers_xml(tuple(self.pressers.values()), PARKED, step)
            )
            spec.attach(child, prefix=PREFIX, frame=spec.worldbody.add_frame())
        try:
            self.model = spec.compile()
        except Exception as error:  # MuJoCo raises ValueError, and others from its reader
            raise DataFormatError(f"not a model that MuJoCo compiles: {error}", path) from error
        self.data = self._mujoco.MjData(self.model)
        self._soften()
        self._steps = max(1, int(1.0 / (RATE * step) + 1e-9))
        self.rate = 1.0 / (self._steps * step)
        self._skins = [_Felt(self._mujoco, self.model, robot.skin(part)) for part in self.parts]
        kind, find = self._mujoco.mjtObj.mjOBJ_JOINT, self._mujoco.mj_name2id
        self._joints = [one for one in robot.body.joints if find(self.model, kind, one) >= 0]
        self._mujoco.mj_forward(self.model, self.data)

    def sample(self, shares: FloatArray | None = None) -> list[FloatArray]:
        """Step to the next sample; loads (n,) of each part, 1 = a firm finger.

        `shares` (k,) are of the full force of each of our motors.
        """
        if shares is not None:
            self.data.ctrl[self._motors] = self._full * shares
        for _ in range(self._steps):
            self._mujoco.mj_step(self.model, self.data)
        return self.felt()

    def felt(self) -> list[FloatArray]:
        """Loads (n,) of each part as things stand."""
        pushed = self._pushed()
        depths = [felt.depth(self.data) for felt in self._skins]
        self._lay_between(depths, pushed)
        total: dict[int, float] = {}
        for felt, depth in zip(self._skins, depths, strict=True):
            total[felt.weld] = total.get(felt.weld, 0.0) + float(depth.sum())
        return [
            felt.loads(depth, pushed.get(felt.weld, 0.0), total[felt.weld])
            for felt, depth in zip(self._skins, depths, strict=True)
        ]

    def angles(self) -> dict[str, float]:
        """Angles [rad] or lengths [m] of the robot's joints that the model has."""
        return {name: float(self.data.joint(name).qpos[0]) for name in self._joints}

    def link_pose(self, part: int) -> FloatArray:
        """T_world_link (4, 4) of the link that carries a part."""
        body = self._skins[part].body
        return rigid_transform(self.data.xmat[body].reshape(3, 3), self.data.xpos[body])

    @property
    def motor_count(self) -> int:
        """How many motors our pressers have."""
        return len(self._motors)

    def motors(self, name: str) -> IntArray:
        """Which of our motors a presser has."""
        return np.flatnonzero(np.isin(self._of_mount, self._mounts(name)))

    def put(self, name: str, frames: FloatArray | None) -> None:
        """Put a presser's mounts at T_world_mount (m, 4, 4), at rest; None parks it."""
        mounts = self._mounts(name)
        for row, mount in enumerate(mounts):
            body = self.model.body(f"{PREFIX}mount_{mount}").id
            if frames is None:
                self.model.body_pos[body] = (0.0, 0.0, PARKED + mount)
                continue
            self.model.body_pos[body] = frames[row, :3, 3]
            turn = Rotation.from_matrix(frames[row, :3, :3])
            self.model.body_quat[body] = turn.as_quat(scalar_first=True)
        for joint in np.flatnonzero(np.isin(self._mount_of_joint, mounts)):
            self.data.qpos[self.model.jnt_qposadr[joint]] = 0.0
            self.data.qvel[self.model.jnt_dofadr[joint]] = 0.0

    def _mounts(self, name: str) -> list[int]:
        """Numbers of a presser's mounts, which run on from presser to presser."""
        check_known("presser", [name], self.pressers)
        owners = [own for own, one in self.pressers.items() for _ in one.mounts]
        return [row for row, own in enumerate(owners) if own == name]

    def _soften(self) -> None:
        """Make our bodies soft, and find which joints and motors are whose."""
        model = self.model
        mount = [_mount_number(model.body(body).name) for body in range(model.nbody)]
        mine = np.array(mount)[model.geom_bodyid] >= 0
        soften(model, np.flatnonzero(mine), np.full(int(mine.sum()), SPRING))
        self._mount_of_joint = np.array(mount)[model.jnt_bodyid]
        names = [model.actuator(row).name for row in range(model.nu)]
        self._motors = np.array(
            [row for row, one in enumerate(names) if one.startswith(PREFIX)], int
        )
        self._of_mount = np.array([int(names[row].split("_")[1]) for row in self._motors], int)
        full = [full_forces(presser) for presser in self.pressers.values()]
        self._full = np.concatenate([np.zeros(0), *full])

    def _lay_between(self, depths: list[FloatArray], pushed: dict[int, float]) -> None:
        """Lay contacts on the nearest taxels where a link is pushed and no taxel is deep.

        A body may rest on the plates between taxels. Depths (n,) of each part become the forces of
        the contacts there, and `pushed` their sum; one further than a spacing from all taxels lies
        beside the skin.
        """
        for weld in pushed:
            skins = [row for row, felt in enumerate(self._skins) if felt.weld == weld]
            if not skins or any(depths[row].any() for row in skins):
                continue
            for force, place, _ in (one for one in self._contacts() if weld in one[2]):
                near = [(*self._skins[row].nearest(self.data, place), row) for row in skins]
                away, taxel, row = min(near)
                if away <= self._skins[row].spacing:
                    depths[row][taxel] += force
            pushed[weld] = sum(float(depths[row].sum()) for row in skins)

    def _contacts(self) -> Iterator[tuple[float, FloatArray, tuple[int, ...]]]:
        """Force [N], place (3,) in the world and the two rigid groups of each contact."""
        data, model = self.data, self.model
        wrench = np.zeros(6)
        for row in range(data.ncon):
            self._mujoco.mj_contactForce(model, data, row, wrench)
            if wrench[0] > 0.0:
                welds = model.body_weldid[model.geom_bodyid[data.contact.geom[row]]]
                yield float(wrench[0]), data.contact.pos[row], tuple(welds.tolist())

    def _pushed(self) -> dict[int, float]:
        """Sum of contact forces [N] on each rigid group of links."""
        found: dict[int, float] = {}
        for force, _, welds in self._contacts():
            for weld in welds:
                found[weld] = found.get(weld, 0.0) + force
        return found


class _Felt:
    """How one part feels: where its sensor's depths are, and the spread of its foam."""

    def __init__(self, mujoco: Any, model: Any, skin: Skin) -> None:
        sensor = model.sensor(skin.part)
        taxels = int(sensor.dim[0]) // 3
        if taxels != len(skin):
            raise SkinMismatchError(
                f"sensor {skin.part!r} has {taxels} taxels, the part has {len(skin)}"
            )
        first = int(sensor.adr[0])
        self._rows = slice(first, first + taxels)
        self._geom, mesh = int(model.sensor_refid[sensor.id]), int(model.sensor_objid[sensor.id])
        self.body = int(model.geom_bodyid[self._geom])
        self.weld = int(model.body_weldid[self.body])
        first = int(model.mesh_vertadr[mesh])
        self._places = model.mesh_vert[first : first + taxels].astype(np.float64)  # of the geometry
        self._spread = _foam(skin)
        self.spacing = median_spacing(skin.positions)
        self._area = self.spacing**2
        fit = rigid_fit(self._places, skin.positions, np.ones(taxels))
        off = np.linalg.norm(transform_points(fit, self._places) - skin.positions, axis=1)
        if off.max() > self.spacing / 2.0:
            raise SkinMismatchError(
                f"the taxels of sensor {skin.part!r} lie up to {1e3 * off.max():.3g} mm from those "
                f"of the part, of another skin perhaps: write the model anew (skinmap export)"
            )

    def depth(self, data: Any) -> FloatArray:
        """(n,) how deep each taxel is in something [m]."""
        return np.array(data.sensordata[self._rows])

    def nearest(self, data: Any, place: FloatArray) -> tuple[float, int]:
        """Distance [m] and row of the taxel nearest to a place (3,) in the world."""
        turn = data.geom_xmat[self._geom].reshape(3, 3)
        away = np.linalg.norm(self._places - (place - data.geom_xpos[self._geom]) @ turn, axis=1)
        return float(away.min()), int(np.argmin(away))

    def loads(self, depth: FloatArray, force: float, total: float) -> FloatArray:
        """(n,) loads whose pressures add up to the part's share of a force [N]."""
        if total <= 0.0:
            return np.zeros_like(depth)
        return np.asarray(self._spread @ depth) * (force / (total * self._area * FIRM))


def _foam(skin: Skin) -> csr_array:
    """(n, n) where a load on one taxel goes: a Gaussian over those around it, in sum 1."""
    tree = cKDTree(skin.positions)
    near = tree.sparse_distance_matrix(tree, 4.0 * SPREAD, output_type="coo_matrix")
    distance = np.linalg.norm(skin.positions[near.row] - skin.positions[near.col], axis=1)
    weight = np.exp(-0.5 * (distance / SPREAD) ** 2)
    weight *= np.einsum("ij,ij->i", skin.normals[near.row], skin.normals[near.col]) > 0.0
    weight[near.row == near.col] = 1.0
    total = np.bincount(near.col, weight, minlength=len(skin))
    return csr_array((weight / total[near.col], (near.row, near.col)), shape=(len(skin),) * 2)


def _read(mujoco: Any, path: Path) -> Any:
    if not path.is_file():
        raise MissingFileError(path, "a robot's MJCF, as `skinmap export --format mjcf` writes it")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except Exception as error:  # MuJoCo raises ValueError, and others from its reader
        raise DataFormatError(f"not a model that MuJoCo reads: {error}", path) from error


def _parts(sensors: Sequence[str], robot: Robot, parts: Sequence[str] | None) -> tuple[str, ...]:
    """The parts that have a sensor, those asked for if any."""
    for name in parts or ():
        robot.part(name)
    check_known("tactile sensor", parts or (), sensors)
    found = tuple(name for name in parts or robot.parts if name in sensors)
    if not found:
        wanted = ", ".join(robot.parts)
        raise SkinMismatchError(
            f"no tactile sensor is called like a part of {robot.name}: the sensors are "
            f"{', '.join(sensors) or 'none'}, the parts {wanted}"
        )
    return found


def _mount_number(name: str) -> int:
    """Number of the mount that a body belongs to, -1 for those that are not ours."""
    if not name.startswith(PREFIX):
        return -1
    return int(name.removeprefix(PREFIX).split("_")[1])
