"""Repair of taxel tables: units, thermal pads, collapsed modules; each step optional, reported.

Nothing is lost: a report keeps the table as it came, and leaving a step out of `steps` undoes
it. Normals are repaired when the skin is made (see `normals`); coincident taxels stay taxels and
share a vertex of the surface mesh, which keeps the map (`SurfaceMesh.representative`).
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from dataclasses import replace as replace_fields
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import SkinWarning, UnknownNameError
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import transform_points
from skinmap.skin.layouts import ModuleLayout
from skinmap.skin.modules import fit_modules, shared_places, slots_of
from skinmap.skin.taxels import THERMAL, UNKNOWN, TaxelTable

NORMALS = "normals"  # taken when the skin is made
ALL_STEPS = ("units", "thermal", "collapsed", NORMALS)
UNIT_METRES = {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "mil": 2.54e-5, "um": 1e-6, "km": 1e3}
PITCHES = (1e-3, 4e-2)  # of robot skins, where no layout says better [m]
MISFIT = 0.4  # in pitches: bent boards of the iCub stay below 0.25, other layouts above 0.5
UNIT_MATCH = 1.25  # how far a pitch may be off and still tell its unit: mm and inch are 25 apart


@dataclass(frozen=True, eq=False, slots=True)
class RepairReport:
    """What was done to a table.

    Attributes
    ----------
    original : TaxelTable
        As it came.
    table : TaxelTable
        As it is now.
    unit : str
        Unit that the positions were found to be in.
    thermal : (a,) int
        Channels of thermal pads, left out.
    rebuilt : (b,) int
        Channels that had no place of their own and have one now.
    unplaced : (c,) int
        Channels that still share a place with others.
    """

    original: TaxelTable
    table: TaxelTable
    unit: str
    thermal: IntArray
    rebuilt: IntArray
    unplaced: IntArray

    def __post_init__(self) -> None:
        freeze(self, thermal=self.thermal, rebuilt=self.rebuilt, unplaced=self.unplaced)


def repair_table(
    table: TaxelTable,
    layout: ModuleLayout | None,
    *,
    steps: Collection[str] = ALL_STEPS,
    known: Mapping[int, FloatArray] | None = None,
) -> RepairReport:
    """Mend what files are known to have wrong.

    Parameters
    ----------
    table : TaxelTable
    layout : ModuleLayout or None
        Without one, thermal pads are known from the file alone and nothing is rebuilt.
    steps : collection of str
        Which of `ALL_STEPS` to take.
    known : mapping of int to (4, 4) array, optional
        T_link_module of modules, where the URDF has frames for them.

    Raises
    ------
    UnknownNameError
        A step that does not exist.
    """
    check_steps(steps)
    original, unit = table, "m"
    if "units" in steps:
        unit = detect_unit(table.positions, layout)
        if unit != "m":
            factor = UNIT_METRES[unit]
            warnings.warn(
                f"positions are in {unit}: multiplied by {factor:g} to be metres",
                SkinWarning,
                stacklevel=2,
            )
            table = replace(table, positions=table.positions * factor)
    thermal = np.zeros(0, np.int64)
    if "thermal" in steps:
        pads = thermal_pads(table, layout)
        thermal, table = table.channels[pads], take(table, ~pads)
    rebuilt = np.zeros(0, np.int64)
    if "collapsed" in steps and layout is not None:
        before = shared_places(table)
        table = rebuild_collapsed(table, layout, known)
        rebuilt = table.channels[before & ~shared_places(table)]
    unplaced = table.channels[shared_places(table)]
    return RepairReport(original, table, unit, thermal, rebuilt, unplaced)


def check_steps(steps: Collection[str]) -> None:
    """Refuse steps that do not exist.

    Raises
    ------
    UnknownNameError
        Says which one, and which there are.
    """
    for step in steps:
        if step not in ALL_STEPS:
            raise UnknownNameError("repair step", step, ALL_STEPS)


def detect_unit(positions: FloatArray, layout: ModuleLayout | None) -> str:
    """Unit in which the spacing of positions (n, 3) fits the layout, or any robot skin.

    "m" where that is so already or no unit fits.
    """
    spacing = median_spacing(np.unique(positions, axis=0))
    if spacing == 0.0:
        return "m"
    if layout is None:
        if PITCHES[0] <= spacing <= PITCHES[1]:
            return "m"
        fits = [u for u, f in UNIT_METRES.items() if PITCHES[0] <= spacing * f <= PITCHES[1]]
        return fits[0] if fits else "m"
    for unit, factor in {"m": 1.0, **UNIT_METRES}.items():
        if 1.0 / UNIT_MATCH <= spacing * factor / layout.pitch <= UNIT_MATCH:
            return unit
    return "m"


def thermal_pads(table: TaxelTable, layout: ModuleLayout | None) -> np.ndarray:
    """(n,) whether a placed row is a thermal pad: by the file's word, or by slot where it errs.

    Files mark pads with -2, or with -1 like absent channels; a row that the file calls tactile
    stays whatever its slot, and so does one of which it says nothing.
    """
    stated = table.representative
    pads = stated == THERMAL
    if layout is not None:
        silent = (stated < 0) & (stated != UNKNOWN)
        pads = pads | (silent & layout.thermal[slots_of(table, layout)])
    return np.asarray(pads)


def rebuild_collapsed(
    table: TaxelTable, layout: ModuleLayout, known: Mapping[int, FloatArray] | None = None
) -> TaxelTable:
    """The table with each module that has taxels in one place laid anew from its layout.

    All taxels of such a module move to the fitted board, so that their mutual distances are
    those of the board. Modules whose pose nothing determines, and those whose own taxels do not
    lie on such a board (another layout, or places rounded to a grid), stay as they are.
    """
    shared = shared_places(table)
    if not shared.any():
        return table
    poses = fit_modules(table, layout, known)
    positions, normals = table.positions.copy(), table.normals.copy()
    slots = slots_of(table, layout)
    for module in np.unique(table.modules[shared]).tolist():
        if module not in poses or poses[module].residual > MISFIT * layout.pitch:
            continue
        rows = np.flatnonzero(table.modules == module)
        pose = poses[module].T_link_module
        places = np.column_stack([layout.xy[slots[rows]], np.zeros(len(rows))])
        positions[rows] = transform_points(pose, places)
        normals[rows] = pose[:3, 2]
    return replace(table, positions=positions, normals=normals)


def replace(
    table: TaxelTable, *, positions: FloatArray, normals: FloatArray | None = None
) -> TaxelTable:
    """The same taxels at other positions (n, 3), with other normals (n, 3) where given."""
    kept = table.normals if normals is None else normals
    return replace_fields(table, positions=positions, normals=kept)


def take(table: TaxelTable, keep: np.ndarray) -> TaxelTable:
    """The rows of a table that a mask (n,) keeps."""
    rows: dict[str, Any] = {
        each.name: values[keep] if len(values) else values
        for each in fields(table)
        if isinstance(values := getattr(table, each.name), np.ndarray)
    }
    return replace_fields(table, **rows)
