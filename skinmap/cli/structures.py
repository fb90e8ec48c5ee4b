"""`skinmap structures`: periodic neighbourhood structures of the layout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands.options import (
    json_option,
    open_robot,
    out_option,
    part_option,
    robot_argument,
)
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit
from skinmap.report.table import table

if TYPE_CHECKING:
    from skinmap.neighbours.offsets import Neighbourhoods
    from skinmap.neighbours.structures import Structures
    from skinmap.touch.prepared_skin import PreparedSkin

RARE = 5  # structures with fewer members say little about the lattice


@click.command("structures")
@robot_argument
@part_option
@click.option(
    "--radius-mm",
    default="8",
    show_default=True,
    help="Radius of a neighbourhood, or auto: between two rings of the lattice, near 8 mm.",
)
@click.option(
    "--tolerance-mm", default=1.5, show_default=True, help="How far neighbours may stray."
)
@click.option(
    "--rotations",
    type=click.Choice(["1", "4", "6"]),
    default="6",
    show_default=True,
    help="Whether structures may turn: by pi/3 (6), or by quarters (4, square grids).",
)
@click.option(
    "--distance",
    type=click.Choice(["euclidean", "geodesic"]),
    default="euclidean",
    show_default=True,
    help="Straight, or along the skin.",
)
@out_option
@profile_option("classify")
@json_option
def command(
    robot: str,
    parts: tuple[str, ...],
    radius_mm: str,
    tolerance_mm: float,
    rotations: str,
    distance: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find the neighbourhood shapes that repeat over all parts asked for.

    \b
    Example:  skinmap structures icub --part right_leg_upper --rotations 6 --out pictures
    """
    from skinmap.neighbours.offsets import concatenate
    from skinmap.neighbours.structures import find_structures
    from skinmap.touch.prepared_skin import PreparedSkin

    if not 0 < tolerance_mm < math.inf:
        raise click.UsageError(f"--tolerance-mm must be above 0, got {tolerance_mm}")
    wanted = read_radius(radius_mm)
    loaded, names = open_robot(robot, parts)
    skins = {name: PreparedSkin(loaded.skin(name)) for name in names}
    radius = auto_radius_of(skins) if wanted is None else wanted
    hoods = [_neighbourhoods(skin, radius, int(rotations), distance) for skin in skins.values()]
    found = find_structures(
        concatenate(hoods), tolerance=tolerance_mm * 1e-3, rotations=int(rotations)
    )
    files = []
    if out is not None:
        from skinmap.io.output import staged_folder
        from skinmap.report.structure_figures import body_figure, structures_figure

        with staged_folder(out) as stage:
            structures_figure(skins, found, stage / "structures.png")
            body_figure(loaded, skins, found, stage / "structures_body.png")
        files = ["structures.png", "structures_body.png"]
    result = summary(found)
    if as_json:
        settings = {
            "radius_mm": radius * 1e3,
            "radius_is": "requested" if wanted is not None else "auto",
            "tolerance_mm": tolerance_mm,
            "rotations": int(rotations),
            "distance": distance,
        }
        emit({"robot": loaded.name, "parts": list(names), **settings, **result, "files": files})
        return
    click.echo(
        f"{result['structures']} structures over {result['taxels']} taxels within "
        f"{radius * 1e3:.2f} mm; {result['rare_taxels']} taxels "
        f"({100.0 * result['rare_share']:.1f} %) in structures with fewer than {RARE} members, "
        f"{result['leftovers']} of them alone"
    )
    table(
        ["structure", "taxels", "neighbours"],
        [[row["structure"], row["taxels"], row["neighbours"]] for row in result["table"]],
    )
    for file in files:
        click.echo(str(Path(out or ".") / file))


def read_radius(text: str) -> float | None:
    """The radius asked for [m], None for auto."""
    if text == "auto":
        return None
    try:
        radius = float(text)
    except ValueError:
        radius = math.nan
    if not 0 < radius < math.inf:
        raise click.UsageError(f"--radius-mm must be above 0, or auto, got {text!r}")
    return radius * 1e-3


def auto_radius_of(skins: Mapping[str, PreparedSkin]) -> float:
    """Between two rings of the lattice [m]."""
    from skinmap.neighbours.radius import auto_radius
    from skinmap.neighbours.structures import RADIUS

    return auto_radius([skin.skin.positions for skin in skins.values()], near=RADIUS)


def _neighbourhoods(
    skin: PreparedSkin, radius: float, rotations: int, distance: str
) -> Neighbourhoods:
    from skinmap.neighbours.offsets import LATTICE

    symmetry = rotations if rotations > 1 else LATTICE
    return skin.neighbourhoods(radius=radius, distance=distance, symmetry=symmetry)


def summary(found: Structures) -> dict[str, Any]:
    """The numbers of a set of structures, ready for JSON."""
    counts = found.counts
    without = int((found.labels < 0).sum())
    rare = int(counts[counts < RARE].sum()) + without
    return {
        "structures": len(found.prototypes),
        "taxels": len(found.labels),
        "rare_taxels": rare,
        "rare_share": rare / max(len(found.labels), 1),
        "leftovers": len(found.leftovers),
        "without_structure": without,
        "table": [
            {
                "structure": s,
                "taxels": int(count),
                "neighbours": int(found.prototypes.filled[s].sum()),
            }
            for s, count in enumerate(counts)
        ],
    }
