"""The page of a check-up: its faults in words, and the parts with the faults marked."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.wiring.findings import WORDS, CheckupResult, lines
from skinmap.errors import SkinError
from skinmap.report.page import draw_channels, plain_figure, save_figure

if TYPE_CHECKING:
    from calibration.wiring.examination import Case
    from skinmap.arrays import FloatArray
    from skinmap.skin.robot import Robot

A4 = (8.27, 11.69)  # [inch]
MOST_PARTS, MOST_LINES, WIDE = 3, 26, 96
COLOUR = {"healthy": "#009e73", "faulty": "#d55e00", "undecided": "#e69f00",
          "inconsistent": "#d55e00"}  # fmt: skip


def write_page(
    path: Path, result: CheckupResult, cases: Sequence[Case], robot: Robot, when: str
) -> None:
    """Write the check-up as a page, a PDF by its suffix."""
    ill = {one.part for one in result.faults}
    shown = sorted(cases, key=lambda case: case.part not in ill)[:MOST_PARTS]
    words = [line for one in lines(result) for line in textwrap.wrap(
        one, WIDE, subsequent_indent="      ", drop_whitespace=False)][1:]  # fmt: skip
    if len(words) > MOST_LINES:
        words = [*words[:MOST_LINES], f"and {len(words) - MOST_LINES} more lines: see --json"]
    figure = plain_figure(A4)
    high = 1.0 + 0.16 * len(words)  # of the words [inch]
    share = (A4[1] - high) / max(len(shown), 1)
    text, *maps = figure.subplots(1 + len(shown), 1, height_ratios=[high, *[share] * len(shown)])
    text.set_axis_off()
    text.text(0, 1, result.status.capitalize(), fontsize=22, color=COLOUR[result.status],
              weight="bold", va="top", transform=text.transAxes)  # fmt: skip
    head = f"Check-up of {result.robot}, {when}: {WORDS[result.status]}"
    body = "\n".join([*textwrap.wrap(head, WIDE), "", *words])
    text.annotate(body, (0, 1), (0, -30), xycoords="axes fraction", textcoords="offset points",
                  fontsize=8, va="top", linespacing=1.35)  # fmt: skip
    for axis, case in zip(maps, shown, strict=True):
        channels = case.boards.table.channels
        states = {
            int(row): one.kind.replace("_", " ")
            for one in reversed(result.faults) if one.part == case.part
            for row in np.flatnonzero(np.isin(channels, one.channels))
        }  # fmt: skip
        draw_channels(axis, flat_places(robot, case), states, dict(enumerate(channels.tolist())))
        axis.set_anchor("NW")
        axis.set_title(f"{case.part}, laid flat", loc="left", fontsize=9)
    save_figure(figure, path)


def flat_places(robot: Robot, case: Case) -> FloatArray:
    """(n, 2) of a part's taxels laid flat; without a flat map, from one side."""
    import skinmap

    positions = case.boards.table.positions
    try:
        uv = skinmap.flatten(skinmap.build_surface(robot.skin(case.part))).uv
    except SkinError:
        uv = np.full((len(positions), 2), np.nan)
    known = np.isfinite(uv[:, 0]) if len(uv) == len(positions) else np.zeros(1, bool)
    if not known.all():
        centred = positions - positions.mean(axis=0)
        uv = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    return np.asarray(uv)
