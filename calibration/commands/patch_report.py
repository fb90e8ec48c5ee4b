"""The report of a calibrated patch: one HTML file with pictures, numbers and what to do next."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.commands.report_figures import board_picture, judged_picture, patch_picture
from calibration.files.tables import BoardTable
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from calibration.commands.patch_job import PatchResult

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


def write_patch_report(
    title: str,
    result: PatchResult,
    found: PatchCalibration,
    board: BoardTable,
    link: tuple[FloatArray, IntArray],
    kind: str,
    path: Path,
) -> None:
    """Write one self-contained page.

    Parameters
    ----------
    title : str
        What was laid on what.
    result : PatchResult
        What the command prints as JSON.
    found : PatchCalibration
    board : BoardTable
    link : (v, 3) array of float [m], (f, 3) array of int
    kind : str
        "anchors" or "touches": what the patch was calibrated by.
    path : Path
    """
    mood = "ok" if result.status == "ok" else "look"
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in result.reasons)
    rows = {int(channel): row for row, channel in enumerate(board.channels)}
    taxels = np.array([rows[one.channel] for one in result.evidence], np.int64)
    board_image = board_picture(found, board.layout, board.channels, {kind: taxels})
    sections = [
        f"<h1>{escape(title)}</h1>",
        f"<p class={mood}><b>{escape(result.status)}</b>: "
        f"{escape(WORDS[result.status])}</p><ul>{reasons}</ul>",
        rows_table(("", ""), _numbers(result)),
        "<h2>On the link</h2>",
        picture(patch_picture(found, link), "patch on its link, coloured by predicted error"),
        "<h2>On the board</h2>",
        picture(board_image, "board, coloured by predicted error"),
        f"<p>{escape(_advice(result))}</p>",
        "<h2>Predicted against measured</h2>",
        f"<p class=note>Each of the {kind} where all others predict it, beside the error that is "
        "expected there (bars, and black lines); and the strain of the sheet beside the strain "
        "that a flat map of this place has (on the line where they agree).</p>",
        picture(judged_picture(result, found), "leave-one-out errors and strain"),
        f"<h2>{escape(kind.capitalize())}</h2>",
        _evidence_table(result),
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


def _numbers(result: PatchResult) -> list[tuple[str, str]]:
    sd, left, expected = (
        result.predicted_mm, result.leave_one_out_mm, result.leave_one_out_expected_mm
    )  # fmt: skip
    return [
        ("taxels", str(result.taxels)),
        ("predicted error, median", f"{sd['median']:.2f} mm"),
        ("predicted error, 95 % of the taxels below", f"{sd['p95']:.2f} mm"),
        ("predicted error, worst taxel", f"{sd['max']:.2f} mm"),
        ("leave-one-out error, median (expected)",
         f"{left['median']:.2f} mm ({expected['median']:.2f} mm)"),
        ("leave-one-out error, worst (expected)",
         f"{left['max']:.2f} mm ({expected['max']:.2f} mm)"),
        ("strain, rms (expected of a flat map of this place)",
         f"{result.strain_percent:.2f} % ({result.expected_strain_percent:.2f} %)"),
        ("strain that was not expected, rms", f"{result.unexpected_strain_percent:.2f} %"),
        ("coverage: share of the patch inside the hull of the evidence",
         f"{100 * result.coverage:.0f} %"),
        ("scale of the body against the layout", f"{result.scale:.4f}"),
        ("layout drawn from the other side", "yes" if result.mirrored else "no"),
        ("mean height above the link", f"{result.height_mm:.2f} mm"),
    ]  # fmt: skip


def _advice(result: PatchResult) -> str:
    return (
        f"Weakest direction: {result.weakest}. "
        f"Measure next: channels {', '.join(map(str, result.next))}, in this order."
    )


def _evidence_table(result: PatchResult) -> str:
    head = ("channel", "missed by [mm]", "left out, missed by [mm]", "expected [mm]", "misfit")
    rows = [
        (str(one.channel), f"{one.missed_mm:.2f}", f"{one.leave_one_out_mm:.2f}",
         f"{one.expected_mm:.2f}", f"{one.misfit:.1f}")
        for one in result.evidence
    ]  # fmt: skip
    return rows_table(head, rows)


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
