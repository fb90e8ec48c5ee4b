"""Forces of contacts: exact where the pressure is even, and whole wherever a newton presses."""

from __future__ import annotations

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from skinmap.errors import SkinMismatchError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.response.loads import SPREAD, ContactForce, PartForces, heaviest_load
from skinmap.physics.pressing import SpringBed
from skinmap.skin.skin import skin_from_points
from skinmap.touch.prepared_skin import PreparedSkin

PITCH = 6e-3


@pytest.fixture(scope="module")
def sheet() -> PreparedSkin:
    """Fifteen rows and columns of taxels in a plane, every second row shifted."""
    row, column = np.divmod(np.arange(225), 15)
    places = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75), 0.0 * row])
    return PreparedSkin(skin_from_points(places, np.tile([0.0, 0.0, 1.0], (225, 1)), part="sheet"))


@pytest.fixture(scope="module")
def forearm() -> PreparedSkin:
    return PreparedSkin(load_robot("icub").skin("left_forearm"))


def exact(forces: PartForces, pressure: np.ndarray, taxels: np.ndarray) -> ContactForce:
    return forces.contact(taxels, pressure, pressure, pressure)


def pressed(skin: PreparedSkin, cells: np.ndarray, newtons: float) -> tuple[np.ndarray, ...]:
    """Pressure (n,) of a force spread evenly over some cells, and the middle of these."""
    bed = SpringBed(skin.skin, skin.mesh)
    load = np.zeros(len(bed.places))
    load[cells] = newtons / len(cells)
    return bed.spread(SPREAD) @ load, bed.places[cells].mean(axis=0)


def test_force_of_an_even_pressure_is_pressure_times_area(sheet: PreparedSkin) -> None:
    bed = SpringBed(sheet.skin, sheet.mesh)
    whole = 1e4 * bed.area * len(bed.places)
    # What presses ends with the skin: taxels at its border feel half of the pressure.
    pressure, _ = pressed(sheet, np.arange(len(bed.places)), whole)
    assert np.median(pressure) == pytest.approx(1e4, rel=0.02)
    found = exact(PartForces(sheet), pressure, np.arange(225))
    assert found.force.value == pytest.approx(whole, rel=0.02)
    assert found.vector == pytest.approx([0.0, 0.0, -found.force.value], rel=1e-6, abs=1e-6)
    assert found.normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert found.mean.low < found.mean.value < found.mean.high
    assert found.area.low <= found.area.value <= found.area.high


def test_force_and_its_moment_are_those_of_a_weight(sheet: PreparedSkin) -> None:
    bed = SpringBed(sheet.skin, sheet.mesh)
    spot = sheet.skin.positions[112]
    cells = np.flatnonzero(np.linalg.norm(bed.places - spot, axis=1) < 12e-3)
    pressure, middle = pressed(sheet, cells, 5.0)
    found = exact(PartForces(sheet), pressure, np.flatnonzero(pressure > 500.0))
    assert found.force.value == pytest.approx(5.0, rel=0.02)
    assert found.force.low < 5.0 < found.force.high
    assert found.centre == pytest.approx(middle, abs=0.5e-3)
    # About the origin of the link: the moment about the centre and that of the force there.
    about_origin = found.moment + np.cross(found.centre, found.vector)
    assert about_origin == pytest.approx(np.cross(middle, [0.0, 0.0, -5.0]), abs=5e-3)
    assert found.area.low <= 1.3 * np.pi * 12e-3**2
    assert found.area.high >= np.pi * 12e-3**2


