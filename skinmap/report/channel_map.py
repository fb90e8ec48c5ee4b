"""Channels of a skin at their places, each with the colour of its fault."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray

COLOURS = (
    "#d55e00", "#0072b2", "#cc79a7", "#e69f00", "#56b4e9", "#009e73", "#8c564b", "#5b6773",
)  # fmt: skip
SOUND, MOST_NAMED = "#dfe6ec", 40


def draw_channels(
    axis: Any, at: FloatArray, states: Mapping[int, str], names: Mapping[int, int] | None = None
) -> None:
    """Draw channels at (n, 2), those with a state in its colour and with their number.

    Parameters
    ----------
    axis : matplotlib axes
    at : (n, 2) float
        Places in the plane; NaN for a channel without one.
    states : mapping of int to str
        Faults by row of `at`.
    names : mapping of int to int, optional
        Numbers that are written beside the rows; the rows themselves by default.
    """
    size = float(np.clip(9000 / max(len(at), 1), 4, 160))
    sound = np.array([row not in states for row in range(len(at))])
    axis.scatter(*at[sound].T, s=size, color=SOUND, label="sound")
    for place, state in enumerate(dict.fromkeys(states.values())):
        own = [row for row, one in states.items() if one == state]
        colour = COLOURS[place % len(COLOURS)]
        axis.scatter(*at[own].T, s=size, color=colour, label=f"{state} ({len(own)})")
        for row in own if len(own) <= MOST_NAMED and np.isfinite(at[own]).all() else []:
            axis.annotate(
                str(row if names is None else names[row]), at[row], (0, -7),
                textcoords="offset points", fontsize=6, ha="center", va="top",
            )  # fmt: skip
    axis.set_aspect("equal")
    axis.set_axis_off()
    axis.legend(loc="upper left", bbox_to_anchor=(0.0, -0.02), frameon=False, fontsize=8, ncols=4)
