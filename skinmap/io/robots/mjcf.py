"""A robot and its skins as MJCF, the model format of MuJoCo; written without MuJoCo.

Each link becomes a body with a hull to bump into; each skin becomes a mesh whose vertices are the
taxels, a `tactile` sensor of the part's name that reads them, and thin plates of a few taxels that
other bodies press on. The robot's own geometries do not touch each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidMeshError, SkinError
from skinmap.geometry.rigid import tangent_frames
from skinmap.skin.robot import Joint, Robot, joint_transform
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import build_surface

HULL_POINTS = 96  # directions that a link's hull is followed in; MuJoCo keeps 64 of them
BARE = 12e-3  # a link with skin is bumped into where no taxel is so near [m]
PIECES = 8  # hulls of what is left of such a link
PLATE = 12  # taxels of a plate: a board of most skins
PLATE_DEPTH = 3e-3  # its thickness below the taxels [m]; flat skins have a volume then
NO_MASS = 0.02  # of a link that moves and says no mass [kg]
NO_INERTIA = 1e-5  # and its moments of inertia [kg m2]
STIFF, DAMPED = 40.0, 2.0  # servo that holds a joint [N m/rad] and [N m s/rad]


@dataclass(slots=True)
class MjcfReport:
    """What was written, and what was made up for it.

    Attributes
    ----------
    links, joints : int
    taxels : dict
        Of each part.
    without_mass, without_mesh, unreadable : list of str
        Moving links that got a mass, links without a mesh, and links whose mesh cannot be read.
    """

    links: int = 0
    joints: int = 0
    taxels: dict[str, int] = field(default_factory=dict)
    without_mass: list[str] = field(default_factory=list)
    without_mesh: list[str] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)


def write_mjcf(robot: Robot, path: Path, *, parts: Sequence[str] | None = None) -> MjcfReport:
    """Write a robot with the skins of some parts, all by default.

    Raises
    ------
    InvalidMeshError
        A part whose taxels make no surface (named).
    DataFormatError
        A body that is no tree of links.
    """
    report = MjcfReport()
    root = ET.parse(Path(__file__).with_suffix(".xml")).getroot()
    root.set("model", robot.name)
    asset, world = ET.SubElement(root, "asset"), ET.SubElement(root, "worldbody")
    skins = [robot.skin(part) for part in (robot.parts if parts is None else parts)]
    taxels: dict[str, FloatArray] = {}
    for skin in skins:
        before = taxels.get(skin.link, np.zeros((0, 3)))
        taxels[skin.link] = np.concatenate([before, skin.positions])
    bodies = _bodies(robot, taxels, world, asset, report)
    sensors = ET.SubElement(root, "sensor")
    for skin in skins:
        _skin(skin, bodies[skin.link], asset, sensors)
        report.taxels[skin.part] = len(skin)
    _servos(robot, root)
    ET.indent(root, " ")
    path.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    return report


def _bodies(
    robot: Robot,
    taxels: dict[str, FloatArray],
    world: ET.Element,
    asset: ET.Element,
    report: MjcfReport,
) -> dict[str, ET.Element]:
    """The element of each link, hung into each other as the joints say."""
    tree, links = robot.body.tree, robot.body.links
    children: dict[str, list[str]] = {}
    for link in links:
        if link in tree:
            children.setdefault(tree[link].parent, []).append(link)
    found: dict[str, ET.Element] = {}
    waiting = [(link, world) for link in links if link not in tree]
    while waiting:
        link, parent = waiting.pop()
        body = ET.SubElement(parent, "body", name=link, childclass="robot", gravcomp="1")
        if link in tree:
            _joint(robot, tree[link], body, report)
        _inertia(robot, link, link in tree and tree[link].kind != "fixed", body, report)
        _hull(robot, link, taxels.get(link, np.zeros((0, 3))), body, asset, report)
        found[link] = body
        waiting += [(child, body) for child in children.get(link, [])]
    if len(found) != len(links):
        lost = next(link for link in links if link not in found)
        raise DataFormatError(f"link {lost!r} does not hang on the root", robot.name)
    report.links = len(found)
    return found


def _joint(robot: Robot, joint: Joint, body: ET.Element, report: MjcfReport) -> None:
    """Where a link hangs on its parent, and how it moves."""
    origin = joint.T_parent_joint
    moves = joint.kind != "fixed" and joint.driver
    if joint.kind != "fixed" and not joint.driver and joint.offset:
        origin = joint_transform(joint, joint.offset)  # mimics a joint that stands still
    body.set("pos", _text(origin[:3, 3]))
    body.set("quat", _text(Rotation.from_matrix(origin[:3, :3]).as_quat(scalar_first=True)))
    if not moves:
        return
    report.joints += 1
    length = float(np.linalg.norm(joint.axis)) if joint.kind == "slides" else 1.0
    attributes = {
        "name": joint.name,
        "type": "slide" if joint.kind == "slides" else "hinge",
        "axis": _text(joint.axis),
        "damping": str(DAMPED),
        "armature": "0.01",
    }
    low, high = robot.body.joints.get(joint.name, (-np.inf, np.inf))
    if joint.driver == joint.name and np.isfinite([low, high]).all() and low < high:
        attributes["range"] = _text([low * length, high * length])
    ET.SubElement(body, "joint", attributes)


def _inertia(robot: Robot, link: str, moves: bool, body: ET.Element, report: MjcfReport) -> None:
    """Mass and inertia as the robot says, and something small where it says none."""
    known = getattr(robot.body, "inertia", None)
    said = None if known is None else known(link)
    if said is None:
        if moves:
            report.without_mass.append(link)
        mass, middle, tensor = NO_MASS, np.zeros(3), NO_INERTIA * np.eye(3)
    else:
        mass, middle, tensor = said
    moments, axes = np.linalg.eigh(tensor)
    moments = np.maximum(moments, 1e-9)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    ET.SubElement(
        body,
        "inertial",
        pos=_text(middle),
        quat=_text(Rotation.from_matrix(axes).as_quat(scalar_first=True)),
        mass=_text([mass]),
        diaginertia=_text(moments),
    )


def _hull(
    robot: Robot,
    link: str,
    taxels: FloatArray,
    body: ET.Element,
    asset: ET.Element,
    report: MjcfReport,
) -> None:
    """Hulls of a link's mesh, where it has one that can be read.

    One for a link without skin. A hull bulges over hollows, and would keep bodies off the taxels
    there: a link with skin gets several, of what lies away from its taxels (t, 3).
    """
    if link not in robot.body.visible_links:
        report.without_mesh.append(link)
        return
    try:
        vertices = robot.mesh(link).vertices
    except SkinError as error:
        report.unreadable.append(f"{link} ({error})")
        return
    pieces = [vertices]
    if len(taxels):
        bare = vertices[cKDTree(taxels).query(vertices)[0] > BARE]
        pieces = [bare[rows] for rows in _clusters(bare, PIECES)] if len(bare) > PIECES else []
    hulls = [extreme_points(one, HULL_POINTS) for one in pieces]
    solid = [one for one in hulls if _has_volume(one)]
    if not solid and not len(taxels):
        report.without_mesh.append(link)  # flat or a line: nothing to bump into
    for number, corners in enumerate(solid):
        name = f"hull {link} {number}"
        ET.SubElement(asset, "mesh", name=name, vertex=_text(corners), maxhullvert="64")
        ET.SubElement(body, "geom", type="mesh", mesh=name, rgba=".8 .8 .8 1")


def _has_volume(corners: FloatArray) -> bool:
    if len(corners) < 4:
        return False
    return bool(np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[-1] > 1e-4)


def _clusters(points: FloatArray, count: int) -> list[IntArray]:
    """Rows of points (n, 3) in groups that lie together."""
    _, label = kmeans2(points, count, minit="++", seed=0)
    return [np.flatnonzero(label == one) for one in np.unique(label)]


def extreme_points(points: FloatArray, count: int) -> FloatArray:
    """(k, 3) those of points (n, 3) that lie furthest in `count` directions spread evenly."""
    turns = np.arange(count) * np.pi * (1.0 + 5.0**0.5)  # a spiral of golden angles
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    flat = np.sqrt(1.0 - z**2)
    directions = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), z])
    if len(points) == 0:
        return np.zeros((0, 3))
    return np.asarray(points[np.unique(np.argmax(points @ directions.T, axis=0))])


def _skin(skin: Skin, body: ET.Element, asset: ET.Element, sensors: ET.Element) -> None:
    """The taxels of a part as a mesh, their sensor, and the plates that carry them."""
    try:
        faces = build_surface(skin).faces
    except InvalidMeshError as error:
        raise InvalidMeshError(f"part {skin.part!r} as MJCF: {error}") from error
    if len(faces) == 0:
        raise InvalidMeshError(f"part {skin.part!r} as MJCF: its taxels lie in a row: no surface")
    # The normal and two tangents, which MuJoCo measures slip along.
    axes = np.concatenate([skin.normals[:, None], tangent_frames(skin.normals)], axis=1)
    name = skin.part
    ET.SubElement(
        asset,
        "mesh",
        name=name,
        inertia="shell",  # open, perhaps flat: no volume
        vertex=_text(skin.positions.ravel()),
        normal=_text(axes.ravel()),
        face=" ".join(map(str, faces.ravel().tolist())),
    )
    ET.SubElement(body, "geom", {"class": "taxels"}, name=name, mesh=name)
    ET.SubElement(sensors, "tactile", name=name, geom=name, mesh=name)
    for number, rows in enumerate(plates(skin)):
        corners = np.concatenate(
            [skin.positions[rows], skin.positions[rows] - PLATE_DEPTH * skin.normals[rows]]
        )
        plate = f"{name} plate {number}"
        ET.SubElement(asset, "mesh", name=plate, vertex=_text(_solid(corners).ravel()))
        ET.SubElement(body, "geom", {"class": "plate"}, type="mesh", mesh=plate)


def plates(skin: Skin) -> list[IntArray]:
    """Rows of the taxels of each plate: the skin's modules, or where they are large, clusters."""
    found = []
    for module in np.unique(skin.modules):
        rows = np.flatnonzero(skin.modules == module)
        found += [rows[one] for one in _clusters(skin.positions[rows], -(-len(rows) // PLATE))]
    return found


def _solid(corners: FloatArray) -> FloatArray:
    """Corners that span a volume: few taxels or all in a line get a small cross round them."""
    middle = corners.mean(axis=0)
    spread, axes = np.linalg.eigh(np.cov((corners - middle).T))
    thin = np.sqrt(np.maximum(spread, 0.0)) < 0.2e-3
    more = [middle + sign * 1e-3 * axes[:, one] for one in np.flatnonzero(thin) for sign in (-1, 1)]
    return np.concatenate([corners, np.array(more).reshape(-1, 3)])


def _servos(robot: Robot, root: ET.Element) -> None:
    """Servos that hold the joints, couplings of those that mimic others."""
    actuator, equality = ET.Element("actuator"), ET.Element("equality")
    for joint in robot.body.tree.values():
        if joint.kind == "fixed" or not joint.driver:
            continue
        length = float(np.linalg.norm(joint.axis)) if joint.kind == "slides" else 1.0
        if joint.driver != joint.name:
            poly = _text([joint.offset * length, joint.factor * length, 0.0, 0.0, 0.0])
            ET.SubElement(equality, "joint", joint1=joint.name, joint2=joint.driver, polycoef=poly)
            continue
        ET.SubElement(
            actuator, "position", name=joint.name, joint=joint.name, kp=str(STIFF), kv=str(DAMPED)
        )
    for one in (actuator, equality):
        if len(one):
            root.append(one)


def _text(values: Any) -> str:
    return " ".join(f"{float(value):.12g}" for value in np.asarray(values).ravel())
