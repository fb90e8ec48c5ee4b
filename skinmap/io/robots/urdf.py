"""A robot body from URDF: links, poses, and visual meshes read only when they are asked for.

What a general reader of URDF brings with it (scenes, meshes, their libraries) takes longer to
import than a skin takes to be laid flat; the tests hold poses and shapes to such a reader's.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import (
    DataFormatError,
    ForbiddenPathError,
    MissingFileError,
    SkinError,
    UnknownNameError,
    check_known,
    warn,
)
from skinmap.geometry.rigid import check_transform, rigid_transform, rpy_matrix, transform_points
from skinmap.geometry.triangles import TriangleMesh
from skinmap.interrupts import import_whole
from skinmap.io.robots.mesh_file import file_metres, read_mesh
from skinmap.io.safe_xml import attribute, children, local_name, read_xml
from skinmap.io.text import is_file, parse_floats
from skinmap.skin.robot import Joint, Kind, joint_transform

BODY = "body"  # the link of a body that is one mesh file
SECTIONS = 48  # of a cylinder: 0.2 % of the radius off the round
# A humanoid has some hundred links, ten deep. Poses take the cube of a chain's length.
MAX_LINKS, MAX_DEPTH = 2_000, 200
NUMBERS = {
    ("origin", "xyz"): (3,),
    ("origin", "rpy"): (3,),
    ("axis", "xyz"): (3,),
    ("mesh", "scale"): (1, 3),
    ("limit", "lower"): (1,),
    ("limit", "upper"): (1,),
    ("mimic", "multiplier"): (1,),
    ("mimic", "offset"): (1,),
}
KINDS: dict[str, Kind] = {"revolute": "turns", "continuous": "turns", "prismatic": "slides"}
# Shapes and the numbers that each has.
SIMPLE = {
    "box": "{size}", "cylinder": "{radius} {length}", "capsule": "{radius} {length}",
    "sphere": "{radius}",
}  # fmt: skip
OTHERS = {"mujoco": "an MJCF model", "sdf": "an SDF model", "COLLADA": "a COLLADA mesh"}
STILL = ("fixed", "floating", "planar")  # one number says nothing about the last two


class UrdfBody:
    """Kinematics and visual meshes of a URDF file.

    Parameters
    ----------
    path : Path
        The URDF file. `package://NAME/...` is looked up in the folders above it, by their names
        and by those in their `package.xml`, and in those of `ROS_PACKAGE_PATH`.
    inside : Path, optional
        Folder that no mesh may lie outside of.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that is no URDF, whose joints go in a circle, or with XML entities.
    """

    def __init__(self, path: Path, *, inside: Path | None = None) -> None:
        root = read_urdf(path)
        self.path, self.inside = path, inside
        try:
            self._links = read_links(root)
            self._tree, self._moved = read_joints(root)
        except Exception as error:  # a number that is none, an element that is missing
            raise DataFormatError(f"not a URDF that can be read: {error}", path) from error

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links."""
        return tuple(self._links)

    @property
    def visible_links(self) -> tuple[str, ...]:
        """Names of the links that carry a visual mesh; without any, those with another shape."""
        shown = tuple(name for name, link in self._links.items() if link.shapes and link.visual)
        return shown or tuple(name for name, link in self._links.items() if link.shapes)

    @property
    def joints(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limit [rad or m] of each joint that moves."""
        return {name: limits for name, (_, limits) in self._moved.items()}

    @property
    def sliding_joints(self) -> frozenset[str]:
        """Joints that slide instead of turning: theirs are lengths [m]."""
        return frozenset(name for name, (kind, _) in self._moved.items() if kind == "prismatic")

    @property
    def tree(self) -> dict[str, Joint]:
        """The joint above each link but the root; joints of other kinds stand still, as in poses.

        A joint that mimics one that does not move stands at its offset.
        """
        return dict(self._tree)

    def poses(self, angles: Mapping[str, float]) -> dict[str, FloatArray]:
        """T_root_link (4, 4) of every link for joint angles [rad]; joints not named are at zero.

        Raises
        ------
        UnknownNameError
            A joint that the URDF lacks.
        """
        check_known("joint", angles, self.joints)
        found: dict[str, FloatArray] = {}

        def pose(link: str) -> FloatArray:
            if link not in found:
                joint = self._tree.get(link)
                if joint is None:
                    found[link] = np.eye(4)
                else:
                    angle = joint.factor * float(angles.get(joint.driver, 0.0)) + joint.offset
                    found[link] = pose(joint.parent) @ joint_transform(joint, angle)
            return found[link]

        return {link: pose(link) for link in self._links}

    def inertia(self, link: str) -> tuple[float, FloatArray, FloatArray] | None:
        """Mass [kg], centre (3,) [m] and inertia about it (3, 3) [kg m2]; None where none is said.

        All in the frame of the link; a mass of zero counts as none.
        """
        said = self._links[link]
        if said.mass is None or said.T_link_centre is None or said.inertia is None:
            return None
        if not (0.0 < said.mass < np.inf and np.isfinite(said.inertia).all()):
            return None
        turn = said.T_link_centre[:3, :3]
        return said.mass, said.T_link_centre[:3, 3], turn @ said.inertia @ turn.T

    def mesh(self, link: str) -> TriangleMesh:
        """Visual mesh of one link in the link's frame [m]; its collision shapes if it has none.

        Shapes whose file is missing are left out with a warning where others are there.

        Raises
        ------
        UnknownNameError, MissingFileError, DataFormatError
            No such link, or a mesh that is missing or cannot be read.
        """
        if link not in self._links:
            raise UnknownNameError("link", link, self.visible_links)
        vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
        own, lost = self._links[link], []
        if own.shapes and not own.visual:
            _warn(f"link {link!r} has no visual mesh: its collision shapes are taken")
        for shape in own.shapes:
            try:
                points, triangles = self._triangles(shape)
            except MissingFileError as error:
                lost.append(error)
                if len(lost) == len(own.shapes):
                    raise
                continue
            points = transform_points(check_transform(shape.T_link_shape, "visual origin"), points)
            vertices.append(points)
            faces.append(triangles + count)
            count += len(points)
        if lost:
            _warn(f"link {link!r} without some of its meshes: {lost[0]}")
        return TriangleMesh(np.concatenate(vertices), np.concatenate(faces))

    def _triangles(self, shape: Shape) -> tuple[FloatArray, IntArray]:
        """Vertices (n, 3) [m] and faces (m, 3) of a shape in its own frame."""
        if shape.kind in SIMPLE:
            return shape_mesh(shape)
        if shape.kind != "mesh":
            known = ", ".join(("mesh", *SIMPLE))
            raise DataFormatError(f"a geometry <{shape.kind}>; known are {known}", self.path)
        path = self._resolve(shape.file)
        points, triangles = read_mesh(path)
        if np.broadcast_to(shape.numbers, 3).prod() < 0:  # a mirror image: inside out
            triangles = triangles[:, ::-1]
        return points * shape.numbers * self._metres(path), triangles

    def _metres(self, mesh: Path) -> float:
        """Metres in a unit of a mesh, before its scale in the URDF."""
        return file_metres(mesh) or 1.0

    def _resolve(self, name: str) -> Path:
        path = self.locate(name)
        if self.inside is not None and not path.resolve().is_relative_to(self.inside):
            raise ForbiddenPathError(
                f"{self.path} names the mesh {name!r}, outside {self.inside}; "
                "SKINMAP_ALLOW_OUTSIDE=1 allows it"
            )
        return path

    def locate(self, name: str) -> Path:
        """The file that a mesh name of the URDF stands for.

        Raises
        ------
        MissingFileError
            There is none.
        """
        if name.startswith("package://"):
            package, _, rest = name.removeprefix("package://").partition("/")
            for root in _packages(package, self.path):
                if is_file(root / rest):
                    return root / rest
            raise MissingFileError(name, f"a mesh in a folder {package!r} above {self.path.name}")
        path = self.path.parent / name.removeprefix("file://")
        if not is_file(path):
            raise MissingFileError(path, "a mesh that the URDF names")
        return path


def _packages(name: str, urdf: Path) -> Iterator[Path]:
    """Folders of a ROS package: above a URDF by name, by package.xml, then those that ROS knows."""
    above = urdf.resolve().parents
    yield from (one for folder in above for one in (folder, folder / name) if one.name == name)
    said = [Path(one) for one in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if one]
    for folder in (*above, *said):
        file = folder / "package.xml"
        try:
            words = [one.text for one in children(read_xml(file, "a package"), "name")]
        except SkinError:  # none, or one of something else
            continue
        if words == [name]:
            yield folder
    yield from (folder / name for folder in said)


def _warn(text: str) -> None:
    warn(text)  # shown once, whoever asks for the mesh


class MeshBody(UrdfBody):
    """One link called "body", without joints.

    Parameters
    ----------
    path : Path
        A mesh file that trimesh reads (STL, OBJ, PLY, DAE, GLB, ...).
    scale : float
        Metres a unit of the file.

    Raises
    ------
    MissingFileError
        No such file; whether it is a mesh shows when it is asked for.
    """

    def __init__(self, path: Path, *, scale: float = 1.0) -> None:
        if not is_file(path):
            raise MissingFileError(path, "a mesh file")
        self.path, self.scale, self.inside = path, scale, None
        self._links = {BODY: Link((Shape("mesh", np.eye(4), np.array([scale]), path.name),))}
        self._tree, self._moved = {}, {}

    def _metres(self, mesh: Path) -> float:
        return 1.0  # `scale` holds the unit


def shape_mesh(shape: Shape) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) [m] and faces (m, 3) of one of the `SIMPLE` shapes, in its own frame."""
    creation = import_whole("trimesh.creation")
    if shape.kind == "box":
        mesh = creation.box(extents=shape.numbers)
    elif shape.kind == "cylinder":
        radius, height = shape.numbers
        mesh = creation.cylinder(radius=radius, height=height, sections=SECTIONS)
    elif shape.kind == "capsule":
        radius, height = shape.numbers
        mesh = creation.capsule(radius=radius, height=height, count=[SECTIONS, SECTIONS])
    else:
        mesh = creation.icosphere(subdivisions=3, radius=float(shape.numbers[0]))
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def read_urdf(path: Path) -> Any:
    """The root element (lxml) of a URDF whose links form one tree.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, unsafe XML, no URDF, or links and joints that are no tree (names the line).
    """
    root = read_xml(path, "a URDF file")
    if local_name(root) != "robot":
        kind = local_name(root)
        other = f", but {OTHERS[kind]}: convert it, or give a mesh" if kind in OTHERS else ""
        raise DataFormatError(f"not a URDF: <{kind}>{other}", path, root.sourceline)
    if not root.get("name"):
        raise DataFormatError("not a URDF: <robot> lacks 'name'", path, root.sourceline)
    links = _names(root, "link", path)
    if not links:
        raise DataFormatError("not a URDF: no <link> with a name", path, root.sourceline)
    joints = _names(root, "joint", path)
    parents: dict[str, str] = {}
    for name, joint in joints.items():
        if (kind := joint.get("type")) not in (*KINDS, *STILL):
            raise DataFormatError(
                f"not a URDF: joint {name!r} has the type {kind!r}; the types are: "
                f"{', '.join((*KINDS, *STILL))}",
                path,
                joint.sourceline,
            )
        parent, child = _ends(joint, links, path)
        if child in parents:
            raise DataFormatError(
                f"not a URDF: link {child!r} has two parents", path, joint.sourceline
            )
        parents[child] = parent
    _check_tree(links, parents, path)
    for element in [*links.values(), *joints.values()]:
        _check_numbers(element, path)
    return root


def _names(root: Any, kind: str, path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for element in children(root, kind):
        name = element.get("name")
        if not name:
            raise DataFormatError(f"not a URDF: <{kind}> lacks 'name'", path, element.sourceline)
        if name in found:
            raise DataFormatError(f"two {kind}s are called {name!r}", path, element.sourceline)
        found[name] = element
    if len(found) > MAX_LINKS:
        raise DataFormatError(f"{len(found)} {kind}s, at most {MAX_LINKS} are read", path)
    return found


def _ends(joint: Any, links: dict[str, Any], path: Path) -> tuple[str, str]:
    ends = []
    for end in ("parent", "child"):
        elements = children(joint, end)
        if not elements:
            raise DataFormatError(f"not a URDF: <joint> lacks <{end}>", path, joint.sourceline)
        link = attribute(elements[0], "link", path)
        if link not in links:
            raise DataFormatError(
                f"not a URDF: {end} link {link!r} does not exist", path, elements[0].sourceline
            )
        ends.append(link)
    return ends[0], ends[1]


def _check_tree(links: dict[str, Any], parents: dict[str, str], path: Path) -> None:
    """Every link must reach the one link without a parent, in not too many joints."""
    for start in links:
        way = [start]  # towards the root
        while (link := parents.get(way[-1])) is not None:
            if link in way:
                circle = " > ".join([*way[way.index(link) :], link])
                raise DataFormatError(f"not a URDF: joints go in a circle: {circle}", path)
            if len(way) > MAX_DEPTH:
                raise DataFormatError(
                    f"a chain of {len(way)} joints ends at {start!r}, at most {MAX_DEPTH} are read",
                    path,
                )
            way.append(link)
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise DataFormatError(
            f"not a URDF: several links without a parent: {', '.join(roots[:10])}", path
        )


def _check_numbers(element: Any, path: Path) -> None:
    for part in element.iter():
        kind = local_name(part)
        if kind == "mesh":
            attribute(part, "filename", path)
        for (owner, name), counts in NUMBERS.items():
            text = part.get(name) if kind == owner else None
            if text is None:
                continue
            values = parse_floats(text.replace(",", " ").split(), path, part.sourceline)
            if len(values) not in counts:
                wanted = " or ".join(str(count) for count in counts)
                raise DataFormatError(
                    f"{name} needs {wanted} numbers, got {len(values)}", path, part.sourceline
                )
            # The iCub's own file gives its fixed joints such an axis; it turns nothing there.
            if kind == "axis" and not any(values) and element.get("type") != "fixed":
                raise DataFormatError("an axis of length zero", path, part.sourceline)


@dataclass(frozen=True, eq=False, slots=True)
class Shape:
    """What a link shows.

    Attributes
    ----------
    kind : str
        "mesh", one of `SIMPLE`, or one that is not known.
    T_link_shape : (4, 4) float
    numbers : (k,) float
        A mesh's scale (1 or 3), a box' size (3), radius and length of a cylinder (of a capsule
        without its ends), a sphere's radius [m].
    file : str
        Of a mesh.
    """

    kind: str
    T_link_shape: FloatArray
    numbers: FloatArray
    file: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """A link: its shapes, and its mass [kg], centre frame (4, 4) and inertia (3, 3) if stated.

    `visual` is false where collision shapes stand in for visual ones.
    """

    shapes: tuple[Shape, ...]
    mass: float | None = None
    T_link_centre: FloatArray | None = None
    inertia: FloatArray | None = None
    visual: bool = True


# Of a joint that is moved, its kind ("revolute", ...) and its limits [rad or m].
Movable = tuple[str, tuple[float, float]]


def read_links(root: Any) -> dict[str, Link]:
    """The links of a URDF by name."""
    return {element.get("name"): _link(element) for element in children(root, "link")}


def read_joints(root: Any) -> tuple[dict[str, Joint], dict[str, Movable]]:
    """The joint above each link but the root, and the joints that are moved, in their order."""
    elements = children(root, "joint")
    moved = {
        element.get("name"): (element.get("type"), _limits(element))
        for element in elements
        if element.get("type") in KINDS and not children(element, "mimic")
    }
    joints = {_said(element, "child", "link"): _joint(element, moved) for element in elements}
    return joints, moved


def _link(element: Any) -> Link:
    visuals = children(element, "visual")
    solid = [one for one in children(element, "collision") if children(one, "geometry")]
    shapes = tuple(_shape(one) for one in visuals or solid)
    shown = bool(visuals)
    for inertial in children(element, "inertial"):
        mass, inertia = _said(inertial, "mass", "value"), children(inertial, "inertia")
        tensor = _tensor(inertia[0]) if inertia else np.zeros((3, 3))
        return Link(shapes, None if mass is None else float(mass), _origin(inertial), tensor, shown)
    return Link(shapes, visual=shown)


def _tensor(element: Any) -> FloatArray:
    xx, yy, zz = (float(element.get(f"i{axis}{axis}", 1.0)) for axis in "xyz")
    xy, xz, yz = (float(element.get(name, 0.0)) for name in ("ixy", "ixz", "iyz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _shape(visual: Any) -> Shape:
    geometry = children(visual, "geometry")[0][0]
    kind, place = local_name(geometry), _origin(visual)
    if kind == "mesh":
        return Shape(kind, place, _numbers(geometry.get("scale") or "1"), geometry.get("filename"))
    # Another one is refused when it is asked for: others may be sound.
    return Shape(kind, place, _numbers(SIMPLE.get(kind, "").format(**geometry.attrib)))


def _joint(element: Any, moved: Collection[str]) -> Joint:
    kind = KINDS.get(element.get("type"), "fixed")
    name, factor, offset = element.get("name"), 1.0, 0.0
    driver = _said(element, "mimic", "joint", name)
    if kind != "fixed":
        factor = float(_said(element, "mimic", "multiplier", 1.0))
        offset = float(_said(element, "mimic", "offset", 0.0))
    return Joint(
        name,
        _said(element, "parent", "link"),
        kind,
        _origin(element),
        _numbers(_said(element, "axis", "xyz", "1 0 0")),
        driver if kind != "fixed" and driver in moved else "",
        factor,
        offset,
    )


def _limits(element: Any) -> tuple[float, float]:
    lower, upper = (_said(element, "limit", end) for end in ("lower", "upper"))
    known = lower is not None and upper is not None
    return (float(lower), float(upper)) if known else (-np.inf, np.inf)


def _origin(element: Any) -> FloatArray:
    """(4, 4) of an element's <origin>: turned about the fixed x, y, then z."""
    xyz, rpy = (_numbers(_said(element, "origin", name, "0 0 0")) for name in ("xyz", "rpy"))
    return rigid_transform(rpy_matrix(rpy.tolist()), xyz)


def _said(element: Any, child: str, name: str, default: Any = None) -> Any:
    """An attribute of the first child of a name; the default where nothing says it."""
    return next((one.get(name, default) for one in children(element, child)), default)


def _numbers(text: str) -> FloatArray:
    return np.array([float(word) for word in text.replace(",", " ").split()])
