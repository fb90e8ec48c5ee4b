"""The viewer: skins, pressures and named touches on the robot's body.

The names below are loaded on first use, so that `import viewer` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

_PUBLIC = {
    "Layers": "viewer.layers",
    "Player": "viewer.playing.player",
    "Scene": "viewer.scene",
    "play": "viewer.window",
    "serve": "viewer.web.server",
    "stepwise": "viewer.playing.player",
    "write_gltf": "viewer.export.gltf",
    "write_html": "viewer.export.html_page",
    "write_movie": "viewer.export.movie",
}
__all__ = [*_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
