"""`--profile`: commands whose options a profile sets take one; the command line wins."""

from __future__ import annotations

import json
import tomllib

import click
import pytest
from click.core import ParameterSource
from click.testing import CliRunner

from skinmap import __version__
from skinmap.cli.main import cli
from skinmap.cli.trade import every_task
from skinmap.commands.options import BESIDE
from skinmap.commands.retired import ANSWERS
from skinmap.errors import SkinError
from skinmap.profile import KNOBS, Allowed

HEAD = f'[profile]\nformat = 1\nskinmap = "{__version__}"\nrobot = "icub"\npart = "left_foot"\n'
NAMES = {"classifier": "histogram", "layer": "pressure"}


def commands() -> dict[str, click.Command]:
    """Every command that can be called, by its words."""
    found: dict[str, click.Command] = {}

    def add(group: click.Group, words: tuple[str, ...]) -> None:
        ctx = click.Context(group)
        for name in group.list_commands(ctx):
            one = group.get_command(ctx, name)
            assert one is not None
            if isinstance(one, click.Group):
                add(one, (*words, name))
            else:
                found[" ".join((*words, name))] = one

    add(cli, ())
    return found


def options_of(command: click.Command) -> dict[str, click.Parameter]:
    return {name: one for one in command.params for name in one.opts}


EVERY = commands()
TASKS = every_task()
COMMANDS = {
    words: one
    for words, one in EVERY.items()
    if "--profile" in (options := options_of(one)) and not options["--profile"].hidden
}


def value_of(name: str, allowed: Allowed) -> str | int | float:
    """A value that a profile may give a knob."""
    if allowed.names:
        return allowed.names[-1]
    if allowed.any_name:
        return NAMES[name]
    if allowed.only:
        return allowed.only[-1]
    middle = (allowed.least + min(allowed.most, allowed.least + 3)) / 2
    return int(allowed.least) if allowed.whole else middle


def full(tmp_path, changed: dict[tuple[str, str], object] | None = None):
    """A profile that sets every knob there is."""
    text = HEAD
    for task, knobs in KNOBS.items():
        text += f"\n[{task}]\n"
        for name, allowed in knobs.items():
            value = (changed or {}).get((task, name), value_of(name, allowed))
            text += f"{name} = {json.dumps(value)}\n"
        text += f'\n[{task}.predicted]\nseconds = 0.1\nerror = 1.0\nunit = "mm"\n'
    path = tmp_path / "full.toml"
    path.write_text(text)
    return path


def test_all_commands_are_looked_at():
    assert {"flatten", "train"} <= set(COMMANDS)
    assert not {"trade", "list", "record", "classify", "info"} & set(COMMANDS)


@pytest.mark.parametrize("words", COMMANDS)
def test_a_profile_is_read_before_anything_else(words, tmp_path):
    path = str(full(tmp_path))
    result = CliRunner().invoke(cli, [*words.split(), "--profile", path, "--help"])
    assert result.exit_code == 0, result.output
    # A wrong one is refused before anything else is asked for.
    with pytest.raises(SkinError, match="expected a profile"):
        CliRunner().invoke(
            cli, [*words.split(), "--profile", str(tmp_path / "no.toml")], catch_exceptions=False
        )


@pytest.mark.parametrize("words", COMMANDS)
def test_every_command_can_use_what_it_takes(words, tmp_path):
    command = COMMANDS[words]
    path = str(full(tmp_path))
    with click.Context(command) as ctx:
        profile = options_of(command)["--profile"]
        profile.process_value(ctx, path)
        assert ctx.default_map, f"no knob of a profile sets an option of skinmap {words}"
        for option in command.params:
            if option.name in (ctx.default_map or {}):
                value, source = option.consume_value(ctx, {})
                assert source is ParameterSource.DEFAULT_MAP
                option.process_value(ctx, value)  # raises where the type refuses it


def test_every_knob_is_an_option_somewhere_or_the_answer_to_one():
    options = {name for command in COMMANDS.values() for name in options_of(command)}
    answers = tomllib.loads(ANSWERS.read_text(encoding="utf-8"))
    options |= {f"--{name}" for words in COMMANDS for name in answers.get(words, ())}
    knobs = {name for table in KNOBS.values() for name in table}
    assert not {f"--{name.replace('_', '-')}" for name in knobs} - options


@pytest.mark.parametrize("task", TASKS)
def test_every_knob_of_a_task_may_stand_in_a_profile_and_its_values_too(task):
    measured = TASKS[task]
    assert {knob.name for knob in measured.knobs} <= set(KNOBS[task])
    settings = measured.settings()
    for knob in measured.knobs:  # each is measured at two values, one of which may be left unsaid
        values = {setting.get(knob.name) for setting in settings}
        assert len(values) >= 2, knob.name
    for name, value in {(n, v) for setting in settings for n, v in setting.items()}:
        assert KNOBS[task][name].allows(value), (name, value)


