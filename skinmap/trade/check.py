"""Whether a profile keeps what it predicts: its settings measured again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skinmap.errors import DataFormatError
from skinmap.profile import Profile
from skinmap.trade.points import Failure, Point
from skinmap.trade.runner import measure
from skinmap.trade.task import TradeTask

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

TIME_WITHIN = 0.20  # share by which the time may differ from what was predicted, and
ERROR_WITHIN = 0.10  # the error
DIGITS = 1e-5  # of an error: a profile keeps six


@dataclass(frozen=True, slots=True)
class Checked:
    """A setting measured again beside its prediction.

    Attributes
    ----------
    point : Point
        As measured now.
    seconds, error : float
        As predicted.
    pace : float
        Of the machine when that was predicted [s]; 0 where it is not known.
    """

    point: Point
    seconds: float
    error: float
    pace: float = 0.0

    @property
    def slower(self) -> float:
        """How many times as long a fixed piece of work takes now; 1 where that is not known."""
        return self.point.pace / self.pace if self.pace and self.point.pace else 1.0

    @property
    def raw_ratio(self) -> float:
        """Time measured over predicted, as they are."""
        return self.point.seconds / self.seconds if self.seconds else float("inf")

    @property
    def seconds_ratio(self) -> float:
        """Measured over predicted, at the same pace of the machine."""
        return self.raw_ratio / self.slower

    @property
    def error_ratio(self) -> float:
        """Measured over predicted; 1 where both are 0."""
        if self.error:
            return self.point.error / self.error
        return 1.0 if abs(self.point.error) <= DIGITS else float("inf")

    @property
    def within(self) -> bool:
        """Whether both agree with the prediction."""
        return (
            abs(self.seconds_ratio - 1.0) <= TIME_WITHIN
            and abs(self.error_ratio - 1.0) <= ERROR_WITHIN
        )


def check_profile(
    profile: Profile,
    tasks: Mapping[str, TradeTask],
    robot: Robot,
    parts: tuple[str, ...],
    *,
    seeds: Sequence[int],
    progress: Callable[[str], None] | None = None,
) -> tuple[list[Checked], list[Failure]]:
    """Measure the settings of a profile again.

    Raises
    ------
    DataFormatError
        A profile that predicts nothing.
    """
    checked: list[Checked] = []
    failures: list[Failure] = []
    predicted = {name: figures for name, figures in profile.predicted.items() if name in tasks}
    if not predicted:
        asked = f" of {', '.join(tasks)}" if profile.predicted else ""
        raise DataFormatError(f"predicts nothing{asked} that could be checked", profile.path)
    for name, figures in predicted.items():
        for key in ("seconds", "error"):
            if key not in figures:
                raise DataFormatError(f"[{name}.predicted] has no {key} to check", profile.path)
    for name, figures in predicted.items():
        setting = profile.settings[name]
        found = measure(
            tasks[name], robot, parts, seeds=seeds, settings=[setting],
            choose=lambda points: points[0], progress=progress,
        )  # fmt: skip
        failures += found.failures
        if found.points:
            seconds, error = float(figures["seconds"]), float(figures["error"])
            pace = float(figures.get("pace", 0.0))
            checked.append(Checked(found.points[0], seconds, error, pace))
    return checked, failures
