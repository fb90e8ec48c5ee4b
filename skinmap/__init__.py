"""Skinmap: from a robot's meshes and taxel positions to named touches on its skin.

The names below are loaded on first use, so that `import skinmap` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "build_surface": ("skinmap.surface.surface_mesh", "build_surface"),
    "flatten": ("skinmap.flat.flat_map", "flatten"),
    "flatteners": ("skinmap.flat.methods", "flattener_names"),
    "load_classifier": ("skinmap.classify.model_file", "load_classifier"),
    "load_robot": ("skinmap.io.robots.manifest", "load_robot"),
    "show": ("viewer.notebook", "show"),
}
__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        module, attribute = _PUBLIC[name]
        return getattr(importlib.import_module(module), attribute)
    raise AttributeError(f"module 'skinmap' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
