"""How the house stands: lines of code, options, circles of imports, modules with one importer.

`python -m tests.house` prints the figures of today as they stand in pyproject.toml.
"""

from __future__ import annotations

import ast
import graphlib
import importlib
import io
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import click

ROOT = Path(__file__).parents[1]
HUNDRED = 100
PRODUCT = ("skinmap", "calibration", "viewer")
MEASURED = (*PRODUCT, "benchmarks", "scripts")
SILENT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
          tokenize.ENCODING, tokenize.ENDMARKER}  # fmt: skip


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


def rooms() -> dict[str, int]:
    """Code lines of each room: a folder below a top folder, or the files beside those."""
    found: Counter[str] = Counter()
    for top in MEASURED:
        for path in (ROOT / top).rglob("*.py"):
            parts = path.relative_to(ROOT).parts
            room = "/".join(parts[:2]) if len(parts) > 2 else top
            found[room] += count([path.read_text(encoding="utf-8")])["code"]
    return {room: lines for room, lines in sorted(found.items()) if lines}


def rounded(lines: int) -> int:
    """Up to the next hundred."""
    return -(-lines // HUNDRED) * HUNDRED


def names_twice() -> list[str]:
    """Names that more than one file of the product has."""
    paths = [path for top in PRODUCT for path in (ROOT / top).rglob("*.py")]
    names = Counter(path.stem for path in paths if path.stem != "__init__")
    return sorted(name for name, times in names.items() if times > 1)


def options() -> dict[str, int]:
    """How many options each command has."""
    from skinmap.cli.main import cli

    def own(command: click.Command, words: str) -> Iterator[tuple[str, int]]:
        given = [one for one in command.params if isinstance(one, click.Option)]
        yield words, sum(one.name != "help" for one in given)
        if isinstance(command, click.Group):
            ctx = click.Context(command)
            for name in command.list_commands(ctx):
                inner = command.get_command(ctx, name)
                assert inner is not None
                yield from own(inner, f"{words} {name}")

    return dict(own(cli, "skinmap"))


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


def table() -> str:
    """The table of pyproject.toml with the figures of today."""
    counts = options()
    lines = [
        "[tool.skinmap.house]",
        f"options = {sum(counts.values())}",
        f"options_of_a_command = {max(counts.values())}",
        f"lone_modules = {len(lone_siblings(importers_of(PRODUCT)))}",
        f"names_twice = {len(names_twice())}",
        "",
        "[tool.skinmap.house.code]",
        *(f'"{room}" = {rounded(lines)}' for room, lines in rooms().items()),
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(table())
