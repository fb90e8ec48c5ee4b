"""Points: what was measured of one setting of one task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from skinmap.trade.task import Setting


@dataclass(frozen=True, slots=True)
class Point:
    """One setting of a task, over all seeds.

    Attributes
    ----------
    task : str
    setting : mapping of str to value
    seconds : float
        CPU time of one unit of work: the mean over the seeds of the median over their runs.
    error : float
        In `unit`, the mean over the seeds.
    unit : str
    seconds_spread, error_spread : float
        Standard deviation over all runs and over the seeds; 0 of a single one.
    memory_mb : float
    runs : int
        How many.
    pace : float
        CPU time of a fixed piece of work at the moment that `seconds` are scaled to [s].
    beside : mapping of str to float
        Other figures of the task, medians over the seeds.
    """

    task: str
    setting: Setting
    seconds: float
    error: float
    unit: str
    seconds_spread: float = 0.0
    error_spread: float = 0.0
    memory_mb: float = float("nan")
    runs: int = 1
    pace: float = 0.0
    beside: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def words(self) -> str:
        """The setting in one line."""
        return describe(self.setting)


@dataclass(frozen=True, slots=True)
class Failure:
    """A task, or one setting of it, that could not be measured, and why."""

    task: str
    setting: Setting | None
    reason: str


def describe(setting: Setting) -> str:
    """A setting as `method=fast meshing=consensus`."""
    return " ".join(f"{name}={value}" for name, value in setting.items()) or "nothing to set"
