"""The same seed gives the same touches on another processor, whatever it rounds otherwise."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__

# Both hands of the iCub are flat, so that two components of their normals are rounding errors.
SCRIPT = """
import hashlib
from skinmap.io.robots.manifest import load_robot
from skinmap.touch.simulation.simulator import simulate

skin = load_robot("icub").skin("left_hand")
gestures = ["poke", "full_finger", "whole_hand", "stroke", "rub"]
found = simulate(skin, rng=11, per_gesture=2, gestures=gestures)
print(*found.labels, hashlib.sha256(found.pressures).hexdigest())
"""


@pytest.fixture(scope="module")
def here() -> str:
    return touches({})


def touches(settings: dict[str, str]) -> str:
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, env=os.environ | settings, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "settings",
    [
        {"OPENBLAS_CORETYPE": "Haswell"},
        {"OPENBLAS_CORETYPE": "Prescott"},
        {"NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__)},
    ],
    ids=["Haswell", "Prescott", "no SIMD"],
)
def test_the_same_touches_on_another_processor(here: str, settings: dict[str, str]) -> None:
    assert touches(settings) == here
