"""A scene as one file that holds everything itself: the page of `viewer.web`, scene and moments.

The page's own scripts and style stand in it, and its policy allows those alone, by their hashes:
nothing is asked of anybody.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyvista as pv

from skinmap.io.output import staged_file
from skinmap.live.contacts.named_touch import Moment
from viewer.colours import BODY, rgb
from viewer.drawing.body.bare_body import body_meshes
from viewer.drawing.skin.skin_layer import polygons
from viewer.drawing.skin.taxel_drawing import set_normals
from viewer.scene import Scene
from viewer.web.files import joined_scripts, page_text
from viewer.web.sample import pack_reel
from viewer.web.scene_data import WebScene

CELL = 4e-3  # of the body's meshes [m]: files stay small
HEAD = re.compile(r"<link rel=.*</script>\n", re.S)  # files that the served page brings


def write_html(
    scene: Scene,
    path: Path,
    *,
    moments: Sequence[Moment] = (),
    now: int | None = None,
    size: tuple[int, int] | None = None,
) -> Path:
    """Write what a scene shows now, with all layers to choose from.

    Parameters
    ----------
    scene : Scene
    path : Path
    moments : sequence of Moment
        To be played in the page; only what is shown now by default.
    now : int, optional
        Which of them is shown first; the last by default.
    size : (int, int), optional
        Width and height of the robot's picture [px]; as large as the page by default.

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
    >>> from viewer import Scene, write_html
    >>> write_html(Scene.load("kaspar", ["torso"]), Path("torso.html")).name
    'torso.html'
    """
    played = list(moments) or [scene.moment]
    first = len(played) - 1 if now is None else now
    skins = {part: scene.data.skins[part] for part in scene.layers}
    links = scene.canvas.body.links  # the same parts and links, in the same pose
    web = WebScene(scene.robot, skins, angles=scene.angles, links=links, cell=CELL)
    reel = pack_reel(
        web,
        scene.data,
        played,
        now=first,
        layer=scene.layer.name,
        style=scene.style,
        size=size,
    )
    with staged_file(path) as stage:
        stage.write_text(page(web.packed, reel, scene.robot.name), encoding="utf-8")
    return path


def page(scene: bytes, reel: bytes, title: str) -> str:
    """The page's file: its own text with scripts, style and data in it.

    Parameters
    ----------
    scene, reel : bytes
        As `WebScene` and `pack_reel` pack them.
    title : str
        Of the page until it has read the scene.
    """
    style, script = page_text("style.css"), joined_scripts()
    policy = (
        f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}; "
        "base-uri 'none'; form-action 'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style}</style>\n'
    )
    data = "".join(
        f'<script type="text/plain" id="{name}">{_text(message)}</script>\n'
        for name, message in (("scene", scene), ("reel", reel))
    )
    text, count = HEAD.subn("", page_text(""))
    if count != 1:
        raise RuntimeError("the page's files are not where they are looked for in its head")
    text = text.replace("<title>Skinmap", head + f"<title>{html.escape(title)} · Skinmap", 1)
    return text.replace("</body>", f"{data}<script>{script}</script>\n</body>", 1)


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _text(message: bytes) -> str:
    return base64.b64encode(zlib.compress(message, 9)).decode()


# A scene as one glTF file: links and skins as nodes, each at its pose, taxels in their colours.

# glTF's y points up, a robot's z.
T_GLTF_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
CORNERS = 6
WELDED = 3e-3  # vertices of the body within so much become one: files stay small [m]
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
    for link, mesh in body_meshes(scene.robot, scene.canvas.body.links, cell=WELDED).items():
        if mesh.n_cells:
            add(link, link, mesh, np.tile(body, (mesh.n_points, 1)))
    for part, drawn in scene.layers.items():
        skin = drawn.skin
        radius = DISC_SHARE * skin.spacing
        # Where the taxels are, not lifted as in pictures: the file is measured in.
        discs = polygons(skin.positions, skin.normals, radius)
        set_normals(discs, np.repeat(skin.normals, CORNERS, axis=0))
        colours = scene.layer.colours(scene.layer.values(part, scene.moment))
        add(f"skin {part}", skin.link, discs, np.repeat(colours, CORNERS, axis=0))
    with staged_file(path) as stage:
        stage.write_bytes(graph.export(file_type="glb"))
    return path
