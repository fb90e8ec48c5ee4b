"""Processes forked from one that has only imported: the cost of a case without that of imports.

A program of cases ends with `serve(modules, run)`; who measures asks it through `Cases`. No case
helps the next. A forked process maps the libraries' pages anew as it runs through them, which is
no memory that a case needs: all are mapped before.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks import ROOT

POPULATE_READ = 22  # MADV_POPULATE_READ of Linux's asm-generic/mman-common.h
LONGEST = 600  # wall time of a case [s]; it is ended then


class CaseError(RuntimeError):
    """A case that failed or took too long, in one line."""


class Cases:
    """A program of cases that has done its imports and waits to be asked.

    Parameters
    ----------
    program : sequence of str
        The command, run at the top of the checkout; it ends with `serve`.
    arguments : str
        Of the program.
    """

    def __init__(self, program: Sequence[str], *arguments: str) -> None:
        self._process = subprocess.Popen(
            [*program, *arguments], cwd=ROOT,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def __enter__(self) -> Cases:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
        self._process.wait()

    def ask(self, *case: Any) -> dict[str, Any]:
        """What `run` of the program gives for a case, from a process of its own.

        Returns
        -------
        dict
            With `case_cpu_s` and `case_mb` of the whole process, its preparations included, and
            `imports_mb` of the program that waits.

        Raises
        ------
        CaseError
            The case failed or took too long.
        """
        words = ", ".join(map(str, case))
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(case) + "\n")
            self._process.stdin.flush()
        for line in self._process.stdout:
            if not line.startswith("{"):
                continue  # said by a library
            found = dict(json.loads(line))
            if "failed" in found:
                raise CaseError(f"{words}: {found['failed']}")
            return found
        raise CaseError(f"{words}: the program ended with {self._process.wait()}")


def serve(modules: Sequence[str], run: Callable[..., dict[str, Any]]) -> None:
    """Import, then answer each line of cases on stdin by a line on stdout."""
    for module in modules:
        import_module(module)
    imports_mb = peak_mb()
    for line in sys.stdin:
        case = json.loads(line)
        out, into = os.pipe()
        if not (pid := os.fork()):
            os.close(out)
            _answer(into, run, case)
        os.close(into)
        with os.fdopen(out, encoding="utf-8") as told:
            text = told.read()
        _, status, used = os.wait4(pid, 0)
        code = os.waitstatus_to_exitcode(status)
        found = json.loads(text) if text else {"failed": f"exit {code}"}
        if code == -signal.SIGALRM:
            found = {"failed": f"took longer than {LONGEST} s"}
        found["case_cpu_s"] = used.ru_utime + used.ru_stime
        found["case_mb"] = used.ru_maxrss / 1024
        found["imports_mb"] = imports_mb
        print(json.dumps(found), flush=True)


def _answer(into: int, run: Callable[..., dict[str, Any]], case: Sequence[Any]) -> None:
    """Run a case in this process and end it, without what the process before would do."""
    signal.alarm(LONGEST)
    found: dict[str, Any] = {}
    try:
        map_libraries()
        found = run(*case)
    except MemoryError:
        found = {"failed": "not enough memory"}
    finally:
        if not found:
            found = {"failed": f"{sys.exc_info()[1]!r}"[:300]}
        with os.fdopen(into, "w", encoding="utf-8") as told:
            told.write(json.dumps(found))
        os._exit(0)


def map_libraries() -> None:
    """Map all pages of the libraries in use (Linux 5.14; elsewhere their pages count as memory)."""
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        fields = line.split()
        if len(fields) > 5 and fields[1].startswith("r") and fields[5].startswith("/"):
            first, last = (int(one, 16) for one in fields[0].split("-"))
            madvise(first, last - first, POPULATE_READ)


def peak_mb() -> float:
    """Largest resident size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
