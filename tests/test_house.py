"""The house stays as small as it is, and no imports run in a circle.

The figures stand in pyproject.toml, `[tool.skinmap.house]`: code lines of each room rounded up to
the next hundred, options, modules with one importer beside it, names that exist twice. A commit
that raises one of them has a line on it in its message; `python -m tests.house` prints all.
"""

from __future__ import annotations

import tomllib

import pytest

from tests.house import (
    HUNDRED,
    PRODUCT,
    ROOT,
    circle,
    count,
    importers_of,
    imports_of,
    lone_siblings,
    names_twice,
    options,
    rooms,
)

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
HOUSE = SETTINGS["tool"]["skinmap"]["house"]


def test_no_room_grows_and_figures_follow_those_that_shrink():
    found, most = rooms(), HOUSE["code"]
    assert len(found) > 30
    larger = {room: lines for room, lines in found.items() if lines > most.get(room, 0)}
    assert not larger, {room: (lines, most.get(room)) for room, lines in larger.items()}
    loose = {room for room in most if most[room] - found.get(room, 0) >= 2 * HUNDRED}
    assert not loose, {room: (found.get(room), most[room]) for room in loose}


def test_commands_have_few_options():
    found = options()
    assert len(found) > 20
    assert sum(found.values()) <= HOUSE["options"], found
    assert max(found.values()) <= HOUSE["options_of_a_command"], found


def test_few_names_exist_twice():
    assert len(names_twice()) <= HOUSE["names_twice"], names_twice()


@pytest.mark.parametrize("package", PRODUCT)
def test_no_imports_run_in_a_circle(package):
    imports = imports_of(package)
    assert sum(map(len, imports.values())) > len(imports) > 10
    assert circle(imports) == []


def test_a_circle_is_seen():
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert set(circle(imports)) == {"a", "b", "c"}
    assert circle({"a": {"b"}, "b": set()}) == []


def test_few_modules_have_one_importer_in_the_same_folder():
    importers = importers_of(PRODUCT)
    assert len(importers) > 300
    # A file ends where an idea ends: a new one of these belongs to its importer, unless it is an
    # idea of its own. What a registry finds by its name has no importer.
    assert len(lone_siblings(importers)) <= HOUSE["lone_modules"], sorted(lone_siblings(importers))


def test_a_lone_sibling_is_seen():
    importers = {"a.b.c": {"a.b.d"}, "a.b.d": {"a.e"}, "a.e": {"a.f", "a.b.c"}, "a.f": set()}
    assert lone_siblings(importers) == {"a.b.c"}


def test_lines_of_code_and_docstrings_are_told_apart():
    text = '"""What\nthis is."""\n\nx = """\nno docstring\n"""  # said\n# alone\ndef f(): "One."\n'
    assert count([text]) == {"lines": 8, "code": 3, "docstrings": 3}