# What a user's profile says, and the parameters of the commands that obey it.
CHOSEN = """
[flatten]
meshing = "fast"
method = "slim"
iterations = 3
[classify]
classifier = "histogram"
radius_mm = 6.5
words = 4
rotations = 1
distance = "geodesic"
"""


@pytest.mark.parametrize(
    ("words", "given", "table"),
    [
        ("flatten", "icub", "flatten"),
        ("train", "recording.npz", "classify"),
    ],
)
def test_the_settings_of_a_profile_reach_the_command(words, given, table, tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(HEAD + CHOSEN)
    arguments = [*given.format(f=path).split(), "--profile", str(path)]
    wanted = tomllib.loads(CHOSEN)[table]
    with COMMANDS[words].make_context(words, arguments) as ctx:
        given = ctx.params | ctx.meta[BESIDE]
        found = {name: given[name] for name in wanted}
    # Options may be words; numbers are read by the command.
    assert {n: str(v) for n, v in found.items()} == {n: str(v) for n, v in wanted.items()}


@pytest.mark.parametrize("command", ["flatten kaspar", "structures kaspar"])
def test_a_profile_of_another_robot_is_taken_with_a_warning(command, tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(HEAD + '[flatten]\nmethod = "fast"\n')
    words = [*command.split(), "--part", "right_hand", "--profile", str(path), "--json"]
    found = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert json.loads(found.stdout)["profile"]["file"] == str(path)
    said = [line for line in found.stderr.splitlines() if line.startswith("Warning: ")]
    assert said == [
        "Warning: the profile was measured on icub, this is kaspar: times and errors may differ "
        "from those predicted"
    ]


def test_the_command_line_wins_over_the_profile(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(HEAD + '[flatten]\nmethod = "tutte"\nmeshing = "fast"\n')
    words = ["flatten", "--part", "left_foot", "--profile", str(path), "--json"]
    taken = CliRunner().invoke(cli, words, catch_exceptions=False)
    result = json.loads(taken.stdout)
    assert (result["method"], result["meshing"]) == ("tutte", "fast")
    assert result["profile"] == {
        "file": str(path), "took": {"method": "tutte", "meshing": "fast"},
    }  # fmt: skip
    # Progress ends with an empty line where it was wiped away.
    said = f"profile {path} (icub left_foot): method tutte, meshing fast"
    assert taken.stderr.splitlines()[0] == said
    won = CliRunner().invoke(cli, [*words, "--method", "lscm"], catch_exceptions=False)
    result = json.loads(won.stdout)
    assert (result["method"], result["meshing"]) == ("lscm", "fast")
    assert result["profile"]["took"] == {"meshing": "fast"}
    assert won.stderr.splitlines()[0].endswith(": meshing fast; given here: method")


def test_numbers_of_a_profile_reach_options_of_words(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(HEAD + "[classify]\nradius_mm = 7\nrotations = 4\n")
    words = ["structures", "--part", "left_foot", "--profile", str(path), "--json"]
    result = json.loads(CliRunner().invoke(cli, words, catch_exceptions=False).stdout)
    assert (result["radius_mm"], result["rotations"]) == (7.0, 4)


def test_a_command_without_knobs_refuses_a_profile(tmp_path):
    words = ["inspect", "--part", "left_foot", "--profile", str(full(tmp_path))]
    found = CliRunner().invoke(cli, words)
    assert found.exit_code == 2
    assert "--profile was removed: a profile holds no setting of this command" in found.output


def test_what_trade_writes_is_read_back(tmp_path):
    from skinmap.cli.trade import profile_text
    from skinmap.profile import read_profile
    from skinmap.trade.measuring import Recommended, TradeResult

    for name in TASKS:
        for setting in TASKS[name].settings():  # all that can be recommended
            best = Recommended(
                setting=dict(setting), seconds=0.125, error=1.5, unit=TASKS[name].unit, why=""
            )
            result = TradeResult(
                robot="icub", parts=["torso", "left_arm"], seed=0, seeds=3, tasks=[], points=[],
                recommended={name: best}, failed=[], profile=None,
            )  # fmt: skip
            path = tmp_path / "p.toml"
            path.write_text(profile_text(result))
            read = read_profile(path)
            assert read.settings == {name: setting}
            assert read.part == "torso,left_arm"
            told = tomllib.loads(path.read_text())[name]["predicted"]
            assert told == {"seconds": 0.125, "error": 1.5, "unit": best.unit}
