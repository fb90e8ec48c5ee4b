"""How modules import each other: never in a circle, and few have one importer beside them."""

from __future__ import annotations

import graphlib
import importlib

import grimp
import pytest

MOST_LONE = 30  # modules with one importer, beside it; fewer are better


def circle(imports: dict[str, set[str]]) -> list[str]:
    """Modules that import each other, the first again at the end; nothing where none do."""
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", ["skinmap", "calibration", "viewer"])
def test_no_imports_run_in_a_circle(package):
    importlib.import_module(package)
    graph = grimp.build_graph(package, exclude_type_checking_imports=True, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert sum(map(len, imports.values())) > len(imports) > 10
    assert circle(imports) == []


def test_a_circle_is_seen():
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert set(circle(imports)) == {"a", "b", "c"}
    assert circle({"a": {"b"}, "b": set()}) == []


def lone_siblings(importers: dict[str, set[str]]) -> set[str]:
    """Modules that exactly one other imports, which lies in the same folder."""
    return {
        name
        for name, others in importers.items()
        if len(others) == 1 and min(others).rpartition(".")[0] == name.rpartition(".")[0]
    }


def test_few_modules_have_one_importer_in_the_same_folder():
    packages = ("skinmap", "calibration", "viewer")
    graph = grimp.build_graph(*packages, cache_dir=None)
    importers = {
        name: graph.find_modules_that_directly_import(name)
        for name in graph.modules
        if not graph.find_children(name)
    }
    assert len(importers) > 400
    # A file ends where an idea ends: a new one of these belongs to its importer, unless it is an
    # idea of its own. What a registry finds by its name has no importer.
    assert len(lone_siblings(importers)) <= MOST_LONE, sorted(lone_siblings(importers))


def test_a_lone_sibling_is_seen():
    importers = {"a.b.c": {"a.b.d"}, "a.b.d": {"a.e"}, "a.e": {"a.f", "a.b.c"}, "a.f": set()}
    assert lone_siblings(importers) == {"a.b.c"}
