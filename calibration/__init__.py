"""Calibration of skins: where every taxel is, how sure, and whether it works.

The names below are loaded on first use, so that `import calibration` costs next to nothing.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

_PUBLIC = {
    "MountFit": "calibration.mount",
    "PatchCalibration": "calibration.patch",
    "ResponseCalibration": "calibration.response",
    "ScanRegistration": "calibration.scan",
    "SelfTouchFit": "calibration.self_touch",
    "Status": "calibration.patch",
    "Touch": "calibration.touch",
    "TouchSession": "calibration.touch_session",
    "fit_mount": "calibration.mount",
    "fit_wrench": "calibration.wrench",
    "locate_by_touch": "calibration.touch",
    "register_scan": "calibration.scan",
    "self_touch": "calibration.self_touch",
    "wrap_layout": "calibration.wrap",
}
__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'calibration' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])


class _Package(ModuleType):
    """The package itself: its `self_touch` is the function, not the module that holds it."""

    def __setattr__(self, name: str, value: object) -> None:
        # What the import system does with every module of a package that it has loaded.
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
