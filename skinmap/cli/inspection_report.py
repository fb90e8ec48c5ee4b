"""The HTML report of `skinmap inspect`: a picture, the numbers and a verdict for each part."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.cli.figures import picture_bytes
from skinmap.skin.fit import measure_fit
from skinmap.skin.robot import Robot

MM = 1e3
VIEWS = ((15.0, -60.0), (15.0, 120.0))  # elevation and azimuth of the two views [deg]
MOST_FACES = 3000  # of the link drawn behind the taxels: more cannot be seen at this size
FAR_MM = 3.0  # end of the colour scale
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1d2733; margin: 2rem auto; max-width: 64rem; }
img { max-width: 100%; } table { border-collapse: collapse; }
td, th { padding: 0.2rem 0.8rem; text-align: left; border-bottom: 1px solid #e3e7eb; }
.ok { color: #00795c; } .look { color: #b04a00; }
"""


def write_inspection(
    name: str, rows: Sequence[Mapping[str, Any]], robot: Robot | None, path: Path
) -> None:
    """Write one self-contained page; pictures need the robot's body."""
    sections = []
    for row in rows:
        mood = "ok" if row["verdict"] == "ok" else "look"
        notes = "".join(f"<li>{escape(text)}</li>" for text in row["warnings"])
        picture = "" if robot is None else _image(part_picture(robot, row["name"]), row["name"])
        sections.append(
            f"<h2>{escape(row['name'])}</h2><p class={mood}><b>{escape(row['verdict'])}</b></p>"
            f"<ul>{notes}</ul>{picture}{_numbers(row)}"
        )
    page = (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        f"<title>{escape(name)}: skin</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(name)}</h1>" + "\n".join(sections) + "</body></html>\n"
    )
    path.write_text(page, encoding="utf-8")


def part_picture(robot: Robot, name: str) -> bytes:
    """PNG of a part from two sides: link in grey, taxels coloured by their distance to it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    skin, mesh = robot.skin(name), robot.mesh(robot.part(name).link)
    found = measure_fit(skin, mesh)
    figure = Figure(figsize=(10.0, 4.6), dpi=100, layout="constrained")
    points = skin.positions * MM
    scale = Normalize(0.0, FAR_MM)
    step = max(1, len(mesh.faces) // MOST_FACES)
    for place, (elevation, azimuth) in enumerate(VIEWS):
        axis: Any = figure.add_subplot(1, 2, place + 1, projection="3d")
        triangles = mesh.vertices[mesh.faces[::step]] * MM
        axis.add_collection3d(Poly3DCollection(triangles, facecolor="#c9ced4", alpha=0.25))
        axis.scatter(*points.T, c=found.distance * MM, s=9, cmap="viridis", norm=scale)
        tips = points + 6.0 * skin.normals
        for start, end in zip(points[::5], tips[::5], strict=True):
            axis.plot(*np.stack([start, end]).T, color="#303030", linewidth=0.6)
        axis.set_box_aspect(np.ptp(points, axis=0) + 1.0)
        for setter, low, high in zip(
            (axis.set_xlim, axis.set_ylim, axis.set_zlim),
            points.min(axis=0) - 8.0,
            points.max(axis=0) + 8.0,
            strict=True,
        ):
            setter(low, high)
        axis.view_init(elevation, azimuth)
        axis.tick_params(labelsize=7)
    bar = figure.colorbar(
        ScalarMappable(scale, "viridis"), ax=figure.axes, shrink=0.7, extend="max"
    )
    bar.set_label("distance to the link [mm]")
    return picture_bytes(figure)


def _numbers(row: Mapping[str, Any]) -> str:
    cells = []
    for key, value in row.items():
        if key in ("name", "verdict", "warnings"):
            continue
        if isinstance(value, Mapping):
            words = [
                f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in value.items()
            ]
            text = ", ".join(words)
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
        cells.append(f"<tr><th>{escape(key)}</th><td>{escape(text or '-')}</td></tr>")
    return f"<table>{''.join(cells)}</table>"


def _image(data: bytes, what: str) -> str:
    encoded = base64.b64encode(data).decode()
    return f"<img alt='{escape(what)}' src='data:image/png;base64,{encoded}'>"
