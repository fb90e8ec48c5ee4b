"""`skinmap structures`: periodic neighbourhood structures of the layout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.common import (
    emit,
    json_option,
    open_robot,
    out_option,
    part_option,
    robot_argument,
    table,
)

if TYPE_CHECKING:
    from skinmap.neighbours.structures import Structures

RARE = 5  # structures with fewer members say little about the lattice


@click.command("structures")
@robot_argument
@part_option
@click.option("--radius-mm", default=8.0, show_default=True, help="Radius of a neighbourhood.")
@click.option(
    "--tolerance-mm", default=1.5, show_default=True, help="How far neighbours may stray."
)
@click.option(
    "--rotations",
    type=click.Choice(["1", "6"]),
    default="6",
    show_default=True,
    help="Whether structures may turn by pi/3.",
)
@out_option
@json_option
def command(
    robot: str,
    parts: tuple[str, ...],
    radius_mm: float,
    tolerance_mm: float,
    rotations: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find the neighbourhood shapes that repeat over all parts asked for.

    \b
    Example:  skinmap structures icub --part right_leg_upper --rotations 6 --out pictures
    """
    from skinmap.neighbours.offsets import concatenate
    from skinmap.neighbours.structures import find_structures
    from skinmap.touch.prepared import PreparedSkin

    if radius_mm <= 0 or tolerance_mm <= 0:
        raise click.UsageError("--radius-mm and --tolerance-mm must be above 0")
    loaded, names = open_robot(robot, parts)
    skins = {name: PreparedSkin(loaded.skin(name), radius=radius_mm * 1e-3) for name in names}
    hoods = concatenate([skin.hoods for skin in skins.values()])
    found = find_structures(hoods, tolerance=tolerance_mm * 1e-3, rotations=int(rotations))
    files = []
    if out is not None:
        from skinmap.cli.figures import structures_figure
        from skinmap.io.output import staged_folder

        with staged_folder(out) as stage:
            structures_figure(skins, found, stage / "structures.png")
        files = ["structures.png"]
    result = summary(found)
    if as_json:
        settings = {
            "radius_mm": radius_mm,
            "tolerance_mm": tolerance_mm,
            "rotations": int(rotations),
        }
        emit({"robot": loaded.name, "parts": list(names), **settings, **result, "files": files})
        return
    click.echo(
        f"{result['structures']} structures over {result['taxels']} taxels; "
        f"{result['rare_taxels']} taxels in structures with fewer than {RARE} members"
    )
    table(
        ["structure", "taxels", "neighbours"],
        [[row["structure"], row["taxels"], row["neighbours"]] for row in result["table"]],
    )
    for file in files:
        click.echo(str(Path(out or ".") / file))


def summary(found: Structures) -> dict[str, Any]:
    """The numbers of a set of structures, ready for JSON."""
    counts = found.counts
    return {
        "structures": len(found.prototypes),
        "taxels": len(found.labels),
        "rare_taxels": int(counts[counts < RARE].sum()),
        "table": [
            {
                "structure": s,
                "taxels": int(count),
                "neighbours": int(found.prototypes.filled[s].sum()),
            }
            for s, count in enumerate(counts)
        ],
    }
