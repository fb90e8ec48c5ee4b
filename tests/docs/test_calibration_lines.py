"""Every line of the documents that calibrates runs as it stands, on files of the repository."""

from __future__ import annotations

import csv
import importlib.util
import json
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli

ROOT = Path(__file__).parents[2]
BOARD = ROOT / "docs" / "examples" / "board"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), BOARD / "README.md"]
LINE = re.compile(r"^    skinmap ((?:calibrate|anchors|checkup) .*)$", re.MULTILINE)
EXTRAS = {"calibrate scan": "open3d"}


def lines() -> list[tuple[Path, str]]:
    """Each line once, with the folder that it is to be run in."""
    found: dict[str, Path] = {}
    for page in PAGES:
        for line in LINE.findall(page.read_text(encoding="utf-8")):
            words = line.split("#")[0].strip()
            found.setdefault(words, BOARD if page.parent == BOARD else ROOT)
    return [(folder, words) for words, folder in found.items()]


def test_every_kind_of_calibration_has_a_line():
    kinds = {" ".join(words.split()[:2]) for _, words in lines() if words.startswith("calibrate")}
    group = cli.get_command(None, "calibrate")
    assert kinds == {f"calibrate {name}" for name in group.list_commands(None)}


@pytest.fixture(scope="module")
def chamber(tmp_path_factory) -> Path:
    """The calibration of loads that those of rest renew."""
    folder = tmp_path_factory.mktemp("chamber") / "load"
    evidence = str(ROOT / "docs" / "examples" / "load" / "chamber.npz")
    result = CliRunner().invoke(cli, ["calibrate", "load", evidence, "-o", str(folder)])
    assert result.exit_code == 0, result.output
    return folder


@pytest.mark.parametrize(("folder", "words"), lines(), ids=lambda value: str(value)[:90])
def test_line_runs(folder, words, chamber, tmp_path, monkeypatch):
    kind = " ".join(words.split()[:2])
    if kind in EXTRAS and importlib.util.find_spec(EXTRAS[kind]) is None:
        pytest.skip(f"{kind} needs the extra that brings {EXTRAS[kind]}")
    monkeypatch.chdir(folder)
    args = shlex.split(words)
    for place, word in enumerate(args[:-1]):
        if word in ("-o", "--out", "--resume"):
            args[place + 1] = str(tmp_path / Path(args[place + 1]).name)
    if "--window" in args:
        from skinmap.display import require_opengl

        require_opengl()
        place = args.index("--window")
        shown = not args[place + 1].startswith("-")  # a picture; else a window: its picture instead
        args[place : place + 1 + shown] = ["--window", str(tmp_path / "anchors.png")]
        if "--anchors" not in args:
            args += ["--anchors", str(BOARD / "anchors.csv")]
    if kind == "calibrate rest":  # its -o is a calibration that is there
        shutil.copytree(chamber, tmp_path / "load")
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == wanted(words), (words, result.output, result.exception)


def wanted(words: str) -> int:
    """3 where the example is one of what goes wrong."""
    return 3 if "_wrong" in words or ("board_back" in words and "--mirror" not in words) else 0


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The example as its script makes it today."""
    spec = importlib.util.spec_from_file_location("make_board", BOARD / "make.py")
    module = importlib.util.module_from_spec(spec)
    before = list(sys.path)
    spec.loader.exec_module(module)
    sys.path[:] = before
    folder = tmp_path_factory.mktemp("board")
    module.main(folder)
    return folder


def test_example_is_what_its_script_makes(made):
    names = {path.name for path in made.iterdir()}
    assert names <= {path.name for path in BOARD.iterdir()}
    for path in made.glob("*.csv"):
        new, kept = (table(folder / path.name) for folder in (made, BOARD))
        assert new[0] == kept[0]
        if path.name == "patches.csv":
            assert new == kept
            continue
        numbers = [np.array(rows[1:], float) for rows in (new, kept)]
        # Micrometres, whose last digit may round the other way on another machine.
        np.testing.assert_allclose(*numbers, rtol=0, atol=2e-6, err_msg=path.name)


def table(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def places(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as file:
        return {row["channel"]: np.array([float(row[k]) for k in "xyz"])
                for row in csv.DictReader(file)}  # fmt: skip


@pytest.mark.parametrize("evidence", ["anchors", "touches"])
def test_example_is_placed_where_its_truth_is(tmp_path, evidence):
    how = ["wrap", "--anchors"] if evidence == "anchors" else ["wrap", "--touches"]
    result = CliRunner().invoke(cli, [
        "calibrate", how[0], "--layout", str(BOARD / "board.csv"), "--mesh",
        str(BOARD / "link.stl"), how[1], str(BOARD / f"{evidence}.csv"), "-o", str(tmp_path / "o"),
        "--json",
    ])  # fmt: skip
    told = json.loads(result.stdout)
    assert told["status"] == "ok"
    assert not told["mirrored"]
    found, truth = places(tmp_path / "o" / "taxels.csv"), places(BOARD / "truth.csv")
    assert found.keys() == truth.keys()
    error = 1e3 * np.array([np.linalg.norm(found[name] - truth[name]) for name in truth])
    assert np.median(error) < 1.2  # six anchors, or 24 touches, of 1 mm
    # The predicted error is that of a typical board; this one may be 2.5 times better or worse.
    assert 0.4 < np.median(error) / told["predicted_mm"]["median"] < 2.5
