"""One touch: a presser pushed by forces onto the springs of a skin, step by step in MuJoCo.

Only the presser moves. Every spring is a point that MuJoCo's contact keeps the flesh away from,
as softly as foam and flesh in series are: at rest the contact force is stiffness times depth, and
the stiffness grows with depth (see `secant_stiffness`).

The skin as a bed of springs, finer than its taxels, and what taxels feel of it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidMeshError, MissingLibraryError
from skinmap.geometry.proximity import bridged_graph, median_spacing
from skinmap.geometry.rigid import rigid_transform
from skinmap.geometry.triangles import face_areas, face_normals, unit
from skinmap.physics.bodies import Mount, Piece, Presser
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface

CELL = 3.4e-3  # no two springs are much further apart [m]: a fingertip stands on ten or more
PAD = 2e-3  # radius of a taxel's electrode [m], 4 mm wide as the iCub's
REACH = 3.0  # the spread of the foam is followed so many standard deviations


class SpringBed:
    """c springs on the surface mesh of a skin: middles of its triangles, each split alike.

    Parameters
    ----------
    skin : Skin
    mesh : SurfaceMesh, optional
        Its own by default.

    Attributes
    ----------
    places, normals : (c, 3) float
        Where springs stand [m] and their outward directions.
    area : float
        Skin that a spring speaks for, mean [m2].
    graph : (n, n) sparse
        Steps between taxels along the skin [m].
    spacing : float
        Of the taxels, median [m].

    Raises
    ------
    InvalidMeshError
        Taxels that make no surface.
    """

    def __init__(self, skin: Skin, mesh: SurfaceMesh | None = None) -> None:
        self.skin, self.spacing = skin, median_spacing(skin.positions)
        faces = (build_surface(skin) if mesh is None else mesh).faces
        if len(faces) == 0:
            raise InvalidMeshError(
                f"the taxels of {skin.part!r} lie in a row: no surface to press on"
            )
        weights = _middles(max(1, round(self.spacing / CELL)))
        middles = np.einsum("kc,fcd->fkd", weights, skin.positions[faces])
        self.places = middles.reshape(-1, 3)
        normals = unit(face_normals(skin.positions, faces))
        self.normals = np.repeat(normals, len(weights), axis=0)
        self.area = float(face_areas(skin.positions, faces).sum()) / len(self.places)
        self.graph = bridged_graph(skin.positions, 10, 2.5 * self.spacing)

    def spread(self, sigma: float) -> csr_array:
        """(n, c) pressure [Pa] on each taxel for a newton on each spring.

        A Gaussian of the foam's spread and the electrode's own size. What lies on the other side
        of a thin part feels nothing.
        """
        variance = sigma**2 + PAD**2 / 4.0  # of a disc along one direction
        reach = REACH * np.sqrt(variance)
        near = cKDTree(self.skin.positions).sparse_distance_matrix(
            cKDTree(self.places), reach, output_type="coo_matrix"
        )
        rows, columns = near.row, near.col
        squared = ((self.skin.positions[rows] - self.places[columns]) ** 2).sum(axis=1)
        weight = np.exp(-0.5 * squared / variance) / (2.0 * np.pi * variance)
        facing = np.einsum("ij,ij->i", self.skin.normals[rows], self.normals[columns]) > 0.0
        shape = (len(self.skin), len(self.places))
        return csr_array((weight * facing, (rows, columns)), shape=shape)


def _middles(splits: int) -> FloatArray:
    """(s * s, 3) barycentric coordinates of the middles of a triangle's s * s equal parts."""
    third = 1.0 / 3.0
    up = [(i + third, j + third) for i in range(splits) for j in range(splits - i)]
    down = [(i - third, j - third) for i in range(1, splits) for j in range(1, splits - i + 1)]
    first, second = np.array(up + down).T / splits
    return np.column_stack([first, second, 1.0 - first - second])


STEP = 2e-3  # at most [s]
POINT = 0.4e-3  # radius of a spring's point [m]: small beside a finger, so that it adds no width
# solimp: impedance d at no depth, at full depth, and that depth [m]. Flesh and foam stiffen when
# they are pressed together: three times at 3 mm, ten times at 6 mm. Small, since n soft contacts
# of impedance d add n d / (1 - d) times the mass of what they hold, which then swings for long.
SOFT, HARD, DEEP = 0.03, 0.092, 6e-3
NEAR = 30e-3  # springs so far from a presser's footprint take part [m]
FREE_SPEED = 0.12  # how fast an arm moves that meets nothing [m/s]
FREE_TURN = 8.0  # and a finger's joint [rad/s]
ARM = 3000.0  # stiffness of an arm along the skin [N/m]
SETTLE = 0.02  # how fast an arm gives way along the skin and tilts [s]
SIZE = 0.01  # of gyration of each piece [m]
CLEAR = 0.5e-3  # the presser begins so far above the skin [m]
DAMPING = 0.006  # of a contact: force for speed, per stiffness [s]
# A joint's damping acts within a step: where it exceeds the mass it moves per step, MuJoCo's
# contacts, solved before it, are too weak for a while. So mass is at least so many times it.
STEADY = 2.0
STILL = 5e-5  # moment of inertia of every joint of a hand: lighter ones chatter [kg m2]
LIGHT = 5e-3  # mass of a piece [kg]; what carries it holds it

