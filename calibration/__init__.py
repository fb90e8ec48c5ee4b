"""Calibration of skins: position of each taxel, with its confidence, and response.

The names below are loaded on first use, so that `import calibration` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

_PUBLIC = {
    "Chain": "calibration.mount.chains",
    "MountFit": "calibration.mount.rigid_mount",
    "PatchCalibration": "calibration.patch.patch_calibration",
    "Plane": "calibration.plane.contacts",
    "PlaneContacts": "calibration.plane.contacts",
    "PlaneFit": "calibration.plane.fit",
    "ResponseCalibration": "calibration.response.response",
    "ScanRegistration": "calibration.scan.registration",
    "SelfTouchFit": "calibration.mount.skin_contacts",
    "Status": "calibration.patch.patch_calibration",
    "Touch": "calibration.patch.touch",
    "TouchRecording": "calibration.mount.chains",
    "TouchSession": "calibration.patch.touch_session",
    "fit_mount": "calibration.mount.rigid_mount",
    "fit_plane": "calibration.plane.fit",
    "fit_wrench": "calibration.mount.wrench",
    "locate_by_touch": "calibration.patch.touch",
    "register_scan": "calibration.scan.registration",
    "robot_chain": "calibration.mount.robot_chains",
    "self_touch": "calibration.mount.skin_contacts",
    "wrap_layout": "calibration.patch.wrap",
}
__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'calibration' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
