"""Reports of mounts and responses: one HTML file with the verdict, the numbers and a picture."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from calibration.commands.patch_report import STYLE
from calibration.response.response import ResponseCalibration
from skinmap.arrays import FloatArray
from skinmap.report.figure import picture_bytes, plain_figure

MM = 1e3
PLACED = "Calibrated taxels from two sides, coloured by their predicted error."
COLOURS = {
    "ok": "#00795c", "never touched": "#9aa5b1", "dead": "#1d2733", "stuck": "#7a3fb0",
    "saturated": "#b04a00", "noisy": "#d4a000",
}  # fmt: skip


def write_report(
    title: str,
    result: Mapping[str, Any],
    rows: Sequence[tuple[str, str]],
    pictures: Sequence[tuple[str, bytes, str]],
    path: Path,
) -> None:
    """Write one self-contained page.

    Parameters
    ----------
    title : str
    result : mapping
        What the command prints as JSON: its `status` and `reasons` come first.
    rows : sequence of two str
        Numbers in words.
    pictures : sequence of str, bytes, str
        Heading, PNG and what one sees on it.
    path : Path
    """
    mood = "ok" if result["status"] == "ok" else "look"
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in result["reasons"])
    body = "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in rows)
    shown = "".join(
        f"<h2>{escape(head)}</h2><p class=note>{escape(words)}</p>"
        f"<img alt='{escape(head)}' src='data:image/png;base64,{base64.b64encode(png).decode()}'>"
        for head, png, words in pictures
    )
    path.write_text(
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(title)}</h1><p class={mood}><b>{escape(result['status'])}</b></p>"
        f"<ul>{reasons}</ul><table>{body}</table>{shown}</body></html>\n",
        encoding="utf-8",
    )


def distance_picture(before: FloatArray | None, after: FloatArray) -> bytes:
    """PNG: how many touches miss by how much, before and after the fit [mm]."""
    figure = plain_figure((7.0, 3.2))
    axis = figure.subplots()
    both = after if before is None else np.concatenate([before, after])
    edges = np.linspace(0.0, MM * max(float(np.percentile(both, 99)), 1e-6), 41)
    if before is not None:
        axis.hist(MM * before, edges, color="#9aa5b1", label="as it came")
    axis.hist(MM * after, edges, color="#00795c", alpha=0.75, label="calibrated")
    axis.set_xlabel("distance of what touched [mm]")
    axis.set_ylabel("touches")
    axis.legend(frameon=False)
    return picture_bytes(figure)


def taxel_picture(positions: FloatArray, sd: FloatArray) -> bytes:
    """PNG: taxels (n, 3) [m] in the frame of their link from two sides, coloured by sd (n,) [m]."""
    middle = positions.mean(axis=0)
    _, _, axes = np.linalg.svd(positions - middle, full_matrices=False)
    across = MM * (positions - middle) @ axes.T
    figure = plain_figure((9.4, 3.8))
    both = figure.subplots(1, 2)
    for axis, (right, up, depth) in zip(both, ((0, 1, 2), (0, 2, 1)), strict=True):
        order = np.argsort(across[:, depth])
        shown = axis.scatter(
            across[order, right], across[order, up], c=MM * sd[order], s=14, cmap="viridis"
        )
        axis.set_aspect("equal")
        axis.set_xlabel("along the patch [mm]")
        axis.set_ylabel(("across the patch [mm]", "out of the patch [mm]")[up == 2])
    figure.colorbar(shown, ax=list(both), shrink=0.8).set_label("predicted error [mm]")
    return picture_bytes(figure)


def response_picture(response: ResponseCalibration) -> bytes:
    """PNG: baseline, noise and threshold of each channel, coloured by its health."""
    figure = plain_figure((9.0, 5.0))
    axes = figure.subplots(2, 1, sharex=True)
    channel = np.arange(len(response))
    for state in dict.fromkeys(response.health.tolist()):
        own = response.health == state
        for axis, values in zip(axes, (response.baseline, response.noise), strict=True):
            axis.scatter(channel[own], values[own], s=9, color=COLOURS[state], label=state)
    axes[0].set_ylabel("baseline [counts]")
    axes[1].set_ylabel("noise [counts]")
    axes[1].set_xlabel("channel")
    axes[0].legend(frameon=False, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return picture_bytes(figure)
