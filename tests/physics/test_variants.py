"""The frozen variant stays as it is, and out of everything that fits."""

import hashlib
import re
from pathlib import Path

import pytest

from skinmap.errors import UnknownNameError
from skinmap.physics.variants import DEFAULT, FROZEN, TUNING, VARIANTS, find_variant, parameters

ROOT = Path(__file__).resolve().parents[2]
JUDGE = "176b3a0c3d57240dbf3331e97c74a1a5df55874558f1c7488327770e06fc201f"
# May name the frozen variant: where it is defined, judged with, and shown.
JUDGES = {
    "skinmap/physics/variants.py",
    "skinmap/cli/evaluate/protocol_simulated.py",  # says which one it is, or tests on it
    "skinmap/cli/evaluate/protocol_force.py",  # judges forces, whose constants are of TUNING
    "benchmarks/classify/default_model.py",  # judges the shipped model
    "scripts/figures.py",  # shows what was measured on it
}


def test_frozen_variant_never_changes() -> None:
    assert FROZEN == "judge"
    found = hashlib.sha256(parameters(VARIANTS[FROZEN]).encode()).hexdigest()
    assert found == JUDGE, "figures judged with it would no longer compare"


def test_tuning_leaves_the_frozen_variant_out() -> None:
    assert FROZEN not in TUNING
    assert set(TUNING) | {FROZEN} == set(VARIANTS)
    assert DEFAULT in TUNING


def test_no_code_that_fits_names_the_frozen_variant() -> None:
    """Training and tuning draw from TUNING; only what judges may read FROZEN."""
    names = re.compile(
        r"physics\.variants import [^)]*?\bFROZEN\b|\bFROZEN = \"judge\"|[\"']judge[\"']"
    )
    found = {
        str(path.relative_to(ROOT))
        for folder in ("skinmap", "calibration", "viewer", "benchmarks", "scripts")
        for path in (ROOT / folder).rglob("*.py")
        if names.search(path.read_text())
    }
    assert found == JUDGES


def test_find_variant_says_which_exist() -> None:
    assert find_variant("flesh").name == "flesh"
    with pytest.raises(UnknownNameError, match="foam, flesh, finger, palm, force, judge"):
        find_variant("steel")
