"""Names of the room, from where they are defined: `skinmap/lazy.py` loads them on first use."""

from calibration.wiring.boards import Fault as Fault
from calibration.wiring.boards import Wiring as Wiring
from calibration.wiring.boards import boards_of as boards_of
from calibration.wiring.doctor import Doctor as Doctor
from calibration.wiring.touches import Baseline as Baseline
from calibration.wiring.touches import judge_rest as judge_rest
from calibration.wiring.touches import make_touch as make_touch

__all__ = [
    "Baseline",
    "Doctor",
    "Fault",
    "Wiring",
    "boards_of",
    "judge_rest",
    "make_touch",
]
