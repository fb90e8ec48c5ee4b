"""The benchmark of whole commands: which it measures, and that a slower one is seen."""

from __future__ import annotations

import sys

import pytest

from benchmarks.harness.compare import FIGURE, compare, main
from benchmarks.harness.record import about, write
from benchmarks.scale import commands
from benchmarks.scale.command_work import WORKS


def test_every_command_of_the_readme_is_measured_or_says_why_not(tmp_path):
    lines = commands.readme_lines()
    assert len(lines) > 20
    assert not any("#" in line for line in lines)
    measured = {one.line for one in commands.commands(tmp_path)}
    for line in lines:
        assert (line in measured) != bool(commands.left_out(line))


def test_the_quick_form_has_commands_and_works_that_exist(tmp_path):
    every = list(commands.commands(tmp_path))
    assert {one.work for one in every} - {"", "mesh"} <= set(WORKS)
    for start in commands.QUICK:
        assert any(one.line.startswith(start) for one in every), start


@pytest.mark.parametrize(("cpu", "turns"), [(0.2, 3), (3.0, 2), (50.0, 1), (0.0, 3)])
def test_short_commands_run_more_often(cpu, turns):
    assert commands.turns_of(cpu, 3) == turns


def test_a_process_is_charged_what_it_spends(tmp_path):
    busy = "import time\nwhile time.process_time() < 0.3: pass\nprint('done')"
    found = commands.spent([sys.executable, "-S", "-c", busy], tmp_path, {})
    assert (found["code"], found["out"]) == (0, "done\n")
    assert 0.3 <= found["cpu_s"] < 1.0  # the interpreter itself takes some hundredths
    assert found["mb"] > 1.0


def test_two_results_with_another_ratio_are_told_apart(tmp_path, capsys):
    row = {"command": "cache info", "cpu_s": 1.0, "spread_s": (0.9, 1.0, 1.1), "mb": 90.0}
    paths = []
    for name, ratio in (("old", 1.1), ("new", 1.7)):
        figures = commands.figures([row | {"ratio": ratio}])
        write(tmp_path / f"{name}.json", about("full") | {"figures": figures})
        paths.append(str(tmp_path / f"{name}.json"))
    assert main(paths) == 1
    assert "regression  commands: skinmap cache info: 1.1 to 1.7 times" in capsys.readouterr().out
    assert main([paths[0], paths[0]]) == 0


@pytest.mark.parametrize(("now", "verdict"), [(1.0, "same"), (2.0, "regression"), (0.4, "better")])
def test_a_ratio_that_grew_is_a_regression(now, verdict):
    row = {"command": "inspect icub", "cpu_s": 1.0, "spread_s": None, "mb": 90.0, "ratio": 1.0}
    old = commands.figures([row])
    new = commands.figures([row | {"ratio": now}])
    assert all(figure.keys() >= FIGURE for figure in old)
    found = {one["key"]: one["verdict"] for one in compare({"figures": old}, {"figures": new})}
    assert found["commands.inspect_icub.ratio"] == verdict
    assert found["commands.inspect_icub.s"] == "same"
