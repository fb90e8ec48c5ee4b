"""Skinmap: from a robot's meshes and taxel positions to named touches on its skin.

Every name below is loaded on first use, so that `import skinmap` costs next to nothing. A table of
places, not entry points, leads to the packages above the core: all three come in one distribution,
a name has one place, and the table is checked against the imports that type checkers read.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.mount.rigid_mount import MountFit as MountFit
    from calibration.mount.rigid_mount import fit_mount
    from calibration.mount.skin_contacts import SelfTouchFit as SelfTouchFit
    from calibration.mount.skin_contacts import self_touch
    from calibration.mount.wrench import fit_wrench
    from calibration.patch.patch_calibration import PatchCalibration as PatchCalibration
    from calibration.patch.touch import Touch as Touch
    from calibration.patch.touch import locate_by_touch
    from calibration.patch.wrap import wrap_layout
    from calibration.plane.fit import PlaneFit as PlaneFit
    from calibration.plane.fit import fit_plane
    from calibration.response.response import ResponseCalibration
    from calibration.scan.registration import ScanRegistration as ScanRegistration
    from calibration.scan.registration import register_scan
    from skinmap import errors
    from skinmap.classify.classifier import Classifier
    from skinmap.classify.classifier import Prediction as Prediction
    from skinmap.classify.model_file import load_classifier as load_classifier
    from skinmap.classify.naming import ClassifiedTouch as ClassifiedTouch
    from skinmap.classify.naming import classify
    from skinmap.classify.training import train
    from skinmap.errors import (
        DataFormatError as DataFormatError,
    )
    from skinmap.errors import (
        FlatteningError as FlatteningError,
    )
    from skinmap.errors import (
        InvalidArrayError as InvalidArrayError,
    )
    from skinmap.errors import (
        InvalidMeshError as InvalidMeshError,
    )
    from skinmap.errors import (
        MissingFileError as MissingFileError,
    )
    from skinmap.errors import (
        MissingLibraryError as MissingLibraryError,
    )
    from skinmap.errors import (
        NotFittedError as NotFittedError,
    )
    from skinmap.errors import (
        OutputError as OutputError,
    )
    from skinmap.errors import (
        SkinError,
    )
    from skinmap.errors import (
        SkinMismatchError as SkinMismatchError,
    )
    from skinmap.errors import (
        SkinWarning as SkinWarning,
    )
    from skinmap.errors import (
        UnknownNameError as UnknownNameError,
    )
    from skinmap.errors import (
        UnreachableError as UnreachableError,
    )
    from skinmap.flat.flat_map import Chart as Chart
    from skinmap.flat.flat_map import FlatMap, flatten
    from skinmap.flat.methods import flattener_names as flatteners  # noqa: F401 - no keyword of its own name
    from skinmap.io.recordings.touch_files import load_recordings, save_recordings
    from skinmap.io.robots.manifest import load_robot
    from skinmap.live.contacts.events import TouchEvent as TouchEvent
    from skinmap.live.contacts.named_touch import NamedTouch as NamedTouch
    from skinmap.live.loop import TouchLoop
    from skinmap.live.moment import Moment as Moment
    from skinmap.live.recording.recording_tap import Recorded as Recorded
    from skinmap.live.recording.recording_tap import record
    from skinmap.live.sources.open_source import open_source
    from skinmap.live.sources.source import Block as Block
    from skinmap.live.sources.source import Source as Source
    from skinmap.live.sources.source import StreamInfo as StreamInfo
    from skinmap.neighbours.structures import Structures as Structures
    from skinmap.neighbours.structures import find_structures
    from skinmap.skin.robot import Robot
    from skinmap.skin.skin import Skin
    from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
    from skinmap.touch.codebook import Codebook as Codebook
    from skinmap.touch.codebook import learn_codebook
    from skinmap.touch.contact_image import contact_image
    from skinmap.touch.contacts import find_contacts
    from skinmap.touch.recording import Recording as Recording
    from skinmap.touch.simulator import simulate
    from skinmap.touch.votes import histograms
    from viewer.picture import show
    from viewer.scene import Scene

__version__ = "0.1.0"

# What users call and hold; each with its parameters, what it returns, and an example.
_NAMES = {
    "Classifier": "skinmap.classify.classifier",
    "FlatMap": "skinmap.flat.flat_map",
    "ResponseCalibration": "calibration.response.response",
    "Robot": "skinmap.skin.robot",
    "Scene": "viewer.scene",
    "Skin": "skinmap.skin.skin",
    "SurfaceMesh": "skinmap.surface.surface_mesh",
    "TouchLoop": "skinmap.live.loop",
    "build_surface": "skinmap.surface.surface_mesh",
    "classify": "skinmap.classify.naming",
    "contact_image": "skinmap.touch.contact_image",
    "find_contacts": "skinmap.touch.contacts",
    "find_structures": "skinmap.neighbours.structures",
    "fit_mount": "calibration.mount.rigid_mount",
    "fit_plane": "calibration.plane.fit",
    "fit_wrench": "calibration.mount.wrench",
    "flatten": "skinmap.flat.flat_map",
    "histograms": "skinmap.touch.votes",
    "learn_codebook": "skinmap.touch.codebook",
    "load_recordings": "skinmap.io.recordings.touch_files",
    "load_robot": "skinmap.io.robots.manifest",
    "locate_by_touch": "calibration.patch.touch",
    "open_source": "skinmap.live.sources.open_source",
    "record": "skinmap.live.recording.recording_tap",
    "register_scan": "calibration.scan.registration",
    "save_recordings": "skinmap.io.recordings.touch_files",
    "self_touch": "calibration.mount.skin_contacts",
    "show": "viewer.picture",
    "simulate": "skinmap.touch.simulator",
    "train": "skinmap.classify.training",
    "wrap_layout": "calibration.patch.wrap",
}
# What they return or raise, and two names for what has another one since.
_RETURNED = {
    "Block": "skinmap.live.sources.source",
    "Chart": "skinmap.flat.flat_map",
    "ClassifiedTouch": "skinmap.classify.naming",
    "Codebook": "skinmap.touch.codebook",
    "MountFit": "calibration.mount.rigid_mount",
    "Moment": "skinmap.live.moment",
    "NamedTouch": "skinmap.live.contacts.named_touch",
    "PatchCalibration": "calibration.patch.patch_calibration",
    "PlaneFit": "calibration.plane.fit",
    "Prediction": "skinmap.classify.classifier",
    "Recorded": "skinmap.live.recording.recording_tap",
    "Recording": "skinmap.touch.recording",
    "ScanRegistration": "calibration.scan.registration",
    "SelfTouchFit": "calibration.mount.skin_contacts",
    "Source": "skinmap.live.sources.source",
    "StreamInfo": "skinmap.live.sources.source",
    "Structures": "skinmap.neighbours.structures",
    "Touch": "calibration.patch.touch",
    "TouchEvent": "skinmap.live.contacts.events",
    "flatteners": "skinmap.flat.methods:flattener_names",
    "load_classifier": "skinmap.classify.model_file",
}
_ERRORS = (
    "DataFormatError",
    "FlatteningError",
    "InvalidArrayError",
    "InvalidMeshError",
    "MissingFileError",
    "MissingLibraryError",
    "NotFittedError",
    "OutputError",
    "SkinError",
    "SkinMismatchError",
    "SkinWarning",
    "UnknownNameError",
    "UnreachableError",
)
_PLACES = {**_NAMES, **_RETURNED, **dict.fromkeys(_ERRORS, "skinmap.errors")}
__all__ = [
    "Classifier",
    "FlatMap",
    "ResponseCalibration",
    "Robot",
    "Scene",
    "Skin",
    "SkinError",
    "SurfaceMesh",
    "TouchLoop",
    "__version__",
    "build_surface",
    "classify",
    "contact_image",
    "errors",
    "find_contacts",
    "find_structures",
    "fit_mount",
    "fit_plane",
    "fit_wrench",
    "flatten",
    "histograms",
    "learn_codebook",
    "load_recordings",
    "load_robot",
    "locate_by_touch",
    "open_source",
    "record",
    "register_scan",
    "save_recordings",
    "self_touch",
    "show",
    "simulate",
    "train",
    "wrap_layout",
]


def __getattr__(name: str) -> Any:
    if name == "errors":
        return importlib.import_module("skinmap.errors")
    if name not in _PLACES:
        raise AttributeError(f"module 'skinmap' has no attribute {name!r}")
    module, _, attribute = _PLACES[name].partition(":")
    return getattr(importlib.import_module(module), attribute or name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_PLACES])
