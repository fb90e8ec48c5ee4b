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

from skinmap.io.output import staged_file
from skinmap.live.moment import Moment
from viewer.scene import Scene
from viewer.web.files import joined_scripts, page_text
from viewer.web.sample import pack_reel
from viewer.web.scene_data import make_scene

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
    web = make_scene(scene.robot, skins, angles=scene.angles, links=links, cell=CELL)
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
        As `make_scene` and `pack_reel` pack them.
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
