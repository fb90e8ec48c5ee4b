"""A result as plain data: a frozen dataclass with units in its names, ready for JSON.

A field that exists only with some option has the default `msgspec.UNSET`, and is then no key. A
field whose name Python keeps for itself ends in an underscore (`with_`), its key does not. The
items of a field with the metadata `MERGED` become keys of the object itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

from msgspec import UNSET, UnsetType

OK = "ok"
REFUSED_CODE = 3  # 0 done, 1 internal error, 2 bad input


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a result was judged.

    Attributes
    ----------
    status : str
        `ok`, or in a word why not.
    reasons : sequence of str
        Whole sentences, the most telling first.
    accepted : bool
        Use it whatever the status.
    """

    status: str = OK
    reasons: Sequence[str] = ()
    accepted: bool = False

    @property
    def refused(self) -> bool:
        """Whether results are not to be used."""
        return self.status != OK and not self.accepted


T = TypeVar("T")

# Metadata of a field that holds further keys of the object itself: a mapping, or a result whose
# keys all are there or none.
MERGED = {"merged": True}


def decimals(value: float) -> float:
    """A number to six decimals: below a micrometre, a microsecond, a thousandth of a percent."""
    return round(value, 6)


def significant(value: float) -> float:
    """A number to six digits, for results that span decades."""
    return float(f"{value:.6g}")


def key_of(field: dataclasses.Field[Any]) -> str:
    """The key of a field."""
    return field.name.rstrip("_")


def given(value: T | UnsetType) -> T | None:
    """A field that may be absent, with None for that."""
    return None if isinstance(value, UnsetType) else value


def plain(value: Any, number: Callable[[float], float] = decimals) -> Any:
    """Nested data with Python numbers only, None for NaN and infinity.

    Parameters
    ----------
    value : object
        A result, or whatever its fields hold: mappings, sequences, arrays, paths, numbers.
    number : callable
        How floats are rounded.

    Returns
    -------
    object
        Of dictionaries, lists, texts and numbers, as JSON takes it.

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.report import plain
    >>> plain({"error": np.array([0.12345678, np.nan])})
    {'error': [0.123457, None]}
    """
    if dataclasses.is_dataclass(value):
        return _fields(value, number)
    if isinstance(value, Mapping):
        return {str(key): plain(item, number) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, number) for item in value]
    if isinstance(value, Enum):
        return value.value
    if hasattr(value, "tolist"):
        return plain(value.tolist(), number)
    if isinstance(value, float):
        return number(value) if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def _fields(value: Any, number: Callable[[float], float]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for field in dataclasses.fields(value):
        item = getattr(value, field.name)
        if item is UNSET:
            continue
        if field.metadata == MERGED:
            found |= plain(item, number)
        else:
            found[key_of(field)] = plain(item, number)
    return found
