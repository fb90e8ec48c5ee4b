"""Cases in processes forked after the imports: none helps the next, failures are one line."""

from __future__ import annotations

import sys

import pytest

PROGRAM = """
import os, sys
sys.path.insert(0, os.getcwd())
from benchmarks.harness import forked
kept = []
def run(what, n=1):
    kept.append(what)
    if what == "fail":
        raise ValueError("no such wheel")
    if what == "end":
        os._exit(7)
    if what == "full":
        raise MemoryError
    print("said by a library")
    return {"n": n, "kept": kept, "pid": os.getpid()}
forked.serve(["json"], run)
"""


@pytest.fixture
def cases(tmp_path):
    """A program with planted cases."""
    from benchmarks.harness import forked

    program = tmp_path / "cases.py"
    program.write_text(PROGRAM)
    with forked.Cases([sys.executable, str(program)]) as asked:
        yield asked


def test_each_case_has_a_process_of_its_own(cases):
    one, two = cases.ask("good", 2), cases.ask("good", 3)
    assert (one["n"], two["n"]) == (2, 3)
    assert one["kept"] == two["kept"] == ["good"]
    assert one["pid"] != two["pid"]
    assert one["case_cpu_s"] > 0
    assert one["case_mb"] > 1


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("fail", r"fail: ValueError\('no such wheel'\)"),
        ("end", "end: exit 7"),
        ("full", "full: not enough memory"),
    ],
)
def test_a_case_that_fails_is_named_and_the_next_one_runs(cases, what, words):
    from benchmarks.harness.forked import CaseError

    with pytest.raises(CaseError, match=words):
        cases.ask(what)
    assert cases.ask("good")["n"] == 1
