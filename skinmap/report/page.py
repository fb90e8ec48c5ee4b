"""The one page of all reports: HTML with its style and pictures inside, nothing from elsewhere.

Figures as PNG, and pictures and films inside a page, so that the page is one file.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.report.result import OK, Verdict
from skinmap.report.table import Table

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


STYLE = Path(__file__).with_suffix(".css").read_text(encoding="utf-8")


def page(title: str, sections: Iterable[str]) -> str:
    """A whole page.

    Parameters
    ----------
    title : str
        Of the window, and above everything.
    sections : iterable of str
        HTML, as the functions below and `skinmap.report.page` make it.
    """
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(title)}</h1>\n" + "\n".join(sections) + "</body></html>\n"
    )


def lines_page(title: str, lines: Iterable[str | Table], pictures: Iterable[str] = ()) -> str:
    """A page of what a command shows to people, and its pictures.

    Parameters
    ----------
    title : str
    lines : iterable of str or Table
    pictures : iterable of str
        HTML, as `skinmap.report.page` makes it.

    Returns
    -------
    str
        HTML with its style inside; nothing is loaded from elsewhere.

    Examples
    --------
    >>> from skinmap.report import Table, lines_page
    >>> "<td>28</td>" in lines_page("Torso", ["Found:", Table(["structures"], [[28]])])
    True
    """
    words = [line.html() if isinstance(line, Table) else paragraph(line) for line in lines]
    return page(title, [*words, *pictures])


def heading(text: str) -> str:
    """The heading of a section."""
    return f"<h2>{escape(text)}</h2>"


def note(text: str) -> str:
    """A quiet paragraph."""
    return f"<p class=note>{escape(text)}</p>"


def paragraph(text: str) -> str:
    """A paragraph."""
    return f"<p>{escape(text)}</p>"


def bullets(texts: Sequence[str]) -> str:
    """A list; nothing where it is empty."""
    inner = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{inner}</ul>" if texts else ""


def verdict_lines(verdict: Verdict) -> str:
    """A status, and its reasons."""
    mood = "ok" if verdict.status == OK else "look"
    head = f"<p class={mood}><b>{escape(verdict.status)}</b></p>"
    return head + bullets(verdict.reasons)


def cards(figures: Iterable[tuple[str, str]]) -> str:
    """A few figures, large, each with its words below."""
    boxes = "".join(f"<div class=card><b>{escape(a)}</b>{escape(b)}</div>" for a, b in figures)
    return f"<div class=cards>{boxes}</div>"


def grid(inner: Iterable[str]) -> str:
    """Pictures side by side where there is room."""
    return f"<div class=grid>{''.join(inner)}</div>"


# Channels of a skin at their places, each with the colour of its fault.

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
