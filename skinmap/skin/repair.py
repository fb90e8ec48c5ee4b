"""Repair of taxel tables: units, thermal pads, collapsed modules; each step optional, reported.

Nothing is lost: a report keeps the table as it came, and leaving a step out of `steps` undoes
it. Normals are repaired when the skin is made (see `normals`); coincident taxels stay taxels and
share a vertex of the surface mesh, which keeps the map (`SurfaceMesh.representative`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, Frozen, IntArray
from skinmap.errors import SkinWarning, check_known
from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import transform_points
from skinmap.skin.modules import ModuleLayout, fit_modules, shared_places, slots_of
from skinmap.skin.taxels import THERMAL, UNKNOWN, TaxelTable

NORMALS = "normals"  # taken when the skin is made
ALL_STEPS = ("units", "thermal", "collapsed", NORMALS)
UNIT_METRES = {
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "inch": 0.0254,
    "mil": 2.54e-5,
    "um": 1e-6,
    "km": 1e3,
}
PITCHES = (1e-3, 4e-2)  # of robot skins, where no layout says better [m]
STATED = ("m", "mm", "cm", "inch")  # units that a manifest knows
STATED_PITCHES = (1e-4, 6e-2)  # a stated unit is believed this far: denser and sparser skins exist
MISFIT = 0.4  # in pitches: bent boards of the iCub stay below 0.25, other layouts above 0.5
UNIT_MATCH = 1.25  # how far a pitch may be off and still tell its unit: mm and inch are 25 apart


@dataclass(frozen=True, eq=False, slots=True)
class RepairReport(Frozen):
    """Repairs of a taxel table.

    Attributes
    ----------
    original : TaxelTable
        The skin before the repairs.
    table : TaxelTable
        As it is now.
    unit : str
        Unit that the positions of the file were found to be in.
    thermal : (a,) int
        Channels of thermal pads, left out.
    rebuilt : (b,) int
        Channels that had no place of their own and have one now.
    unplaced : (c,) int
        Channels that still share a place with others.
    stated : str
        Unit that they were said to be in.
    """

    original: TaxelTable
    table: TaxelTable
    unit: str
    thermal: IntArray
    rebuilt: IntArray
    unplaced: IntArray
    stated: str = "m"


def repair_table(
    table: TaxelTable,
    layout: ModuleLayout | None,
    *,
    steps: Collection[str] = ALL_STEPS,
    known: Mapping[int, FloatArray] | None = None,
    unit: str | None = None,
    stated: str = "m",
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
    unit : str, optional
        Unit that the file turned out to be in, where the table is in metres by now: whoever carries
        it to another frame finds its unit first.
    stated : str
        Unit that the file is said to be in.

    Returns
    -------
    RepairReport
    The mended table, and what was done.

    Raises
    ------
    UnknownNameError
        A step that does not exist.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.skin import repair_table
    >>> report = skinmap.load_robot("icub").repair("left_hand")
    >>> len(repair_table(report.table, None).table)
    48
    """
    check_known("repair step", steps, ALL_STEPS)
    original = table
    if unit is None:
        unit = detect_unit(table.positions, layout) if "units" in steps else "m"
        if unit != "m":
            warn_of_unit(unit)
            table = replace(table, positions=table.positions * UNIT_METRES[unit])
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
    return RepairReport(original, table, unit, thermal, rebuilt, unplaced, stated)


def warn_of_unit(unit: str, of: str = "", stated: str | None = None) -> None:
    """Warn that positions are in another unit than they should be, and name the remedy."""
    instead = "" if stated is None else f", not in {stated} as the manifest states"
    known = of and unit in STATED  # of a manifest, which may say it
    remedy = f'; units = "{unit}" in the manifest ends this warning' if known else ""
    warnings.warn(
        f"{of}positions are in {unit}{instead}: multiplied by {UNIT_METRES[unit]:g} "
        f"to be metres{remedy}",
        SkinWarning,
        stacklevel=3,
    )


def detect_unit(
    positions: FloatArray,
    layout: ModuleLayout | None,
    stated: str | None = None,
    *,
    lies: Callable[[str], bool] | None = None,
) -> str:
    """Unit in which the spacing of positions (n, 3) fits the layout, or any robot skin.

    Parameters
    ----------
    positions : (n, 3) float
        The numbers of the file.
    layout : ModuleLayout or None
    stated : str, optional
        Unit that the file is said to be in; metres without.
    lies : callable, optional
        Whether the taxels lie on their link where the file is in a unit. It is asked where the
        spacing is odd in the stated unit, and there is no layout: large skins exist.

    Returns
    -------
    str
        The stated unit (metres without) where it fits, or where no other does.
    """
    spacing = median_spacing(np.unique(positions, axis=0))
    first = stated or "m"
    fits = []
    for unit in (first, *UNIT_METRES) if spacing else ():
        low, high = STATED_PITCHES if unit == stated else PITCHES
        if layout is not None:
            low, high = layout.pitch / UNIT_MATCH, layout.pitch * UNIT_MATCH
        if low <= spacing * UNIT_METRES[unit] <= high:
            fits.append(unit)
    if first in fits:
        return first
    if layout is None and lies is not None and spacing:
        fits = [unit for unit in (*fits, first, *UNIT_METRES) if lies(unit)] or fits
    return fits[0] if fits else first


def thermal_pads(table: TaxelTable, layout: ModuleLayout | None) -> np.ndarray:
    """(n,) whether a placed row is a thermal pad: by the file's word, or by slot where it errs.

    Files mark pads with -2, or with -1 like absent channels; a row that the file calls tactile
    stays whatever its slot. Where the file is silent the slots decide, if it lists the pads.
    """
    stated = table.representative
    pads = stated == THERMAL
    if layout is not None:
        silent = (stated < 0) & ((stated != UNKNOWN) | _lists_pads(table, layout))
        pads = pads | (silent & layout.thermal[slots_of(table, layout)])
    return np.asarray(pads)


def _lists_pads(table: TaxelTable, layout: ModuleLayout) -> bool:
    """Whether the channels of each module are its slots, and some have more than feel touch.

    Channels that leave the thermal pads out tell of no slots.
    """
    blocks = np.unique(np.column_stack([table.modules, table.channels // len(layout)]), axis=0)
    modules, count = np.unique(table.modules, return_counts=True)
    return len(blocks) == len(modules) and bool((count > len(layout.tactile)).any())


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


def take(table: TaxelTable, keep: np.ndarray) -> TaxelTable:
    """The rows of a table that a mask (n,) keeps."""
    rows: dict[str, Any] = {
        each.name: values[keep] if len(values) else values
        for each in fields(table)
        if isinstance(values := getattr(table, each.name), np.ndarray)
    }
    return replace(table, **rows)
