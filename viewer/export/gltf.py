"""A scene as one glTF file: links and skins as nodes, each at its pose, taxels in their colours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.triangles import unit
from skinmap.io.output import staged_file
from skinmap.skin.skin import Skin
from viewer.colours import BODY, rgb
from viewer.drawing.body.bare_body import body_meshes
from viewer.scene import Scene

# glTF's y points up, a robot's z.
T_GLTF_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
CORNERS = 6
CELL = 3e-3  # vertices of the body within so much become one: files stay small [m]
DISC_SHARE = 0.46  # a disc's radius in spacings: neighbours do not touch
LIFT = 2.0e-3  # of discs above the taxels [m]


def write_gltf(scene: Scene, path: Path) -> Path:
    """Write what a scene shows now as a binary glTF 2.0 file.

    Parameters
    ----------
    scene : Scene
    path : Path
        Ends in .glb.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    import trimesh

    graph = trimesh.Scene(base_frame="world")
    body = np.append(np.round(255 * rgb(BODY)), 255).astype(np.uint8)
    for solid in body_solids(scene):
        _add(graph, scene, solid, np.tile(body, (len(solid.vertices), 1)))
    for part, drawn in scene.layers.items():
        solid, taxels = disc_solid(drawn.skin)
        colours = np.full((len(taxels), 4), 255, np.uint8)
        colours[:, :3] = scene.layer.colours(scene.layer.values(part, scene.moment))[taxels]
        _add(graph, scene, solid, colours)
    with staged_file(path) as stage:
        stage.write_bytes(graph.export(file_type="glb"))
    return path


def _add(graph: object, scene: Scene, solid: Solid, colours: np.ndarray) -> None:
    import trimesh

    mesh = trimesh.Trimesh(
        solid.vertices,
        solid.faces,
        vertex_normals=solid.normals,
        vertex_colors=colours,
        process=False,
    )
    assert isinstance(graph, trimesh.Scene)
    name = f"skin {solid.name}" if solid.name in scene.layers else solid.name
    placed = T_GLTF_WORLD @ scene.poses[solid.link]
    graph.add_geometry(mesh, node_name=name, geom_name=name, transform=placed)


@dataclass(frozen=True, eq=False, slots=True)
class Solid:
    """Triangles of one link or of one part's taxels, in the frame of the link.

    Attributes
    ----------
    name, link : str
    vertices, normals : (v, 3) float
        [m], unit.
    faces : (m, 3) int
    """

    name: str
    link: str
    vertices: FloatArray
    normals: FloatArray
    faces: IntArray


def body_solids(scene: Scene) -> list[Solid]:
    """The links that the scene draws."""
    meshes = body_meshes(scene.robot, scene.canvas.body.links, cell=CELL)
    return [_solid(link, mesh) for link, mesh in meshes.items() if mesh.n_cells]


def _solid(link: str, mesh: pv.PolyData) -> Solid:
    faces = np.asarray(mesh.triangulate().regular_faces, np.int64)
    normals = np.asarray(mesh.point_data["Normals"], np.float64)
    return Solid(link, link, np.asarray(mesh.points, np.float64), normals, faces)


def disc_solid(skin: Skin) -> tuple[Solid, IntArray]:
    """A hexagon for each taxel (n of them), and the taxel (6 n,) of each of its corners."""
    n = len(skin)
    radius = DISC_SHARE * median_spacing(skin.positions)
    least = np.eye(3)[np.argmin(np.abs(skin.normals), axis=1)]
    right = unit(np.cross(skin.normals, least))
    up = np.cross(skin.normals, right)
    angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
    ring = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    corners = (skin.positions + LIFT * skin.normals)[:, None] + radius * ring
    fan = np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)])
    faces = (CORNERS * np.arange(n)[:, None, None] + fan).reshape(-1, 3)
    normals = np.repeat(skin.normals, CORNERS, axis=0)
    solid = Solid(skin.part, skin.link, corners.reshape(-1, 3), normals, faces)
    return solid, np.repeat(np.arange(n), CORNERS)
