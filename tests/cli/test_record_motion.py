from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import MOTION
from skinmap.io.ros2.messages import read_text
from skinmap.touch.simulation.simulator import simulate


def test_motion_is_recorded_for_any_mcap_reader(tmp_path):
    from mcap.reader import make_reader

    robot = skinmap.load_robot("kaspar")
    made = simulate(robot.skin("left_hand"), rng=4, gestures=["stroke"], per_gesture=2)
    skinmap.save_recordings(made, tmp_path / "t.npz", robot=robot)
    out = tmp_path / "m.mcap"
    line = ["record", str(tmp_path / "t.npz"), "-o", str(out), "--label", "stroke"]
    line += ["--speed", "inf"]
    found = CliRunner().invoke(cli, line)
    assert found.exit_code == 0, found.output
    with out.open("rb") as file:
        told = [
            (message.log_time / 1e9, json.loads(read_text(message.data)))
            for _, _, message in make_reader(file).iter_messages(topics=[MOTION])
        ]
    assert len(told) > 20
    assert all(np.diff([time for time, _ in told]) > 0)
    moving = [one for _, row in told for one in row["touches"] if one["heading"] != "still"]
    assert moving
    assert {one["part"] for one in moving} == {"left_hand"}
    for one in moving:
        # Written to the micrometre a second.
        assert abs(np.linalg.norm(one["velocity_m_s"]) - one["speed_m_s"]) < 1e-5
        assert one["speed_m_s"] > one["error_m_s"]
    np.testing.assert_array_equal(read_track(out).values[:], made.pressures)  # as without motion


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
