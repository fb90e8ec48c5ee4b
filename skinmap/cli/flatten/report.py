"""The report of `skinmap flatten`: one HTML file with the pictures and numbers in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from skinmap.flat.face_metrics import FaceMetric

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1d2733; margin: 2rem auto; max-width: 76rem;
       padding: 0 1rem; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #d5dbe1; }
img { max-width: 100%; } .note { color: #5b6773; } .bad { color: #b04a00; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2rem 0.7rem; text-align: right; border-bottom: 1px solid #e3e7eb; }
th:first-child, td:first-child { text-align: left; }
"""
COLUMNS = {
    "part": "part",
    "patch": "patch",
    "vertices": "vertices",
    "faces": "faces",
    "holes": "holes",
    "cut_mm": "cut [mm]",
    "method": "method",
    "flips": "flips",
    "quasi_conformal": "quasi-conformal",
    "area_sd": "area sd",
    "symmetric_dirichlet": "symmetric Dirichlet",
    "stretch_l2": "stretch L2",
    "edge_rms_percent": "edge rms [%]",
    "geodesic_stress": "geodesic stress",
    "seconds": "seconds",
}
COMPARED = {
    "part": "part",
    "patch": "patch",
    "with": "with",
    "taxels": "taxels drawn",
    "flips": "flips",
    "quasi_conformal": "quasi-conformal",
    "area_sd": "area sd",
    "symmetric_dirichlet": "symmetric Dirichlet",
    "edge_rms_percent": "edge rms [%]",
    "distance_mm": "apart [mm]",
    "seconds": "seconds",
}


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG in base64, and what it shows."""

    what: str
    data: str


def write_flat_report(
    result: Mapping[str, Any],
    pictures: Mapping[str, Sequence[Picture]],
    metric: FaceMetric,
    path: Path,
) -> None:
    """Write one self-contained page from what the command prints as JSON, and its pictures."""
    rows = result["patches"]
    sections = [
        f"<h1>{escape(result['robot'])}: flat maps</h1>",
        "<p class=note>Coloured by: "
        f"{escape(metric.label)}. Distortion at the scale that keeps the whole area; means are "
        "weighted by area, the edge error by length.</p>",
        _table(COLUMNS, rows),
    ]
    if result["compare"]:
        sections += ["<h2>Compared</h2>", _table(COMPARED, result["compare"])]
    for part, images in pictures.items():
        own = [row for row in rows if row["part"] == part]
        sections.append(f"<h2>{escape(part)}</h2>")
        sections += [
            f"<img alt='{escape(part)}: {escape(image.what)}' "
            f"src='data:image/png;base64,{image.data}'>"
            for image in images
        ]
        sections.append(_worst(own, metric))
    page = (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{escape(result['robot'])}: flat maps</title><style>{STYLE}</style></head><body>"
        + "\n".join(sections)
        + "</body></html>\n"
    )
    path.write_text(page, encoding="utf-8")


def _worst(rows: Sequence[Mapping[str, Any]], metric: FaceMetric) -> str:
    found = [
        {
            "patch": row["patch"],
            "channels": ", ".join(map(str, face["channels"])),
            "value": face["value"],
        }
        for row in rows
        for face in row["worst"]
    ]
    columns = {"patch": "patch", "channels": "channels of the triangle", "value": metric.label}
    return "<h3>Worst triangles</h3>" + _table(columns, found)


def _table(columns: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> str:
    used = {key: name for key, name in columns.items() if any(key in row for row in rows)}
    head = "".join(f"<th>{escape(name)}</th>" for name in used.values())
    body = "".join(
        "<tr>" + "".join(f"<td>{_cell(row.get(key))}</td>" for key in used) + "</tr>"
        for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div class=wide>{table}</div>"


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, Mapping):
        return f"{value['mean']:.4g} <span class=note>(max {value['max']:.4g})</span>"
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
