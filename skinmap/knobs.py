"""The knobs that trade speed for accuracy: their names and what each may be set to.

A knob is named as the option that sets it, with underscores: `--radius-mm` is `radius_mm`. The
tables are those of a profile. What plug-ins add (methods, classifiers) is checked by the command
that looks the name up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points

Value = str | int | float | bool
TASKS = "skinmap.trade_tasks"  # entry points; each may have a table of its own


@dataclass(frozen=True, slots=True)
class Allowed:
    """What a knob may be set to.

    Attributes
    ----------
    names : tuple of str
        Words that it may be; with `any_name` these are examples.
    any_name : bool
        Whether plug-ins add names.
    least, most : float or None
        Range of its numbers; none for a knob that is no number.
    whole : bool
        Whether they must be whole.
    only : tuple of int
        All numbers that there are, where they are few.
    """

    names: tuple[str, ...] = ()
    any_name: bool = False
    least: float | None = None
    most: float | None = None
    whole: bool = False
    only: tuple[int, ...] = ()

    def allows(self, value: object) -> bool:
        """Whether a value is one of these."""
        if isinstance(value, str):
            return value in self.names or (self.any_name and value.isprintable() and value != "")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        if self.only:
            return isinstance(value, int) and value in self.only
        if self.least is None or self.most is None or (self.whole and isinstance(value, float)):
            return False
        return math.isfinite(value) and self.least <= value <= self.most

    def words(self) -> str:
        """What there is, for a message."""
        said = [", ".join(self.names)] if self.names else []
        if self.any_name:
            said.append("and those of plug-ins" if self.names else "a name")
        if self.only:
            said.append(", ".join(map(str, self.only)))
        if self.least is not None and self.most is not None:
            kind = "whole numbers" if self.whole else "numbers"
            said.append(f"{kind} from {self.least:g} to {self.most:g}")
        return "; ".join(said)


def _number(least: float, most: float, *names: str) -> Allowed:
    return Allowed(names, least=least, most=most)


def _count(least: int, most: int) -> Allowed:
    return Allowed(least=least, most=most, whole=True)


PRECISION = Allowed(("float64", "float32"))
KNOBS: Mapping[str, Mapping[str, Allowed]] = {
    "flatten": {
        "meshing": Allowed(("consensus", "fast", "accurate")),
        "method": Allowed(("fast", "balanced", "accurate", "auto"), any_name=True),
        "iterations": _count(1, 10_000),
        "precision": PRECISION,
    },
    "classify": {
        "classifier": Allowed(any_name=True),
        "radius_mm": _number(0.1, 1000.0, "auto"),
        "tolerance_mm": _number(0.01, 1000.0),
        "words": _count(2, 256),
        "rotations": Allowed(only=(1, 4, 6)),
        "distance": Allowed(("euclidean", "geodesic")),
        "search": Allowed(("plain", "compiled")),
        "precision": PRECISION,
        "image_size": Allowed(("66x100",), any_name=True),
    },
    "calibrate": {
        "starts": _count(1, 9),
        "steps": _count(1, 1000),
        "wrap_detail_mm": _number(0.5, 50.0),
    },
    "view": {
        "style": Allowed(("surface", "discs")),
        "links": Allowed(("all", "skin", "none")),
        "layer": Allowed(any_name=True),
        "detail": _number(0.1, 100.0),
        "contour_rate": _number(0.1, 1000.0),
    },
}


def tables() -> tuple[str, ...]:
    """Tables that a profile may have: ours, and one for each task of a plug-in."""
    return tuple(dict.fromkeys([*KNOBS, *(point.name for point in entry_points(group=TASKS))]))
