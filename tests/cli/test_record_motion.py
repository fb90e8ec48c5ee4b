from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.io.mcap.reading import read_track
from skinmap.touch.simulation.simulator import simulate


def test_marks_keep_what_a_model_answers_and_data_sets_have_it(tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow (skinmap[lerobot]) is missing")
    robot = skinmap.load_robot("kaspar")
    made = simulate(robot.skin("torso"), rng=5, gestures=["whole_hand"], per_gesture=3)
    skinmap.save_recordings(made, tmp_path / "t.npz", robot=robot)
    skinmap.default_model().save(tmp_path / "m.skinmodel")
    out, again = tmp_path / "m.mcap", tmp_path / "again.mcap"
    for line in (
        ["record", str(tmp_path / "t.npz"), "--model", str(tmp_path / "m.skinmodel"),
         "-o", str(out), "--speed", "inf"],
        ["export", str(out), "-o", str(again)],
        ["export", str(out), "--format", "lerobot", "-o", str(tmp_path / "d")],
    ):  # fmt: skip
        found = CliRunner().invoke(cli, line)
        assert found.exit_code == 0, found.output
    marks = read_track(out).touches
    assert marks
    for mark in marks:
        assert set(mark.answers) == {"kind", "motion", "hand"}
        assert mark.answers["kind"]["answer"] in mark.answers["kind"]["set"]
    assert read_track(again).touches == marks
    told = json.loads((tmp_path / "d/meta/skin.json").read_text())["touches"]
    assert [{key: one[key] for key in ("kind", "motion", "hand")} for one in told] == [
        mark.answers for mark in marks
    ]
    assert [(one["first_frame"], one["last_frame"]) for one in told] == [
        (mark.first, mark.last) for mark in marks
    ]


def test_marks_that_no_model_answered_have_none(tmp_path):
    robot = skinmap.load_robot("kaspar")
    made = simulate(robot.skin("torso"), rng=5, gestures=["poke"], per_gesture=2)
    skinmap.save_recordings(made, tmp_path / "t.npz", robot=robot)
    line = ["record", str(tmp_path / "t.npz"), "-o", str(tmp_path / "t.mcap"), "--label", "poke"]
    found = CliRunner().invoke(cli, [*line, "--speed", "inf"])
    assert found.exit_code == 0, found.output
    marks = read_track(tmp_path / "t.mcap").touches
    assert marks
    assert all(mark.answers is None for mark in marks)
