"""The report of the first run: one HTML file with every picture and number in it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from skinmap.flat.distortion import spread
from skinmap.touch.prepared_skin import PreparedSkin

TYPES = {".png": "image/png", ".mp4": "video/mp4", ".gif": "image/gif"}
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1d2733; margin: 2rem auto; max-width: 70rem;
       padding: 0 1rem; }
h1 { margin-bottom: 0.2rem; } h2 { margin-top: 2.5rem; border-bottom: 1px solid #d5dbe1; }
img, video { max-width: 100%; border: 1px solid #e3e7eb; border-radius: 4px; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.8rem; text-align: right; border-bottom: 1px solid #e3e7eb; }
th:first-child, td:first-child { text-align: left; }
.cards { display: flex; flex-wrap: wrap; gap: 1rem; }
.card { background: #f3f6f9; border-radius: 6px; padding: 0.6rem 1rem; }
.card b { display: block; font-size: 1.5rem; } .note { color: #5b6773; }
.maps { display: grid; grid-template-columns: repeat(auto-fill, minmax(30rem, 1fr)); gap: 1rem; }
@media (max-width: 40rem) { .maps { grid-template-columns: 1fr; } table { font-size: 0.8rem; } }
"""


def write_report(
    result: Mapping[str, Any], folder: Path, skins: Mapping[str, PreparedSkin]
) -> None:
    """Write `report.html` from the numbers and the pictures that lie in the folder."""
    movie = next(name for name in result["files"] if Path(name).stem == "replay")
    sections = [
        _head(result),
        f"<h2>Touches on the body</h2>{_media(folder / 'robot.png', 'named touches on the body')}"
        "<p class=note>Simulated touches on parts that the classifier was never trained on. "
        "Boxes: the name given and its confidence.</p>",
        f"<h2>Replay</h2>{_media(folder / movie, 'replay of simulated touches')}",
        "<h2>How often the name is right</h2>" + _accuracy(result),
        "<h2>Flat maps</h2>" + _charts(skins),
        "<div class=maps>"
        + "".join(_media(folder / "flatmaps" / f"{part}.png", part) for part in skins)
        + "</div>",
        f"<h2>Periodic structures</h2>{_media(folder / 'structures.png', 'structures')}",
    ]
    page = (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>Skinmap: {escape(result['robot'])}</title><style>{STYLE}</style></head><body>"
        + "\n".join(sections)
        + "</body></html>\n"
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _head(result: Mapping[str, Any]) -> str:
    strain, normals, accuracy = result["edge_rms_percent"], result["normals"], result["accuracy"]
    cards = [
        (f"{result['taxels']:,}", f"taxels on {len(result['parts'])} parts"),
        (f"{result['meshed_taxels']:,}", f"of them meshed, in {result['patches']} patches"),
        (f"{result['flips']}", "flipped triangles"),
        (f"{strain['median']:.2f} %", f"edge rms, median patch (worst {strain['max']:.2f} %)"),
        (f"{normals['median_deg']:.1f}°", "normals against the body, median"),
        (
            f"{result['structures']['plain']} / {result['structures']['rotated']}",
            "structures, plain / with rotation",
        ),
        (f"{100 * accuracy['same_parts']:.1f} %", "named right, parts trained on (simulated)"),
        (f"{100 * accuracy['other_parts']:.1f} %", "named right, other parts (simulated)"),
    ]
    boxes = "".join(f"<div class=card><b>{big}</b>{escape(small)}</div>" for big, small in cards)
    return (
        f"<h1>{escape(result['robot'])}</h1><p class=note>Skinmap demo, seed {result['seed']}, "
        f"{result['seconds']['total']:.0f} s</p><div class=cards>{boxes}</div>"
    )


def _accuracy(result: Mapping[str, Any]) -> str:
    labels = sorted({label for row in result["table"] for label in row["per_label"]})
    rows = [
        [
            row["classifier"],
            row["tested_on"].replace("_", " "),
            str(row["touches"]),
            _percent(row["accuracy"]),
            *(_percent(row["per_label"].get(label)) for label in labels),
        ]
        for row in result["table"]
    ]
    names = [label.replace("_", " ") for label in labels]
    note = (
        "<p class=note>Simulated touches, counted per touch event; trained on "
        f"{escape(', '.join(result['trained_on']))} ({result['touches']['train']} touches). "
        "No tested touch, and for other parts no part or mirror image, was trained on. "
        "A gesture that does not fit a part is not simulated there.</p>"
    )
    return _table(["classifier", "tested on", "touches", "all", *names], rows) + note


def _charts(skins: Mapping[str, PreparedSkin]) -> str:
    rows = []
    for part, skin in skins.items():
        for chart in skin.flat.charts:
            numbers = chart.distortion
            angle = spread(numbers.quasi_conformal, numbers.face_areas)
            rows.append(
                [
                    part,
                    str(chart.patch),
                    str(len(chart.taxels)),
                    str(chart.holes),
                    chart.method,
                    str(numbers.flips),
                    f"{100 * numbers.edge_rms:.2f}",
                    f"{angle['mean']:.4f}",
                    f"{numbers.area_sd:.4f}",
                ]
            )
    columns = ["part", "patch", "taxels", "holes", "method", "flips", "edge rms [%]"]
    return _table([*columns, "quasi-conformal", "area sd"], rows)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _media(path: Path, what: str) -> str:
    data = f"data:{TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"
    if path.suffix == ".mp4":
        return f"<video controls autoplay loop muted src='{data}'></video>"
    return f"<img src='{data}' alt='{escape(what)}'>"
