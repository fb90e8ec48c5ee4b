"""What `skinmap inspect` finds: the types of its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from msgspec import UNSET, UnsetType


@dataclass(frozen=True, kw_only=True, slots=True)
class Spread:
    """Spread of a figure over the taxels.

    Attributes
    ----------
    mean, median, p95, min, max
        The 95th percentile among them.
    """

    mean: float
    median: float
    p95: float
    min: float
    max: float


@dataclass(frozen=True, kw_only=True, slots=True)
class AngleSpread(Spread):
    """Spread of an angle over the taxels.

    Attributes
    ----------
    share_within_15
        Share of the taxels with at most 15 degrees.
    """

    share_within_15: float


@dataclass(frozen=True, kw_only=True, slots=True)
class DrawingMatch:
    """A drawing beside the table of taxels.

    Attributes
    ----------
    taxels
        Number of taxels on the drawing.
    missing
        Taxels that are not drawn.
    extra
        Drawn ones that are not in the table.
    """

    taxels: int
    missing: int
    extra: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Standing:
    """Fit of a skin to its link.

    Attributes
    ----------
    why
        "on it" where all taxels lie as the manifest states, else the likely cause.
    far
        Taxels more than 5 mm from where they should be.
    cover_mm
        Thickness of the cover that the manifest names.
    low_mm, high_mm
        5th and 95th percentile of the distances from the link.
    move_mm
        A rigid move that lays the skin on the link; null where none does.
    """

    why: Literal["on it", "a cover", "a frame", "a cover or a frame"]
    far: int
    cover_mm: float
    low_mm: float
    high_mm: float
    move_mm: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class PartRow:
    """One part, or a bare table.

    Attributes
    ----------
    name, link
        Of the part and of the body that it covers.
    channels
        Length of its live vector.
    taxels
        Total number of taxels.
    modules
        Total number of modules.
    distinct
        Number of positions that differ.
    coincident
        Taxels that share a mesh vertex with another.
    rebuilt
        Taxels that shared a place and were set beside each other.
    normals_repaired
        Stored normals that were more than 20 degrees off.
    unwired
        Taxels with a place and no channel.
    thermal
        Number of temperature sensors, which are not taxels.
    unit
        Of the positions in their file.
    pitch_mm
        Distance to the nearest taxel on the same side of a thin part.
    distance_mm
        To the mesh of the link; null for a bare table, which has no body.
    standing
        Fit of the part to its link, with the likely cause of a misfit; absent for a bare
        table.
    frame
        Frame of the positions; absent for a bare table.
    normal_angle_deg
        To the normals of the link's mesh; not for a bare table.
    inward, covered
        Taxels whose normal points into the body, or that lie below it; not for a bare table.
    module_side_mm
        With a module layout; null where no module is whole enough.
    swapped
        With a module layout: module by number, and the one whose frame it stands at.
    mirror_mm
        Distance from the mirror image of the part's twin, where it has one.
    drawing
        Match with the drawing that the manifest names; absent without one.
    verdict
        Next step, in a few words.
    warnings
        Warnings, in whole sentences.
    """

    name: str
    link: str
    channels: int
    taxels: int
    modules: int
    distinct: int
    coincident: int
    rebuilt: int
    normals_repaired: int
    unwired: int
    thermal: int
    unit: str
    pitch_mm: Spread
    distance_mm: Spread | None
    standing: Standing | UnsetType = UNSET
    frame: str | UnsetType = UNSET
    normal_angle_deg: AngleSpread | UnsetType = UNSET
    inward: int | UnsetType = UNSET
    covered: int | UnsetType = UNSET
    module_side_mm: float | UnsetType | None = UNSET
    swapped: dict[str, int] | UnsetType = UNSET
    mirror_mm: float | UnsetType = UNSET
    drawing: DrawingMatch | UnsetType = UNSET
    verdict: str
    warnings: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class InspectResult:
    """Taxels, modules and fit of a robot's skin.

    Attributes
    ----------
    robot
        Its name, or that of the table.
    parts
        In the manifest's order, or that of the command line.
    taxels
        Over all these parts.
    """

    robot: str
    parts: list[PartRow]
    taxels: int