def test_force_of_a_newton_is_a_newton_anywhere_on_a_curved_part(forearm: PreparedSkin) -> None:
    forces, rng = PartForces(forearm), np.random.default_rng(3)
    bed = SpringBed(forearm.skin, forearm.mesh)
    ratios, plain, away = [], [], []
    for _ in range(60):
        middle = bed.places[rng.integers(len(bed.places))]
        cells = np.flatnonzero(np.linalg.norm(bed.places - middle, axis=1) < 6e-3)
        pressure, _ = pressed(forearm, cells, 1.0)
        found = exact(forces, pressure, np.flatnonzero(pressure > 100.0))
        ratios.append(found.force.value)
        plain.append(pressure @ forearm.geometry.areas)
        normal = bed.normals[cells].mean(axis=0)
        away.append(np.degrees(np.arccos(found.normal @ normal / np.linalg.norm(normal))))
    # A fingertip falls between few taxels: single ones may miss, the middle must not. The plain
    # areas are the control: they are further off.
    assert np.median(np.abs(np.array(ratios) - 1.0)) < 0.06
    assert np.quantile(np.abs(np.array(ratios) - 1.0), 0.9) < 0.2
    assert np.median(np.abs(np.array(plain) - 1.0)) > 2 * np.median(np.abs(np.array(ratios) - 1.0))
    assert np.median(away) < 4.0


@pytest.mark.parametrize("foam", [1.5e-3, 3e-3])
def test_a_fingertip_weighs_alike_above_taxels_and_between_them(
    forearm: PreparedSkin, foam: float
) -> None:
    bed, rng = SpringBed(forearm.skin, forearm.mesh), np.random.default_rng(3)
    forces, feels, errors = PartForces(forearm), bed.spread(foam), []
    for _ in range(100):
        away = np.linalg.norm(bed.places - bed.places[rng.integers(len(bed.places))], axis=1)
        load = np.maximum(1.0 - (away / 6e-3) ** 2, 0.0)
        pressure = feels @ (load / load.sum())
        found = exact(forces, pressure, np.flatnonzero(pressure > 500.0))
        errors.append(abs(found.force.value - 1.0))
    assert np.quantile(errors, 0.95) < 0.1  # weights alone are off by 13 %


def test_force_bridges_a_taxel_without_an_answer(sheet: PreparedSkin) -> None:
    bed = SpringBed(sheet.skin, sheet.mesh)
    spot = sheet.skin.positions[112]
    cells = np.flatnonzero(np.linalg.norm(bed.places - spot, axis=1) < 15e-3)
    pressure, _ = pressed(sheet, cells, 5.0)
    answered = np.arange(225) != 112
    taxels = np.flatnonzero(pressure > 500.0)
    holed = np.where(answered, pressure, np.nan)
    found = exact(PartForces(sheet, answered), holed, taxels)
    assert found.force.value == pytest.approx(5.0, rel=0.06)
    simply_left_out = np.nansum(np.where(answered, pressure * sheet.geometry.areas, 0.0))
    assert simply_left_out < 0.95 * 5.0
    none = exact(PartForces(sheet, ~np.isin(np.arange(225), taxels)), holed, taxels)
    assert none.refused == "none of its taxels is calibrated"


def test_force_is_refused_above_the_range_and_without_pressure(sheet: PreparedSkin) -> None:
    forces, pressure = PartForces(sheet), np.full(225, 1e4)
    pressure[100] = np.nan
    found = exact(forces, pressure, np.arange(90, 110))
    assert found.refused == "above the calibrated range"
    assert found.in_words() == found.refused
    assert np.isnan(found.force.value)
    assert found.plain()["force_n"] is None
    assert found.plain()["area_mm2_90"] is None
    json.dumps(found.plain(), allow_nan=False)
    assert exact(forces, np.zeros(225), np.arange(5)).refused == "too light for a force"
    with pytest.raises(SkinMismatchError, match="5 taxels are calibrated, the part has 225"):
        PartForces(sheet, np.ones(5, bool))


def test_a_recorded_touch_that_leaves_the_range_is_refused(sheet: PreparedSkin) -> None:
    forces, taxels = PartForces(sheet), np.isin(np.arange(225), [111, 112, 113])
    bars = np.array([0.2, 1.8, np.nan, np.nan, 1.8])[:, None] * np.where(taxels, 1.0, 0.1)
    model = SimpleNamespace(doubt=0.01)
    ask = partial(heaviest_load, forces, model, (bars, bars - 0.1, bars + 0.1), taxels=taxels)
    assert ask(rows=np.arange(5)).refused == "above the calibrated range"
    assert ask(rows=np.arange(2)).force.value > 0.0


