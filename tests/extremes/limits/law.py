"""One law of one function along one axis, and how it is measured."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Outside:
    """A value outside the range, and what must come of it.

    Attributes
    ----------
    value : object
        As it stands in the table.
    reaction : type of exception or warning, or str
        What is raised or warned of; otherwise what `run` returns.
    run : function
    says : str
        Part of the message.
    """

    value: Any
    reaction: type[Exception] | str
    run: Callable[[], Any]
    says: str = ""

    def check(self) -> str:
        """What came of it, for the table; an AssertionError where it is something else."""
        name, said = _outcome(self.run)
        wanted = self.reaction if isinstance(self.reaction, str) else self.reaction.__name__
        if name != wanted or self.says not in said:
            raise AssertionError(f"{self.value}: {name} {said!r}, expected {wanted} {self.says!r}")
        return f"`{name}`" if said else name


@dataclass(frozen=True)
class Law:
    """What a function keeps along one axis.

    Attributes
    ----------
    function : str
    axis : str
        "scale", "offset", "size", "noise", "saturation", "dead taxels", "missing modules", "input";
        of streams "late samples", "gaps", "jitter" and the like; of searches "start".
    law : str
        One clause.
    measure : function of a value
        How far the law is off there; 0 is exact.
    bound : float
        How far it may be off, and `why`.
    inside : sequence
        Values at which it holds, in order.
    outside : tuple of Outside
    unit : str
        Of the values.
    """

    function: str
    axis: str
    law: str
    measure: Callable[[Any], float]
    bound: float
    why: str
    inside: Sequence[Any]
    outside: tuple[Outside, ...] = ()
    unit: str = ""

    @property
    def name(self) -> str:
        return f"{self.function}-{self.axis}-{self.law}".replace(" ", "-")

    def range(self) -> str:
        """As it stands in the table."""
        values = [f"{v:g}" if isinstance(v, int | float) else str(v) for v in self.inside]
        numbers = all(isinstance(v, int | float) for v in self.inside) and len(values) > 2
        if not values:
            return "not swept here"
        text = f"{values[0]} to {values[-1]}" if numbers else ", ".join(values)
        return f"{text} {self.unit}".rstrip()


@dataclass(frozen=True)
class Measured:
    """What one law came to: the largest deviation, and the reactions outside."""

    law: Law
    worst: float
    reactions: tuple[str, ...]


def measure(law: Law) -> Measured:
    """Run a law at all of its values; an AssertionError where it does not hold."""
    worst = 0.0
    for value in law.inside:
        off = float(law.measure(value))
        if not off <= law.bound:  # NaN is no pass
            raise AssertionError(f"{law.name} at {value}: {off:g}, at most {law.bound:g}")
        worst = max(worst, off)
    return Measured(law, worst, tuple(one.check() for one in law.outside))


def one_digit(value: float) -> str:
    """A deviation rounded up to one digit: other machines differ in the rest."""
    if value == 0:
        return "0"
    unit = 10.0 ** math.floor(math.log10(value))
    return f"{math.ceil(value / unit * (1 - 1e-9)) * unit:.1g}"


def _outcome(run: Callable[[], Any]) -> tuple[str, str]:
    """Name of what was raised or warned of with its message; what came back with ""."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            back = run()
        except Exception as error:  # noqa: BLE001  # which one it is, is what is asked
            return type(error).__name__, str(error)
    if heard:
        return heard[-1].category.__name__, str(heard[-1].message)
    return str(back), ""
