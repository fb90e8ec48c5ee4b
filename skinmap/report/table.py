"""A table, for people in a terminal and for a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from skinmap.rows import by_class, formatted, heading, value

Cell = str | int | float | None
ROUNDING = 1e-9  # what is less is an error of arithmetic in every unit that tables have
WIDE = 200  # columns of a table where there is no terminal


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under headings; columns of numbers stand to the right.

    Attributes
    ----------
    columns : sequence of str
    rows : sequence of sequences
        Text, numbers, or None where there is nothing.
    title : str
        What stands above it on a page; nothing in a terminal.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    title: str = ""

    @classmethod
    def of(
        cls,
        kind: type,
        rows: Sequence[Any],
        fields: str,
        title: str = "",
        classes: Sequence[str] = (),
    ) -> Table:
        """Some fields of rows of a kind: "part cut_mm area.max mean:% ece:.3f right:%=all".

        Behind a colon stands a format, `%` for a share; behind = another heading, `_` for spaces.
        `per_class` is a share for each of `classes`, a list of names a pair ("torso > left_arm").
        """
        columns: list[str] = []
        cells: list[list[Cell]] = [[] for _ in rows]
        for field in fields.split():
            path, renamed, other = field.partition("=")
            name, _, form = path.partition(":")
            if name == "per_class":
                columns += classes
                for own, row in zip(cells, rows, strict=True):
                    own += by_class(row, classes)
                continue
            columns.append(other.replace("_", " ") if renamed else heading(kind, name))
            for own, row in zip(cells, rows, strict=True):
                own.append(formatted(value(row, name), form))
        return cls(columns, cells, title)

    @property
    def texts(self) -> list[bool]:
        """Which columns hold text."""
        return [
            any(isinstance(row[place], str) for row in self.rows)
            for place in range(len(self.columns))
        ]

    def print(self) -> None:
        """Print it on standard output."""
        from rich.console import Console
        from rich.table import Table as RichTable

        drawn = RichTable(box=None, header_style="bold")
        for column, text in zip(self.columns, self.texts, strict=True):
            drawn.add_column(column, justify="left" if text else "right", no_wrap=True)
        for row in self.rows:
            drawn.add_row(*(visible(cell_text(cell)) for cell in row))
        # A pipe has no width; what is cut off there cannot be read at all.
        width = None if Console().is_terminal else WIDE
        console = Console(width=width, markup=False)  # names may hold brackets
        console.print(drawn)

    def html(self) -> str:
        """The table inside a page, which scrolls by itself where it is too wide."""
        kinds = [" class=text" if text else "" for text in self.texts]
        head = _row("th", kinds, self.columns)
        body = "".join(_row("td", kinds, [cell_text(cell, 4) for cell in row]) for row in self.rows)
        above = f"<thead>{head}</thead>" if any(self.columns) else ""
        title = f"<h3>{escape(self.title)}</h3>" if self.title else ""
        return f"{title}<div class=wide><table>{above}<tbody>{body}</tbody></table></div>"


def cell_text(cell: Cell, digits: int = 3) -> str:
    """A cell as text: numbers to some significant digits, a dash for nothing."""
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return "0" if abs(cell) < ROUNDING else f"{cell:.{digits}g}"
    return str(cell)


def _row(tag: str, kinds: Sequence[str], cells: Sequence[str]) -> str:
    inner = "".join(
        f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, cells, strict=True)
    )
    return f"<tr>{inner}</tr>"


def visible(text: str) -> str:
    """A text whose control characters are written out: names of files obey no terminal."""
    return "".join(
        letter if letter.isprintable() or letter in "\n\t" else repr(letter)[1:-1]
        for letter in text
    )
