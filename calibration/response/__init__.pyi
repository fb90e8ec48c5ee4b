"""Names of the room, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from calibration.response.gain import Gain as Gain
from calibration.response.gain import ReferenceLoads as ReferenceLoads
from calibration.response.gain import fit_gain as fit_gain
from calibration.response.load_fit import LoadFit as LoadFit
from calibration.response.load_fit import Pressed as Pressed
from calibration.response.load_fit import fit_load as fit_load
from calibration.response.response import DriftTracker as DriftTracker
from calibration.response.response import Health as Health
from calibration.response.response import ResponseCalibration as ResponseCalibration
from calibration.response.response import load_response as load_response
from calibration.response.response import save_response as save_response
from skinmap.touch.load_calibration import LoadCalibration as LoadCalibration

__all__ = [
    "DriftTracker",
    "Gain",
    "Health",
    "LoadCalibration",
    "LoadFit",
    "Pressed",
    "ReferenceLoads",
    "ResponseCalibration",
    "fit_gain",
    "fit_load",
    "load_response",
    "save_response",
]
