"""The house in figures: lines, circles, lone modules, and what the public interface costs.

`python -m benchmarks.harness.house` prints one JSON object; it is an area of `make bench`.
"""

from __future__ import annotations

import ast
import graphlib
import importlib
import io
import json
import subprocess
import sys
import tokenize
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.timing import children_seconds

PRODUCT = ("skinmap", "calibration", "viewer")
MEASURED = (*PRODUCT, "benchmarks")
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
          tokenize.ENCODING, tokenize.ENDMARKER}  # fmt: skip


def measure(quick: bool = False) -> dict[str, Any]:
    """Lines of each folder, how modules hang together, and the seconds of two fresh processes."""
    import skinmap

    folders = {name: sorted((ROOT / name).rglob("*.py")) for name in MEASURED}
    lines = {name: count(path.read_text(encoding="utf-8") for path in files)
             for name, files in folders.items()}  # fmt: skip
    turns = 1 if quick else 5
    return {
        "lines": lines,
        "lines_in_all": sum(one["lines"] for one in lines.values()),
        "code_in_all": sum(one["code"] for one in lines.values()),
        "modules": sum(map(len, folders.values())),
        "lone_modules": len(lone_siblings(importers_of(PRODUCT))),
        "circles": sum(bool(circle(imports_of(name))) for name in PRODUCT),
        "public_names": len(skinmap.__all__),
        "import_cpu_s": _seconds((sys.executable, "-c", "import skinmap"), turns),
        "help_cpu_s": _seconds((str(Path(sys.executable).with_name("skinmap")), "--help"), turns),
    }


def count(texts: Iterable[str]) -> dict[str, int]:
    """Lines of some modules, and how many of them are code, docstrings, and the rest."""
    found = {"lines": 0, "code": 0, "docstrings": 0}
    for text in texts:
        said = docstring_lines(text)
        code: set[int] = set()
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type not in SILENT:
                code.update(range(token.start[0], token.end[0] + 1))
        found["lines"] += text.count("\n")
        found["docstrings"] += len(said)
        found["code"] += len(code - said)
    return found


def docstring_lines(text: str) -> set[int]:
    """Numbers of the lines that docstrings of a module, its classes and functions take."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    bodies = [node.body for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    heads = [body[0] for body in bodies if body and isinstance(body[0], ast.Expr)]
    return {
        line
        for head in heads
        if isinstance(head.value, ast.Constant) and isinstance(head.value.value, str)
        for line in range(head.lineno, (head.end_lineno or head.lineno) + 1)
    }


def imports_of(package: str) -> dict[str, set[str]]:
    """Modules of a package, and which each imports where it runs (not for types alone)."""
    import grimp

    importlib.import_module(package)
    graph = grimp.build_graph(package, exclude_type_checking_imports=True, cache_dir=None)
    return {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}


def importers_of(packages: Iterable[str]) -> dict[str, set[str]]:
    """Modules of some packages, and which import each."""
    import grimp

    graph = grimp.build_graph(*packages, cache_dir=None)
    return {
        name: graph.find_modules_that_directly_import(name)
        for name in graph.modules
        if not graph.find_children(name)
    }


def circle(imports: Mapping[str, set[str]]) -> list[str]:
    """Modules that import each other, the first again at the end; nothing where none do."""
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def lone_siblings(importers: Mapping[str, set[str]]) -> set[str]:
    """Modules that exactly one other imports, which lies in the same folder."""
    return {
        name
        for name, others in importers.items()
        if len(others) == 1 and min(others).rpartition(".")[0] == name.rpartition(".")[0]
    }


def _seconds(words: tuple[str, ...], turns: int) -> float:
    """CPU seconds of a fresh process, the least of some."""
    found = []
    for _ in range(1 + turns):  # the first one reads the files from the disk
        began = children_seconds()
        subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        found.append(children_seconds() - began)
    return min(found[1:])


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
