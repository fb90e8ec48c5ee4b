"""A robot: a posable body and the parts of it that carry skin, loaded when asked for.

Joints of a body hang each link on its parent, and give the path between two links.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from skinmap.arrays import FloatArray, check_finite, freeze
from skinmap.errors import InvalidArrayError, SkinError, UnknownNameError, check_known
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import check_transform, transform_points
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.modules import ModuleLayout
from skinmap.skin.repair import (
    ALL_STEPS,
    NORMALS,
    UNIT_METRES,
    RepairReport,
    detect_unit,
    repair_table,
    warn_of_unit,
)
from skinmap.skin.skin import Skin, skin_from_table
from skinmap.skin.taxels import TaxelTable
from skinmap.summary import Summary, listed

Kind = Literal["fixed", "turns", "slides"]


@dataclass(frozen=True, eq=False, slots=True)
class Joint:
    """What holds a link to its parent.

    Attributes
    ----------
    name : str
    parent : str
        Link that it hangs on.
    kind : {"fixed", "turns", "slides"}
    T_parent_joint : (4, 4) float
        Where the link is while the joint is at zero [m].
    axis : (3,) float
        In the joint's frame. A turning joint's length does not matter; a sliding joint goes its
        axis' length a metre.
    driver : str
        Joint whose angle moves this one: itself, or the one that it mimics; "" where nothing does.
    factor, offset : float
        Its own angle is factor * angle of the driver + offset.
    """

    name: str
    parent: str
    kind: Kind
    T_parent_joint: FloatArray
    axis: FloatArray
    driver: str
    factor: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        axis = check_finite(self.axis, f"axis of joint {self.name!r}", (3,))
        if self.kind != "fixed" and not axis.any():
            raise InvalidArrayError(f"the axis of joint {self.name!r} has no length")
        origin = check_transform(self.T_parent_joint, f"origin of joint {self.name!r}")
        freeze(self, axis=axis, T_parent_joint=origin)


def joint_transform(joint: Joint, angle: float) -> FloatArray:
    """T_parent_link (4, 4) at a joint's own angle [rad or m]."""
    move = np.eye(4)
    if joint.kind == "slides":
        move[:3, 3] = angle * joint.axis
    elif joint.kind == "turns":
        x, y, z = joint.axis / np.linalg.norm(joint.axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        # Rodrigues' formula.
        move[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return np.asarray(joint.T_parent_joint @ move)


Tree = Mapping[str, Joint]  # the joint above each link but the root


def ancestors(tree: Tree, link: str) -> list[str]:
    """The link itself, its parent, and so on to the root."""
    way = [link]
    while way[-1] in tree:
        way.append(tree[way[-1]].parent)
    return way


def common_ancestor(tree: Tree, links: Sequence[str]) -> str:
    """The deepest link that all of `links` hang on; one of them may be it.

    Raises
    ------
    InvalidArrayError
        No link was named.
    """
    if not links:
        raise InvalidArrayError("a common link of no links does not exist")
    shared = ancestors(tree, links[0])
    for link in links[1:]:
        own = set(ancestors(tree, link))
        shared = [one for one in shared if one in own]
    return shared[0]


def check_link(links: Sequence[str], link: str) -> str:
    """The link, if the body has it.

    Raises
    ------
    UnknownNameError
        It has not (names those that exist).
    """
    check_known("link", [link], links)
    return link


class Body(Protocol):
    """Links with meshes and poses; `skinmap.io.robots.urdf.UrdfBody` is one."""

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links."""

    @property
    def visible_links(self) -> tuple[str, ...]:
        """Names of the links that carry a visual mesh."""

    @property
    def joints(self) -> dict[str, tuple[float, float]]:
        """Limits [rad or m] of each joint."""

    @property
    def sliding_joints(self) -> frozenset[str]:
        """Joints that slide instead of turning: theirs are lengths [m]."""

    @property
    def tree(self) -> Mapping[str, Joint]:
        """The joint above each link but the root."""

    def poses(self, angles: Mapping[str, float]) -> dict[str, FloatArray]:
        """T_root_link (4, 4) of every link for joint angles [rad]."""

    def mesh(self, link: str) -> TriangleMesh:
        """Visual mesh of one link in its frame [m]."""


AUTO = "auto"
DH_SUFFIX = "_dh_frame"
NEAR_MESH = 0.1  # taxels nearer to their link than this share of the skin's size lie on it


@dataclass(frozen=True, slots=True)
class Part:
    """What the manifest says of one part.

    Attributes
    ----------
    name, link : str
    read : callable
        Reads the table, in metres and in its frame. May be given the metres of a unit, where its
        numbers are in another one than `unit`.
    layout : ModuleLayout or None
    frame : str
        Frame that the positions are in: a link of the body, or "auto": the part's link, or
        `<link>_dh_frame` where the body has one and the taxels fit the link better from there.
    drawing : Path or None
        A hand-drawn 2D layout of the part to compare with.
    maps : tuple of Path
        Files of its pieces, where they can bring flat maps of their own.
    ring : bool
        Whether its patches close to a ring: a contact goes on across their joints.
    cover : float
        Distance of the skin from its link, where a cover that no mesh has lies between [m].
    unit : str or None
        Unit that the positions are said to be in, of `skinmap.skin.repair.UNIT_METRES`.
    cover_mesh : callable or None
        Reads the mesh that the skin lies on instead of its link's, in the frame of the link.
    """

    name: str
    link: str
    read: Callable[..., TaxelTable]
    layout: ModuleLayout | None = None
    frame: str = AUTO
    drawing: Path | None = None
    maps: tuple[Path, ...] = ()
    ring: bool = False
    cover: float = 0.0
    cover_mesh: Callable[[], TriangleMesh] | None = None
    unit: str | None = None


@dataclass(eq=False, repr=False)
class Robot(Summary):
    """A body with skinned parts.

    Attributes
    ----------
    name : str
        As people call it.
    body : Body
        Links, meshes and poses.
    pose : dict
        Joint angles [rad] of a natural pose, for pictures.
    steps : collection of str
        Repair steps to take, all of `skinmap.skin.repair.ALL_STEPS` by default.
    origin : str
        What `skinmap.load_robot` loads it by: a built-in name or the path of its manifest; empty
        where it was made otherwise.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> robot.parts[:3]
    ('torso', 'right_arm', 'left_arm')
    >>> robot.skin("torso").positions.shape
    (240, 3)
    """

    name: str
    body: Body
    part_specs: Mapping[str, Part]
    pose: Mapping[str, float] = field(default_factory=dict)
    steps: Collection[str] = ALL_STEPS
    origin: str = ""
    _skins: dict[str, Skin] = field(default_factory=dict, repr=False)
    _meshes: dict[str, TriangleMesh] = field(default_factory=dict, repr=False)
    _repairs: dict[str, RepairReport] = field(default_factory=dict, repr=False)
    _frames: dict[str, str] = field(default_factory=dict, repr=False)
    _covers: dict[str, TriangleMesh] = field(default_factory=dict, repr=False)

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the skinned parts, in the manifest's order."""
        return tuple(self.part_specs)

    def part(self, name: str) -> Part:
        """What the manifest says of a part.

        Raises
        ------
        UnknownNameError
            No such part (lists those that exist).
        """
        if not isinstance(name, str) or name not in self.part_specs:
            raise UnknownNameError("part", str(name), self.part_specs)
        return self.part_specs[name]

    def skin(self, part: str) -> Skin:
        """The taxels of a part with repaired normals; reads its table and its link's mesh."""
        link = self.part(part).link
        if part not in self._skins:
            report = self.repair(part)
            keep = NORMALS not in self.steps
            # Robots stand on z: its direction in the link tells which end of a limb is up.
            up = self.body.poses({})[link][2, :3]
            self._skins[part] = skin_from_table(
                report.table,
                self.mesh_under(part),
                part,
                link,
                keep_normals=keep,
                up=up,
                ring=self.part(part).ring,
            )
        return self._skins[part]

    def repair(self, part: str) -> RepairReport:
        """The table of a part, mended, with what was done to it (see `skinmap.skin.repair`)."""
        spec = self.part(part)
        if part not in self._repairs:
            table, unit = self._in_metres(spec)
            table, self._frames[part] = self._in_link_frame(table, spec)
            self._repairs[part] = repair_table(
                table,
                spec.layout,
                steps=self.steps,
                known=self.module_frames(part),
                unit=unit,
                stated=spec.unit or "m",
            )
        return self._repairs[part]

    def frame(self, part: str) -> str:
        """Frame that the positions of a part turned out to be in."""
        self.repair(part)
        return self._frames[part]

    def _in_metres(self, spec: Part) -> tuple[TaxelTable, str]:
        """The table of a part and its unit, found in the file's numbers: poses are in metres."""
        table, stated = spec.read(), spec.unit or "m"
        if "units" not in self.steps:
            return table, stated
        shape = table.positions[table.pieces == 0] if len(table.pieces) else table.positions
        numbers = shape / UNIT_METRES[stated]
        unit = detect_unit(numbers, spec.layout, spec.unit, lies=lambda one: self._lies(spec, one))
        if unit == stated:
            return table, unit
        warn_of_unit(unit, f"part {spec.name!r}: ", spec.unit)
        return spec.read(UNIT_METRES[unit]), unit

    def _lies(self, spec: Part, unit: str) -> bool:
        """Whether the taxels of a part lie on its mesh, where their file is in this unit."""
        try:
            bare = len(self.mesh_under(spec.name).faces) == 0
        except SkinError:
            bare = True  # no mesh that could be read
        if bare:
            return False
        table, _ = self._in_link_frame(spec.read(UNIT_METRES[unit]), spec)
        size = float(np.linalg.norm(np.ptp(table.positions, axis=0)))
        return self._misfit(table, spec) <= NEAR_MESH * size + spec.cover

    def _in_link_frame(self, table: TaxelTable, spec: Part) -> tuple[TaxelTable, str]:
        if spec.frame == spec.link:
            return table, spec.link
        frame = spec.link + DH_SUFFIX if spec.frame == AUTO else spec.frame
        if frame not in self.body.links:
            if spec.frame == AUTO:
                return table, spec.link
            raise UnknownNameError(f"frame (part {spec.name!r})", frame, self.body.links)
        rest = self.body.poses({})
        T_link_frame = np.linalg.inv(rest[spec.link]) @ rest[frame]
        carried = replace(table, positions=transform_points(T_link_frame, table.positions))
        if spec.frame == AUTO and self._misfit(table, spec) <= self._misfit(carried, spec):
            return table, spec.link
        return carried, frame

    def _misfit(self, table: TaxelTable, spec: Part) -> float:
        mesh = self.mesh_under(spec.name)
        if len(mesh.faces) == 0:
            return 0.0
        distance, _, _ = closest_on_mesh(table.positions, mesh.vertices, mesh.faces)
        return float(np.median(distance))

    def module_frames(self, part: str) -> dict[int, FloatArray]:
        """T_link_module (4, 4) of the modules that the body has frames for.

        The URDFs of the iCub name them `<link>_skin_<module>`; those of the foot go by the sole.
        """
        link = self.part(part).link
        found = {}
        for prefix in (f"{link}_skin_", f"{link.replace('foot', 'sole')}_skin_"):
            for name in self.body.links:
                if name.startswith(prefix) and name.removeprefix(prefix).isdigit():
                    found[int(name.removeprefix(prefix))] = name
        if not found:
            return {}
        rest = self.body.poses({})
        T_link_root = np.linalg.inv(rest[link])
        return {module: T_link_root @ rest[name] for module, name in sorted(found.items())}

    def mesh(self, link: str) -> TriangleMesh:
        """Visual mesh of a link in its frame [m], read once."""
        if link not in self._meshes:
            self._meshes[link] = self.body.mesh(link)
        return self._meshes[link]

    def mesh_under(self, part: str) -> TriangleMesh:
        """The mesh that the skin of a part lies on, in the frame of its link [m].

        That of the link, or of a cover where the manifest names one.
        """
        spec = self.part(part)
        if spec.cover_mesh is None:
            return self.mesh(spec.link)
        if part not in self._covers:
            self._covers[part] = spec.cover_mesh()
        return self._covers[part]

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {"name": self.name, "parts": listed(self.parts), "joints": len(self.body.joints)}
