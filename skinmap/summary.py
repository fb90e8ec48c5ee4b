"""What an object says of itself: one line at the prompt, a small table in a notebook."""

from __future__ import annotations

import html
import importlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from skinmap.errors import OutputError

SHOWN = 4  # names of a long list
STYLE = "text-align: left; padding: 0 1em 0 0"


class Summary:
    """Base of objects that hold arrays: their facts are shown, never the arrays.

    A class says in `facts` what it is; both ways of showing it come from there.
    """

    __slots__ = ()

    def facts(self) -> Mapping[str, object]:
        """Names and values, the most telling first; values carry their units."""
        raise NotImplementedError

    def __repr__(self) -> str:
        said = ", ".join(f"{name}={value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({said})"

    def _repr_html_(self) -> str:
        """For notebooks."""
        rows = "".join(
            f'<tr><th style="{STYLE}">{html.escape(name.replace("_", " "))}</th>'
            f'<td style="{STYLE}">{html.escape(str(value))}</td></tr>'
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


class Drawable(Summary):
    """Base of objects that can be drawn as a figure."""

    __slots__ = ()
    FIGURE: ClassVar[str]  # "module:function" that draws it, loaded when a figure is wanted

    def plot(self) -> Any:
        """Draw it.

        Returns
        -------
        matplotlib.figure.Figure
        """
        home, _, function = self.FIGURE.partition(":")
        return getattr(importlib.import_module(home), function)(self)

    def save(self, path: str | Path) -> Path:
        """Write its figure.

        Parameters
        ----------
        path : str or Path
            Ends in .png, .svg or .pdf.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        OutputError
            Another ending, or a file that cannot be written.
        """
        path = Path(path)
        if path.suffix not in (".png", ".svg", ".pdf"):
            raise OutputError(f"{str(path)!r}: a figure ends in .png, .svg or .pdf")
        figure = self.plot()
        try:
            importlib.import_module("skinmap.report.page").save_figure(figure, path)
        except OSError as error:
            path.unlink(missing_ok=True)
            raise OutputError(f"cannot write {str(path)!r}: {error.strerror}") from None
        return path


def first_few(things: Sequence[object], most: int = SHOWN, between: str = ", ") -> str:
    """The first of them and how many more there are: "3, 7, 8, 12 and 5 more"."""
    more = f" and {len(things) - most} more" if len(things) > most else ""
    return between.join(map(str, things[:most])) + more


def listed(names: Iterable[object], most: int = SHOWN) -> str:
    """How many there are and the first of them: "13: torso, left_arm, ..."."""
    every = [str(name) for name in names]
    if len(every) <= most:
        return ", ".join(every) or "none"
    return f"{len(every)}: {', '.join(every[:most])}, ..."


def millimetres(metres: float) -> str:
    """A length [m] as text."""
    return f"{round(metres * 1e3, 3):g} mm"
