"""Mesh files of links, through trimesh and as binary PLY.

What a file unfolds to is bounded before anything is made of it: GLB and COLLADA name a mesh once
and show it at any number of places, and GLB has arrays of zeros that are not in the file. Without a
bound a few hundred bytes would fill any memory.
"""

from __future__ import annotations

import json
import struct
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.disk_cache import Ingredient, cached
from skinmap.errors import DataFormatError, check_kind
from skinmap.geometry.triangles import TriangleMesh
from skinmap.interrupts import import_whole
from skinmap.io.safe_xml import local_name, read_xml
from skinmap.io.text import check_file

# trimesh reads more, archives and scene formats among them, that may name or unpack other files.
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf", ".off")
MAX_MESH_BYTES = 512 * 2**20
# Kept once read: files that say all themselves (a .gltf names others). Small ones too: what reads
# them takes half a second to import.
WHOLE = (".stl", ".obj", ".ply", ".dae", ".glb", ".off")
MAX_UNFOLDED = 1_000_000  # vertices, or as many as the file has bytes
MAX_PLACES = 10_000  # at which meshes are shown: the largest link has some hundred screws
GLB_HEAD = struct.Struct("<12xI4x")  # of the file and of its first chunk, which is JSON


def check_gltf(path: Path) -> None:
    """Refuse a .glb or .gltf that claims more numbers than a mesh may have, or names other files.

    Raises
    ------
    DataFormatError
        Too many numbers, or a buffer or picture that is neither in the file itself nor a file of at
        most 512 MB beside it.
    """
    length = path.stat().st_size
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            (length,) = GLB_HEAD.unpack(file.read(GLB_HEAD.size))
        head = json.loads(file.read(min(length, path.stat().st_size)))
    _check(max((int(one["count"]) for one in head.get("accessors", ())), default=0), path)
    for one in (*head.get("buffers", ()), *head.get("images", ())):
        uri = str(one.get("uri", "data:"))
        if uri.startswith("data:"):
            continue
        named = path.parent / uri
        plain = all(Path(name).name == name for name in (uri, unquote(uri)))
        if not plain or named.resolve().parent != path.parent.resolve():
            raise DataFormatError(f"names {uri!r}, which is not a file beside it", path)
        check_file(named, f"a part of {path.name}", MAX_MESH_BYTES)


