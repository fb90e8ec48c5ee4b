"""The benchmark of whole commands: which it measures, and that a slower one is seen."""

from __future__ import annotations

import sys

import pytest

from benchmarks.harness.compare import FIGURE, compare
from benchmarks.scale import commands
from benchmarks.scale.command_work import WORKS


def test_every_command_of_the_readme_is_measured_or_says_why_not(tmp_path):
    lines = commands.readme_lines()
    assert len(lines) > 20
    assert not any("#" in line for line in lines)
    measured = {one.line for one in commands.commands(tmp_path, quick=True)}
    for line in lines:
        assert (line in measured) != bool(commands.left_out(line)) or line.startswith(commands.LONG)


def test_the_work_of_each_command_exists(tmp_path):
    named = {one.work for one in commands.commands(tmp_path, quick=True)} - {"", "mesh"}
    assert named <= set(WORKS)


def test_a_process_is_charged_what_it_spends(tmp_path):
    busy = "import time\nwhile time.process_time() < 0.3: pass\nprint('done')"
    found = commands.spent([sys.executable, "-S", "-c", busy], tmp_path, {})
    assert (found["code"], found["out"]) == (0, "done\n")
    assert 0.3 <= found["cpu_s"] < 1.0  # the interpreter itself takes some hundredths
    assert found["mb"] > 1.0


@pytest.mark.parametrize(("now", "verdict"), [(1.0, "same"), (2.0, "regression"), (0.4, "better")])
def test_a_ratio_that_grew_is_a_regression(now, verdict):
    row = {"command": "inspect icub", "cpu_s": 1.0, "spread_s": None, "mb": 90.0, "ratio": 1.0}
    old = commands.figures([row])
    new = commands.figures([row | {"ratio": now}])
    assert all(figure.keys() >= FIGURE for figure in old)
    found = {one["key"]: one["verdict"] for one in compare({"figures": old}, {"figures": new})}
    assert found["commands.inspect_icub.ratio"] == verdict
    assert found["commands.inspect_icub.s"] == "same"
