"""A robot body from URDF: links, poses, and visual meshes read only when they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.cache import Ingredient, cached
from skinmap.errors import (
    DataFormatError,
    ForbiddenPathError,
    MissingFileError,
    UnknownNameError,
)
from skinmap.geometry.mesh import TriangleMesh
from skinmap.geometry.rigid import check_transform, transform_points
from skinmap.io.robots.mesh_bounds import check_collada, check_gltf, check_scene
from skinmap.io.robots.urdf_elements import (
    KINDS,
    STILL,
    Shape,
    joint_transform,
    read_joints,
    read_links,
)
from skinmap.io.safe_xml import attribute, children, local_name, read_xml
from skinmap.io.text import check_file, is_file, parse_floats
from skinmap.skin.joints import Joint

# trimesh reads more, archives and scene formats among them, that may name or unpack other files.
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf", ".off")
MAX_MESH_BYTES = 512 * 2**20
# Kept once read: files that say all themselves (a .gltf names others), and are slow to parse.
WHOLE = (".stl", ".obj", ".ply", ".dae", ".glb", ".off")
WORTH_KEEPING = 50_000  # [bytes]
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


class UrdfBody:
    """Kinematics and visual meshes of a URDF file.

    Parameters
    ----------
    path : Path
        The URDF file. `package://NAME/...` is looked up in the folders above it.
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
        """Names of the links that carry a visual mesh."""
        return tuple(name for name, link in self._links.items() if link.shapes)

    @property
    def joints(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limit [rad or m] of each joint that moves."""
        return {one.name: one.limits or (-np.inf, np.inf) for one in self._moved}

    @property
    def sliding_joints(self) -> frozenset[str]:
        """Joints that slide instead of turning: theirs are lengths [m]."""
        return frozenset(one.name for one in self._moved if one.kind == "prismatic")

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
        known = self.joints
        for name in angles:
            if name not in known:
                raise UnknownNameError("joint", name, known)
        found: dict[str, FloatArray] = {}
        for link in self._links:
            way = [link]
            while way[-1] not in found and way[-1] in self._tree:
                way.append(self._tree[way[-1]].parent)
            found.setdefault(way[-1], np.eye(4))
            for below in reversed(way[:-1]):
                joint = self._tree[below]
                angle = joint.factor * float(angles.get(joint.driver, 0.0)) + joint.offset
                found[below] = found[joint.parent] @ joint_transform(joint, angle)
        return {link: found[link] for link in self._links}

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
        """Visual mesh of one link in the link's frame [m].

        Raises
        ------
        UnknownNameError, MissingFileError, DataFormatError
            No such link, or a mesh that is missing or cannot be read.
        """
        if link not in self._links:
            raise UnknownNameError("link", link, self.visible_links)
        vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
        for shape in self._links[link].shapes:
            if shape.kind == "mesh":
                points, triangles = read_mesh(self._resolve(shape.file))
                points = points * shape.numbers
            else:
                points, triangles = shape_mesh(shape)
            points = transform_points(check_transform(shape.T_link_shape, "visual origin"), points)
            vertices.append(points)
            faces.append(triangles + count)
            count += len(points)
        return TriangleMesh(np.concatenate(vertices), np.concatenate(faces))

    def _resolve(self, name: str) -> Path:
        path = self._locate(name)
        if self.inside is not None and not path.resolve().is_relative_to(self.inside):
            raise ForbiddenPathError(
                f"{self.path} names the mesh {name!r}, outside {self.inside}; "
                "allow it with --allow-outside"
            )
        return path

    def _locate(self, name: str) -> Path:
        if name.startswith("package://"):
            package, _, rest = name.removeprefix("package://").partition("/")
            for folder in self.path.resolve().parents:
                for root in (folder, folder / package):
                    if root.name == package and is_file(root / rest):
                        return root / rest
            raise MissingFileError(name, f"a mesh in a folder {package!r} above {self.path.name}")
        path = self.path.parent / name.removeprefix("file://")
        if not is_file(path):
            raise MissingFileError(path, "a mesh that the URDF names")
        return path


def read_mesh(path: Path, *, merge: bool = True) -> tuple[FloatArray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of a mesh file in its own units, through trimesh.

    `merge` joins vertices that are closer than 1e-8 units; right for robots, whose unit is known.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not a mesh that can be read, one without a triangle, or above 512 MB.
    """
    check_file(path, "a mesh", MAX_MESH_BYTES)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise DataFormatError(f"not a mesh; the formats are: {', '.join(MESH_SUFFIXES)}", path)

    def parse() -> dict[str, np.ndarray]:
        vertices, faces = _parsed(path, merge)
        return {"vertices": vertices, "faces": faces}

    if suffix not in WHOLE or path.stat().st_size < WORTH_KEEPING:
        made = parse()
    else:
        what: list[Ingredient] = [path.read_bytes(), suffix, merge]
        made = cached("mesh", what, parse, made_by=("trimesh", "pycollada"))
    return made["vertices"], made["faces"]


def _parsed(path: Path, merge: bool) -> tuple[FloatArray, np.ndarray]:
    import trimesh

    if (suffix := path.suffix.lower()) == ".dae":
        root = read_xml(path, "a COLLADA mesh", MAX_MESH_BYTES)  # COLLADA is XML with all its doors
    try:
        if suffix == ".dae":
            check_collada(root, path)
        elif suffix in (".glb", ".gltf"):
            check_gltf(path)
        with np.errstate(over="ignore", invalid="ignore"):  # merging casts to whole numbers
            scene = trimesh.load_scene(str(path), process=merge)
            check_scene(scene, path)
            mesh = scene.to_mesh()
        vertices = np.asarray(mesh.vertices, np.float64)
        faces = np.asarray(mesh.faces, np.int64)
    except DataFormatError:
        raise
    except Exception as error:  # each format has its own kinds of failure
        raise DataFormatError(f"not a mesh that can be read: {error}", path) from error
    if len(faces) == 0 or not np.isfinite(vertices).all():
        raise DataFormatError("a mesh without triangles or with NaN in it", path)
    return vertices, faces


def shape_mesh(shape: Shape) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3) [m] and faces (m, 3) of a box, cylinder or sphere, in its own frame."""
    from trimesh import creation

    if shape.kind == "box":
        mesh = creation.box(extents=shape.numbers)
    elif shape.kind == "cylinder":
        radius, height = shape.numbers
        mesh = creation.cylinder(radius=radius, height=height, sections=SECTIONS)
    else:
        mesh = creation.icosphere(subdivisions=3, radius=float(shape.numbers[0]))
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def read_urdf(path: Path) -> Any:
    """The root element (lxml) of a URDF whose links form one tree.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, unsafe XML, no URDF, or links and joints that are no tree (says which line).
    """
    root = read_xml(path, "a URDF file")
    if local_name(root) != "robot":
        raise DataFormatError(f"not a URDF: <{local_name(root)}>", path, root.sourceline)
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
    depths: dict[str, int] = {}
    for start in links:
        way: dict[str, None] = {}  # from the link towards the root, up to where it is known
        link = start
        while link in parents and link not in depths:
            if link in way:
                circle = " > ".join([*list(way)[list(way).index(link) :], link])
                raise DataFormatError(f"not a URDF: joints go in a circle: {circle}", path)
            way[link] = None
            link = parents[link]
        depth = depths.setdefault(link, 0)
        for link in reversed(way):
            depth += 1
            depths[link] = depth
        if depth > MAX_DEPTH:
            raise DataFormatError(
                f"a chain of {depth} joints ends at {start!r}, at most {MAX_DEPTH} are read", path
            )
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
