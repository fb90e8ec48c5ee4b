from __future__ import annotations

import json

import numpy as np
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
