"""`skinmap trade`: one JSON object, plots, a profile, and one line for bad input."""

from __future__ import annotations

import json
import tomllib

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli, main
from skinmap.errors import (
    ImpossibleBudgetError,
    OutputError,
    SkinError,
    UnknownNameError,
)

pytestmark = pytest.mark.usefixtures("sketched")
SMALL = ("kaspar", "--part", "right_hand")


@pytest.fixture
def sketched(request, monkeypatch):
    """Plots that are quickly drawn, but in the tests that look at them."""
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr(
            "skinmap.trade.measuring.trade_figure", lambda *arguments: arguments[-1].touch()
        )


@pytest.fixture
def drawn():
    """Real plots."""


def trade(*arguments: str):
    return CliRunner().invoke(cli, ["trade", *map(str, arguments)])


def result_of(*arguments: str):
    result = trade(*arguments, "--json")
    assert result.exit_code == 0, (result.output, result.exception)
    return json.loads(result.stdout)


def refused(kind: type[Exception], *arguments: str) -> str:
    """The message of an error; `main` shows it in one line and exits 2 (tests/cli)."""
    result = trade(*arguments)
    assert isinstance(result.exception, kind), result.output
    return str(result.exception)


def test_json_has_the_agreed_keys(plugged):
    plugged("planted")
    found = result_of(*SMALL, "--seeds", 2)
    assert set(found) == {
        "robot", "parts", "seed", "seeds", "machine", "versions", "tasks", "points", "recommended",
        "failed", "profile", "files",
    }  # fmt: skip
    assert (found["robot"], found["parts"], found["seed"]) == ("kaspar", ["right_hand"], 0)
    for row in found["points"]:
        assert set(row) >= {
            "task", "setting", "seconds", "seconds_spread", "error", "error_spread", "unit",
            "pareto", "runs", "extra",
        }  # fmt: skip
    marked = {row["setting"]["level"]: row["pareto"] for row in found["points"]}
    assert marked == {"low": True, "middle": True, "high": True, "silly": False}
    best = found["recommended"]["planted"]
    assert set(best) == {"setting", "seconds", "error", "unit", "why"}
    assert best["setting"] == {"level": "middle"}  # 10 ms; high takes 100
    assert best["why"] == "least error within one sample of a stream (20 ms)"
    assert found["tasks"][0]["knobs"][0]["values"] == ["low", "middle", "high", "silly"]
    assert (found["profile"], found["files"]) == (None, [])


@pytest.mark.parametrize(
    ("arguments", "level"),
    [
        (("--max-ms", 50), "middle"),
        (("--max-ms", 500), "high"),
    ],
)
def test_budgets_choose_the_planted_setting(plugged, arguments, level):
    plugged("planted")
    best = result_of(*SMALL, "--seeds", 1, *arguments)["recommended"]["planted"]
    assert best["setting"] == {"level": level}


def test_out_holds_a_plot_and_a_profile_that_reads_back(plugged, drawn, tmp_path):
    plugged("planted")
    out = tmp_path / "out"
    result = trade(*SMALL, "--seeds", 2, "--max-ms", 50, "--out", out)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == [
        "planted.png", "profile.toml", "report.html",
    ]  # fmt: skip
    assert (out / "planted.png").read_bytes().startswith(b"\x89PNG")
    written = tomllib.loads((out / "profile.toml").read_text())
    assert written["profile"]["format"] == 1
    assert (written["profile"]["robot"], written["profile"]["part"]) == ("kaspar", "right_hand")
    assert written["planted"]["level"] == "middle"
    # 10 ms; the mean of 1 and 1.1 mm.
    assert written["planted"]["predicted"] == {
        "seconds": 0.01, "error": 1.05, "unit": "mm"
    }  # fmt: skip
    for line in ("level=middle", "recommended (least error within 50 ms)", "profile.toml"):
        assert line in result.stdout


def test_one_seed_has_no_spread(plugged):
    plugged("planted")
    rows = [line for line in trade(*SMALL, "--seeds", 1).stdout.splitlines() if "level=" in line]
    assert [line.split()[-1] for line in rows[:4]] == ["-"] * 4
    point = result_of(*SMALL, "--seeds", 1)["points"][0]
    assert (point["seconds_spread"], point["error_spread"]) == (None, None)


@pytest.mark.parametrize("option", ["--budget-ms", "--check", "--max-error"])
def test_options_that_were_removed_answer(plugged, option):
    plugged("planted")
    result = trade(*SMALL, option, "5")
    assert result.exit_code == 2
    assert f"{option} was removed: " in result.output


