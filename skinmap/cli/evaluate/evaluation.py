"""What the protocols of `skinmap evaluate` share: one module each, which is found by its name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from skinmap.cli.evaluate.result import EvaluateResult
from skinmap.cli.evaluate.result.shared import AccuracyRow
from skinmap.report.table import Cell, Table

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers
    from skinmap.touch.subjects import Places

PROTOCOLS = ("kaspar", "baxter", "cross-patch", "physics", "time", "cost", "fingers", "hands")
ON_DATA = ("cost", "fingers", "hands")  # protocols of files that users bring
OTHER_NAMES = {"time": "in_time", "cost": "social_touch"}  # of modules; the others by their own

BLUE, ORANGE, GREY = "#3b6ea8", "#d98032", "#9aa3ad"
COLOURS = (BLUE, "#7fa6d0", "#2f8f6b", ORANGE, "#e8b98a")

Rows = list[list[Cell]]
Figure = Callable[[Any, Path], None]


@dataclass(frozen=True, slots=True)
class Settings:
    """The options of the command, checked by click."""

    protocol: str
    recordings: tuple[Path, ...]
    workers: Workers
    robot: str | None
    train_robot: str | None
    parts: tuple[str, ...]
    seeds: int
    seed: int
    names: tuple[str, ...]
    gestures: str
    per_gesture: int
    places: Places
    sweep: bool
    images: int
    network: str
    folds: int
    leave_out: tuple[str, ...]
    leaks: bool

    @property
    def all_seeds(self) -> list[int]:
        """The seed of each repetition."""
        return list(range(self.seed, self.seed + self.seeds))


class Evaluation(Protocol):
    """The module of a protocol.

    Attributes
    ----------
    FIGURES
        What draws a result, by the name of the picture.
    """

    FIGURES: Mapping[str, Figure]

    def work(self, settings: Settings) -> EvaluateResult:
        """Run it."""

    def lines(self, result: Any) -> Iterator[str | Table]:
        """The tables of its result."""


def find_evaluation(name: str) -> Evaluation:
    """The module of a protocol, or of `recordings`."""
    module = OTHER_NAMES.get(name, name.replace("-", "_"))
    return cast(Evaluation, importlib.import_module(f"skinmap.cli.evaluate.{module}"))


def chosen_gestures(settings: Settings) -> tuple[str, ...]:
    """Names of the gestures that were asked for."""
    from skinmap.touch.gestures import gesture_set
    from skinmap.touch.simulator import check_gestures

    names = gesture_set([name.strip() for name in settings.gestures.split(",")])
    check_gestures(names)
    return names


def percent(value: float | None) -> str:
    """A share as a cell; empty where it is not known."""
    return "" if value is None or value != value else f"{100 * value:.1f}"


def by_class(row: AccuracyRow, classes: Sequence[str]) -> list[str]:
    """Cells of the share named right of each class."""
    return [percent(row.per_class.get(name)) for name in classes]
