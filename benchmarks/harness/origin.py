"""The code behind a result: what ran when it was made, and how much of that is still the same.

A piece is a function that ran, or a statement (a constant, the head of a class) of a module in
which something ran. Each has a digest of its syntax tree, without comments and docstrings: moving,
formatting and explaining code changes none. Pieces of a result that today's code no longer holds
have changed since it was made.
"""

from __future__ import annotations

import ast
import hashlib
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import CodeType
from typing import Any

from benchmarks import ROOT

ROOMS = ("skinmap", "calibration", "viewer", "benchmarks")
DIGITS = 6  # of a digest: one of today's 15,000 pieces is taken for another once in a thousand
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
Functions = dict[tuple[str, int], str]


@contextmanager
def watched() -> Iterator[set[str]]:
    """The pieces of this project that run meanwhile, known when it ends: threads, no processes.

    Loops that numba compiles are known by the function that they stand in.
    """
    ran: set[CodeType] = set()
    found: set[str] = set()

    def note(frame: Any, *_: object) -> None:
        ran.add(frame.f_code)

    before = sys.gettrace()
    threading.settrace(note)
    sys.settrace(note)
    try:
        yield found
    finally:
        sys.settrace(before)
        threading.settrace(before)  # type: ignore[arg-type]  # None is what it begins with
        found |= _pieces_of(ran.copy())  # threads that go on add to it


def today() -> frozenset[str]:
    """All pieces of the code as it is."""
    return frozenset(
        piece
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*.py"))
        for functions, rest in [_digests(path)]
        for piece in (*functions.values(), *rest)
    )


def changed(result: Mapping[str, Any], code: frozenset[str]) -> float | None:
    """Share of the pieces behind a result that code no longer holds; None where none is kept."""
    pieces = str(result.get("made", result).get("code", "")).split()
    return sum(piece not in code for piece in pieces) / len(pieces) if pieces else None


def _pieces_of(ran: Iterable[CodeType]) -> set[str]:
    """Digests of functions that ran, and of what else their modules hold."""
    files: dict[Path, set[tuple[str, int]]] = {}
    for code in ran:
        path = Path(code.co_filename)
        if not code.co_name.startswith("<") and path.parts[: len(ROOT.parts)] == ROOT.parts:
            files.setdefault(path, set()).add((code.co_name, code.co_firstlineno))
    found: set[str] = set()
    for path, keys in files.items():
        if path.relative_to(ROOT).parts[0] in ROOMS:
            functions, rest = _digests(path)
            own = {functions[key] for key in keys if key in functions}
            found |= own | (rest if own else set())
    return found


def _digests(path: Path) -> tuple[Functions, set[str]]:
    """Digests of a module's functions by name and first line, and of its other statements."""
    functions: Functions = {}
    rest: set[str] = set()

    def take(body: list[ast.stmt], inside: str) -> None:
        for node in body:
            if isinstance(node, FUNCTIONS):
                first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                functions[node.name, first] = _digest(node, inside)
            elif isinstance(node, ast.ClassDef):
                take(node.body, f"{inside}.{node.name}")
                heads: list[ast.expr] = [*node.bases, *node.decorator_list]
                rest.update(_digest(one, f"{inside}.{node.name}") for one in heads)
            elif not isinstance(node, ast.Import | ast.ImportFrom) and not _words(node):
                rest.add(_digest(node, inside))

    take(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return functions, rest


def _digest(node: ast.AST, inside: str) -> str:
    for one in ast.walk(node):
        body = getattr(one, "body", None)
        if isinstance(body, list) and body and _words(body[0]):
            del body[0]
    text = f"{inside} {ast.dump(node)}"
    return hashlib.blake2b(text.encode(), digest_size=DIGITS // 2).hexdigest()


def _words(node: ast.AST) -> bool:
    """Whether a statement is a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
