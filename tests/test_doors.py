"""Doors: the names by which a room is entered are documented, and their examples run."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import re
import sys
from enum import StrEnum
from pathlib import Path

import pytest

import skinmap

ROOT = Path(__file__).parents[1]
STUBS = sorted(
    stub for top in ("skinmap", "calibration", "viewer") for stub in (ROOT / top).rglob("*.pyi")
)
ROOMS = [".".join(stub.parent.relative_to(ROOT).parts) for stub in STUBS]
DOORS = [
    (room, name)
    for room in ROOMS
    for name in importlib.import_module(room).__all__
    if name not in skinmap.__all__  # those are held by tests/test_public.py
]
DRAWS = ("viewer",)  # rooms whose examples need OpenGL


def documented(thing: object) -> str:
    """Sections that are missing; empty where nothing is."""
    text = inspect.getdoc(thing) or ""

    def has(*sections: str) -> bool:
        return any(re.search(rf"^{one}\n-+\n", text, flags=re.MULTILINE) for one in sections)

    if inspect.isclass(thing):
        described = has("Parameters", "Attributes") or issubclass(thing, (Exception, StrEnum))
        return "" if described else "Parameters or Attributes"
    missing = [] if has("Examples") else ["Examples"]
    signature = inspect.signature(thing)
    if signature.parameters and not has("Parameters"):
        missing.append("Parameters")
    if signature.return_annotation not in ("None", None) and not has("Returns", "Yields"):
        missing.append("Returns")
    if re.search(r"^\s+raise ", inspect.getsource(thing), re.MULTILINE) and not has("Raises"):
        missing.append("Raises")
    return ", ".join(missing)


@pytest.mark.parametrize(("room", "name"), DOORS)
def test_a_door_is_documented(room, name):
    thing = getattr(importlib.import_module(room), name)
    if callable(thing):
        assert not documented(thing)
        described = (inspect.getdoc(thing) or "").partition("Parameters\n")[2]
        described = described.partition("\nReturns\n")[0]
        for parameter in () if inspect.isclass(thing) else inspect.signature(thing).parameters:
            assert re.search(
                rf"^(\w+, )*[*]*{parameter}(, \w+)*( : |$)", described, re.MULTILINE
            ), f"{name} does not describe {parameter}"


@pytest.mark.parametrize(("room", "name"), DOORS)
def test_the_example_of_a_door_runs(room, name, tmp_path, monkeypatch):
    if room in DRAWS:
        from skinmap.display import require_opengl

        require_opengl()
    monkeypatch.chdir(tmp_path)
    thing = getattr(importlib.import_module(room), name)
    if not callable(thing):
        return
    names = dict(vars(sys.modules[thing.__module__]))  # as a reader of the module has them
    finder = doctest.DocTestFinder(recurse=False)
    for example in finder.find(thing, name, module=False, globs=names):
        said: list[str] = []
        doctest.DocTestRunner().run(example, out=said.append)
        assert not said, "".join(said)


def test_a_thing_without_sections_is_seen():
    def bare(a: int) -> int:
        """One line."""
        raise ValueError

    assert documented(bare) == "Examples, Parameters, Returns, Raises"


def test_every_room_with_doors_is_packaged():
    text = (ROOT / "pyproject.toml").read_text()
    for room in ROOMS:
        assert re.search(rf'^"{re.escape(room)}" = \[.*"\*\.pyi"', text, flags=re.MULTILINE), room
    for stub in STUBS:
        ast.parse(stub.read_text())
