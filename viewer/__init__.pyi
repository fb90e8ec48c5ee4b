"""Names of the viewer, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from viewer.export.html_page import write_gltf as write_gltf
from viewer.export.html_page import write_html as write_html
from viewer.layers import Layers as Layers
from viewer.playing.player import Player as Player
from viewer.scene import Scene as Scene
from viewer.view_files import write_movie as write_movie
from viewer.web.server import serve as serve
from viewer.window import play as play

__all__ = [
    "Layers",
    "Player",
    "Scene",
    "play",
    "serve",
    "write_gltf",
    "write_html",
    "write_movie",
]
