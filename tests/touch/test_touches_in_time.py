from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.geometry.point_surface import OFF, STEP, PointSurface
from skinmap.recognition.descriptors import recorded_touches
from skinmap.skin.skin import skin_from_points
from skinmap.touch.contacts.motion_features import (
    MOTION_FEATURES,
    develop,
    in_time,
    motion_features,
    presses,
    reversals,
)
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording, TrueMotion, load_recordings, save_recordings
from skinmap.touch.simulation.gestures import TIME
from skinmap.touch.simulation.moving_touches import TIME_GESTURES
from skinmap.touch.simulation.simulator import place, prepare, simulate
from skinmap.touch.simulation.variety import draw_subjects

RADIUS = 0.04


def cylinder(spacing: float = 5e-3) -> tuple[np.ndarray, np.ndarray]:
    """Points on a cylinder along z, and their normals."""
    count = round(2 * np.pi * RADIUS / spacing)
    angle, height = np.meshgrid(np.arange(count) * 2 * np.pi / count, np.arange(0, 0.15, spacing))
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1).reshape(-1, 3)
    points = RADIUS * normals
    points[:, 2] = height.ravel()
    return points, normals


@pytest.fixture(scope="module")
def limb():
    points, normals = cylinder()
    return skin_from_points(points, normals)


