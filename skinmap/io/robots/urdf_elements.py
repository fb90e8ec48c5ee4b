"""Links and joints of a URDF whose tree and numbers were checked, as plain records.

What a general reader of URDF brings with it (scenes, meshes, their libraries) takes longer to
import than a skin takes to be laid flat; the tests hold poses and shapes to such a reader's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.io.safe_xml import children, local_name
from skinmap.skin.joints import Joint, Kind

KINDS: dict[str, Kind] = {"revolute": "turns", "continuous": "turns", "prismatic": "slides"}
STILL = ("fixed", "floating", "planar")  # one number says nothing about the last two


@dataclass(frozen=True, eq=False, slots=True)
class Shape:
    """What a link shows.

    Attributes
    ----------
    kind : {"mesh", "box", "cylinder", "sphere"}
    T_link_shape : (4, 4) float
    numbers : (k,) float
        A mesh's scale (1 or 3), a box' size (3), a cylinder's radius and length, a sphere's
        radius [m].
    file : str
        Of a mesh.
    """

    kind: str
    T_link_shape: FloatArray
    numbers: FloatArray
    file: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """A link: what it shows, and its mass [kg], centre frame (4, 4) and inertia (3, 3) if said."""

    shapes: tuple[Shape, ...]
    mass: float | None = None
    T_link_centre: FloatArray | None = None
    inertia: FloatArray | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Movable:
    """The name and kind ("revolute", ...) of a joint, and its limits [rad or m] where both are."""

    name: str
    kind: str
    limits: tuple[float, float] | None


def read_links(root: Any) -> dict[str, Link]:
    """The links of a URDF by name."""
    return {element.get("name"): _link(element) for element in children(root, "link")}


def read_joints(root: Any) -> tuple[dict[str, Joint], list[Movable]]:
    """The joint above each link but the root, and the joints that are moved, in their order."""
    elements = children(root, "joint")
    moved = [
        Movable(element.get("name"), element.get("type"), _limits(element))
        for element in elements
        if element.get("type") in KINDS and not children(element, "mimic")
    ]
    names = {one.name for one in moved}
    joints = {
        children(element, "child")[0].get("link"): _joint(element, names) for element in elements
    }
    return joints, moved


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


def _link(element: Any) -> Link:
    shapes = tuple(_shape(visual) for visual in children(element, "visual"))
    said = children(element, "inertial")
    if not said:
        return Link(shapes)
    mass, inertia = children(said[0], "mass"), children(said[0], "inertia")
    return Link(
        shapes,
        float(mass[0].get("value", 0.0)) if mass else None,
        _origin(said[0]),
        _tensor(inertia[0]) if inertia else np.zeros((3, 3)),
    )


def _tensor(element: Any) -> FloatArray:
    xx, yy, zz = (float(element.get(f"i{axis}{axis}", 1.0)) for axis in "xyz")
    xy, xz, yz = (float(element.get(name, 0.0)) for name in ("ixy", "ixz", "iyz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _shape(visual: Any) -> Shape:
    geometry = children(visual, "geometry")[0][0]
    kind, place = local_name(geometry), _origin(visual)
    if kind == "mesh":
        return Shape(kind, place, _numbers(geometry.get("scale") or "1"), geometry.get("filename"))
    if kind == "box":
        return Shape(kind, place, _numbers(geometry.attrib["size"]))
    if kind == "cylinder":
        return Shape(kind, place, _numbers("{radius} {length}".format(**geometry.attrib)))
    if kind == "sphere":
        return Shape(kind, place, _numbers(geometry.attrib["radius"]))
    raise ValueError(f"a geometry <{kind}>; known are mesh, box, cylinder and sphere")


def _joint(element: Any, moved: set[str]) -> Joint:
    kind = KINDS.get(element.get("type"), "fixed")
    axis, mimic = children(element, "axis"), children(element, "mimic")
    name = element.get("name")
    driver, factor, offset = ("" if kind == "fixed" else name), 1.0, 0.0
    if kind != "fixed" and mimic:
        driver = mimic[0].get("joint") if mimic[0].get("joint") in moved else ""
        factor = float(mimic[0].get("multiplier", 1.0))
        offset = float(mimic[0].get("offset", 0.0))
    return Joint(
        name,
        children(element, "parent")[0].get("link"),
        kind,
        _origin(element),
        _numbers(axis[0].get("xyz", "1 0 0") if axis else "1 0 0"),
        driver,
        factor,
        offset,
    )


def _limits(element: Any) -> tuple[float, float] | None:
    limit = children(element, "limit")
    if not limit or limit[0].get("lower") is None or limit[0].get("upper") is None:
        return None
    return float(limit[0].get("lower")), float(limit[0].get("upper"))


def _origin(element: Any) -> FloatArray:
    """(4, 4) of an element's <origin>: turned about the fixed x, y, then z."""
    place = np.eye(4)
    said = children(element, "origin")
    if said:
        place[:3, 3] = _numbers(said[0].get("xyz", "0 0 0"))
        (a, b, c), (sa, sb, sc) = (
            f(_numbers(said[0].get("rpy", "0 0 0"))) for f in (np.cos, np.sin)
        )
        place[:3, :3] = [
            [b * c, c * sa * sb - a * sc, sa * sc + a * c * sb],
            [b * sc, a * c + sa * sb * sc, a * sb * sc - c * sa],
            [-sb, b * sa, a * b],
        ]
    return place


def _numbers(text: str) -> FloatArray:
    return np.array([float(word) for word in text.replace(",", " ").split()])
