"""Reports of calibrations: the verdict, numbers in words, pictures, what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import astuple
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.commands.results import MM, PatchResult
from calibration.patch.patch_calibration import PatchCalibration
from skinmap.arrays import FloatArray, IntArray
from skinmap.report.page import (
    heading,
    image,
    note,
    page,
    paragraph,
    picture_bytes,
    plain_figure,
    verdict_lines,
)
from skinmap.report.table import Table

if TYPE_CHECKING:
    from calibration.commands.results import Calibrated
    from calibration.response.response import ResponseCalibration

Picture = tuple[str, bytes, str]  # heading, PNG, and what one sees on it
PLACED = "Calibrated taxels from two sides, coloured by their predicted error."
COLOURS = {
    "ok": "#00795c", "never touched": "#9aa5b1", "dead": "#1d2733", "stuck": "#7a3fb0",
    "saturated": "#b04a00", "noisy": "#d4a000",
}  # fmt: skip
MAX_NAMED = 24  # taxels with evidence that are named


def judged_page(
    title: str, result: Calibrated, lines: Iterable[str], pictures: Sequence[Picture], *more: str
) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
    result : Calibrated
        Its status and reasons come first.
    lines : iterable of str
        What people read in the terminal.
    pictures : sequence of Picture
    *more : str
        HTML below them.
    """
    shown = [heading(head) + note(words) + image(png, head) for head, png, words in pictures]
    verdict = verdict_lines(result.verdict(accept=False))
    return page(title, [verdict, *map(paragraph, lines), *shown, *more])


def places_picture(
    positions: FloatArray,
    off: FloatArray,
    words: str = "predicted error [mm]",
    *,
    most: float | None = None,
    behind: FloatArray | None = None,
) -> bytes:
    """PNG: taxels or points (n, 3) [m], coloured by off (n,) [m], which `words` names.

    From above and from beside, the nearer ones in front. Colours go from 0 to `most` [m], or from
    the least to the most; points `behind` (k, 3) [m] are grey.
    """
    middle = positions.mean(axis=0)
    _, _, axes = np.linalg.svd(positions - middle, full_matrices=False)
    across = MM * (positions - middle) @ axes.T
    ground = MM * ((positions if behind is None else behind) - middle) @ axes.T
    scale = {} if most is None else {"vmin": 0.0, "vmax": MM * most}
    figure = plain_figure((9.4, 3.8))
    both = figure.subplots(1, 2)
    size = np.clip(14_000 / len(positions), 3.0, 14.0)
    for axis, (up, depth) in zip(both, ((1, 2), (2, 1)), strict=True):
        order = np.argsort(across[:, depth])
        places = across[order][:, (0, up)].T
        if behind is not None:
            axis.scatter(*ground[:, (0, up)].T, c="0.8", s=1.0)
        shown = axis.scatter(*places, c=MM * off[order], s=size, cmap="viridis", **scale)
        axis.set_aspect("equal")
        axis.set_xlabel("along the skin [mm]")
        axis.set_ylabel(("across the skin [mm]", "out of the skin [mm]")[up - 1])
    figure.colorbar(shown, ax=list(both), shrink=0.8).set_label(words)
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
    axes[1].xaxis.get_major_locator().set_params(integer=True)
    axes[0].legend(frameon=False, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return picture_bytes(figure)


def evidence_table(result: PatchResult, kind: str) -> str:
    """Heading, words and table of the anchors or touches (`kind`) of a patch."""
    columns = ("channel", "missed by [mm]", "left out, missed by [mm]", "expected [mm]", "misfit")
    words = (
        f"How far each of the {kind} is from where it was laid, and from where all others predict "
        "it, beside the error that is expected there."
    )
    table = Table(columns, [astuple(one) for one in result.evidence])
    return heading(kind.capitalize()) + note(words) + table.html()


def board_picture(
    found: PatchCalibration, layout: FloatArray, channels: IntArray, kind: str, taxels: IntArray
) -> bytes:
    """PNG of the flat board coloured by the predicted error, with the evidence on it.

    Parameters
    ----------
    found : PatchCalibration
    layout : (n, 2) array of float
        [m].
    channels : (n,) array of int
        Names of the taxels.
    kind : str
        What is known: "anchors" or "touches".
    taxels : (k,) array of int
        Where.
    """
    sd = MM * found.predicted_sd
    wide, tall = np.ptp(layout, axis=0)
    height = float(np.clip(7.5 * tall / max(wide, 1e-9), 2.5, 7.0))
    figure = plain_figure((8.6, height + 1.4))
    axis = figure.subplots()
    places = MM * layout
    paint = axis.scatter(*places.T, c=sd, vmin=0.0, cmap="viridis", s=26, linewidths=0)
    style = {"s": 110, "linewidths": 1.4, "edgecolors": "black", "label": kind}
    names = [str(channels[taxel]) for taxel in taxels[:MAX_NAMED]]
    _ring(axis, places[taxels], names, (6, 6), **style)
    following = found.next_taxels
    if len(following):
        style = {"s": 130, "linewidths": 1.6, "edgecolors": "#d3202f", "label": "measure next"}
        names = [f"{rank}: {channels[taxel]}" for rank, taxel in enumerate(following, start=1)]
        _ring(axis, places[following], names, (6, -13), marker="s", **style)
    axis.set_aspect("equal")
    axis.margins(0.08)
    axis.set_xlabel("mm on the board, seen from outside", fontsize=9)
    axis.tick_params(labelsize=8)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.colorbar(paint, ax=axis, shrink=0.8).set_label("predicted error [mm]")
    return picture_bytes(figure)


def _ring(
    axis: Any, places: FloatArray, names: Sequence[str], off: tuple[int, int], **style: Any
) -> None:
    """Marks round places (k, 2), and the names of the first of them."""
    axis.scatter(*places.T, facecolors="none", **style)
    for place, name in zip(places, names, strict=False):
        axis.annotate(
            name, place, xytext=off, textcoords="offset points", fontsize=8,
            color=style["edgecolors"],
        )  # fmt: skip
