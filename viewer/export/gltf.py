"""A scene as one glTF file: links and skins as nodes, each at its pose, taxels in their colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinmap.io.output import staged_file
from viewer.colours import BODY, rgb
from viewer.export.solids import Solid, body_solids, disc_solid, skin_colours
from viewer.scene import Scene

# glTF's y points up, a robot's z.
T_GLTF_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


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
        colours[:, :3] = skin_colours(scene, part)[taxels]
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
    graph.add_geometry(
        mesh,
        node_name=f"skin {solid.name}" if solid.name in scene.layers else solid.name,
        geom_name=f"skin {solid.name}" if solid.name in scene.layers else solid.name,
        transform=T_GLTF_WORLD @ scene.poses[solid.link],
    )
