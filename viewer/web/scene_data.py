"""What the page draws, packed once: body, sheets, taxels and flat maps."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import transform_directions, transform_points
from skinmap.geometry.topology import border_edges
from skinmap.skin.robot import Robot
from skinmap.touch.images.contact_image import ContactImageGeometry, taxel_grid
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.colours import BACKGROUND, BODY, DOT, INK, RIM, TRACES, UNKNOWN
from viewer.drawing.body.bare_body import Links, body_meshes, check_links, posed
from viewer.drawing.frame.camera import VIEW_ANGLE, front_view
from viewer.drawing.skin.skin_layer import DOT_SHARE, SkinLayer, flat_places

TYPES = ("u1", "i1", "u2", "u4", "i4", "f4")  # what a page has typed arrays for


def pack(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A message of a header (JSON) and arrays: what `page/packing.js` reads.

        [4 bytes] length of the header, little-endian
        [n bytes] header, JSON
        [padding] to a multiple of 8
        [arrays]  each at a multiple of 8, little-endian

    The header's `arrays` names each array with its type, first byte (counted behind the padding)
    and number of elements, so that the page reads them in place.

    Raises
    ------
    TypeError
        An array of a type that a page cannot read in place.
    """
    table, blobs, offset = {}, [], 0
    for name, array in arrays.items():
        kind = array.dtype.kind + str(array.dtype.itemsize)
        if kind not in TYPES:
            raise TypeError(f"array {name!r} of type {array.dtype}, expected one of {TYPES}")
        blob = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
        table[name] = [kind, offset, array.size]
        blobs.append(blob + bytes(-len(blob) % 8))
        offset += len(blobs[-1])
    text = json.dumps({**header, "arrays": table}, separators=(",", ":"), allow_nan=False).encode()
    head = len(text).to_bytes(4, "little") + text
    return b"".join([head, bytes(-len(head) % 8), *blobs])


def finite(value: float | None) -> float | None:
    """A number for JSON: None where it is not known."""
    return None if value is None or not np.isfinite(value) else float(value)


CELL = 6e-3  # of the body's meshes [m]: four pixels of a whole robot in a picture of 768
LEANING = 0.2  # length of a mean normal that says where a skin faces


class WebScene:
    """A robot made ready for pages: the body decimated, the sheets built, and both packed.

    Parameters
    ----------
    robot : Robot
    skins : mapping of str to PreparedSkin
        Parts to show, in the order of their taxels in a sample.
    angles : mapping of str to float, optional
        Joint angles [rad] where a moment has none; the robot's natural pose by default.
    links : iterable of str, optional
        Links to draw; all that have a mesh by default.
    cell : float
        Vertices of the body within so much become one [m].

    Attributes
    ----------
    layers : mapping of str to SkinLayer
    links : tuple of str
        Links in the order of their poses.
    first_taxel, first_vertex : mapping of str to int
        Where each part begins among all taxels and all vertices of sheets.
    packed : bytes
        The page's scene.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        A joint or link that the body lacks, or an angle beyond its joint's limits.
    """

    def __init__(
        self,
        robot: Robot,
        skins: Mapping[str, PreparedSkin],
        *,
        angles: Mapping[str, float] | None = None,
        links: Links = None,
        cell: float = CELL,
    ) -> None:
        self.robot, self.skins, self.angles = robot, dict(skins), dict(angles or {})
        self.layers = {part: SkinLayer(skin.mesh) for part, skin in skins.items()}
        meshes = body_meshes(robot, check_links(robot, links, skins), cell=cell)
        own = (skin.skin.link for skin in skins.values())
        self.links = tuple(dict.fromkeys([*meshes, *own]))
        poses = posed(robot, self.angles)
        taxels = first_rows([len(skin) for skin in skins.values()])
        vertices = first_rows([len(layer.points) for layer in self.layers.values()])
        self.first_taxel = dict(zip(skins, taxels, strict=False))
        self.first_vertex = dict(zip(skins, vertices, strict=False))
        header: dict[str, Any] = {"kind": "scene", "robot": robot.name, "view_angle": VIEW_ANGLE}
        header["colours"] = {
            "background": BACKGROUND, "body": BODY, "dot": DOT, "rim": RIM, "unknown": UNKNOWN,
            "ink": INK,
        }  # fmt: skip
        header["traces"] = TRACES
        close = set(skins) != set(robot.parts)
        header.update(_whereabouts(skins, meshes, poses, close=close))
        arrays: dict[str, NDArray[Any]] = {"poses": pack_poses(poses, self.links)}
        header["links"] = _add_body(arrays, meshes, self.links)
        header["parts"] = _add_skins(arrays, skins, self.layers, self.links, taxels, vertices)
        self.packed = pack(header, arrays)

    @property
    def name(self) -> str:
        """Another one for another scene: a page that is open must be loaded anew then."""
        return hashlib.sha256(self.packed).hexdigest()[:16]


