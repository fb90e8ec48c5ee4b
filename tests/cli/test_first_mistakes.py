"""Mistakes of the first hour: exit code 2 or 3, and one line that names what came and what fits."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli, main
from skinmap.recognition.named_classifiers import DEFAULT_FILE

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
# The command, in a folder with a recording, a model, a text, empty files, a mesh of points, and the
# examples of a robot and a board; words of the answer.
MISTAKES = {
    "inspect icbu": "did you mean 'icub'",
    "inspect robot/robot.urdf": "a URDF where a manifest (.toml), as `skinmap new",
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
    "label t.npz": "Missing option '-o'",
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
    "cache drop": "cache was removed: skinmap info shows its folder",
    "calibrate wrp": "did you mean 'wrap'",
    "calibrate wrap --layout no.csv --mesh no.stl --anchors no.csv -o w": "no.csv",
    "calibrate wrap --layout words.txt --mesh no.stl --touches no.csv -o w": "words.txt",
    # files of one kind for another
    "inspect m.skinmodel": "a model where a manifest (.toml)",
    "inspect t.npz": "a recording where a manifest (.toml)",
    "inspect board/link.stl": "a mesh where a manifest (.toml)",
    "inspect folder.csv": "'folder.csv' is a folder; expected a taxel table",
    "inspect empty.csv": "expected the header channel,module,x,y,z,nx,ny,nz",
    "inspect robot": "'robot' is a folder",
    "inspect robot/forearm.csv robot/robot.toml": "several tables, or one robot",
    "flatten points.obj -o o": "a mesh without triangles",
    "flatten t.npz -o o": "a recording where a manifest",
    "flatten robot/forearm.csv -o o": "`skinmap new ROBOT.urdf --taxels FILE",
    "flatten kaspar --part torso --meshing wild -o o": "no meshing method 'wild'",
    "flatten kaspar --part torso --sheet a.docx": "formats are: .pdf, .svg, .dxf",
    "flatten kaspar --part torso --jobs 0": "--jobs",
    "flatten kaspar --part torso --seam nowhere.txt": "no file 'nowhere.txt'",
    "flatten kaspar --part torso --compare nothing": "no flattening method 'nothing'",
    "structures t.npz": "a recording where a manifest",
    "structures kaspar --part torso --rotations 5": "'5' is not one of '1', '4', '6'",
    "simulate t.npz": "a recording where a manifest",
    "simulate kaspar --fault noise=loud": "'loud' is not a number",
    "simulate kaspar --fault rust=1": "no fault 'rust'",
    "simulate kaspar --variety huge": "no variety level 'huge'",
    "simulate kaspar --publish smoke:1": "no way to publish 'smoke'",
    "simulate kaspar --physics jelly": "no physics 'jelly'",
    "simulate kaspar --per-gesture 1e3": "'1e3' is not a valid whole number",
    "train kaspar": "no file 'kaspar'; expected a recording",
    "train m.skinmodel": "a model where a recording",
    "train robot/robot.toml": "a manifest where a recording",
    "train folder.csv": "'folder.csv' is a folder",
    "train empty.mcap": "an empty file",
    "train t.npz --part nose": "the only recorded part is torso",
    "train t.npz --groups hand": "hand=LABEL",
    "train board/rest.npy": "an array where a recording",
    "evaluate m.skinmodel": "a model where a recording",
    "evaluate t.npz --leave-out city": "'city' is not one of",
    "evaluate t.npz": "two labels",
    "evaluate --protocol kaspar --seeds 0": "--seeds",
    "classify t.npz kaspar": "a recording where a model (.skinmodel)",
    "classify kaspar": "no source 'kaspar'",
    "classify robot/robot.toml": "a manifest where a recording",
    "classify m.skinmodel nothing.npz": "no file 'nothing.npz'",
    "classify m.skinmodel": "name what it should classify",
    "classify t.npz --seconds -1": "--seconds",
    "classify sim:stab": "gestures: poke",
    "record sim -o folder.csv": "'folder.csv' is a directory",
    "record sim -o x.mcap --label ''": "a label is empty",
    "record sim -o x.mcap --part nose --seconds 1": "no part 'nose'",
    "record t.npz -o t.mcap --robot icbu": "did you mean 'icub'",
    "label m.skinmodel -o n.mcap": "a model where a recording",
    "label t.npz -o t.npz": "it is the recording; name a new file",
    "label t.npz words.txt -o n.mcap": "columns part, event",
    "merge t.npz t.npz -o all.npz": "given twice: t.npz",
    "merge t.npz m.skinmodel -o all.npz": "a model where a recording",
    "merge t.npz -o all.docx": "the recording formats are: .npz, .mcap",
    "replay m.skinmodel": "a model where a recording",
    "replay t.npz --publish nowhere": "no way to publish 'nowhere'",
    "info m.skinmodel": "a model where a recording",
    "info robot/robot.toml": "a manifest where a recording",
    "info empty.mcap": "an empty file",
    "examine m.skinmodel": "a model where a recording",
    "examine words.txt": "a header and no rows",
    "examine nothing.csv": "no file 'nothing.csv'",
    "export t.npz --format urdf -o e.urdf": "--format lerobot, rosbag2",
    "export kaspar --part torso --format csv -o e.docx": "files ending in .csv",
    "export kaspar --format csv -o e.csv": "--part chooses it",
    "export kaspar --part torso --format lerobot -o e": "kaspar is not one",
    "view m.skinmodel --screenshot a.png": "a model where a manifest",
    "view kaspar --source nothing.npz --screenshot a.png": "no file 'nothing.npz'",
    "view kaspar --movie a.png": "the formats are: .mp4, .gif",
    "view kaspar --web 99999999": "ports are 0 to 65535",
    "view kaspar --screenshot nowhere/a.png": "no folder 'nowhere'",
    "view robot/robot.urdf --screenshot a.png": "a URDF where a manifest",
    "list parts icbu": "did you mean 'icub'",
    "list": "Missing argument",
    "cache clear --kind pizza": "cache was removed",
    "new robot/robot.toml --taxels robot/forearm.csv -o n.toml": "a manifest already",
    "new robot/robot.urdf -o n.toml": "Missing option '--taxels'",
    "new robot/robot.urdf --taxels t.npz -o n.toml": "files ending in '.npz'",
    "new robot/robot.urdf --taxels robot/forearm.csv --units furlong -o n.toml": "'furlong'",
    "new robot/robot.urdf --taxels robot/forearm.csv --link nose -o n.toml": "no link 'nose'",
    "new robot/robot.urdf --taxels robot/forearm.csv -o n.json": "a manifest ends in .toml",
    "new robot/robot.urdf --taxels folder.csv -o n.toml": "'folder.csv' is a folder",
    "demo --part torso": "give two --part",
    "anchors --mesh link.stl": "write skinmap calibrate wrap --mesh link.stl --window",
    "calibrate wrap --layout board/board.csv --mesh board/link.stl -o w": "or --window",
    "calibrate wrap --layout board/board.csv --mesh robot/robot.urdf --anchors board/anchors.csv "
    "-o w": "a URDF where a mesh",
    "calibrate wrap --layout board/board.csv --mesh board/link.stl --anchors board/board.csv "
    "-o w": "expected the columns channel,x,y,z",
    "calibrate wrap --layout board/board.csv --mesh board/link.stl": "Missing option '-o'",
    "calibrate scan board/link.stl -o s": "Missing option '--mesh'",
    "calibrate plane words.txt --robot icub -o p": "not presses on a flat surface",
    "calibrate selftouch words.txt --robot icub -o p": "not a recording of self-touch",
    "calibrate wrench words.txt -o w": "not touches with wrenches",
    "calibrate response words.txt -o w": "not samples (.npy, or .npz with samples)",
    "calibrate load words.txt -o w": "is an .npz, .csv or .mcap file",
    "calibrate rest words.txt -o w": "no file 'w'",
    "calibrate batch words.txt -o b": "expected the columns name,layout,mesh,anchors",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import shutil

    folder = tmp_path_factory.mktemp("mistakes")
    for name in ("robot", "board"):
        shutil.copytree(EXAMPLES / name, folder / name)
    shutil.copy(DEFAULT_FILE, folder / "m.skinmodel")
    (folder / "folder.csv").mkdir()
    (folder / "points.obj").write_text("o points\nv 0 0 0\nv 1 0 0\n")
    for name in ("empty.csv", "empty.mcap"):
        (folder / name).touch()
    (folder / "words.txt").write_text("these are words\n")
    words = "simulate kaspar --part torso --gesture poke --per-gesture 2 -o t.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = CliRunner().invoke(cli, shlex.split(words))
    assert done.exit_code == 0, done.output
    return folder


def test_there_are_a_hundred():
    assert len(MISTAKES) >= 100


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
