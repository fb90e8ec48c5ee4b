"""Planted tasks: what each setting costs and errs is known, and nothing has to be timed."""

from __future__ import annotations

from typing import ClassVar

import pytest

from skinmap.errors import InvalidMeshError
from skinmap.trade import Knob, Outcome


class Planted:
    """Three levels whose figures are written down, and one that is worse than another in both."""

    name = "planted"
    unit = "mm"
    work = "one planted figure"
    truth = "what was planted"
    knobs = (
        Knob("level", ("low", "middle", "high", "silly"), "low", "how much effort"),
        Knob("rounds", (1, 2), 1, "does nothing"),
    )
    figures: ClassVar = {
        "low": (0.001, 8.0),
        "middle": (0.01, 1.0),
        "high": (0.1, 0.5),
        "silly": (0.02, 4.0),
    }

    def __init__(self) -> None:
        self.calls: list[tuple[str, int]] = []

    def settings(self):
        return [{"level": level} for level in self.figures]

    def prepare(self, robot, parts, *, seed):
        return seed

    def run(self, prepared, setting, *, seed):
        self.calls.append((setting["level"], prepared))
        seconds, error = self.figures[setting["level"]]
        return Outcome(seconds, error * (1.0 + 0.1 * seed), {"extra": 7.0})


class Failing(Planted):
    """As before, but one setting raises an error of ours and another one of its own."""

    name = "failing"

    def run(self, prepared, setting, *, seed):
        if setting["level"] == "high":
            raise InvalidMeshError("no triangle\nto stand on")
        if setting["level"] == "silly":
            raise ZeroDivisionError("by nought")
        return super().run(prepared, setting, seed=seed)


class Broken(Planted):
    """Fails before anything is measured."""

    name = "broken"

    def prepare(self, robot, parts, *, seed):
        raise RuntimeError("nothing to prepare")


CLASSES = {"planted": Planted, "failing": Failing, "broken": Broken}


@pytest.fixture
def toys():
    """The planted tasks by name, as classes."""
    return CLASSES


@pytest.fixture
def plugged(monkeypatch):
    """A function that plugs planted tasks in, and nothing else."""

    def plug(*names: str) -> None:
        planted = {name: CLASSES[name]() for name in names}
        monkeypatch.setattr("skinmap.cli.trade.every_task", lambda: planted)

    return plug
