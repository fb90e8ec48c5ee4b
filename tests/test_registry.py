"""The registry of plug-ins: lazy built-ins, plug-ins that fail."""

from __future__ import annotations

import logging
import sys
from importlib.metadata import EntryPoint
from types import ModuleType

import pytest

from skinmap import registry
from skinmap.errors import BrokenPluginError, UnknownNameError
from skinmap.registry import Registry

LAZY = {"colours": "colorsys:rgb_to_hsv", "gone": "no_such_module:thing"}


class Leaving(ModuleType):
    """A module that wants to end the program."""

    def __getattr__(self, name: str) -> object:
        raise SystemExit(7)


def test_built_in_things_are_imported_when_looked_up(monkeypatch):
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    things = Registry("thing", "skinmap.no_such_group", built_in=LAZY)
    assert things.names() == ("colours", "gone")
    assert "colorsys" not in sys.modules
    import colorsys

    assert things.get("colours") is colorsys.rgb_to_hsv


def test_a_built_in_thing_that_is_missing_says_so():
    things = Registry("thing", "skinmap.no_such_group", built_in=LAZY)
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        things.get("gone")


def test_registered_and_plugged_in_things_stand_beside_built_in_ones(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "leaving", Leaving("leaving"))
    points = [
        EntryPoint("leaver", "leaving:thing", "g"),
        EntryPoint("half", "math:nan", "g"),
        EntryPoint("broken", "no_such_module:thing", "g"),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    things = Registry("thing", "g", built_in=LAZY, adapt=lambda name, thing: f"{name}={thing}")
    things.register("own")("mine")
    with caplog.at_level(logging.ERROR):
        assert things.names() == ("colours", "gone", "own", "half")
    assert "plug-in broken of g does not load" in caplog.text
    assert "plug-in leaver of g does not load" in caplog.text
    assert things.get("half") == "half=nan"
    assert things.get("own") == "mine"
    with pytest.raises(
        UnknownNameError, match="no thing 'x'; the things are: colours, gone, own, half"
    ):
        things.get("x")
    assert len(caplog.records) == 2
    assert not any(one.exc_info for one in caplog.records)  # a line each
    with pytest.raises(BrokenPluginError, match="'broken' does not load: ModuleNotFoundError"):
        things.get("broken")
