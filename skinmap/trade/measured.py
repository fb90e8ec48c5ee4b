"""What `skinmap trade` measures and recommends, the same in Python and in JSON."""

from __future__ import annotations

import importlib.metadata
import platform
from dataclasses import dataclass, field

from skinmap import __version__
from skinmap.profile import Value
from skinmap.report.result import MERGED
from skinmap.trade.task import Knob, Setting

LIBRARIES = ("numpy", "scipy", "libigl", "scikit-learn", "numba")


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskRow:
    """A task that is measured.

    Attributes
    ----------
    task
        Name of the task.
    work
        Work that the seconds measure.
    unit, truth
        Of the errors, and what they are against.
    knobs
        Settings that are varied.
    """

    task: str
    work: str
    unit: str
    truth: str
    knobs: list[Knob]


@dataclass(frozen=True, kw_only=True, slots=True)
class Point:
    """One setting of a task.

    Attributes
    ----------
    task, setting
        Which: the value of each knob.
    seconds, seconds_spread
        CPU time of one unit of work, the median over the seeds, and its standard deviation; the
        latter null for one seed.
    error, error_spread, unit
        In the task's unit, the mean over the seeds, and its standard deviation; the latter null
        for one seed.
    runs
        Number of runs, one for each seed.
    pareto
        Whether no other setting is both faster and better.
    beside
        Further figures of the task, medians over the seeds: `training_seconds`, `unmeshed`, or
        those of a plug-in; null where one does not exist.
    """

    task: str
    setting: dict[str, Value]
    seconds: float
    error: float
    unit: str
    seconds_spread: float | None = None
    error_spread: float | None = None
    runs: int = 1
    pareto: bool = False
    beside: dict[str, float | None] = field(default_factory=dict, metadata=MERGED)

    @property
    def cost(self) -> str:
        """Time and error in words."""
        return f"{self.seconds * 1e3:.3g} ms, {self.error:.3g} {self.unit}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Recommended:
    """The setting to take.

    Attributes
    ----------
    setting
        The value of each knob.
    seconds
        Time of the recommended setting.
    error
        Error of the recommended setting.
    unit
        Unit of the error.
    why
        The limit that it keeps.
    """

    setting: dict[str, Value]
    seconds: float
    error: float
    unit: str
    why: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Unmeasured:
    """A setting or task without a measurement.

    Attributes
    ----------
    task
        Name of the task.
    reason
        Reason for the missing measurement.
    setting
        The value of each knob; null: the whole task.
    """

    task: str
    setting: dict[str, Value] | None
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TradeResult:
    """Time and error of each setting, with a recommendation.

    Attributes
    ----------
    robot, parts
        The robot as given.
    seed, seeds
        The first, and how many.
    machine
        Its processor and system.
    versions
        Versions of packages behind the figures; null where one is not installed.
    tasks
        Tasks with measured settings.
    points
        Every setting of every task.
    recommended
        Recommended settings by task.
    failed
        Settings and tasks without a measurement.
    profile
        File of the recommended settings; null without `--out`.
    files
        Names of the files inside `--out`.
    """

    robot: str
    parts: list[str]
    seed: int
    seeds: int
    machine: str = field(default_factory=lambda: machine())
    versions: dict[str, str | None] = field(default_factory=lambda: versions())
    tasks: list[TaskRow]
    points: list[Point]
    recommended: dict[str, Recommended]
    failed: list[Unmeasured]
    profile: str | None
    files: list[str] = field(default_factory=list)


def describe(setting: Setting) -> str:
    """A setting as `method=fast meshing=consensus`."""
    return " ".join(f"{name}={value}" for name, value in setting.items()) or "nothing to set"


def machine() -> str:
    """The processor and its system, in a few words."""
    name = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            models = [line.partition(":")[2] for line in lines if line.startswith("model name")]
    except OSError:  # not Linux
        models = []
    return f"{models[0].strip() if models else name}, {platform.system()}"


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on; None where it is not installed."""
    found: dict[str, str | None] = {"skinmap": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found
