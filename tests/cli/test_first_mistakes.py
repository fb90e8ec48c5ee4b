"""Mistakes of the first hour: exit code 2 or 3, and one line that names what came and what fits."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli, main

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
# The command, in a folder with a recording `t.npz`, a text `words.txt` and the example robot; words
# of the answer.
MISTAKES = {
    "inspect icbu": "did you mean 'icub'",
    "inspect robot/robot.urdf": "a URDF where a manifest (.toml) is expected",
    "inspect nothing.toml": "no file 'nothing.toml'",
    "inspect words.txt": "words.txt",
    "inspect kaspar --part nose": "no part 'nose'",
    "inspect kaspar --colour red": "--colour",
    "inspct kaspar": "did you mean 'inspect'",
    "flatten kaspar --part torso --method fastest -o m": "no flattening method 'fastest'",
    "flatten kaspar --part torso -o words.txt": "words.txt",
    "structures kaspar --part torso --radius-mm wide -o s": "wide",
    "structures kaspar --part torso --radius-mm -1 -o s": "-1",
    "simulate kaspar --gesture stab": "no gesture 'stab'",
    "simulate kaspar --per-gesture 0": "--per-gesture",
    "simulate kaspar --per-gesture many": "many",
    "simulate kaspar --seed -1": "--seed",
    "simulate kaspar -o t.docx": "docx",
    "train": "Missing argument",
    "train nothing.npz": "no file 'nothing.npz'",
    "train words.txt": "a mapping",
    "train t.npz": "training needs two labels",
    "train t.npz --classifier oracle": "no classifier 'oracle'",
    "classify nothing.skinmodel t.npz": "nothing.skinmodel",
    "classify t.npz m.skinmodel": "the model comes first",
    "classify words.txt t.npz": "words.txt",
    "classify zmq:nowhere": "expected PORT or HOST:PORT",
    "evaluate nothing.npz": "no file 'nothing.npz'",
    "evaluate --protocol paper": "'paper'; the protocols",
    "evaluate --protocol kaspar --seeds 1e3": "1e3",
    "record sim": "Missing option '-o' / '--out'",
    "record sim -o words.txt": "ending in '.txt'",
    "record sim -o r.npz": ".npz",
    "record moon:1 -o r.mcap": "moon:1",
    "record sim -o r.mcap --seconds -3": "-3",
    "merge t.npz": "Missing option '-o' / '--out'",
    "merge t.npz -o t.npz": "t.npz",
    "label nothing.mcap -o n.mcap": "nothing.mcap",
    "label t.npz": "name the new recording",
    "info nothing.mcap": "nothing.mcap",
    "info words.txt": "words.txt",
    "info robot/robot.urdf": "robot.urdf",
    "export kaspar --part torso --format paper -o e": "'paper' is not one of",
    "export icbu --part torso -o e.csv": "did you mean 'icub'",
    "replay nothing.mcap": "nothing.mcap",
    "view icbu --screenshot a.png": "did you mean 'icub'",
    "view kaspar --screenshot a.docx": "docx",
    "view kaspar --layer colour --screenshot a.png": "no layer 'colour'",
    "trade kaspar --part nose -o t": "no part 'nose'",
    "list colours": "no kind of names 'colours'",
    "cache drop": "no command 'drop'",
    "calibrate wrp": "did you mean 'wrap'",
    "calibrate wrap --layout no.csv --mesh no.stl --anchors no.csv -o w": "no.csv",
    "calibrate touch --layout words.txt --mesh no.stl --touches no.csv -o w": "words.txt",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import shutil

    folder = tmp_path_factory.mktemp("mistakes")
    shutil.copytree(EXAMPLES / "robot", folder / "robot")
    (folder / "words.txt").write_text("these are words\n")
    words = "simulate kaspar --part torso --gesture poke --per-gesture 2 -o t.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = CliRunner().invoke(cli, shlex.split(words))
    assert done.exit_code == 0, done.output
    return folder


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake_gets_one_line(mistake, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.argv", ["skinmap", *shlex.split(mistake)])
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    with pytest.raises(SystemExit) as end:
        main()
    printed = capsys.readouterr()
    assert end.value.code in (2, 3), printed
    (line,) = [one for one in printed.err.splitlines() if one.strip()]
    assert line.startswith("Error: ")
    assert MISTAKES[mistake] in line
    assert printed.out == ""
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