def test_walk_round_a_cylinder_stays_on_it_and_goes_as_far_as_it_says():
    points, normals = cylinder()
    surface = PointSurface(points, normals, 5e-3)
    start = points[len(points) // 2]
    way = surface.walk(start, np.cross([0, 0, 1.0], normals[len(points) // 2]), 0.1)
    # The taxels stand 7 degrees apart; the mean of both planes is right to the second order.
    np.testing.assert_allclose(np.hypot(*way.points[:, :2].T), RADIUS, atol=1e-4)
    assert np.ptp(way.points[:, 2]) < 1e-4
    steps = np.linalg.norm(np.diff(way.points, axis=0), axis=1)
    np.testing.assert_allclose(steps, STEP, rtol=0.01)


def test_walk_ends_where_the_skin_ends():
    points, normals = cylinder()
    way = PointSurface(points, normals, 5e-3).walk(points[0], np.array([0, 0, 1.0]), 1.0)
    assert 0.145 < way.length < 0.16


def test_walk_goes_on_beyond_the_rim_as_far_as_it_may_and_comes_back():
    points, normals = cylinder()
    surface = PointSurface(points, normals, 5e-3)
    ahead = np.array([0, 0, 1.0])
    ends = surface.walk(points[0], ahead, 1.0)
    way = surface.walk(points[0], ahead, 1.0, over=0.02)
    assert way.length == pytest.approx(ends.length + 0.02, abs=2 * STEP)
    np.testing.assert_allclose(np.hypot(*way.points[:, :2].T), RADIUS, atol=1e-3)
    back = way.back()
    np.testing.assert_array_equal(back.points[0], way.points[-1])
    assert (back.headings @ ahead < -0.99).all()


@pytest.mark.parametrize(("variety", "over"), [(1.0, False), (2.0, True)])
def test_beyond_wide_touches_that_move_come_and_go_over_the_rim(limb, variety, over):
    stage = prepare(limb, rng=np.random.default_rng(0), variety=variety)
    (person,) = draw_subjects(1, rng=np.random.default_rng(0))
    rng = np.random.default_rng(1)
    found = [place(stage, "stroke", person, rng=rng) for _ in range(40)]
    heights = [one.motion.places[:, 2] for one in found if one is not None]
    beyond = [np.maximum(-row, row - 0.145) > OFF * 5e-3 + STEP for row in heights]
    assert any(rows[0] for rows in beyond) == over
    assert any(rows[-1] for rows in beyond) == over
    assert all(rows.mean() < 0.5 for rows in beyond)


def test_a_helix_rolled_out_is_a_straight_line_of_its_length():
    t = np.linspace(0.0, 3.0, 400)
    points = np.column_stack([RADIUS * np.cos(t), RADIUS * np.sin(t), 0.02 * t])
    normals = np.column_stack([np.cos(t), np.sin(t), np.zeros_like(t)])
    plane = develop(points, normals)
    chord = np.linalg.norm(plane[-1] - plane[0])
    assert chord == pytest.approx(3.0 * np.hypot(RADIUS, 0.02), rel=1e-4)


def test_presses_have_hysteresis_and_no_short_gaps():
    load = np.array([0, 9, 10, 9, 3, 9, 1, 1, 1, 1, 9, 8, 0, 9, 0.0])
    assert presses(load, 50.0) == [(1, 6), (10, 14)]  # one sample of 20 ms is no gap
    assert presses(load, 20.0) == [(1, 6), (10, 12), (13, 14)]
    assert presses(np.zeros(4), 50.0) == []


def test_reversals_count_only_what_goes_back_far_enough():
    along = np.concatenate([np.linspace(0, 1, 9), np.linspace(1, 0, 9), np.linspace(0, 1, 9)])
    assert reversals(along, 0.5) == 2
    assert reversals(along, 1.5) == 0
    assert reversals(np.array([0, 0.1, 0, 0.1, 0, 1.0]), 0.5) == 0


def test_names_of_touches_in_time_are_those_that_are_made():
    assert tuple(TIME_GESTURES) == TIME


def test_truth_is_kept_with_a_recording(limb, tmp_path):
    made = simulate(limb, rng=3, gestures=["stroke", "tap", "poke"], per_gesture=1)
    save_recordings([made], tmp_path / "t.npz")
    (read,) = load_recordings(tmp_path / "t.npz")
    kinds = dict(zip(made.labels, made.motions, strict=True))
    assert kinds["poke"] is None
    assert len(kinds["stroke"].times) > 5
    for one, other in zip(made.motions, read.motions, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            np.testing.assert_array_equal(one.places, other.places)
            np.testing.assert_array_equal(one.onsets, other.onsets)
            assert one.speed == other.speed
    # Onsets lie where the event does.
    event = made.labels.index("tap")
    times = made.times[made.events == event]
    assert abs(kinds["tap"].onsets[0] - times[0]) < 0.03
    assert abs(kinds["tap"].ends[-1] - times[-1]) < 0.05


def test_a_recording_refuses_motions_of_other_events():
    none = np.zeros(0)
    truth = TrueMotion(none, none, none, np.zeros((0, 3)))
    with pytest.raises(InvalidArrayError, match="motions must be 0"):
        Recording("a", none, np.zeros((0, 2), np.uint8), none.astype(int), (), motions=(truth,))


def test_strokes_keep_the_speed_that_people_have(limb):
    made = simulate(limb, rng=1, gestures=["stroke"], per_gesture=12)
    speeds = np.array([one.speed for one in made.motions])
    assert (speeds > 0.019).all()
    assert (speeds < 0.31).all()
    assert speeds.max() > 2 * speeds.min()


def test_features_count_taps_and_follow_strokes(limb):
    skin = PreparedSkin(limb)
    made = simulate(limb, rng=5, gestures=["tap", "stroke", "rub", "poke"], per_gesture=6)
    column = {name: k for k, name in enumerate(MOTION_FEATURES)}
    touches = recorded_touches(skin, made)  # without stuck taxels and spikes
    rows = np.array([motion_features(skin.geometry, one.samples, one.rate) for one in touches])
    labels = np.array(made.labels)
    true = np.array([0 if one is None else len(one.onsets) for one in made.motions])
    taps = labels == "tap"
    assert (rows[taps, column["presses"]] == true[taps]).mean() >= 5 / 6
    far = labels == "stroke"
    true_way = np.array([0.0 if one is None else 1e3 * one.length for one in made.motions])
    ratio = rows[far, column["way_mm"]] / true_way[far]
    assert 0.7 < np.median(ratio) < 1.2
    assert np.median(rows[labels == "rub", column["reversals"]]) >= 2
    assert not in_time(rows[labels == "poke"]).any()
    assert in_time(rows[far]).all()
    assert (motion_features(skin.geometry, np.zeros((5, len(limb)), np.uint8), 50.0) == 0).all()


def test_features_mean_the_same_at_another_rate(limb):
    skin = PreparedSkin(limb)
    made = simulate(limb, rng=2, gestures=["rub"], per_gesture=2, variety=0.0)
    for _, _, samples in made.touches():
        fine = motion_features(skin.geometry, samples, 50.0)
        coarse = motion_features(skin.geometry, samples[::2], 25.0)
        for name in ("contact_ms", "way_mm", "reach_mm", "presses"):
            k = MOTION_FEATURES.index(name)
            assert coarse[k] == pytest.approx(fine[k], rel=0.2), name
