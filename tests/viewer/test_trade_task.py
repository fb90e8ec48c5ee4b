"""The trade task `view`: errors are against the richest picture, which has none."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.profile import KNOBS
from skinmap.touch.contacts import ACTIVE
from skinmap.trade.measuring import untimed
from skinmap.trade.task import tasks
from viewer import trade_task
from viewer.trade_task import ViewTask, colour_difference, view_task


def test_view_task_is_found_by_its_name():
    assert isinstance(tasks.get("view"), ViewTask)
    for setting in view_task.settings():
        assert all(KNOBS["view"][name].allows(value) for name, value in setting.items())


def test_colour_difference_is_a_share_of_full_scale():
    black, white = np.zeros((2, 3, 4, 3), np.uint8), np.full((2, 3, 4, 3), 255, np.uint8)
    assert colour_difference(black, black) == 0.0
    assert colour_difference(black, white) == 1.0
    half = np.concatenate([black[:1], white[:1]])
    assert colour_difference(half, black) == pytest.approx(np.sqrt(0.5), abs=1e-12)


@pytest.fixture
def prepared(monkeypatch):
    """Short touches on a forearm without a body, in small pictures."""
    monkeypatch.setattr(trade_task, "SIZE", (320, 240))
    monkeypatch.setattr(trade_task, "STEPS", 4)
    return view_task.prepare(skinmap.load_robot("baxter-forearm"), ("forearm",), seed=0)


def test_a_poorer_picture_has_an_error_and_the_truth_itself_none(prepared):
    with untimed():
        errors = {
            name: view_task.run(prepared, setting, seed=0).error
            for name, setting in (
                ("truth", trade_task.RICHEST),
                ("bare", {"links": "none"}),
                ("coarse", {"detail": 12.0}),
                ("seldom", {"detail": trade_task.FINE, "contour_rate": 1.0}),
            )
        }
    assert errors["truth"] == 0.0
    # Contours of 0.1 s ago change some lines and cells of 12 pixels the body's edges; a body left
    # out is more of the picture than either.
    assert 0.0 < errors["seldom"] < errors["bare"]
    assert 0.0 < errors["coarse"] < errors["bare"] < 50.0


def test_every_moment_has_a_touch_that_lies_where_it_is_felt(prepared):
    assert len(prepared.moments) == 4 * trade_task.STEPS
    times = [moment.time for moment in prepared.moments]
    assert times == sorted(times)
    for moment in prepared.moments:
        [touch] = moment.touches
        values = moment.pressures["forearm"]
        assert values[touch.taxels].min() >= ACTIVE > np.delete(values, touch.taxels).max()