logger = logging.getLogger(__name__)

LEAST = (4, 0)  # the first whose tactile sensor and direct contact stiffness were tested here


def import_mujoco() -> ModuleType:
    """The package `mujoco`.

    Raises
    ------
    MissingLibraryError
        Not installed, or older than `LEAST` (names the extra).
    """
    try:
        mujoco = import_module("mujoco")
    except ImportError as error:
        raise MissingLibraryError(
            "MuJoCo is not installed: pip install 'skinmap[mujoco]'"
        ) from error
    version = str(mujoco.__version__)
    if tuple(int(one) for one in version.split(".")[:2]) < LEAST:
        raise MissingLibraryError(
            f"MuJoCo {version} is too old, 4.0 or later is needed: pip install 'skinmap[mujoco]'"
        )
    # By itself it writes warnings into a file of the current folder.
    mujoco.set_mju_user_warning(logger.warning)
    return mujoco


@dataclass(frozen=True, eq=False, slots=True)
class Pressed:
    """What springs and presser did in one touch, t samples.

    Attributes
    ----------
    springs : (k,) int
        Rows of the bed's springs that took part.
    loads : (t, k) float
        Force of each spring [N]: its depth times its stiffness at that depth.
    forces : (t,) float
        Contact force of MuJoCo's solver, summed over contacts [N].
    centres : (t, 3) float
        Where it acts [m], in the frame of the link; NaN where nothing touches.
    vectors : (t, 3) float
        Sum of these forces on the skin along their normals [N], in the frame of the link.
    """

    springs: IntArray
    loads: FloatArray
    forces: FloatArray
    centres: FloatArray
    vectors: FloatArray


def press(
    bed: SpringBed,
    presser: Presser,
    frames: FloatArray,
    *,
    foam: float,
    flesh: float,
    course: FloatArray,
    step: float = STEP,
    samples: int = 10,
    friction: float = 0.0,
) -> Pressed:
    """Push a presser at the skin.

    Parameters
    ----------
    bed : SpringBed
    presser : Presser
        m mounts.
    frames : (m, 4, 4) array of float
        T_link_mount: where each mount pushes from; its z points away from the skin.
    foam, flesh : float
        Stiffness when hardly pressed, per area [Pa/m]; they stand in series.
    course : (s, m) array of float
        Share of the full force of each mount at each step; below 0 it lifts.
    step : float
        [s].
    samples : int
        Steps between two samples.
    friction : float
        Between presser and skin.
    """
    mujoco = import_mujoco()
    centre = frames[:, :3, 3].mean(axis=0)
    spots = np.array([mount.spot for mount in presser.mounts]).mean(axis=0)
    reach = NEAR + float(np.linalg.norm(presser.footprint - spots, axis=1).max())
    springs = np.flatnonzero(np.linalg.norm(bed.places - centre, axis=1) < reach)
    places = bed.places[springs] - POINT * bed.normals[springs]
    model = mujoco.MjModel.from_xml_string(_model(presser, frames, places, friction, step))
    firm = [one for mount in presser.mounts for one in _firmness(mount.piece)]
    spring = bed.area / (1.0 / foam + 1.0 / (flesh * np.array(firm)))
    soften(model, np.arange(len(spring)), spring)
    data = mujoco.MjData(model)
    _lift(mujoco, model, data, places, len(presser.mounts))
    mounts = np.array([int(model.actuator(row).name.split("_")[1]) for row in range(model.nu)])
    full = full_forces(presser)
    read: list[tuple[Any, ...]] = []
    first = model.ngeom - len(springs)
    for number, share in enumerate(course):
        data.ctrl[:] = full * share[mounts]
        mujoco.mj_step(model, data)
        if number % samples == samples - 1:
            read.append(_read(data, first, len(springs), spring))
    return Pressed(springs, *(np.array(column) for column in zip(*read, strict=True)))


