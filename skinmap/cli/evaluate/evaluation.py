"""What the protocols of `skinmap evaluate` share: one module each, which is found by its name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
import numpy as np
from msgspec import Meta, Struct, ValidationError, convert

from skinmap.commands.progress import progress
from skinmap.report.table import Cell, Table

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers
    from skinmap.recognition.protocols.recordings import Way

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
# Protocols that share a module.
HOMES = dict.fromkeys(("kaspar", "baxter"), "papers")
HOMES |= dict.fromkeys(("cross-patch", "physics", "time"), "simulated")
HOMES |= dict.fromkeys(("fingers", "hands"), "real")

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

    @property
    def drawn(self) -> dict[str, Any]:
        """How touches are drawn, for protocols and for their results."""
        return {"variety": self.variety, "seeds": self.all_seeds}

    @contextmanager
    def working(self, steps: int, title: str) -> Iterator[dict[str, Any]]:
        """Who computes and whom that tells, under a bar of so many steps."""
        with progress(steps, title) as advance:
            yield {"workers": self.workers, "progress": advance}


class Own(Struct, forbid_unknown_fields=True):
    """Settings of a protocol that no other has; this one has none."""


class Gestures(Own):
    """Of protocols that may tell other touches apart than the four."""

    gestures: str = "four"


class Folds(Gestures):
    """Of protocols that deal out what was recorded."""

    folds: Annotated[int, Meta(ge=2, le=20)] = 4


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How a protocol is run and told.

    Attributes
    ----------
    work
        Takes the settings and gives a result.
    lines
        Makes tables of that.
    settings
        What `--set` sets.
    draw
        Draws a picture of the result into a file, where there is one.
    """

    work: Callable[[Settings], Any]
    lines: Callable[[Any], Iterator[str | Table]]
    settings: type[Own] = Own
    draw: Callable[[Any, Path], None] | None = None


def find_evaluation(name: str) -> Evaluation:
    """That of a protocol, or of `recordings`."""
    module = f"skinmap.cli.evaluate.protocol_{HOMES.get(name, name)}"
    found: Evaluation = importlib.import_module(module).EVALUATIONS[name]
    return found


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
    from skinmap.touch.simulation.hands import gesture_set

    return gesture_set([settings.own.gestures])


def write_predictions(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write what a protocol answered as an archive of arrays."""
    from skinmap.io.output import staged_file

    with staged_file(path) as stage, stage.open("wb") as file:
        np.savez_compressed(file, **arrays)
