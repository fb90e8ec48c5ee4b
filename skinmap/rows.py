"""Rows of results: each field says in one line what it holds, wherever it is shown.

    @row
    class Patch:
        cut_mm: float = column("Length of its seams.")

The sentence goes into the JSON schema and `docs/json.md`, the heading ("cut [mm]") above the column
in terminals and on pages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from typing import Any, TypeVar, dataclass_transform, get_args, get_type_hints

from msgspec import UNSET

T = TypeVar("T")
UNITS = {"mm": "[mm]", "deg": "[deg]", "percent": "[%]", "hz": "[Hz]", "kb": "[kB]"}


def column(text: str, heading: str | None = None, *, default: Any = MISSING) -> Any:
    """A field of a row.

    Parameters
    ----------
    text : str
        What it holds, in a sentence; also when it is null or absent.
    heading : str, optional
        Above its column; by default the field's name in words. The empty one is that of the field
        that holds the row.
    default : object, optional
        `msgspec.UNSET` for a key that is absent where the field is not given.
    """
    return field(default=default, metadata={"text": text, "heading": heading})


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(column, field))
def row(kind: type[T]) -> type[T]:
    """Make a class a row of a result: a frozen dataclass whose fields are keywords."""
    return dataclass(frozen=True, kw_only=True, slots=True)(kind)


def heading(kind: Any, path: str) -> str:
    """What stands above the column of a field of a row type ("cut_mm", "area.max")."""
    name, _, rest = path.partition(".")
    own = kind.__dataclass_fields__[name].metadata.get("heading")
    if own is None:
        words = name.strip("_").split("_")
        own = " ".join([*words[:-1], UNITS.get(words[-1], words[-1])])
    if not rest:
        return str(own)
    hint = get_type_hints(kind)[name]
    inner = next(one for one in (hint, *get_args(hint)) if is_dataclass(one))
    return heading(inner, rest) or str(own)


def value(row: Any, path: str) -> Any:
    """A field of a row, or of a row inside it; None where it is absent."""
    for name in path.split("."):
        row = None if row is None else getattr(row, name)
        row = None if row is UNSET else row
    return row


def percent(share: float | None) -> str:
    """A share as a cell; empty where it is not known."""
    return "" if share is None or share != share else f"{100 * share:.1f}"


def by_class(row: Any, classes: Sequence[str]) -> list[str]:
    """Cells of the share named right of each class."""
    return [percent(row.per_class.get(name)) for name in classes]


def formatted(cell: Any, form: str) -> Any:
    """A cell: `%` for a share, else a format of Python; empty where there is nothing to format."""
    if form == "%":
        return percent(cell)
    if isinstance(cell, list):
        return " > ".join(cell)
    return cell if not form else "" if cell is None else f"{cell:{form}}".replace("%", " %")


def shallow(row: Any) -> dict[str, Any]:
    """The fields of a row as they are, for the constructor of one that has them too."""
    return {field.name: getattr(row, field.name) for field in fields(row)}
