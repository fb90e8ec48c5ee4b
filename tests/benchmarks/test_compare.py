"""`make bench-compare` on planted files."""

from __future__ import annotations

import copy
import json

import pytest


@pytest.fixture
def run(planted, tmp_path, capsys):
    """Compare the planted run with a changed copy of itself: exit code, what it printed."""

    def compare(change, *arguments):
        from benchmarks.harness.compare import main

        new = copy.deepcopy(planted)
        change(new)
        for name, result in (("old", planted), ("new", new)):
            (tmp_path / f"{name}.json").write_text(json.dumps(result))
        paths = [str(tmp_path / f"{name}.json") for name in ("old", "new")]
        return main([*paths, *arguments]), capsys.readouterr()

    return compare


def scaled(by: float, *, area: str = "needs"):
    """A change: all figures of an area and their spread times a factor."""

    def change(result):
        for row in result["figures"]:
            if row["area"] == area:
                row["value"] *= by
                row["spread"] = row["spread"] and [one * by for one in row["spread"]]

    return change


def test_two_equal_files_have_no_regression(run):
    code, said = run(lambda _: None)
    assert code == 0
    assert "no figure of" in said.out


def test_a_figure_twice_as_bad_is_a_regression_by_name(run):
    code, said = run(scaled(2.0))
    assert code == 1
    assert "regression  needs: parts loaded: 13: 0.5 to 1 s  2x  beyond the spread" in said.out
    assert "memory: 20 to 40 MB  2x  spread unknown" in said.out
    assert run(scaled(2.0), "--threshold", "3")[0] == 0


def test_a_figure_half_as_bad_is_better(run):
    code, said = run(scaled(0.5))
    assert code == 0
    assert "better      needs: parts loaded: 13" in said.out


def test_a_change_within_the_spread_is_none(run):
    def change(result):
        for row in result["figures"]:
            row["value"] *= 1.5
            row["spread"] = row["spread"] and [row["spread"][0], row["spread"][1] * 2]
            if row["spread"] is None:
                row["value"] /= 1.5

    code, said = run(change)
    assert code == 0
    assert "within the spread" in said.out


def test_a_figure_that_should_be_large_regresses_when_it_shrinks():
    from benchmarks.harness.compare import verdict

    assert verdict(100.0, 50.0, "more", None, 1.25) == "regression"
    assert verdict(100.0, 50.0, "less", None, 1.25) == "better"
    assert verdict(0.0, 1.0, "less", None, 1.25) == "regression"
    assert verdict(0.0, 0.0, "less", None, 1.25) == "same"


def test_figures_that_came_or_went_are_named(run):
    code, said = run(lambda result: result["figures"].pop())
    assert code == 0
    assert "gone " in said.out


def test_files_of_other_machines_are_refused_with_a_warning(run):
    def change(result):
        result["machine"]["cores"] = 64

    code, said = run(change)
    assert code == 2
    assert said.err.count("\n") == 1
    assert said.err.startswith("warning: the files are of two machines: ")
    code, said = run(change, "--other-machine")
    assert code == 0
    assert said.err.startswith("warning: ")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda result: result.update(format=99), "has format 99; this program reads 1"),
        (lambda result: result.pop("figures"), "is of one area"),
        (lambda result: result.pop("machine"), "is damaged: figures, machine or form"),
        (lambda result: result["figures"][0].pop("key"), "is damaged: figures, machine or form"),
        (lambda result: result.update(figures=[1]), "is damaged: figures, machine or form"),
        (lambda result: result.update(form="full"), "of the short form, the other of the full"),
    ],
)
def test_files_that_cannot_be_compared_are_refused_in_one_line(run, change, words):
    code, said = run(change)
    assert code == 2
    assert words in said.err
    assert said.err.count("\n") == 1


def test_a_missing_or_damaged_file_is_refused_in_one_line(tmp_path, capsys):
    from benchmarks.harness.compare import main

    (tmp_path / "half.json").write_text('{"format": 1,')
    for name in ("half.json", "none.json"):
        assert main([str(tmp_path / name)] * 2) == 2
        said = capsys.readouterr().err
        assert said.startswith("cannot read ")
        assert said.count("\n") == 1


def test_json_is_one_object(run):
    _, said = run(scaled(2.0), "--json")
    told = json.loads(said.out)
    assert told["regressions"] == 3  # time and memory, and the time as it was asked for
    assert {"area", "name", "old", "new", "ratio", "verdict"} <= set(told["rows"][0])
