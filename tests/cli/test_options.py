"""Options mean the same in all commands; a recording knows its robot; what is wrong is one line."""

from __future__ import annotations

import json
import shutil
import sys
from contextlib import nullcontext
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli import main as program
from skinmap.cli.main import cli
from skinmap.io.text import UNITS
from viewer.layers import LAYERS

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "robot"


def run(*words: object):
    return CliRunner().invoke(cli, [str(word) for word in words])


@pytest.fixture(scope="module")
def own(tmp_path_factory) -> Path:
    """A robot of the user's own, with touches on its skin in both formats."""
    folder = tmp_path_factory.mktemp("own")
    shutil.copytree(EXAMPLE, folder / "robot")
    for name in ("t.npz", "t.mcap"):
        words = ["simulate", folder / "robot" / "robot.toml", "--per-gesture", 8]
        words += ["--gesture", "poke", "--gesture", "full_finger", "-o", folder / name]
        assert run(*words).exit_code == 0
    return folder


@pytest.mark.parametrize("name", ["t.npz", "t.mcap"])
def test_a_recording_knows_its_robot(own, name, tmp_path):
    (recording,) = skinmap.load_recordings(own / name)
    assert recording.robot == str(own / "robot" / "robot.toml")
    model = tmp_path / "m.skinmodel"
    trained = run("train", own / name, "-o", model, "--json")
    assert trained.exit_code == 0, trained.exception
    named = run("classify", model, own / name, "--json")
    assert named.exit_code == 0, named.exception
    assert json.loads(named.stdout)["events"] == len(recording.labels)
    arrays = tmp_path / "arrays.npz"
    assert run("export", own / name, "-o", arrays).exit_code == 0
    assert skinmap.load_recordings(arrays)[0].robot == recording.robot
    (tmp_path / "m.txt").write_bytes(model.read_bytes())  # holds no robot: the recording is asked
    named = run("classify", tmp_path / "m.txt", own / name, "--json")
    assert named.exit_code == 0, named.exception
    error = str(run("classify", model, own / name, "--robot", "icub").exception)
    assert "the recording has parts forearm; iCub has none of them: name its robot" in error
    error = str(run("record", "sim", "--part", "forearm", "-o", tmp_path / "r.mcap").exception)
    assert "no part 'forearm' of icub, the default robot (--robot names another)" in error
    error = str(run("train", own / name, "-o", tmp_path / "new.txt").exception)
    assert "the only format is .skinmodel" in error
    other = run("train", own / name, "-o", model, "--robot", "icub")
    assert isinstance(other.exception, skinmap.UnknownNameError)
    assert "no part 'forearm'" in str(other.exception)


def test_a_built_in_robot_is_known_too(tmp_path):
    path = tmp_path / "t.mcap"
    skinmap.record("sim", path, seconds=0.1, robot="icub")
    assert {one.robot for one in skinmap.load_recordings(path)} == {"icub"}


def test_a_robot_that_is_gone_is_named(own, tmp_path):
    moved = tmp_path / "moved"
    shutil.copytree(EXAMPLE, moved)
    path = tmp_path / "t.npz"
    assert run("simulate", moved / "robot.toml", "--per-gesture", 1, "-o", path).exit_code == 0
    shutil.rmtree(moved)
    error = run("train", path, "-o", tmp_path / "m.skinmodel").exception
    assert isinstance(error, skinmap.MissingFileError)
    assert "--robot" in str(error)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("robots",), {"icub", "kaspar", "baxter-forearm", "ur10e-cyskin"}),
        (("parts", "kaspar"), {"torso", "left_hand"}),
        (("classifiers",), {"contact-geometry", "histogram"}),
        (("methods",), {"balanced", "auto"}),
        (("kinds",), {"full_finger", "three_finger", "whole_hand"}),
        (("gestures",), {"poke", "squeeze", "hand", "time"}),
        (("sources",), {"sim", "lsl"}),
        (("layers",), set(LAYERS)),
    ],
)
def test_list_names_what_commands_take(words, expected):
    names = json.loads(run("list", *words, "--json").stdout)["names"]
    assert expected <= set(names)
    lines = run("list", *words).stdout.splitlines()
    assert [line.split()[0] for line in lines] == names
    assert all(len(line.split()) > 1 for line in lines)  # with a line on each


