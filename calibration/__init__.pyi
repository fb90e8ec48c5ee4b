"""Names of calibration, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from calibration.mount.chains import Chain as Chain
from calibration.mount.chains import TouchRecording as TouchRecording
from calibration.mount.chains import robot_chain as robot_chain
from calibration.mount.rigid_mount import MountFit as MountFit
from calibration.mount.rigid_mount import fit_mount as fit_mount
from calibration.mount.rigid_mount import fit_wrench as fit_wrench
from calibration.mount.skin_contacts import SelfTouchFit as SelfTouchFit
from calibration.mount.skin_contacts import self_touch as self_touch
from calibration.patch.patch_calibration import PatchCalibration as PatchCalibration
from calibration.patch.patch_calibration import Status as Status
from calibration.patch.placing import Touch as Touch
from calibration.patch.placing import locate_by_touch as locate_by_touch
from calibration.patch.placing import wrap_layout as wrap_layout
from calibration.plane.fit import PlaneFit as PlaneFit
from calibration.plane.fit import fit_plane as fit_plane
from calibration.plane.model import Plane as Plane
from calibration.plane.model import PlaneContacts as PlaneContacts
from calibration.response.response import ResponseCalibration as ResponseCalibration
from calibration.scan.registration import ScanRegistration as ScanRegistration
from calibration.scan.registration import register_scan as register_scan

__all__ = [
    "Chain",
    "MountFit",
    "PatchCalibration",
    "Plane",
    "PlaneContacts",
    "PlaneFit",
    "ResponseCalibration",
    "ScanRegistration",
    "SelfTouchFit",
    "Status",
    "Touch",
    "TouchRecording",
    "fit_mount",
    "fit_plane",
    "fit_wrench",
    "locate_by_touch",
    "register_scan",
    "robot_chain",
    "self_touch",
    "wrap_layout",
]
