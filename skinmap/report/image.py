"""Figures as PNG, and pictures and films inside a page, so that the page is one file."""

from __future__ import annotations

import base64
import io
from html import escape
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


TYPES = {".png": "image/png", ".mp4": "video/mp4", ".gif": "image/gif"}


def data_uri(data: bytes, kind: str = "image/png") -> str:
    """Bytes as an address that holds them."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def image(png: bytes, what: str) -> str:
    """A PNG, and in words what it shows."""
    return f"<img alt='{escape(what)}' src='{data_uri(png)}'>"


def media(path: Path, what: str) -> str:
    """A file with a picture or a film, and in words what it shows."""
    data = data_uri(path.read_bytes(), TYPES[path.suffix])
    if path.suffix == ".mp4":
        return f"<video controls autoplay loop muted src='{data}'></video>"
    return f"<img alt='{escape(what)}' src='{data}'>"