def check_collada(root: Any, path: Path) -> None:
    """Refuse a COLLADA file whose nodes show more vertices than a mesh may have.

    Raises
    ------
    DataFormatError
    """
    shapes = {
        f"#{shape.get('id')}": max(
            ((one.text or "").count(" ") // 3 + 1 for one in shape.iter("{*}float_array")),
            default=0,
        )
        for shape in root.iter("{*}geometry")
    }
    nodes = {f"#{node.get('id')}": node for node in root.iter("{*}node")}
    known: dict[str, int] = {}  # nodes are shown by other nodes, which may double at each step

    def shown(element: Any) -> int:
        total = 0
        for child in element:
            kind, url = local_name(child), child.get("url", "")
            if kind in ("instance_geometry", "instance_controller"):
                total += shapes.get(url, 0)
            elif kind == "instance_node" and url in nodes:
                if url not in known:
                    known[url] = shown(nodes[url])
                total += known[url]
            elif kind == "node":
                total += shown(child)
        return total

    _check(max(map(shown, root.iter("{*}visual_scene")), default=0), path)


def check_scene(scene: Any, path: Path) -> None:
    """Refuse a trimesh scene that shows too many vertices, or meshes at too many places.

    Raises
    ------
    DataFormatError
    """
    shown = {name: len(places) for name, places in scene.graph.geometry_nodes.items()}
    if sum(shown.values()) > MAX_PLACES:
        raise DataFormatError(
            f"meshes at {sum(shown.values()):,} places; at most {MAX_PLACES:,} are read", path
        )
    _check(sum(len(scene.geometry[name].vertices) * n for name, n in shown.items()), path)


def _check(vertices: int, path: Path) -> None:
    most = max(MAX_UNFOLDED, path.stat().st_size)
    if vertices > most:
        raise DataFormatError(
            f"unfolds to {vertices:,} vertices; at most {most:,} are read of a file of its size",
            path,
        )


def read_mesh(path: Path, *, merge: bool = True) -> tuple[FloatArray, np.ndarray]:
    r"""Vertices and faces of a mesh file, through trimesh.

    Parameters
    ----------
    path : Path
        A file in one of the formats `MESH_SUFFIXES`.
    merge : bool
        Whether vertices that are closer than 1e-8 units are joined; right for robots, whose unit is
        known.

    Returns
    -------
    vertices : (n, 3) array of float
        In the units of the file, see `file_metres`.
    faces : (m, 3) array of int

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not a mesh that can be read, one without a triangle, or above 512 MB.

    Examples
    --------
    >>> from pathlib import Path
    >>> from skinmap.io import read_mesh
    >>> _ = Path("one.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    >>> vertices, faces = read_mesh(Path("one.off"))
    >>> vertices.shape, faces.tolist()
    ((3, 3), [[0, 1, 2]])
    """
    check_file(path, "a mesh", MAX_MESH_BYTES)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        check_kind(path, "a mesh")
        raise DataFormatError(f"not a mesh; the formats are: {', '.join(MESH_SUFFIXES)}", path)

    def parse() -> dict[str, np.ndarray]:
        vertices, faces = _parsed(path, merge)
        return {"vertices": vertices, "faces": faces}

    if suffix not in WHOLE:
        made = parse()
    else:
        what: list[Ingredient] = [path.read_bytes(), suffix, merge]
        made = cached("mesh", what, parse, made_by=("trimesh", "pycollada"))
    return made["vertices"], made["faces"]


def file_metres(path: Path) -> float | None:
    """Metres in a unit of a mesh file; None where it states none, as all but COLLADA."""
    if path.suffix.lower() != ".dae":
        return None

    def stated() -> dict[str, np.ndarray]:
        root = read_xml(path, "a COLLADA mesh", MAX_MESH_BYTES)
        units = list(root.iterfind("{*}asset/{*}unit"))[:1]
        try:
            return {"metres": np.array([float(one.get("meter", "1")) for one in units])}
        except ValueError:
            return {"metres": np.full(1, np.nan)}

    metres: FloatArray = cached("mesh_unit", [path.read_bytes()], stated)["metres"]
    if not ((metres > 0.0) & (metres < np.inf)).all():
        raise DataFormatError("its unit is not a length in metres", path)
    return float(metres[0]) if len(metres) else None


def _parsed(path: Path, merge: bool) -> tuple[FloatArray, np.ndarray]:
    trimesh = import_whole("trimesh")
    if (suffix := path.suffix.lower()) == ".dae":
        root = read_xml(path, "a COLLADA mesh", MAX_MESH_BYTES)  # COLLADA is XML with all its doors
    try:
        if suffix == ".dae":
            check_collada(root, path)
        elif suffix in (".glb", ".gltf"):
            check_gltf(path)
        # Merging casts to whole numbers; parsers warn of dates and names that no mesh needs.
        with np.errstate(over="ignore", invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(str(path), process=merge)
            check_scene(scene, path)
            mesh = scene.to_mesh()
        vertices = np.asarray(mesh.vertices, np.float64)
        faces = np.asarray(mesh.faces, np.int64)
    except DataFormatError:
        raise
    except Exception as error:  # each format has its own kinds of failure
        raise DataFormatError(f"not a mesh that can be read: {error}", path) from error
    if not np.isfinite(vertices).all():
        raise DataFormatError("a mesh with NaN or infinity among its vertices", path)
    if len(faces) == 0:
        raise DataFormatError(
            "a mesh without triangles: empty, cut short, points alone or with NaN in it", path
        )
    return vertices, faces


def write_mesh(mesh: TriangleMesh, path: Path) -> None:
    """Write a mesh as binary PLY: single-precision vertices [m], then triangles.

    Vertices are shared, so it is a third of an STL.
    """
    whole = import_whole("trimesh").Trimesh(mesh.vertices, mesh.faces, process=False)
    export = import_whole("trimesh.exchange.ply").export_ply
    path.write_bytes(export(whole, vertex_normal=False, include_attributes=False))
