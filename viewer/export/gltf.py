"""A scene as one glTF file: links and skins as nodes, each at its pose, taxels in their colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyvista as pv

from skinmap.io.output import staged_file
from viewer.colours import BODY, rgb
from viewer.drawing.body.bare_body import body_meshes
from viewer.drawing.skin.draw_positions import LIFT, polygons
from viewer.drawing.skin.taxel_drawing import set_normals
from viewer.scene import Scene

# glTF's y points up, a robot's z.
T_GLTF_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
CORNERS = 6
CELL = 3e-3  # vertices of the body within so much become one: files stay small [m]
DISC_SHARE = 0.46  # a disc's radius in spacings: neighbours do not touch


def write_gltf(scene: Scene, path: Path) -> Path:
    """Write what a scene shows now as a binary glTF 2.0 file.

    Parameters
    ----------
    scene : Scene
    path : Path
        Ends in .glb.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.

    Examples
    --------
    >>> from viewer import Scene, write_gltf
    >>> write_gltf(Scene.load("kaspar", ["torso"]), Path("torso.glb")).name
    'torso.glb'
    """
    import trimesh

    graph = trimesh.Scene(base_frame="world")

    def add(name: str, link: str, mesh: pv.PolyData, colours: np.ndarray) -> None:
        solid = trimesh.Trimesh(
            np.asarray(mesh.points, np.float64),
            np.asarray(mesh.triangulate().regular_faces, np.int64),
            vertex_normals=np.asarray(mesh.point_data["Normals"], np.float64),
            vertex_colors=colours,
            process=False,
        )
        placed = T_GLTF_WORLD @ scene.poses[link]
        graph.add_geometry(solid, node_name=name, geom_name=name, transform=placed)

    body = np.round(255 * rgb(BODY)).astype(np.uint8)
    for link, mesh in body_meshes(scene.robot, scene.canvas.body.links, cell=CELL).items():
        if mesh.n_cells:
            add(link, link, mesh, np.tile(body, (mesh.n_points, 1)))
    for part, drawn in scene.layers.items():
        skin = drawn.skin
        radius = DISC_SHARE * skin.spacing
        discs = polygons(
            skin.positions + LIFT * drawn.places.scale * skin.normals, skin.normals, radius
        )
        set_normals(discs, np.repeat(skin.normals, CORNERS, axis=0))
        colours = scene.layer.colours(scene.layer.values(part, scene.moment))
        add(f"skin {part}", skin.link, discs, np.repeat(colours, CORNERS, axis=0))
    with staged_file(path) as stage:
        stage.write_bytes(graph.export(file_type="glb"))
    return path
