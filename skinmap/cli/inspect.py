"""`skinmap inspect`: what a robot's skin is made of, and whether it fits."""

from __future__ import annotations

from typing import Any

import click

from skinmap.cli.common import emit, json_option, open_robot, part_option, robot_argument, table


@click.command("inspect")
@robot_argument
@part_option
@json_option
def command(robot: str, parts: tuple[str, ...], as_json: bool) -> None:
    """Show the parts of a robot: taxels, distance to the body, pitch, normals.

    ROBOT is a built-in name (default: icub) or the path of a manifest.

    \b
    Example:  skinmap inspect icub --part right_forearm --json
    """
    loaded, names = open_robot(robot, parts)
    rows = [inspect_part(loaded, name) for name in names]
    if as_json:
        emit({"robot": loaded.name, "parts": rows, "taxels": sum(row["taxels"] for row in rows)})
        return
    columns = ["part", "link", "taxels", "modules", "distance mm", "max", "pitch mm"]
    table(
        [*columns, "normals deg", "inward", "covered", "verdict"],
        [
            [
                row["name"],
                row["link"],
                row["taxels"],
                row["modules"],
                row["distance_mm"]["median"],
                row["distance_mm"]["max"],
                row["pitch_mm"]["median"],
                row["normal_angle_deg"]["median"],
                row["inward"],
                row["covered"],
                row["verdict"],
            ]
            for row in rows
        ],
    )
    for row in rows:
        for warning in row["warnings"]:
            click.echo(f"{row['name']}: {warning}")


def inspect_part(robot: Any, name: str) -> dict[str, Any]:
    """The numbers of one part, ready for JSON."""
    import numpy as np

    from skinmap.skin.fit import measure_fit

    skin = robot.skin(name)
    fit = measure_fit(skin, robot.mesh(skin.link))
    inward = int(fit.inward.sum())
    warnings = []
    if inward:
        warnings.append(f"{inward} normals point into the body: inspect the link's mesh")
    if np.median(fit.distance) > np.median(fit.pitch):
        warnings.append(
            "taxels lie further from the body than from each other: wrong frame or unit"
        )
    return {
        "name": name,
        "link": skin.link,
        "channels": int(skin.channels.max()) + 1,
        "taxels": len(skin),
        "modules": len(np.unique(skin.modules)),
        "distance_mm": _spread(fit.distance * 1e3),
        "pitch_mm": _spread(fit.pitch * 1e3),
        "normal_angle_deg": {
            **_spread(np.degrees(fit.normal_angle)),
            "share_within_15": float((fit.normal_angle <= np.radians(15.0)).mean()),
        },
        "inward": inward,
        "covered": int(fit.covered.sum()),
        "verdict": "look again" if warnings else "ok",
        "warnings": warnings,
    }


def _spread(values: Any) -> dict[str, float]:
    import numpy as np

    return {
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "min": float(values.min()),
        "max": float(values.max()),
    }
