"""Options that were removed answer with one line."""

from __future__ import annotations

import tomllib

import click
import pytest
from click.testing import CliRunner

from calibration.commands import calibrate
from skinmap.cli.main import cli
from skinmap.commands.retired import ANSWERS, NamedGroup
from tests.cli.test_options import commands


@click.command("flatten")
@click.option("--jobs")
def sweep(jobs: str | None) -> None:
    click.echo(f"jobs {jobs}")


@pytest.mark.parametrize(
    "words", [["--backend", "dask"], ["--backend"], ["--backend=dask"], ["--backend", "-1"]]
)
def test_retired_option_answers_with_what_to_write(words):
    group = NamedGroup("skinmap", commands={"sweep": sweep})
    result = CliRunner().invoke(group, ["sweep", "--jobs", "2", *words])
    assert result.exit_code == 2
    assert "--backend was removed: write --jobs tcp://HOST:PORT" in result.output


def test_an_option_before_its_command_is_none_that_was_removed():
    result = CliRunner().invoke(cli, ["--profile", "a.toml", "train"])
    assert result.exit_code == 2
    assert "No such option '--profile'" in result.output


def test_retired_options_are_hidden_and_cost_nothing_when_absent():
    assert CliRunner().invoke(sweep, ["--jobs", "2"]).output == "jobs 2\n"
    assert "--split-sheets" not in CliRunner().invoke(cli, ["flatten", "--help"]).output


def test_each_option_that_has_an_answer_is_one_that_its_command_does_not_have():
    known = {command.name: command for command in (cli, *commands(cli).values())}
    answers = tomllib.loads(ANSWERS.read_text(encoding="utf-8"))
    assert sum(map(len, answers.values())) > 100
    for name in answers.keys() - {"any"}:
        taken = {opt for one in known[name].params for opt in one.opts}
        assert not taken & {f"--{option}" for option in answers[name]}, name


def test_a_misspelt_option_is_answered_without_those_that_were_removed():
    group = NamedGroup("skinmap", commands={"sweep": sweep})
    result = CliRunner().invoke(group, ["sweep", "--bakend", "2"])
    assert result.output.splitlines()[-1] == "Error: No such option '--bakend'."
    assert "Did you mean '--jobs'?" in CliRunner().invoke(group, ["sweep", "--job", "2"]).output


@pytest.mark.parametrize("name", ["touch", "wrap"])
def test_the_former_name_of_a_calibration_is_the_same_command(name):
    result = CliRunner().invoke(calibrate, [name, "--layout", "a.csv"])
    assert result.exit_code == 2
    assert "Missing option '--mesh'" in result.output


def test_the_former_name_is_not_listed():
    assert (
        " touch " not in CliRunner().invoke(calibrate, ["--help"]).output.partition("Commands:")[2]
    )
