"""What `skinmap trade` measures: the types of its results."""

from __future__ import annotations

import importlib.metadata
import platform
from dataclasses import dataclass, field

from skinmap import __version__
from skinmap.profile import Value
from skinmap.report.result import MERGED

LIBRARIES = ("numpy", "scipy", "libigl", "scikit-learn", "numba")


@dataclass(frozen=True, kw_only=True, slots=True)
class KnobRow:
    """A knob that is turned.

    Attributes
    ----------
    name, meaning
        What it is called and what it does.
    values, default
        That are measured, and the one taken where nothing is said.
    """

    name: str
    values: list[Value]
    default: Value
    meaning: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskRow:
    """A task that is measured.

    Attributes
    ----------
    task
        Its name.
    work
        What the seconds pay for.
    unit, truth
        Of the errors, and what they are against.
    knobs
        What its settings are made of.
    """

    task: str
    work: str
    unit: str
    truth: str
    knobs: list[KnobRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class PointRow:
    """One setting of a task.

    Attributes
    ----------
    task, setting
        Which: the value of each knob.
    seconds, seconds_spread
        CPU time of one unit of work, and its standard deviation over the runs.
    error, error_spread, unit
        In the task's unit, and its standard deviation over the seeds.
    memory_mb
        Largest; null where it was not measured.
    pareto
        Whether no other setting is both faster and better.
    runs
        How many.
    pace_seconds
        Of a fixed piece of work at that moment.
    beside
        Further figures of the task: `training_seconds`, `unmeshed`, `worst_mm`, `p95_mm`,
        `update_seconds`, `anew_seconds`, or those of a plug-in; null where one does not exist.
    """

    task: str
    setting: dict[str, Value]
    seconds: float
    seconds_spread: float
    error: float
    error_spread: float
    unit: str
    memory_mb: float | None
    pareto: bool
    runs: int
    pace_seconds: float
    beside: dict[str, float | None] = field(default_factory=dict, metadata=MERGED)


@dataclass(frozen=True, kw_only=True, slots=True)
class Recommended:
    """The setting to take.

    Attributes
    ----------
    setting
        The value of each knob.
    seconds, error, unit
        What it costs.
    why
        The limit that it keeps, or the knee of the front.
    """

    setting: dict[str, Value]
    seconds: float
    error: float
    unit: str
    why: str


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedRow:
    """What could not be measured.

    Attributes
    ----------
    task, reason
        Where, and why.
    setting
        The value of each knob; null: the whole task.
    """

    task: str
    setting: dict[str, Value] | None
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Measurement:
    """What was measured on, and with what.

    Attributes
    ----------
    robot, parts
        The robot as given.
    seed, seeds
        The first, and how many.
    machine
        Its processor and system.
    versions
        Of what the figures depend on; null where it is not installed.
    """

    robot: str
    parts: list[str]
    seed: int
    seeds: int
    machine: str
    versions: dict[str, str | None] = field(default_factory=lambda: versions())


@dataclass(frozen=True, kw_only=True, slots=True)
class TradeResult(Measurement):
    """What each setting costs, and which to take.

    Attributes
    ----------
    tasks
        That were measured.
    points
        Every setting of every task.
    recommended
        By task.
    failed
        What could not be measured.
    profile
        Where the recommendation was written; null without `--out`.
    files
        Names inside `--out`.
    """

    tasks: list[TaskRow]
    points: list[PointRow]
    recommended: dict[str, Recommended]
    failed: list[FailedRow]
    profile: str | None
    files: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True, slots=True)
class Cost:
    """What a setting costs.

    Attributes
    ----------
    seconds, error
        CPU time, and the error in the task's unit.
    """

    seconds: float
    error: float


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckedRow:
    """A setting measured again.

    Attributes
    ----------
    task, setting, unit
        Which.
    predicted, measured
        What it costs by the profile, and now.
    slower
        How many times as long a fixed piece of work takes now.
    raw_seconds_ratio
        Measured over predicted; null where nothing was predicted.
    seconds_ratio
        The same at the same pace: the raw one over `slower`; null where nothing was predicted.
    error_ratio
        Measured over predicted; null where 0 was predicted and not measured.
    within
        Whether both agree.
    """

    task: str
    setting: dict[str, Value]
    unit: str
    predicted: Cost
    measured: Cost
    slower: float
    raw_seconds_ratio: float | None
    seconds_ratio: float | None
    error_ratio: float | None
    within: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckFailed:
    """What could not be checked.

    Attributes
    ----------
    task, reason
        Where, and why.
    """

    task: str
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckResult(Measurement):
    """Whether a profile keeps what it predicts.

    Attributes
    ----------
    profile
        The file.
    checked
        By task.
    failed
        What could not be measured.
    within
        Whether everything is as predicted.
    """

    profile: str
    checked: list[CheckedRow]
    failed: list[CheckFailed]
    within: bool


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on; None where it is not installed."""
    found: dict[str, str | None] = {"skinmap": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found
