"""What a benchmark writes: its rows, and where, when and with what they were measured.

Every file of benchmarks/results that a program here writes goes through `write`; every program
that measures one area has `measure(quick) -> dict` and ends with `command`.

Each result keeps the code that ran for it, so that a page can show how much of it has changed. A
piece is a function that ran, or a statement (a constant, the head of a class) of a module in which
something ran. Each has a digest of its syntax tree, without comments and docstrings: moving,
formatting and explaining code changes none. Pieces of a result that today's code no longer holds
have changed since it was made.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import os
import platform
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from types import CodeType
from typing import Any

from benchmarks import ROOT
from skinmap.imports import installed

RESULTS = ROOT / "benchmarks" / "results"
FORMAT = 1  # of the files
DIRTY = "-dirty"  # of a commit whose files were changed
LIBRARIES = (
    "skinmap", "numpy", "scipy", "scikit-learn", "numba", "libigl", "trimesh", "pymeshlab",
    "potpourri3d", "open3d", "pyvista", "vtk", "websockets",
    "mcap", "zstandard", "pyzmq", "pylsl", "loky", "torch",
)  # fmt: skip
Measure = Callable[..., dict[str, Any]]


def about(form: str) -> dict[str, Any]:
    """Commit, date, form, versions and machine: the head of every result.

    Parameters
    ----------
    form : {"full", "short", "quick"}
        How long the benchmark was allowed to be.
    """
    named = commit()
    return {
        "format": FORMAT,
        "commit": named.removesuffix(DIRTY),
        "clean": not named.endswith(DIRTY),
        "date": datetime.now(UTC).date().isoformat(),
        "form": form,
        "python": platform.python_version(),
        "versions": {name: installed(name) or "not installed" for name in LIBRARIES},
        "machine": machine(),
        "threads": int(os.environ.get("OMP_NUM_THREADS", "0")) or "all",
    }


def commit() -> str:
    """The commit that is measured, `-dirty` where files other than results differ from it."""
    named = _git("describe", "--always")
    elsewhere = ":(exclude)benchmarks/results"
    differs = _git("status", "--porcelain", "--untracked-files=no", "--", ".", elsewhere)
    return (named or "unknown") + (DIRTY if differs else "")


def _git(*words: str) -> str:
    try:
        run = subprocess.run(
            ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False
        )
    except OSError:  # there is no git
        return ""
    return run.stdout.strip()


def machine() -> dict[str, Any]:
    """Processor, cores, memory [GB] and how busy the machine is."""
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(pages / 2**30, 1),
        "load_average": round(os.getloadavg()[0], 2),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    fields = dict(line.split(":", 1) for line in lines if ":" in line)
    names = {key.strip(): value.strip() for key, value in fields.items()}
    return f"{names.get('model name', 'unknown')} (model {names.get('model', '?')})"


def write(path: Path, result: dict[str, Any]) -> None:
    """Write a result as JSON that people can read: one number a line, short lists in one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(readable(result) + "\n", encoding="utf-8")
    partial.replace(path)  # never half a file


def readable(value: Any, indent: int = 0) -> str:
    """JSON whose objects and lists stand on one line where they fit into a hundred characters."""
    short = json.dumps(rounded(value), allow_nan=False)
    if len(short) + indent <= 100 or not isinstance(value, dict | list | tuple) or not value:
        return short
    inner, outer = " " * (indent + 1), " " * indent
    if isinstance(value, dict):
        pairs = value.items()
        lines = [f"{inner}{json.dumps(str(k))}: {readable(v, indent + 1)}" for k, v in pairs]
        return "{\n" + ",\n".join(lines) + f"\n{outer}}}"
    return "[\n" + ",\n".join(inner + readable(v, indent + 1) for v in value) + f"\n{outer}]"


def rounded(value: Any) -> Any:
    """The same with numbers of six figures, as no clock is better; null for what is no number."""
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    return rounded(value.item()) if hasattr(value, "item") else value


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    body = ("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *body]


def afresh(work: Callable[..., Any], *given: Any, preload: Sequence[str] = ()) -> Any:
    """What a function returns in a process of its own, which only these modules were loaded into.

    What the function prints goes to the terminal; what it raises is raised here.
    """
    context = get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    with ProcessPoolExecutor(1, context) as pool:
        return pool.submit(work, *given).result()


def code_of(measure: Measure) -> str:
    """The pieces of code behind `measure`, from a quick run: watching would slow the full one."""
    with watched() as pieces:
        measure(True)
    return " ".join(sorted(pieces))


def command(measure: Measure, what: str | None, name: str, arguments: Any = None) -> Path | None:
    """The program of one area: measure in full (or `--quick`), and write its file.

    Parameters
    ----------
    measure : callable
        `measure(quick)`, which gives the rows.
    what : str
        Said by `--help`.
    name : str
        Of the file in benchmarks/results.
    arguments : sequence of str, optional
        Instead of the command line's.

    Returns
    -------
    Path or None
        The file; None where the rows were only printed.
    """
    from threadpoolctl import threadpool_limits

    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("--quick", action="store_true", help="whether it runs; no figures to keep")
    parser.add_argument("--out", type=Path, help="file to write instead of benchmarks/results")
    options = parser.parse_args(arguments)
    head = about("quick" if options.quick else "full")
    with threadpool_limits(1):
        rows = measure(options.quick)
        if not options.quick:
            head["code"] = code_of(measure)
    target = options.out or RESULTS / f"{name}.json"
    if options.quick and not options.out:
        print(readable(rows))
        return None
    write(target, head | rows)
    print(f"written to {target}", file=sys.stderr)
    return target


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
    functions, rest = Functions(), set[str]()

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
    return isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str)