def _read(
    data: Any, first: int, count: int, spring: FloatArray
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Force of each spring, force of all contacts, where that acts, and its sum on the springs."""
    contact = data.contact
    push = np.zeros(count)
    touching = contact.dist < 0
    touching &= contact.efc_address >= 0
    if not touching.any():
        return push, 0.0, np.full(3, np.nan), np.zeros(3)
    geoms = contact.geom[touching]
    rows = geoms.max(axis=1) - first
    depth = -contact.dist[touching]
    np.add.at(push, rows, depth * secant_stiffness(depth, spring[geoms.min(axis=1)]))
    force = data.efc_force[contact.efc_address[touching]]
    centre = force @ contact.pos[touching] / max(float(force.sum()), 1e-12)
    # Normals point from the first geom of a contact to the second.
    towards = np.where(geoms[:, 1] >= first, 1.0, -1.0)
    vector = (force * towards) @ contact.frame[touching, :3]
    return push, float(force.sum()), np.asarray(centre), np.asarray(vector)


def secant_stiffness(depth: FloatArray, spring: FloatArray) -> FloatArray:
    """Force over depth [N/m] at depths (k,) [m] of springs (k,) that begin with so much [N/m].

    What MuJoCo's solver does at rest: force = k d^2 depth / ((1 - d) w HARD^2), k the direct
    `solref`, w the inverse weight of the body at the contact and d the impedance of `solimp`, here
    rising evenly with depth (MuJoCo, "Computation", solver parameters).
    """
    d = SOFT + (HARD - SOFT) * np.minimum(depth / DEEP, 1.0)
    return np.asarray(spring * d**2 / (1.0 - d) * (1.0 - SOFT) / SOFT**2)


def _firmness(piece: Piece) -> list[float]:
    """Of each capsule of a piece and of what it carries, in the order of MuJoCo's geoms."""
    carried = [firm for one in piece.further for firm in _firmness(one)]
    return [piece.firm] * len(piece.flesh) + carried


def full_forces(presser: Presser) -> FloatArray:
    """(k,) force [N] or torque [N m] of each motor at full press, in their order in the model."""
    return np.array(
        [one for mount in presser.mounts for one in (-mount.force, *_torques(mount.piece))]
    )


def _torques(piece: Piece) -> list[float]:
    carried = [torque for one in piece.further for torque in _torques(one)]
    return [piece.torque, *carried] if piece.torque else carried


def soften(model: Any, geoms: IntArray, spring: FloatArray) -> None:
    """Make contacts of some geoms (k,) springs (k,) [N/m], see `secant_stiffness`."""
    weight = model.body_invweight0[model.geom_bodyid[geoms], 0]
    scale = -spring * weight * HARD**2 * (1.0 - SOFT) / SOFT**2
    model.geom_solref[geoms] = np.column_stack([scale, scale * DAMPING])


def _lift(mujoco: Any, model: Any, data: Any, places: FloatArray, mounts: int) -> None:
    """Move each mount out along its z until it is clear of all springs."""
    mujoco.mj_kinematics(model, data)
    roots = [-1] * model.nbody
    for mount in range(mounts):
        roots[int(model.body(f"mount_{mount}").id)] = mount
    owner = np.array([roots[root] for root in model.body_rootid])[model.geom_bodyid]
    for mount in range(mounts):
        joint = model.joint(f"z_{mount}")
        body = int(joint.bodyid[0])
        frame = data.xmat[body].reshape(3, 3)
        springs = (places - data.xpos[body]) @ frame
        lift = -np.inf
        for geom in np.flatnonzero(owner == mount):
            middle = (data.geom_xpos[geom] - data.xpos[body]) @ frame
            axis = data.geom_xmat[geom].reshape(3, 3)[:, 2] @ frame
            radius, half = model.geom_size[geom, :2]
            if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_CAPSULE:
                half = 0.0
            for along in np.linspace(-half, half, 3 + int(2.0 * half / radius)):
                point = middle + along * axis
                away = (springs[:, :2] - point[:2]) ** 2
                under = radius**2 - away.sum(axis=1)
                hit = under > 0
                if hit.any():
                    top = springs[hit, 2] + np.sqrt(under[hit]) - point[2]
                    lift = max(lift, float(top.max()))
        if np.isfinite(lift):
            data.qpos[joint.qposadr[0]] = lift + POINT + CLEAR


def _model(
    presser: Presser, frames: FloatArray, places: FloatArray, friction: float, step: float
) -> str:
    """The MJCF of a presser above its springs."""
    motors: list[str] = []
    pairs = zip(presser.mounts, frames, strict=True)
    bodies = [_mount(mount, k, frame, step, motors) for k, (mount, frame) in enumerate(pairs)]
    points = "".join(
        f'<geom type="sphere" size="{POINT}" pos="{x:.6f} {y:.6f} {z:.6f}"/>'
        for x, y, z in places.tolist()
    )
    # The springs' points come last, in a body that stands still.
    bed = f'<body name="bed_0" childclass="spring">{points}</body>'
    option = (
        f'<option timestep="{step!r}" gravity="0 0 0" integrator="implicitfast" iterations="20" '
        f'tolerance="1e-6" cone="{"elliptic" if friction else "pyramidal"}"/>'
    )
    return _document("".join(bodies) + bed, motors, friction, option)


def pressers_xml(pressers: Sequence[Presser], height: float, step: float) -> str:
    """The MJCF of several pressers, their mounts numbered on and parked at a height [m]."""
    bodies: list[str] = []
    motors: list[str] = []
    for mount in (mount for presser in pressers for mount in presser.mounts):
        frame = np.eye(4)
        frame[2, 3] = height + len(bodies)
        bodies.append(_mount(mount, len(bodies), frame, step, motors))
    return _document("".join(bodies), motors, 0.0)


def _document(bodies: str, motors: Sequence[str], friction: float, option: str = "") -> str:
    dims = 3 if friction else 1
    return f"""<mujoco><compiler angle="radian"/>{option}
<default><geom contype="1" conaffinity="0" condim="{dims}" priority="1" mass="0"
 friction="{friction or 1} 0 0" solimp="{SOFT} {HARD} {DEEP} 0.5 1"/>
<default class="spring"><geom contype="0" conaffinity="1" priority="0" mass="0"/></default>
</default>
<worldbody>{bodies}</worldbody><actuator>{"".join(motors)}</actuator></mujoco>"""


def _mount(mount: Mount, number: int, frame: FloatArray, step: float, motors: list[str]) -> str:
    """The body of a mount, on slides and hinges; its motors are added to `motors`."""
    motors.append(f'<motor name="push_{number}" joint="z_{number}"/>')
    side, turn = ARM * SETTLE, mount.tilt * SETTLE
    out = max(mount.force, 0.5) / FREE_SPEED
    mass, inertia = STEADY * step * max(out, side), STEADY * step * turn
    joints = "".join(
        f'<joint name="{name}_{number}" type="slide" axis="{axis}" stiffness="{stiff}" '
        f'damping="{damping}"/>'
        for name, axis, stiff, damping in (
            ("x", "1 0 0", ARM, side),
            ("y", "0 1 0", ARM, side),
            ("z", "0 0 1", 0, out),
        )
    ) + "".join(
        f'<joint name="{name}_{number}" type="hinge" axis="{axis}" stiffness="{mount.tilt}" '
        f'damping="{turn}"/>'
        for name, axis in (("rx", "1 0 0"), ("ry", "0 1 0"))
    )
    inner = _piece(mount.piece, f"{number}", number, step, motors)
    turn_of = Rotation.from_matrix(frame[:3, :3])
    return (
        f'<body name="mount_{number}" gravcomp="1" pos="{_text(frame[:3, 3])}" '
        f'quat="{_text(turn_of.as_quat(scalar_first=True))}">'
        f'{joints}<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{_text([inertia] * 3)}"/>'
        f"{inner}</body>"
    )


def _piece(piece: Piece, name: str, number: int, step: float, motors: list[str]) -> str:
    """The body of a piece and of what it carries."""
    joint = ""
    if piece.torque:
        motors.append(f'<motor name="bend_{number}_{name}" joint="b_{name}"/>')
        slow = piece.torque / FREE_TURN
        joint = (
            f'<joint name="b_{name}" type="hinge" axis="0 1 0" damping="{slow!r}" '
            f'armature="{STEADY * step * slow + STILL!r}" limited="true" range="-0.6 1.6"/>'
        )
    flesh = "".join(
        f'<geom type="sphere" size="{one.radius!r}" pos="{_text(one.start)}"/>'
        if one.start == one.end
        else f'<geom type="capsule" size="{one.radius!r}" '
        f'fromto="{_text((*one.start, *one.end))}"/>'
        for one in piece.flesh
    )
    carried = "".join(
        _piece(one, f"{name}_{row}", number, step, motors) for row, one in enumerate(piece.further)
    )
    half_turn, half_bend = piece.turn / 2.0, piece.bend / 2.0
    c, s, cb, sb = np.cos(half_turn), np.sin(half_turn), np.cos(half_bend), np.sin(half_bend)
    quat = (c * cb, -s * sb, c * sb, s * cb)  # about z, then about the turned y
    return (
        f'<body name="piece_{name}" gravcomp="1" pos="{_text(piece.at)}" '
        f'quat="{_text(quat)}">{joint}'
        f'<inertial pos="0 0 0" mass="{LIGHT}" diaginertia="{_text([LIGHT * SIZE**2] * 3)}"/>'
        f"{flesh}{carried}</body>"
    )


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def mount_frame(place: FloatArray, normal: FloatArray, along: FloatArray) -> FloatArray:
    """T_link_mount (4, 4) at a place, z along the normal and x nearest to a direction."""
    up = unit(normal)
    ahead = unit(along - (along @ up) * up)
    return rigid_transform(np.column_stack([ahead, np.cross(up, ahead), up]), place)
