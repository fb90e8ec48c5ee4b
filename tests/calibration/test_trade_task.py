"""The trade task `calibrate`: planted truth, and knobs that do what they say."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from calibration.patch.solver_budget import Effort
from calibration.trade_task import MAX_MODULES, CalibrateTask, calibrate_task
from skinmap.errors import InvalidArrayError
from skinmap.profile import KNOBS
from skinmap.trade.task import defaults, tasks


@pytest.fixture(scope="module")
def prepared():
    return calibrate_task.prepare(skinmap.load_robot("icub"), ("left_hand",), seed=3)


def test_calibrate_task_is_found_by_its_name():
    assert isinstance(tasks.get("calibrate"), CalibrateTask)
    names = {knob.name for knob in calibrate_task.knobs}
    assert names == set(KNOBS["calibrate"])
    for setting in calibrate_task.settings():
        assert all(KNOBS["calibrate"][name].allows(value) for name, value in setting.items())
    assert calibrate_task.settings()[0] == defaults(calibrate_task.knobs)


def test_prepare_plants_anchors_on_boards_that_keep_their_lengths(prepared):
    (one, *_) = prepared
    assert len(np.unique(one.taxels)) == len(one.points) >= 3
    # Noise of 1 mm a coordinate: 5 sd in three coordinates.
    assert np.linalg.norm(one.points - one.truth[one.taxels], axis=1).max() < 9e-3
    near = np.linalg.norm(one.layout[:, None] - one.layout, axis=2)
    far = np.linalg.norm(one.truth[:, None] - one.truth, axis=2)
    close = (near > 0) & (near < 8e-3)
    # Flat maps of real patches strain by 7.5 % at most, and a chord is shorter than its arc.
    assert np.abs(far[close] / near[close] - 1.0).max() < 0.15
    robot = skinmap.load_robot("icub")
    assert len(one.layout) <= 12 * MAX_MODULES <= len(robot.skin("torso"))
    again = calibrate_task.prepare(robot, ("left_hand",), seed=3)
    np.testing.assert_array_equal(again[0].points, one.points)


def test_run_errs_by_millimetres_and_the_same_each_time(prepared):
    quick = {"starts": 1, "steps": 3, "wrap_detail_mm": 8.0}
    outcome = calibrate_task.run(prepared, quick, seed=3)
    # Five anchors off by 1 mm: a wrong minimum would be off by more than a pitch, 6.5 mm.
    assert 0.05 < outcome.error < 5.0
    assert outcome.seconds > 0
    assert calibrate_task.run(prepared, quick, seed=3).error == outcome.error


@pytest.mark.parametrize(
    ("how", "message"),
    [({"starts": 0}, "starts"), ({"steps": 0}, "steps"), ({"detail": 1e-5}, "detail of a wrap")],
)
def test_effort_refuses_nothing_at_all(how, message):
    with pytest.raises(InvalidArrayError, match=message):
        Effort(**how)
