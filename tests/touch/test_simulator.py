from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.skin.skin import skin_from_points
from skinmap.touch.recording import Recording, load_recordings, save_recordings
from skinmap.touch.simulation.gestures import FOUR, Pad
from skinmap.touch.simulation.simulator import (
    NOISE,
    RATE,
    Stage,
    prepare,
    simulate,
    touch_loads,
)
from skinmap.touch.simulation.variety import Sensing, Sensors


@pytest.fixture
def plate(hexagons):
    """A flat skin of 168 taxels."""
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    return skin_from_points(points, np.tile([0.0, 0, 1], (len(points), 1)))


def test_pad_depth_of_a_capsule():
    pad = Pad((0.0, 0.0), (2.0, 0.0), 1.0, 1.0)
    points = np.array([[1.0, 0], [1, 0.5], [1, 1], [3, 0], [-2, 0]])
    np.testing.assert_allclose(pad.depth(points), [1, 0.5, 0, 0, -1], atol=1e-12)


def test_touch_loads_fall_off_with_distance(plate, rng):
    stage = prepare(plate, rng=rng)
    uv = np.column_stack([np.linspace(0, 0.03, 60), np.zeros(60)])
    (load,) = touch_loads(stage, [Pad((0.0, 0.0), (0.0, 0.0), 8e-3, 1.0)], uv)
    assert load[0] == pytest.approx(1.0)
    assert (np.diff(load) <= 1e-12).all()
    assert load[-1] < 1e-6


def test_touch_loads_skip_what_the_log_map_did_not_reach(plate, rng):
    uv = np.array([[0.0, 0.0], [np.nan, np.nan]])
    (load,) = touch_loads(prepare(plate, rng=rng), [Pad((0, 0), (0, 0), 1e-2, 1.0)], uv)
    assert load[1] == 0.0


def test_simulate_gives_every_gesture_equally_often(icub, rng):
    recording = simulate(icub.skin("torso"), rng=rng, per_gesture=3, variety=0.0)
    assert sorted(recording.labels) == sorted(list(FOUR) * 3)
    assert recording.pressures.dtype == np.uint8
    np.testing.assert_allclose(np.diff(recording.times), 1 / RATE, rtol=1e-9)


def test_simulate_presses_during_events_and_rests_between(icub, rng):
    recording = simulate(icub.skin("torso"), rng=rng, per_gesture=2, variety=0.0)
    rest = recording.pressures[recording.events < 0]
    # Noise of sd 1.2 counts exceeds six standard deviations once in 1e9 samples.
    assert rest.max() <= 6 * NOISE + 1
    for _, label, samples in recording.touches():
        assert samples.max() > 60, label


def test_simulate_is_the_same_for_the_same_seed(plate):
    one = simulate(
        plate, rng=np.random.default_rng(3), per_gesture=2, gestures=["poke"], variety=0.0
    )
    other = simulate(
        plate, rng=np.random.default_rng(3), per_gesture=2, gestures=["poke"], variety=0.0
    )
    np.testing.assert_array_equal(one.pressures, other.pressures)


def test_whole_hand_does_not_fit_a_palm(icub, rng):
    recording = simulate(
        icub.skin("left_hand"), rng=rng, per_gesture=2, gestures=["whole_hand"], variety=0.0
    )
    assert recording.labels == ()
    assert recording.pressures.shape == (0, 48)


def test_larger_gestures_touch_more_skin(icub, rng):
    recording = simulate(icub.skin("left_leg_upper"), rng=rng, per_gesture=6, variety=0.0)
    active = {name: [] for name in FOUR}
    for _, label, samples in recording.touches():
        active[label].append((samples > 12).any(axis=0).sum())
    poke, finger, grip, hand = (np.median(active[name]) for name in FOUR)
    assert poke < finger < hand
    assert poke < grip < hand


def test_simulate_names_the_gestures(plate, rng):
    with pytest.raises(
        UnknownNameError, match="no gesture 'slap'; the gestures are: poke, full_finger"
    ):
        simulate(plate, rng=rng, gestures=["slap"], variety=0.0)


def test_gains_differ_between_taxels(plate, rng):
    stage = prepare(plate, rng=rng)
    assert isinstance(stage, Stage)
    assert 0.1 < stage.sensors.gains.std() < 0.2


def test_recordings_come_back_as_they_were(tmp_path, plate, rng):
    one = simulate(plate, rng=rng, per_gesture=2, gestures=["poke"], variety=0.0)
    other = Recording("b", np.arange(2.0), np.zeros((2, 3), np.uint8), np.array([-1, 0]), ("x",))
    save_recordings([one, other], tmp_path / "r.npz")
    back = load_recordings(tmp_path / "r.npz")
    for before, after in zip([one, other], back, strict=True):
        assert (after.part, after.labels) == (before.part, before.labels)
        for name in ("times", "pressures", "events"):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_load_recordings_refuses_what_is_none(tmp_path, plate, rng):
    with pytest.raises(MissingFileError, match="a recording"):
        load_recordings(tmp_path / "gone.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(DataFormatError, match="not a Skinmap recording"):
        load_recordings(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(DataFormatError, match="not a Skinmap recording"):
        load_recordings(tmp_path / "other.npz")
    save_recordings([simulate(plate, rng=rng, per_gesture=1, variety=0.0)], tmp_path / "r.npz")
    whole = (tmp_path / "r.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataFormatError, match="not a Skinmap recording"):
        load_recordings(tmp_path / "cut.npz")


@pytest.mark.parametrize(
    ("times", "pressures", "events", "message"),
    [
        ([0, 1], np.zeros((2, 3)), [0, 0], "uint8"),
        ([0], np.zeros((2, 3), np.uint8), [0, 0], "must have shape"),
        ([1, 0], np.zeros((2, 3), np.uint8), [0, 0], "backwards"),
        ([0, np.nan], np.zeros((2, 3), np.uint8), [0, 0], "NaN or infinity, first in row 1"),
        ([0, 1], np.zeros((2, 3), np.uint8), [0, 1], "events must lie"),
    ],
)
def test_recording_says_what_is_wrong(times, pressures, events, message):
    with pytest.raises(InvalidArrayError, match=message):
        Recording("p", np.array(times), pressures, np.array(events), ("poke",))


def test_a_sensor_too_slow_for_a_touch_reads_without_it(prepared):
    skin = prepared("left_hand").skin
    sensors = Sensors(skin, Sensing(rate=0.5, cross_talk=0.05), rng=np.random.default_rng(0))
    assert sensors.read(np.zeros((0, len(skin))), rng=np.random.default_rng(0)).shape == (0, 48)