def first_rows(sizes: Iterable[int]) -> list[int]:
    """Where each of several arrays begins when they follow each other, and where all end."""
    return [0, *np.cumsum(list(sizes)).tolist()]


def pack_poses(poses: Mapping[str, FloatArray], links: Iterable[str]) -> NDArray[np.float32]:
    """(k, 4, 4) T_root_link of some links, column by column as WebGL wants it."""
    return np.stack([poses[link].T for link in links]).astype(np.float32)


def _whereabouts(
    skins: Mapping[str, PreparedSkin],
    meshes: Mapping[str, pv.PolyData],
    poses: Mapping[str, FloatArray],
    *,
    close: bool,
) -> dict[str, Any]:
    """Middle and size [m] of what the camera frames, and from where most of the skin is seen.

    That is all that is shown; with `close`, the links that carry the skins alone. `reach` is how
    far the rest lies away at most.
    """
    placed = [transform_points(poses[link], np.asarray(m.points)) for link, m in meshes.items()]
    normals = [np.zeros((1, 3))]
    for skin in skins.values():
        placed.append(transform_points(poses[skin.skin.link], skin.skin.positions))
        normals.append(transform_directions(poses[skin.skin.link], skin.skin.normals))
    points = np.concatenate([p for p in placed if len(p)] or [np.zeros((1, 3))])
    far = points
    if close:
        carriers = {skin.skin.link for skin in skins.values()}
        near = [one for link, one in zip(meshes, placed, strict=False) if link in carriers]
        points = np.concatenate([*near, *placed[len(meshes) :]])
    low, high = points.min(axis=0), points.max(axis=0)
    reach = np.linalg.norm(far - (low + high) / 2, axis=1).max()
    front = front_view(np.concatenate(normals))
    mean = np.concatenate(normals).mean(axis=0)
    rise = front.elevation
    if not meshes and np.linalg.norm(mean) > LEANING:  # skin alone is looked at from above it
        rise = float(np.clip(np.degrees(np.arcsin(mean[2] / np.linalg.norm(mean))), -70.0, 70.0))
    return {
        "middle": ((low + high) / 2).tolist(),
        "size": (high - low).tolist(),
        "reach": max(float(reach), float(np.linalg.norm(high - low))),
        "front": [front.azimuth, rise],
    }


