"""Damaged layouts and robots: whatever came, the outcome is what was asked for or an error of ours.

The targets of `tests/extremes/damage` that say where taxels are, twelve times as many examples as
there, and real files of the iCub where they lie beside the checkout.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from damage.catalogue import TARGETS
from damage.mutations import accidents, mutate
from damage.target import Target
from hypothesis import HealthCheck, given, settings

from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.taxels.icub import read_icub

NAMES = [
    "taxels-csv", "taxels-icub", "taxels-skinware", "taxels-urdf", "urdf", "manifest", "mesh-ply",
]  # fmt: skip

# The same examples each time: a gate that fails by chance teaches nobody.
fuzz = settings(
    max_examples=max(300, settings.default.max_examples),
    deadline=None,
    derandomize=settings.default.derandomize,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> dict[str, tuple[Path, bytes]]:
    """Of each target a folder with what stands beside the file, and the whole file."""
    made = {}
    for name in NAMES:
        made[name] = tmp_path_factory.mktemp(name), TARGETS[name].originals()[0]
        TARGETS[name].lay_out(made[name][0])
    return made


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("name", NAMES)
def test_damaged_layouts_are_read_or_refused(originals, name, steps):
    folder, whole = originals[name]
    TARGETS[name].try_one(mutate(whole, steps), folder)


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("name", ["left_forearm_V2.txt", "right_leg_upper.txt", "torso.txt"])
def test_damaged_files_of_the_icub_are_read_or_refused(tmp_path, icub_main, name, steps):
    data = (icub_main / "positions" / name).read_bytes()
    Target(name, "t.txt", lambda: [data], read_icub).try_one(mutate(data, steps), tmp_path)


@pytest.mark.fuzz
@fuzz
@given(steps=accidents)
@pytest.mark.parametrize("name", ["left_hand_V2_1.ini", "right_arm_V2_7.ini", "torso_left_top.ini"])
def test_damaged_drawings_are_read_or_refused(tmp_path, icub_main, name, steps):
    data = (icub_main / "skinGui" / name).read_bytes()
    Target(name, "d.ini", lambda: [data], read_drawing).try_one(mutate(data, steps), tmp_path)
