"""Touched sets of both simulators: the same pieces under the same forces, and a control."""

import numpy as np
import pytest

from benchmarks.classify.physics import carried, compare, flat_bodies
from skinmap import load_robot
from skinmap.physics.bodies import PRESSERS
from skinmap.physics.variants import find_variant


def test_pieces_of_a_hand_carry_what_the_springs_below_them_do() -> None:
    rng = np.random.default_rng(0)
    presser = PRESSERS["whole_hand"](rng, 1.0, find_variant("foam"))
    bodies = flat_bodies(presser, 2e7)
    assert len(bodies) == 4 + 4 * 3 + 2  # pads of the palm, phalanges of fingers and thumb
    middles = np.array([body.middle for body in bodies])
    lost = np.array([[np.nan, np.nan]])  # where the map does not reach
    found = carried(bodies, np.concatenate([middles, lost]), np.full(len(bodies) + 1, 0.5))
    assert sum(body.force for body in found) == pytest.approx(0.5 * len(bodies))
    few = carried(bodies, middles[-1:], np.array([3.0]))
    assert [body.force for body in few] == [3.0]
    assert np.allclose(few[0].middle, middles[-1])


def test_same_pieces_touch_the_same_taxels_and_pieces_laid_beside_do_not() -> None:
    pytest.importorskip("mujoco")
    skin = load_robot("kaspar").skin("torso")
    rng = np.random.default_rng(1)
    rows = compare(skin, variant="foam", touches=3, gestures=("poke", "full_finger"), rng=rng)
    assert len(rows) == 6
    assert np.median([row["iou"] for row in rows]) >= 0.6
    assert np.median([row["beside"] for row in rows]) <= 0.2
