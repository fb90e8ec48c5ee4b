"""Names of skinmap, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from calibration.mount.rigid_mount import MountFit as MountFit
from calibration.mount.rigid_mount import fit_mount as fit_mount
from calibration.mount.rigid_mount import fit_wrench as fit_wrench
from calibration.mount.skin_contacts import SelfTouchFit as SelfTouchFit
from calibration.mount.skin_contacts import self_touch as self_touch
from calibration.patch.patch_calibration import PatchCalibration as PatchCalibration
from calibration.patch.placing import Touch as Touch
from calibration.patch.placing import locate_by_touch as locate_by_touch
from calibration.patch.placing import wrap_layout as wrap_layout
from calibration.plane.fit import PlaneFit as PlaneFit
from calibration.plane.fit import fit_plane as fit_plane
from calibration.response.response import ResponseCalibration as ResponseCalibration
from calibration.scan.registration import ScanRegistration as ScanRegistration
from calibration.scan.registration import register_scan as register_scan
from skinmap import errors as errors
from skinmap.errors import DataFormatError as DataFormatError
from skinmap.errors import FlatteningError as FlatteningError
from skinmap.errors import InvalidArrayError as InvalidArrayError
from skinmap.errors import InvalidMeshError as InvalidMeshError
from skinmap.errors import MissingFileError as MissingFileError
from skinmap.errors import MissingLibraryError as MissingLibraryError
from skinmap.errors import NotFittedError as NotFittedError
from skinmap.errors import OutputError as OutputError
from skinmap.errors import SkinError as SkinError
from skinmap.errors import SkinMismatchError as SkinMismatchError
from skinmap.errors import SkinWarning as SkinWarning
from skinmap.errors import UnknownNameError as UnknownNameError
from skinmap.errors import UnreachableError as UnreachableError
from skinmap.errors import WrongTypeError as WrongTypeError
from skinmap.flat.flat_map import Chart as Chart
from skinmap.flat.flat_map import FlatMap as FlatMap
from skinmap.flat.flat_map import flatten as flatten
from skinmap.front import classifiers as classifiers
from skinmap.front import flatteners as flatteners
from skinmap.front import gestures as gestures
from skinmap.front import robots as robots
from skinmap.io.recordings.touch_files import load_recordings as load_recordings
from skinmap.io.recordings.touch_files import save_recordings as save_recordings
from skinmap.io.robots.manifest import load_robot as load_robot
from skinmap.live.contacts.named_touch import Moment as Moment
from skinmap.live.contacts.named_touch import NamedTouch as NamedTouch
from skinmap.live.contacts.named_touch import TouchEvent as TouchEvent
from skinmap.live.loop import TouchLoop as TouchLoop
from skinmap.live.recording.recorder import Recorded as Recorded
from skinmap.live.recording.recorder import record as record
from skinmap.live.sources.open_source import open_source as open_source

# What they return or raise, and two names for what has another one since.
from skinmap.live.sources.source import Block as Block
from skinmap.live.sources.source import Source as Source
from skinmap.live.sources.source import StreamInfo as StreamInfo
from skinmap.neighbours.structures import Structures as Structures
from skinmap.neighbours.structures import find_structures as find_structures

# What users call and hold; each with its parameters, what it returns, and an example.
from skinmap.recognition.classifier import Classifier as Classifier
from skinmap.recognition.classifier import Prediction as Prediction
from skinmap.recognition.model_file import load_classifier as load_classifier
from skinmap.recognition.named_classifiers import default_model as default_model
from skinmap.recognition.naming import ClassifiedTouch as ClassifiedTouch
from skinmap.recognition.naming import classify as classify
from skinmap.recognition.training import train as train
from skinmap.skin.robot import Robot as Robot
from skinmap.skin.skin import Skin as Skin
from skinmap.soundness.examination import examine as examine
from skinmap.surface.surface_mesh import SurfaceMesh as SurfaceMesh
from skinmap.surface.surface_mesh import build_surface as build_surface
from skinmap.touch.contacts.skin_geometry import Contacts as Contacts
from skinmap.touch.contacts.skin_geometry import find_contacts as find_contacts
from skinmap.touch.histograms.codebook import Codebook as Codebook
from skinmap.touch.histograms.codebook import histograms as histograms
from skinmap.touch.histograms.codebook import learn_codebook as learn_codebook
from skinmap.touch.images.contact_image import contact_image as contact_image
from skinmap.touch.recording import Recording as Recording
from skinmap.touch.simulation.simulator import simulate as simulate
from viewer.picture import show as show
from viewer.scene import Scene as Scene

__version__: str
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
    "classifiers",
    "classify",
    "contact_image",
    "default_model",
    "errors",
    "examine",
    "find_contacts",
    "find_structures",
    "fit_mount",
    "fit_plane",
    "fit_wrench",
    "flatten",
    "flatteners",
    "gestures",
    "histograms",
    "learn_codebook",
    "load_recordings",
    "load_robot",
    "locate_by_touch",
    "open_source",
    "record",
    "register_scan",
    "robots",
    "save_recordings",
    "self_touch",
    "show",
    "simulate",
    "train",
    "wrap_layout",
]
