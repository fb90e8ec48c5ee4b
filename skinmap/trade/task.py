"""Trade tasks: what is measured, and under which knobs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from skinmap.profile import Value

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

# Knob: value. A knob that a setting does not name stands at its default, or does not matter there.
Setting = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Knob:
    """A knob that is turned.

    Attributes
    ----------
    name
        Name of the command's option, with underscores.
    meaning
        Effect of the option, in one line.
    values
        Values that were measured.
    default
        Default of the commands.
    """

    name: str
    values: tuple[Value, ...]
    default: Value
    meaning: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one run of a setting cost, and how wrong it was.

    Attributes
    ----------
    seconds : float
        CPU time of one unit of the task's work, warm.
    error : float
        In the task's unit; 0 is perfect.
    beside : mapping of str to float
        Other figures worth showing, such as `training_seconds`.
    """

    seconds: float
    error: float
    beside: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))


class TradeTask(Protocol):
    """Promises of a task.

    Attributes
    ----------
    name : str
        Also the group of its knobs in a profile.
    unit : str
        Of the error: "%", "mm".
    work : str
        What the seconds pay for: "one flat map of the part".
    truth : str
        What the errors are against.
    knobs : tuple of Knob
    """

    name: str
    unit: str
    work: str
    truth: str
    knobs: tuple[Knob, ...]

    def settings(self) -> Sequence[Setting]:
        """Which combinations are measured; see `around` and `product`."""

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Any:
        """What all settings share, untimed; another seed is another repetition."""

    def run(self, prepared: Any, setting: Setting, *, seed: int) -> Outcome:
        """Measure one setting once; `skinmap.trade.measuring.cpu_seconds` takes the time."""


def defaults(knobs: Sequence[Knob]) -> dict[str, Value]:
    """Every knob at its default."""
    return {knob.name: knob.default for knob in knobs}
