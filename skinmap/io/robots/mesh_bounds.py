"""Bounds of what a mesh file unfolds to, looked at before anything is made of it.

GLB and COLLADA name a mesh once and show it at any number of places, and GLB has arrays of zeros
that are not in the file: without a bound a few hundred bytes would fill any memory.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from skinmap.errors import DataFormatError
from skinmap.io.safe_xml import local_name

MAX_UNFOLDED = 1_000_000  # vertices, or as many as the file has bytes
MAX_PLACES = 10_000  # at which meshes are shown: the largest link has some hundred screws
GLB_HEAD = struct.Struct("<12xI4x")  # of the file and of its first chunk, which is JSON


def check_gltf(path: Path) -> None:
    """Refuse a .glb or .gltf whose arrays claim more numbers than a mesh may have.

    Raises
    ------
    DataFormatError
    """
    length = path.stat().st_size
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            (length,) = GLB_HEAD.unpack(file.read(GLB_HEAD.size))
        head = json.loads(file.read(min(length, path.stat().st_size)))
    _check(max((int(one["count"]) for one in head.get("accessors", ())), default=0), path)


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
