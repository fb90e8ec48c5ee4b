"""The report of a calibrated patch: one HTML file with pictures, numbers and what to do next."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from calibration.commands.report_figures import board_picture, patch_picture, residual_picture
from calibration.files.tables import BoardTable
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import FloatArray, IntArray

MM = 1e3
WORDS = {
    "ok": "The patch may be used as it is.",
    "low_coverage": "The evidence covers too little of the patch.",
    "ambiguous": "What was measured does not settle where the patch is.",
    "unobservable": "The patch can still move freely in some way.",
}
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1d2733; margin: 2rem auto; max-width: 68rem;
       padding: 0 1rem; }
h2 { margin-top: 2.2rem; border-bottom: 1px solid #d5dbe1; }
img { max-width: 100%; } .note { color: #5b6773; } .ok { color: #00795c; } .look { color: #b04a00; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2rem 0.8rem; text-align: right; border-bottom: 1px solid #e3e7eb; }
th:first-child, td:first-child { text-align: left; }
"""


@dataclass(frozen=True, eq=False, slots=True)
class EvidenceRows:
    """What a patch was calibrated by.

    Attributes
    ----------
    kind : str
        "anchors" or "touches".
    taxels : (k,) int
        Row of the board that each belongs to most.
    missed : (k,) float
        Distance from what was found [m].
    held_out : (k or 0,) float
        The same where it was left out [m].
    """

    kind: str
    taxels: IntArray
    missed: FloatArray
    held_out: FloatArray


def write_patch_report(
    title: str,
    result: Mapping[str, Any],
    found: PatchCalibration,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    evidence: EvidenceRows,
    path: Path,
) -> None:
    """Write one self-contained page.

    Parameters
    ----------
    title : str
        What was laid on what.
    result : mapping
        What the command prints as JSON.
    found : PatchCalibration
    board : BoardTable
    link : (v, 3) array of float [m], (f, 3) array of int
    evidence : EvidenceRows
    path : Path
    """
    mood = "ok" if result["status"] == "ok" else "look"
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in result["reasons"])
    board_image = board_picture(
        found, board.layout, board.channels, {evidence.kind: evidence.taxels}
    )
    sections = [
        f"<h1>{escape(title)}</h1>",
        f"<p class={mood}><b>{escape(result['status'])}</b>: "
        f"{escape(WORDS[result['status']])}</p><ul>{reasons}</ul>",
        rows_table(("", ""), _numbers(result)),
        "<h2>On the link</h2>",
        picture(patch_picture(found, link), "patch on its link, coloured by predicted error"),
        "<h2>On the board</h2>",
        picture(board_image, "board, coloured by predicted error"),
        f"<p>{escape(_advice(result))}</p>",
        "<h2>Residuals</h2>",
        "<p class=note>Each divided by what was expected of it: most lie below 2.</p>",
        picture(residual_picture(found), "residuals"),
        f"<h2>{escape(evidence.kind.capitalize())}</h2>",
        _evidence_table(board, evidence),
    ]
    path.write_text(page(title, sections), encoding="utf-8")


def page(title: str, sections: Sequence[str]) -> str:
    """A whole HTML page with nothing outside it."""
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"
        + "\n".join(sections)
        + "</body></html>\n"
    )


def _numbers(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    sd, held_out = result["predicted_sd_mm"], result["cross_validation_mm"]
    left_out = "too little evidence to leave any out" if held_out is None else f"{held_out:.2f} mm"
    return [
        ("taxels", str(result["taxels"])),
        ("predicted error, median", f"{sd['median']:.2f} mm"),
        ("predicted error, 95 % of the taxels below", f"{sd['p95']:.2f} mm"),
        ("predicted error, worst taxel", f"{sd['max']:.2f} mm"),
        ("held-out error: anchors left out are missed by (rms)", left_out),
        ("coverage: share of the patch inside the hull of the evidence",
         f"{100 * result['coverage']:.0f} %"),
        ("scale of the body against the layout", f"{result['scale']:.4f}"),
        ("mean height above the link", f"{result['height_mm']:.2f} mm"),
    ]  # fmt: skip


def _advice(result: Mapping[str, Any]) -> str:
    return (
        f"Weakest direction: {result['weakest']}. "
        f"Measure next: taxels {', '.join(map(str, result['next']))}, in this order."
    )


def _evidence_table(board: BoardTable, evidence: EvidenceRows) -> str:
    rows = []
    for row, taxel in enumerate(evidence.taxels):
        left = f"{MM * evidence.held_out[row]:.2f}" if len(evidence.held_out) else "-"
        rows.append((str(board.channels[taxel]), f"{MM * evidence.missed[row]:.2f}", left))
    return rows_table(("taxel", "missed by [mm]", "missed when left out [mm]"), rows)


def rows_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A table of texts."""
    heads = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"


def picture(data: bytes, what: str) -> str:
    """A PNG inside the page."""
    encoded = base64.b64encode(data).decode()
    return f"<img alt='{escape(what)}' src='data:image/png;base64,{encoded}'>"
