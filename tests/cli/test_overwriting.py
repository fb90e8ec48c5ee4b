"""No file of a user is overwritten by accident: the same rule for every command that writes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import OutputError

BOARD = Path(__file__).parents[2] / "docs" / "examples" / "board"
PATCH = ("--layout", "board.csv", "--mesh", "link.stl", "--anchors", "anchors.csv")
RECORDED = b"an hour of somebody's work"
# Of each command its outputs, as words around the name of what is there already.
FILES = {
    "simulate icub -o": ("t.npz", "t.mcap", "t.csv"),
    "train {RECORDING} -o": ("c.mcap", "m.skinmodel"),
    "export icub --part torso -o": ("torso.csv",),
    "export icub --format mjcf -o": ("icub.xml",),
    "export {RECORDING} -o": ("t.h5", "t.npz", "e.mcap"),
    "examine {RECORDING} --mend": ("m.npz",),
    "record sim -o": ("t.mcap",),
    "label {RECORDING} -o": ("n.mcap",),
    "merge {RECORDING} -o": ("all.npz",),
    "view icub --screenshot": ("icub.png", "icub.glb"),
    "view icub --movie": ("icub.mp4",),
    "view icub --html": ("icub.html",),
    "calibrate wrap {PATCH} -o out --window": ("anchors.png",),
    "new ../robot/robot.urdf --taxels ../robot/forearm.csv -o": ("robot.toml",),
    "checkup wiring/pokes.mcap --part right_forearm -o": ("map.csv",),
}
FOLDERS = (
    "demo -o",
    "flatten icub -o",
    "examine {RECORDING} -o",
    "structures icub -o",
    "evaluate {RECORDING} -o",
    "trade icub --part torso -o",
    "calibrate wrap {PATCH} -o",
    "calibrate batch {RECORDING} -o",
    "calibrate selftouch {RECORDING} --robot icub -o",
    "calibrate plane {RECORDING} --robot icub -o",
    "calibrate scan {RECORDING} --mesh link.stl -o",
    "calibrate wrench {RECORDING} -o",
    "calibrate response {RECORDING} -o",
    "calibrate load {RECORDING} -o",
)
RENEWED = "calibrate rest"  # its -o is the calibration that it zeroes anew
OUTPUTS = (
    "--out",
    "--html",
    "--screenshot",
    "--movie",
    "--mend",
    "--window",
)


def call(line: str, output: Path, *more: str):
    line = line.replace("{RECORDING}", "wrench.npz").replace("{PATCH}", " ".join(PATCH))
    words = [str(BOARD / one) if (BOARD / one).is_file() else one for one in line.split()]
    return CliRunner().invoke(cli, [*words, str(output), *more])


def commands(group: click.Group, above: str = "") -> Iterator[tuple[str, click.Command]]:
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} ")
        elif command is not None:
            yield above + name, command


def test_the_tables_hold_every_output_of_every_command():
    """A new command or output has a line above, and its command takes --force."""
    lines = [line.replace(" -o", " --out") for line in (*FILES, *FOLDERS)]
    for name, command in commands(cli):
        options = {opt for one in command.params for opt in one.opts}
        outputs = [] if name == RENEWED else sorted(options & set(OUTPUTS))
        for output in outputs:
            found = [one for one in lines if one.startswith(f"{name} ") and one.endswith(output)]
            assert found, (name, output)
        assert ("--force" in options) == bool(outputs), name


@pytest.mark.parametrize(
    ("line", "name"), [(line, name) for line, names in FILES.items() for name in names]
)
def test_a_file_that_the_command_did_not_make_is_refused(tmp_path, line, name):
    there = tmp_path / name
    there.write_bytes(RECORDED)
    result = call(line, there)
    assert isinstance(result.exception, OutputError), (result.output, result.exception)
    assert str(result.exception) == f"{str(there)!r} is there already; --force replaces it"
    assert there.read_bytes() == RECORDED
    assert list(tmp_path.iterdir()) == [there]


@pytest.mark.parametrize("line", FOLDERS)
def test_a_folder_with_files_of_others_is_refused(tmp_path, line):
    there = tmp_path / "patch" / "taxels.csv"
    there.parent.mkdir()
    there.write_bytes(RECORDED)
    result = call(line, there.parent)
    assert isinstance(result.exception, OutputError), (result.output, result.exception)
    assert "'taxels.csv', which this command did not make" in str(result.exception)
    assert there.read_bytes() == RECORDED
    assert list(there.parent.iterdir()) == [there]


def export(output: Path, *more: str, part: str = "left_foot"):
    return call(f"export icub --part {part} -o", output, *more)


def test_a_command_replaces_what_it_made_as_long_as_nobody_changed_it(tmp_path):
    path = tmp_path / "foot.csv"
    assert export(path).exit_code == 0
    assert export(path, part="right_foot").exit_code == 0
    written = path.read_bytes()
    path.write_bytes(written.replace(b"channel", b"Channel"))
    assert isinstance(export(path).exception, OutputError)
    assert export(path, "--force").exit_code == 0
    assert path.read_bytes() != written
    assert export(path).exit_code == 0


def test_another_command_does_not_replace_it_and_its_mark_ends_with_it(tmp_path):
    path = tmp_path / "t.npz"
    simulated = ("--part", "left_foot", "--per-gesture", "1", "--gesture", "pat")
    assert call("simulate icub -o", path, *simulated).exit_code == 0
    assert call("simulate icub -o", path, *simulated).exit_code == 0
    refused = [call("merge {RECORDING} -o", path), call("export {RECORDING} -o", path)]
    assert all(isinstance(one.exception, OutputError) for one in refused)
    path.unlink()
    path.write_bytes(RECORDED)
    assert isinstance(call("simulate icub -o", path, *simulated).exception, OutputError)


def test_what_was_recorded_is_not_replaced_by_the_command_that_recorded_it(tmp_path):
    path = tmp_path / "t.mcap"
    words = ("--part", "left_foot", "--seconds", "0.1", "--speed", "inf")
    assert call("record sim -o", path, *words).exit_code == 0
    recorded = path.read_bytes()
    assert isinstance(call("record sim -o", path, *words).exception, OutputError)
    assert path.read_bytes() == recorded
    assert call("record sim -o", path, *words, "--force").exit_code == 0


def test_a_folder_is_written_again_by_the_command_that_made_all_of_it(tmp_path):
    out = tmp_path / "maps"
    words = ("--part", "left_foot")
    for _ in range(2):
        assert call("structures icub -o", out, *words).exit_code == 0
    assert isinstance(call("flatten icub -o", out, *words).exception, OutputError)
    (out / ".hidden").write_text("not counted")
    assert call("structures icub -o", out, *words).exit_code == 0
    (out / "notes.txt").write_text("mine")
    assert isinstance(call("structures icub -o", out, *words).exception, OutputError)
    assert call("structures icub -o", out, *words, "--force").exit_code == 0
    assert (out / "notes.txt").read_text() == "mine"


def test_without_a_place_for_notes_only_what_is_not_there_is_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file" / "below"))
    assert export(tmp_path / "foot.csv").exit_code == 0
    assert isinstance(export(tmp_path / "foot.csv").exception, OutputError)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("icub --part torso", "live.mcap"),
        ("icub --part torso --format icub", "torso.csv"),
        ("icub --part torso --format urdf", "torso"),
        ("icub --format mjcf", "icub.urdf"),
        ("{RECORDING} --format lerobot", "data.h5"),
    ],
)
def test_export_refuses_an_ending_of_another_format(tmp_path, words, name):
    result = call(f"export {words} -o", tmp_path / name)
    assert result.exit_code == 2
    assert f"{name!r}" in " ".join(result.output.split())
    assert not (tmp_path / name).exists()
