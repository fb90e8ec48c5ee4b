"""What the protocols of `skinmap evaluate` share: one module each, which is found by its name."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, cast

import click
from msgspec import Meta, Struct, ValidationError, convert

from skinmap.recognition.protocols.results import AccuracyRow, EvaluateResult
from skinmap.report.table import Cell, Table

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers
    from skinmap.recognition.protocols.left_out import Way

PROTOCOLS = (
    "kaspar",
    "baxter",
    "cross-patch",
    "physics",
    "time",
    "fingers",
    "hands",
    "prints",
    "force",
    "load",
)
ON_DATA = {  # protocols of files that users bring: how many, and their names
    "fingers": (1, 1, "its file or folder"),
    "hands": (1, 1, "its file or folder"),
    "prints": (2, 2, "TRAIN.npz TEST.npz"),
    "load": (2, 1000, "MODEL RECORDING..."),
}

Rows = list[list[Cell]]


@dataclass(frozen=True, slots=True)
class Settings:
    """The options of the command, checked by click.

    `own` are the protocol's settings, of its type `SETTINGS`; with `pictures` all that they show is
    measured; `predictions` is the file for what a protocol of measured data answered.
    """

    recordings: tuple[Path, ...]
    workers: Workers
    robot: str | None
    parts: tuple[str, ...]
    seeds: int
    seed: int
    names: tuple[str, ...]
    per_gesture: int
    variety: float
    leave_out: tuple[Way, ...]
    pictures: bool
    predictions: Path | None
    own: Any

    @property
    def all_seeds(self) -> list[int]:
        """The seed of each repetition."""
        return list(range(self.seed, self.seed + self.seeds))


class Own(Struct, forbid_unknown_fields=True):
    """Settings of a protocol that no other has; this one has none."""


class Gestures(Own):
    """Of protocols that may tell other touches apart than the four."""

    gestures: str = "four"


class Folds(Gestures):
    """Of protocols that deal out what was recorded."""

    folds: Annotated[int, Meta(ge=2, le=20)] = 4


class Evaluation(Protocol):
    """The module of a protocol.

    Attributes
    ----------
    SETTINGS
        What `--set` may set: a field with its default for each.
    """

    SETTINGS: type[Own]

    def work(self, settings: Settings) -> EvaluateResult:
        """Run it."""

    def lines(self, result: Any) -> Iterator[str | Table]:
        """The tables of its result."""


def find_evaluation(name: str) -> Evaluation:
    """The module of a protocol, or of `recordings`."""
    module = f"skinmap.cli.evaluate.protocol_{name.replace('-', '_')}"
    return cast(Evaluation, importlib.import_module(module))


def own_settings(kind: type[Own], protocol: str, words: Sequence[str]) -> Own:
    """The settings `NAME=VALUE` of a protocol.

    Raises
    ------
    click.UsageError
        No such setting of the protocol, or a value that it does not take.
    """
    found = {}
    for word in words:
        name, equals, value = word.partition("=")
        if name not in kind.__struct_fields__ or not equals:
            known = ", ".join(kind.__struct_fields__) or "none"
            raise click.UsageError(f"--set {word}: settings of {protocol}: {known}")
        found[name] = {"yes": True, "no": False}.get(value, value)
    try:
        return convert(found, kind, strict=False)
    except ValidationError as error:
        raise click.UsageError(f"--set of {protocol}: {error}") from None


def chosen_gestures(settings: Settings) -> tuple[str, ...]:
    """Names of the gestures that were asked for."""
    from skinmap.touch.simulation.simulator import check_gestures
    from skinmap.touch.simulation.things import gesture_set

    names = gesture_set([name.strip() for name in settings.own.gestures.split(",")])
    check_gestures(names)
    return names


def percent(value: float | None) -> str:
    """A share as a cell; empty where it is not known."""
    return "" if value is None or value != value else f"{100 * value:.1f}"


def by_class(row: AccuracyRow, classes: Sequence[str]) -> list[str]:
    """Cells of the share named right of each class."""
    return [percent(row.per_class.get(name)) for name in classes]
