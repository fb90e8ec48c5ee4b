"""`skinmap structures`: periodic neighbourhood structures of the layout."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from skinmap.commands import options
from skinmap.errors import warn
from skinmap.report.present import present
from skinmap.report.table import Table

if TYPE_CHECKING:
    from skinmap.neighbours.structures import Structures
    from skinmap.touch.prepared_skin import PreparedSkin

Distance = Literal["euclidean", "geodesic"]
ROTATIONS = 6  # structures may turn by pi/3; 4, by quarters: square grids; 1, not at all
RARE = 5  # structures with fewer members say little about the lattice


@dataclass(frozen=True, kw_only=True, slots=True)
class StructureRow:
    """One structure of the neighbourhoods.

    Attributes
    ----------
    structure
        Number of the structure.
    taxels
        Number of taxels with this structure.
    neighbours
        Number of neighbours of a taxel with this structure.
    """

    structure: int
    taxels: int
    neighbours: int


@dataclass(frozen=True, kw_only=True, slots=True)
class StructuresResult:
    """Neighbourhood shapes that repeat.

    Attributes
    ----------
    robot
        Name of the robot.
    parts
        Names of the parts.
    radius_mm
        Radius of a neighbourhood.
    radius_is
        Origin of the radius: given, or automatic.
    tolerance_mm
        Largest deviation of a matching neighbour.
    rotations
        Turns that make no difference; 1: none.
    distance
        Straight, or along the skin.
    structures
        Number of different structures.
    taxels
        Number of taxels of all parts.
    rare_taxels, rare_share
        Taxels in structures with fewer than 5 members, and their share.
    leftovers
        Taxels alone in their structure.
    without_structure
        Taxels that have none.
    table
        The commonest structure first.
    files
        Names of the pictures inside `--out`.
    """

    robot: str
    parts: list[str]
    radius_mm: float
    radius_is: Literal["requested", "auto"]
    tolerance_mm: float
    rotations: int
    distance: Distance
    structures: int
    taxels: int
    rare_taxels: int
    rare_share: float
    leftovers: int
    without_structure: int
    table: list[StructureRow]
    files: list[str] = field(default_factory=list)


@click.command("structures")
@options.robot_argument
@options.part_option
@options.word(
    "--radius-mm",
    "MM|auto",
    "Radius of a neighbourhood, or auto: between two rings of the lattice.",
    shown="auto",
)
@options.choice(
    "--rotations",
    ("1", "4", "6"),
    "Order of the rotations that match structures: 6 (by pi/3) or 4 (square grids).",
    shown=str(ROTATIONS),
)
@options.out_option
@options.profile_option("classify", beside=("tolerance_mm", "distance"))
@options.prints(StructuresResult)
def command(out: Path | None, as_json: bool, **asked: Any) -> None:
    """Find the neighbourhood shapes that repeat over all parts asked for, turned by pi/3 or not.

    With --out two pictures: the structures, and under each of them its codewords of simulated
    touches with the word that each taxel votes for.

    \b
    Example:  skinmap structures icub --part right_leg_upper --rotations 6 --out pictures
    """
    result, skins, found = work(**asked)

    def write(stage: Path) -> Iterator[str]:
        from skinmap.report.structure_figures import codewords_figure, structures_figure

        structures_figure(skins, found, stage / "structures.png")
        yield "structures.png"
        codewords_figure(skins, found, stage / "codewords.png")
        yield "codewords.png"

    present(result, _lines, as_json=as_json, out=out, write=write)


def work(
    robot: str,
    parts: tuple[str, ...],
    radius_mm: str,
    rotations: str,
    tolerance_mm: float | None = None,
    distance: Distance | None = None,
) -> tuple[StructuresResult, dict[str, PreparedSkin], Structures]:
    """The numbers, the skins by part, and the structures on them; the last two from a profile."""
    from skinmap.neighbours.offsets import LATTICE, auto_radius, concatenate
    from skinmap.neighbours.structures import find_structures, usual_radius, usual_tolerance
    from skinmap.touch.prepared_skin import PreparedSkin

    asked, turns, distance = options.read_radius(radius_mm), int(rotations), distance or "euclidean"
    loaded, names = options.open_robot(robot, parts)
    skins = {name: PreparedSkin(loaded.skin(name)) for name in names}
    places = [skin.skin.positions for skin in skins.values()]
    radius = asked or auto_radius(places, near=usual_radius(places))
    symmetry = turns if turns > 1 else LATTICE
    hoods = [
        skin.neighbourhoods(radius=radius, distance=distance, symmetry=symmetry)
        for skin in skins.values()
    ]
    joined = concatenate(hoods)
    lonely = int((~joined.filled.any(axis=1)).sum())
    if 2 * lonely > len(joined):
        message = f"{lonely} of {len(joined)} taxels have no neighbour within {1e3 * radius:.3g} mm"
        warn(f"{message}: ask for more by --radius-mm")
    tolerance = 1e-3 * tolerance_mm if tolerance_mm else usual_tolerance(joined)
    found = find_structures(joined, tolerance=tolerance, rotations=turns)
    counts, filled = found.counts, found.prototypes.filled.sum(axis=1)
    without = int((found.labels < 0).sum())
    rare = int(counts[counts < RARE].sum()) + without
    result = StructuresResult(
        robot=loaded.name,
        parts=list(names),
        radius_mm=radius * 1e3,
        radius_is="auto" if asked is None else "requested",
        tolerance_mm=tolerance * 1e3,
        rotations=turns,
        distance=distance,
        structures=len(found.prototypes),
        taxels=len(found.labels),
        rare_taxels=rare,
        rare_share=rare / max(len(found.labels), 1),
        leftovers=len(found.leftovers),
        without_structure=without,
        table=[
            StructureRow(structure=s, taxels=int(count), neighbours=int(filled[s]))
            for s, count in enumerate(counts)
        ],
    )
    return result, skins, found


def _lines(result: StructuresResult) -> Iterator[str | Table]:
    yield (
        f"{result.structures} structures over {result.taxels} taxels within "
        f"{result.radius_mm:.2f} mm; {result.rare_taxels} taxels "
        f"({100.0 * result.rare_share:.1f} %) in structures with fewer than {RARE} members, "
        f"{result.leftovers} of them alone"
    )
    yield Table.of(StructureRow, result.table, "structure taxels neighbours")
