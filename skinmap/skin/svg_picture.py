"""A small picture of taxels for notebooks: lines and dots in SVG, with a line of words below."""

from __future__ import annotations

from html import escape

import numpy as np

from skinmap.arrays import FloatArray

WIDE, HIGH = 420.0, 320.0  # of the picture at most [px]
EDGE = 6.0  # free around it [px]
DOT = 0.22  # radius of a dot, in the distance of taxels if they were spread evenly
INK, LINE = "#0b3d91", "#8d97a3"


def svg_picture(points: FloatArray, lines: FloatArray, words: str) -> str:
    """HTML with a picture of dots and lines.

    Parameters
    ----------
    points : (n, 2) float
        Dots [m], y upwards; those that are not finite are left out.
    lines : (k, 2, 2) float
        Ends of lines [m].
    words : str
        Below the picture.
    """
    dots = points[np.isfinite(points).all(axis=1)]
    every = np.concatenate([dots, lines.reshape(-1, 2)])
    every = every if len(every) else np.zeros((1, 2))
    low, high = every.min(axis=0), every.max(axis=0)
    side = np.maximum(high - low, 1e-6)
    scale = float(min((WIDE - 2 * EDGE) / side[0], (HIGH - 2 * EDGE) / side[1]))
    width, height = scale * side + 2 * EDGE

    def place(at: FloatArray) -> FloatArray:
        return np.stack(
            [EDGE + (at[..., 0] - low[0]) * scale, EDGE + (high[1] - at[..., 1]) * scale], axis=-1
        ).round(1)

    radius = max(0.8, DOT * scale * float(np.sqrt(side.prod() / max(len(dots), 1))))
    path = "".join(f"M{a} {b}L{c} {d}" for (a, b), (c, d) in place(lines).tolist())
    circles = "".join(
        f'<circle cx="{x}" cy="{y}" r="{radius:.1f}"/>' for x, y in place(dots).tolist()
    )
    return (
        f'<figure style="margin:0"><svg width="{width:.0f}" height="{height:.0f}" role="img" '
        f'aria-label="{escape(words)}"><path d="{path}" stroke="{LINE}" fill="none"/>'
        f'<g fill="{INK}">{circles}</g></svg><figcaption>{escape(words)}</figcaption></figure>'
    )