def test_list_of_an_unknown_kind_names_the_kinds():
    error = run("list", "layer").exception
    assert "did you mean 'layers'? The kinds are: robots, parts" in str(error)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "kaspar", "--seed", "-1"), "'--seed'"),
        (("structures", "kaspar", "--radius-mm", "1e9"), "in 0.1..1000, or auto, got '1e9'"),
        (("record", "sim", "-o", "x.mcap", "--seconds", "nan"), "'nan' is not a number"),
        (("view", "--at", "-1"), "-1.0 is not in the range 0<=x<="),
        (("view", "--seconds", "nan"), "'nan' is not a number"),
        (("view", "--speed", "0"), "0.0 is not in the range 0<x<="),
        (("flatten", "kaspar", "--max-distortion", "4"), "4.0 is not in the range 4<x<="),
        (("flatten", "kaspar", "--max-distortion", "nan"), "'nan' is not a number"),
        (("classify", "sim", "--span-mm", "9"), "--span-mm was removed: a spread hand is 200 mm"),
        (("replay", "x.mcap", "--speed", "-inf"), "-inf is not in the range 0<x<=1e+06 or inf"),
        (("simulate", "kaspar", "--fault", "bits=9"), "9 is not in the range 1<=x<=8"),
        (("evaluate", "--seed", "4000000001"), "0<=x<=4000000000"),
        (("view", "kaspar", "--html", "p.png"), "files ending in '.png'"),
        (
            ("inspect", "kaspar", "--module", "nan"),
            "--module is for bare tables; kaspar",
        ),
        (("calibrate", "wrap", "--window", "p.html"), "files ending in '.html'"),
        (
            ("view", "--screenshot", "p.foo"),
            "files ending in '.foo'; the formats are",
        ),
        (("flatten", "--methd", "arap"), "--method"),
        (("flatten", "kaspar", "--method"), "requires an argument"),
        (("train",), "Missing argument"),
        (("--verbose", "list", "robots"), "--verbose was removed: write --debug"),
    ],
)
def test_a_wrong_option_is_one_line_and_exit_2(words, said, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["skinmap", *words])
    monkeypatch.setattr(program, "interruptible", lambda: nullcontext([]))
    with pytest.raises(SystemExit) as stop:
        program.main()
    assert stop.value.code == 2
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert line.startswith("Error: ")
    assert said in line
    assert out == ""


def test_quiet_leaves_warnings_out(tmp_path, monkeypatch, capsys):
    def warned(*before: str) -> str:
        monkeypatch.setattr(sys, "argv", ["skinmap", *before, "list", "robots"])
        program.main.__globals__["cli"].main([*before, "list", "robots"], standalone_mode=False)
        import warnings

        warnings.showwarning("careful", UserWarning, "f", 1)
        return capsys.readouterr().err

    import warnings

    monkeypatch.setattr(warnings, "showwarning", program._warn)
    assert "careful" in warned()
    assert warned("--quiet") == ""


def commands(group: click.Group, above: str = "") -> dict[str, click.Command]:
    """Every command by the words that call it, those of groups too."""
    found = {}
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            found |= commands(command, f"{above}{name} ")
        else:
            found[above + name] = command
    return found


def named(option: str) -> dict[str, click.Option]:
    """The option of that name of each command that has it."""
    return {
        words: one
        for words, command in commands(cli).items()
        for one in command.params
        if option in one.opts
    }


@pytest.mark.parametrize(
    ("option", "metavar", "begins", "fewest"),
    [
        ("--part", "PART", "Only this part of the robot", 15),
        ("--units", None, "Unit of lengths in ", 4),
        ("--robot", "ROBOT", "Robot ", 10),
        ("--publish", "SPEC", "", 3),
        ("--response", "[PART=]FILE", "Response calibration of a part ", 2),
        ("--force", None, "Replace files that are there.", 3),
        ("--seed", None, "Seed of all randomness.", 5),
        ("--json", None, "Print one JSON object.", 20),
    ],
)
def test_an_option_means_and_looks_the_same_in_all_commands(option, metavar, begins, fewest):
    found = named(option)
    assert len(found) >= fewest
    for words, one in found.items():
        assert one.metavar == metavar, words
        assert (one.help or "").startswith(begins), words


def test_units_are_one_set_with_one_default():
    for words, one in named("--units").items():
        assert tuple(one.type.choices) == tuple(UNITS), words
        assert one.default == "m" or words == "new", words  # which finds the unit itself


def test_out_is_one_option_in_all_commands():
    found = named("--out")
    assert len(found) >= 15
    assert all(one.opts == ["-o", "--out"] for one in found.values())
    assert not named("--output")


def test_recordings_are_called_so_in_all_commands():
    for words, command in commands(cli).items():
        for one in command.params:
            if isinstance(one, click.Argument) and one.name.startswith("recording"):
                shown = one.make_metavar(click.Context(command)).strip("[].")
                assert shown == "RECORDING", words
