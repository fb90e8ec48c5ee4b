"""How modules import each other: never in a circle, and few have one importer beside them."""

from __future__ import annotations

import pytest

from benchmarks.harness.house import (
    PRODUCT,
    circle,
    count,
    importers_of,
    imports_of,
    lone_siblings,
)

MOST_LONE = 30  # modules with one importer, beside it; fewer are better


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
    assert len(importers) > 400
    # A file ends where an idea ends: a new one of these belongs to its importer, unless it is an
    # idea of its own. What a registry finds by its name has no importer.
    assert len(lone_siblings(importers)) <= MOST_LONE, sorted(lone_siblings(importers))


def test_a_lone_sibling_is_seen():
    importers = {"a.b.c": {"a.b.d"}, "a.b.d": {"a.e"}, "a.e": {"a.f", "a.b.c"}, "a.f": set()}
    assert lone_siblings(importers) == {"a.b.c"}


def test_lines_of_code_and_docstrings_are_told_apart():
    text = '"""What\nthis is."""\n\nx = """\nno docstring\n"""  # said\n# alone\ndef f(): "One."\n'
    assert count([text]) == {"lines": 8, "code": 3, "docstrings": 3}