def test_one_task_that_fails_leaves_the_others(plugged):
    plugged("broken", "failing", "planted")
    found = result_of(*SMALL, "--seeds", 1)
    assert set(found["recommended"]) == {"failing", "planted"}
    said = {(one["task"], one["setting"] and one["setting"]["level"]) for one in found["failed"]}
    assert said == {("broken", None), ("failing", "high"), ("failing", "silly")}
    shown = trade(*SMALL, "--seeds", 1).output
    assert "not measured: broken: RuntimeError: nothing to prepare" in shown
    assert "not measured: failing level=high: no triangle to stand on" in shown


def test_nothing_measured_is_an_error(plugged):
    plugged("broken")
    said = refused(SkinError, *SMALL, "--task", "broken")
    assert said == "nothing could be measured: broken: RuntimeError: nothing to prepare"


def test_an_impossible_budget_names_the_nearest_and_writes_nothing(plugged, tmp_path):
    plugged("planted")
    out = tmp_path / "out"
    said = refused(ImpossibleBudgetError, *SMALL, "--max-ms", 0.5, "--out", out)
    assert "planted: no setting keeps to 0.5 ms; the nearest is level=low" in said
    assert "1 ms" in said
    assert not out.exists()


def test_an_impossible_budget_is_one_line_and_exit_code_2(plugged, monkeypatch, capsys):
    plugged("planted")
    monkeypatch.setattr("sys.argv", ["skinmap", "trade", *SMALL, "--max-ms", "0.5"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    printed = capsys.readouterr()
    assert not printed.out
    said = [line for line in printed.err.splitlines() if line]
    assert len(said) == 1  # an empty line is where the progress stood
    assert said[0].startswith("Error: planted: no setting keeps to 0.5 ms; the nearest is")


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_measured(
    plugged, tmp_path, toys, monkeypatch
):
    plugged("planted")
    monkeypatch.setattr(toys["planted"], "prepare", lambda *_, **__: pytest.fail("measured"))
    (tmp_path / "file").touch()
    said = refused(OutputError, *SMALL, "--out", tmp_path / "file" / "out")
    assert said.startswith("cannot write to the folder ")


def test_a_second_run_replaces_its_own_files_and_no_others(plugged, tmp_path):
    plugged("planted")
    out = tmp_path / "out"
    words = (*SMALL, "--seeds", 1, "--out", out)
    assert trade(*words).exit_code == 0
    assert trade(*words, "--max-ms", 5).exit_code == 0
    assert 'level = "low"' in (out / "profile.toml").read_text()
    (out / "profile.toml").write_text("# mine\n")
    said = refused(OutputError, *words)
    assert "holds 'profile.toml', which this command did not make" in said
    assert (out / "profile.toml").read_text() == "# mine\n"
    assert trade(*words, "--force").exit_code == 0
    assert 'level = "middle"' in (out / "profile.toml").read_text()


def test_help_shows_an_example():
    assert "Example:  skinmap trade icub --part right_forearm --out trade" in trade("--help").output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--task", "juggle"), "no trade task 'juggle'; the only trade task is planted"),
        (("--part", "tail"), "no part 'tail'"),
    ],
)
def test_names_that_do_not_exist_are_refused(plugged, arguments, message):
    plugged("planted")
    assert message in refused(UnknownNameError, "kaspar", *arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--max-ms", "soon"), "'soon' is not a number"),
        (("--max-ms", "planted=5"), "'planted=5' is not a number"),
        (("--max-ms", "-3"), "-3.0 is not in the range 0<x<=1e+08"),
        (("--max-ms", "nan"), "'nan' is not a number"),
        (("--max-ms", "inf"), "inf is not in the range"),
        (("--seeds", "0"), "0 is not in the range"),
    ],
)
def test_nonsense_is_refused(plugged, arguments, message):
    plugged("planted")
    result = trade(*SMALL, *arguments)
    assert result.exit_code == 2
    assert message in result.output


def test_an_interrupted_run_leaves_nothing(plugged, tmp_path, toys, monkeypatch):
    plugged("planted")

    def interrupt(self, prepared, setting, *, seed):
        raise KeyboardInterrupt

    monkeypatch.setattr(toys["planted"], "run", interrupt)
    out = tmp_path / "out"
    assert trade(*SMALL, "--out", out).exit_code == 1  # 130 in `main`, which click's runner is not
    assert not out.exists()
