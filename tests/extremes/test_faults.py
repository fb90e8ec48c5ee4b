"""Disks without room, commands that are stopped, names that are code: a few of `make soak`."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.reliability import full_disk, stops
from benchmarks.reliability.soak import by_hand
from skinmap.cli.main import cli

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "robot"
NASTY = "<img src=x onerror=alert(1)>\\u001b[31m"


@pytest.mark.parametrize("command", ["export csv", "export urdf", "export mjcf"])
def test_a_disk_without_room_is_one_line_and_leaves_nothing(tmp_path, command):
    found = full_disk.refuse(command, tmp_path)
    assert found["fault"] == ""
    assert "File too large" in found["said"]


def test_the_judge_of_full_disks_sees_a_result_that_was_written(tmp_path):
    assert "no line" in full_disk.refuse("export csv", tmp_path, room=10**9)["fault"]


@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM"])
def test_a_command_that_is_stopped_says_so_and_leaves_nothing(tmp_path, kind):
    words = "simulate kaspar --per-gesture 1000 -o OUT.npz"  # minutes of work
    assert stops.stop(words, tmp_path / "out", Path(), kind) == ("under_way", "")
    assert not list(tmp_path.iterdir())


def test_the_judge_of_stops_sees_a_command_that_does_not_listen(tmp_path, monkeypatch):
    monkeypatch.setattr(stops.os, "killpg", lambda *_: None)
    monkeypatch.setattr(stops, "LATE", 0.0)
    _, fault = stops.stop(stops.COMMANDS["simulate"], tmp_path / "out", Path(), "SIGINT")
    assert fault.startswith("went on for")


def test_the_judge_of_stops_sees_a_folder_that_lacks_a_file(tmp_path):
    (tmp_path / "report.html").touch()
    (tmp_path / ".skinmap-part").mkdir()
    (tmp_path / ".skinmap-part" / "map.png").touch()
    assert stops.names_of(tmp_path) == {"report.html"}
    assert stops.opens(tmp_path, frozenset({"report.html"}))
    assert not stops.opens(tmp_path, frozenset({"report.html", "map.png"}))


def test_commands_that_are_stopped_listen_where_this_program_does_not(tmp_path):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        words = "simulate kaspar --per-gesture 1000 -o OUT.npz"
        assert stops.stop(words, tmp_path / "out", Path(), "SIGINT")[1] == ""
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_folder_that_becomes_read_only_is_one_line(tmp_path):
    end, fault = stops.stop(stops.COMMANDS["simulate"], tmp_path / "out", Path(), stops.LOCK)
    assert (end, fault) == ("refused", "")


def test_the_judge_of_locked_folders_sees_one_that_is_not_locked(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "chmod", lambda *_: None)
    assert stops.stop(stops.COMMANDS["simulate"], tmp_path / "out", Path(), stops.LOCK) == (
        "done",
        "",
    )


@pytest.mark.filterwarnings("ignore:Glyph 27")  # of the font that a picture is drawn with
@pytest.mark.parametrize("place", ["[robot]", "[[part]]"])
def test_names_that_are_code_are_shown_as_text(tmp_path, place):
    for path in EXAMPLE.iterdir():
        text = path.read_text()
        if path.suffix == ".toml":
            head, mark, rest = text.partition(place)
            text = head + mark + rest.replace('name = "', f'name = "{NASTY}', 1)
        (tmp_path / path.name).write_text(text)
    ran = CliRunner().invoke(cli, ["inspect", str(tmp_path / "robot.toml")])
    assert ran.exit_code == 0
    assert "\x1b" not in ran.output
    words = ["flatten", str(tmp_path / "robot.toml"), "-o", str(tmp_path / "out")]
    ran = CliRunner().invoke(cli, words)
    assert ran.exit_code == 0
    assert "\x1b" not in ran.output
    assert not [path for path in (tmp_path / "out").iterdir() if set(path.name) & set("<>\x1b")]
    assert "<img src=x" not in (tmp_path / "out" / "report.html").read_text()


def test_names_of_files_that_are_code_are_shown_as_text(tmp_path):
    board = ROOT / "docs" / "examples" / "board"
    nasty = "<img src=x onerror=alert(1)>"
    for kind in ("board.csv", "link.stl", "anchors.csv"):
        (tmp_path / f"{nasty}{kind}").write_bytes((board / kind).read_bytes())
    words = [f"--layout={tmp_path}/{nasty}board.csv", f"--mesh={tmp_path}/{nasty}link.stl"]
    words += [f"--anchors={tmp_path}/{nasty}anchors.csv", "-o", str(tmp_path / "out")]
    ran = CliRunner().invoke(cli, ["calibrate", "wrap", *words])
    assert ran.exit_code == 0, ran.output
    assert "<img src=x" not in (tmp_path / "out" / "report.html").read_text()


def test_all_that_a_page_is_made_of_shows_code_as_text():
    from skinmap.report import page

    nasty = "<img src=x onerror=alert(1)>"
    pieces = [page.heading(nasty), page.note(nasty), page.paragraph(nasty), page.bullets([nasty]),
              page.cards([(nasty, nasty)])]  # fmt: skip
    assert "<img src=x" not in page.page(nasty, pieces)
    assert "<img src=x" not in page.lines_page(nasty, [nasty])


def test_tests_that_the_page_names_exist():
    rows = [line for line in by_hand().splitlines() if line.startswith("| ") and "`tests/" in line]
    assert len(rows) > 20
    for row in rows:
        folder = Path("tests")
        for name in re.findall(r"`([\w/]+\.py)`", row):
            path = Path(name)
            folder = path.parent if len(path.parts) > 1 else folder
            assert (ROOT / folder / path.name).exists() or list(
                (ROOT / "tests").rglob(path.name)
            ), name


def test_damage_is_the_same_in_each_run():
    from benchmarks.reliability.cuts import damaged

    first, again = (damaged(b"abcdef", 9, rng=np.random.default_rng(3)) for _ in range(2))
    assert first == again
    assert len(first) == 18