def _add_body(
    arrays: dict[str, NDArray[Any]], meshes: Mapping[str, pv.PolyData], names: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Add all link meshes one behind the other; where each of them is comes back."""
    links, points, normals, faces, start, first = [], [], [], [], 0, 0
    for link in names:
        mesh = meshes.get(link)
        if mesh is None or mesh.n_cells == 0:
            links.append({"name": link, "first": first, "count": 0})
            continue
        triangles = triangles_of(mesh)
        points.append(np.asarray(mesh.points, np.float32))
        normals.append(as_bytes(np.asarray(mesh.point_normals)))
        faces.append(triangles + start)
        links.append({"name": link, "first": first, "count": triangles.size})
        start += len(points[-1])
        first += triangles.size
    for key, some, kind in (
        ("points", points, np.float32), ("normals", normals, np.int8), ("faces", faces, np.uint32),
    ):  # fmt: skip
        flat = [np.zeros(0), *(array.ravel() for array in some)]
        arrays[f"body.{key}"] = np.concatenate(flat).astype(kind)
    return links


def _add_skins(
    arrays: dict[str, NDArray[Any]],
    skins: Mapping[str, PreparedSkin],
    layers: Mapping[str, SkinLayer],
    names: tuple[str, ...],
    taxels: list[int],
    vertices: list[int],
) -> list[dict[str, Any]]:
    """Add sheets, shells, taxels and flat maps of all parts; where each of them is comes back."""
    parts: list[dict[str, Any]] = []
    kept: defaultdict[str, list[NDArray[Any]]] = defaultdict(list)
    shell_start = seam_start = 0
    for place, (part, skin) in enumerate(skins.items()):
        layer, start = layers[part], vertices[place]
        flat = flat_places(skin.flat, layer.fine, np.inf)
        # Of each vertex one place; its others, at a seam, follow the vertices of all parts.
        one_of, number = np.unique(flat.vertex, return_index=True)[1], flat.vertex + start
        others = np.setdiff1d(np.arange(len(number)), one_of)
        number[others] = vertices[-1] + seam_start + np.arange(len(others))
        uv, taxel_uv = flat.points[:, :2], np.nan_to_num(skin.flat.uv)
        twice = np.flatnonzero((flat.centres[:, :2] != taxel_uv[flat.taxels]).any(axis=1))
        own: dict[str, NDArray[Any]] = {
            "sheet.points": layer.points.astype(np.float32),
            "sheet.normals": as_bytes(layer.fine.normals),
            "sheet.faces": (layer.fine.faces + start).astype(np.uint32),
            "sheet.uv": uv[one_of].astype(np.float32),
            "seam.uv": uv[others].astype(np.float32),
            "seam.vertices": (flat.vertex[others] + start).astype(np.uint32),
            "seam.dots": flat.centres[twice, :2].astype(np.float32),
            "seam.taxels": (flat.taxels[twice] + taxels[place]).astype(np.uint32),
            "flat.faces": number[flat.faces].astype(np.uint32),
            "flat.border": number[border_edges(flat.faces)].astype(np.uint32),
            "shell.points": np.asarray(layer.shell.points, np.float32),
            "shell.faces": (triangles_of(layer.shell) + shell_start).astype(np.uint32),
            "taxel.points": layer.places.centres.astype(np.float32),
            "taxel.normals": as_bytes(skin.skin.normals),
            "taxel.uv": taxel_uv.astype(np.float32),
            "taxel.channels": skin.skin.channels.astype(np.int32),
            "taxel.modules": skin.skin.modules.astype(np.int32),
            "taxel.patches": skin.patches.astype(np.int32),
        }
        grid = taxel_grid(skin.flat)
        own |= _contact_image(grid, taxels[place])
        spacing = skin.skin.spacing
        one: dict[str, Any] = {
            "name": part,
            "link": names.index(skin.skin.link),
            "taxels": [taxels[place], len(skin)],
            "vertices": [start, len(layer.points)],
            "spacing": spacing,
            "scale": layer.places.scale,
            "dot": DOT_SHARE * spacing,
            "patches": len(skin.flat.charts),
            "image": sorted(grid.shape),  # rows and columns: it lies, as for classifiers
        }
        for key in (
            "sheet.faces", "flat.faces", "shell.faces", "flat.border", "image.pixels", "seam.taxels"
        ):  # fmt: skip
            first = sum(array.size for array in kept[key])
            one[key.replace(".", "_")] = [first, own[key].size]
        for key, array in own.items():
            kept[key].append(array.ravel())
        shell_start += len(layer.shell.points)
        seam_start += len(others)
        parts.append(one)
    arrays |= {key: np.concatenate(several) for key, several in kept.items()}
    smooth = csr_array(block_diag([layer.fine.smooth for layer in layers.values()], format="csr"))
    arrays["smooth.starts"] = smooth.indptr.astype(np.uint32)
    arrays["smooth.taxels"] = smooth.indices.astype(np.uint32)
    arrays["smooth.weights"] = smooth.data.astype(np.float32)
    return parts


def _contact_image(grid: ContactImageGeometry, start: int) -> dict[str, NDArray[Any]]:
    """Pixels of a part's contact image, the three taxels under each and their weights in 1/255.

    An image that stands is turned by a quarter, its top to the right, as in `paper_images`.
    """
    (rows, columns), (row, column) = grid.shape, np.divmod(grid.pixels, grid.shape[1])
    pixels = column * rows + rows - 1 - row if rows > columns else grid.pixels
    return {
        "image.pixels": pixels.astype(np.uint32),
        "image.taxels": (grid.columns.astype(np.int64) + start).astype(np.uint32),
        "image.weights": np.rint(255.0 * grid.weights).astype(np.uint8),
    }


def triangles_of(mesh: pv.PolyData) -> IntArray:
    """(m, 3) corners of a triangle mesh."""
    return np.asarray(mesh.regular_faces, np.int64)


def as_bytes(normals: FloatArray) -> NDArray[np.int8]:
    """(n, 4) unit vectors (n, 3) in steps of 1/127, and a zero: WebGL likes multiples of 4."""
    return np.pad(np.rint(127 * np.asarray(normals)), ((0, 0), (0, 1))).astype(np.int8)
