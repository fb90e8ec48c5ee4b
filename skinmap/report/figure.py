"""Figures as PNG; matplotlib is imported inside, as only pictures need it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

DPI = 110
MM = 1e3


def plain_figure(size: tuple[float, float]) -> Any:
    """An empty matplotlib figure of a size [inch]."""
    # The object interface and not pyplot: no global state, no window system.
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=DPI, layout="constrained")


def picture_bytes(figure: Any) -> bytes:
    """A matplotlib figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    # Not `print_figure`, which draws everything once more beforehand to find the layout.
    FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def save_figure(figure: Any, path: Path) -> None:
    """Write a matplotlib figure, as vectors where the name ends in .svg or .pdf, else as PNG."""
    if path.suffix not in (".svg", ".pdf"):
        path.write_bytes(picture_bytes(figure))
        return
    import matplotlib as mpl

    with mpl.rc_context({"svg.fonttype": "none", "pdf.fonttype": 42}):  # text stays text
        figure.savefig(path)
