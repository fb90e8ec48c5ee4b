"""What `skinmap inspect` finds: the types of its result."""

from __future__ import annotations

from dataclasses import dataclass

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
    rebuilt
        Taxels that shared a place and were set beside each other.
    normals_repaired
        Stored normals that were more than 20 degrees off.
    unwired
        Taxels with a place and no channel.
    unit
        Of the positions in their file.
    pitch_mm
        Distance to the nearest taxel on the same side of a thin part.
    distance_mm
        To the mesh of the link; null for a bare table, which has no body.
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
    rebuilt: int
    normals_repaired: int
    unwired: int
    unit: str
    pitch_mm: Spread
    distance_mm: Spread | None
    frame: str | UnsetType = UNSET
    normal_angle_deg: Spread | UnsetType = UNSET
    inward: int | UnsetType = UNSET
    covered: int | UnsetType = UNSET
    module_side_mm: float | UnsetType | None = UNSET
    swapped: dict[str, int] | UnsetType = UNSET
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
