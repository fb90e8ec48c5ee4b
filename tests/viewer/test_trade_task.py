"""The trade task `view`: errors are against the richest picture, which has none."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.knobs import KNOBS
from skinmap.trade.task import defaults, tasks
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


def test_the_richest_picture_has_no_error_and_a_poorer_one_has():
    prepared = view_task.prepare(skinmap.load_robot("baxter-forearm"), ("forearm",), seed=0)
    richest = view_task.run(prepared, defaults(view_task.knobs), seed=0)
    bare = view_task.run(prepared, {"style": "surface", "links": "none"}, seed=0)
    assert richest.error == 0.0
    assert richest.seconds > 0
    # The body covers a share of the picture and is darker than what is behind it.
    assert 0.5 < bare.error < 50.0