def test_a_touch_smaller_than_a_taxel_lies_within_the_interval_of_its_area(
    sheet: PreparedSkin,
) -> None:
    forces, away = PartForces(sheet), sheet.skin.positions - sheet.skin.positions[112]
    taxel = np.median(sheet.geometry.areas)
    for shift in (0.0, 2e-3, 3e-3):  # on a taxel, and between two
        beside = np.linalg.norm(away - [shift, 0.0, 0.0], axis=1)
        pressure = 4e4 * np.exp(-0.5 * (beside / 2.7e-3) ** 2)  # as foam spreads a point
        found = exact(forces, pressure, np.flatnonzero(pressure > 4e3))
        assert 0.0 < found.area.low < 0.2 * taxel
        assert found.mean.high < np.inf
    broad = 4e4 * np.exp(-0.5 * (np.linalg.norm(away, axis=1) / 8e-3) ** 2)
    assert exact(forces, broad, np.flatnonzero(broad > 4e3)).area.low > 3 * taxel


def test_noise_does_not_make_the_heaviest_moment_heavier(sheet: PreparedSkin) -> None:
    forces, taxels = PartForces(sheet), np.isin(np.arange(225), [111, 112, 113])
    model, rng = SimpleNamespace(doubt=0.01), np.random.default_rng(3)

    def heaviest(loads: np.ndarray) -> float:
        bars = loads[:, None] * np.where(taxels, 1.0, 0.05)
        found, rows = (bars, bars - 0.1, bars + 0.1), np.arange(len(loads))
        return heaviest_load(forces, model, found, rows, taxels, 50.0).force.value

    held = np.interp(np.arange(100), [10, 20, 90, 99], [0.1, 1.0, 1.0, 0.1])
    noisy = [heaviest(held + rng.normal(0.0, 0.03, 100)) for _ in range(20)]
    assert np.mean(noisy) == pytest.approx(heaviest(held), rel=0.03)
    poke = np.interp(np.arange(20), [5, 10, 15], [0.1, 1.0, 0.1])  # its peak stays
    assert heaviest(poke) > 0.9 * heaviest(held)


def test_a_broad_touch_is_felt_beyond_its_contact(sheet: PreparedSkin) -> None:
    forces, n = PartForces(sheet), 225
    away = np.linalg.norm(sheet.skin.positions - sheet.skin.positions[112], axis=1)
    pressure = 4e4 * np.exp(-0.5 * (away / 12e-3) ** 2)
    pushed = float(pressure @ forces.weights)
    taxels = np.flatnonzero(pressure > 0.9 * pressure.max())  # few lie above the contact's counts
    found = forces.contact(taxels, pressure, np.maximum(pressure - 7e3, 0), pressure + 7e3)
    assert 0.85 * pushed < found.force.value < pushed < found.force.high
    # Another touch behind a valley is left to its own contact.
    beside = np.linalg.norm(sheet.skin.positions - sheet.skin.positions[116], axis=1) < 8e-3
    lone = np.where(away < 8e-3, 1e4, 0.0)
    both = forces.contact(np.flatnonzero(away < 8e-3), *[lone + np.where(beside, 9e3, 0.0)] * 3)
    assert both.force.value < 1.1 * float(lone @ forces.weights)
    faint = np.full(n, 1e3)  # all of it below its doubt
    wide = forces.contact(np.array([112]), faint, np.zeros(n), faint + 7e3)
    assert wide.refused == "too light for a force where it ends"


def test_intervals_grow_with_what_taxels_share(sheet: PreparedSkin) -> None:
    forces, pressure = PartForces(sheet), np.full(225, 1e4)
    taxels = np.arange(80, 140)
    own = forces.contact(taxels, pressure, pressure - 3e3, pressure + 3e3, shared=0.0)
    all_ = forces.contact(taxels, pressure, pressure - 3e3, pressure + 3e3, shared=1.0)
    assert own.force.value == all_.force.value
    # Errors of each taxel average out over sixty of them, a shared one of 30 % does not.
    assert (own.force.high / own.force.value - 1.0) < 0.25
    assert (all_.force.high / all_.force.value - 1.0) > 0.3
    assert all_.in_words().endswith(f"N ({all_.force.low:.3g} to {all_.force.high:.3g})")
