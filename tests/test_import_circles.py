"""No module imports one that imports it back, not even inside a function."""

from __future__ import annotations

import graphlib
import importlib

import grimp
import pytest


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
