from __future__ import annotations

import warnings

import numpy as np
import pytest

from calibration.response import ReferenceLoads, ResponseCalibration, save_response
from skinmap.errors import (
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.live.response.pressures import (
    MARGIN,
    Response,
    Responses,
    RestBaseline,
    load_responses,
)
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.skin import fingerprint

RATE = 50.0
ONE = np.zeros(20, np.int64)


def rest(rng, seconds, level=240.0, n=20):
    return np.rint(level + rng.normal(0, 1.2, (round(seconds * RATE), n)))


@pytest.mark.parametrize(("level", "sign"), [(240.0, -1), (12.0, 1)])
def test_the_sign_is_that_of_the_rest_values(rng, level, sign):
    response = RestBaseline(ONE, RATE)
    quiet = response.apply(rest(rng, 3, level))
    assert (response.sign == sign).all()
    np.testing.assert_allclose(response.baseline, level, atol=1.0)
    # 20 channels of noise with sd 1.2, at least 4 counts above its 95th percentile: 5 sd.
    assert (quiet > 0).mean() < 1e-3
    pressed = rest(rng, 0.2, level)
    pressed[:, 3] += sign * 100
    found = response.apply(pressed)
    np.testing.assert_allclose(found[:, 3], 100.0, atol=6.0)
    assert not found[:, 4:].any()


def test_a_press_of_ten_minutes_keeps_its_value(rng):
    """The incumbent with the shipped configuration erases it after 18 to 104 s."""
    response = RestBaseline(ONE, RATE)
    response.apply(rest(rng, 3))
    peaks = []
    for _ in range(60):
        block = rest(rng, 10)
        block[:, 7] -= 60
        peaks.append(response.apply(block)[:, 7].mean())
    # Its baseline stands still: the mean of 500 samples of sd 1.2 is good to 0.2 counts.
    np.testing.assert_allclose(peaks, peaks[0], atol=0.3)
    after = response.apply(rest(rng, 2))
    assert not after[5:, 7].any()


def test_free_channels_follow_drift_and_a_pressed_one_is_released(rng):
    response = RestBaseline(ONE, RATE)
    response.apply(rest(rng, 3))
    steps = 120 * RATE
    drift = np.linspace(0.0, -5.0, round(steps))[:, None]  # 0.04 counts a second
    block = rest(rng, 120) + drift
    block[:, 7] -= 60
    found = response.apply(block)
    assert (found[:, :7] > 0).mean() < 1e-3
    assert (found[:, 7] > 50).all()
    let_go = response.apply(rest(rng, 5) - 5.0)
    assert not let_go[10:, 7].any()


def test_a_channel_that_is_touched_at_first_speaks_after_it_was_calm(rng):
    response = RestBaseline(ONE, RATE)
    first = rest(rng, 3)
    first[:, 5] -= rng.uniform(20, 100, len(first))
    response.apply(first)
    assert not response.ready[5]
    assert response.ready.sum() == 19
    response.apply(rest(rng, 3))
    assert response.ready.all()
    pressed = rest(rng, 0.2)
    pressed[:, 5] -= 80
    np.testing.assert_allclose(response.apply(pressed)[:, 5], 80.0, atol=6.0)


def test_noisy_channels_speak_in_the_end_and_are_reported(rng):
    n = 48
    deviation = np.linspace(0.5, 4.0, n)
    quiet = np.rint(240.0 + deviation * rng.standard_normal((round(24 * RATE), n)))
    response = RestBaseline(np.zeros(n, np.int64), RATE)
    found = response.apply(quiet)
    assert response.ready.all()
    assert response.noisy[deviation > 2.6].all()
    assert not response.noisy[deviation < 1.6].any()
    # Twice the 95th percentile and 4 counts are 4.3 standard deviations of the noisiest.
    assert (found > 0).mean() < 1e-3
    pressed = quiet[-20:] - 100.0
    assert (response.apply(pressed) > 50.0).any(axis=0).all()


def test_channels_that_wait_are_unheard_and_noisy_ones_named(prepared, rng):
    skin = prepared("left_hand")
    joined = JoinedSkin({"left_hand": skin})
    responses = Responses(joined, info_of(skin, "left_hand"))
    samples = rest(rng, 15, n=len(skin))
    samples[:, 5] += rng.normal(0.0, 4.0, len(samples))
    assert responses.states()["unheard"].all()
    responses.apply(samples[:150])
    assert np.flatnonzero(responses.states()["unheard"]).tolist() == [5]
    responses.apply(samples[150:])
    assert not responses.states()["unheard"].any()
    assert np.flatnonzero(responses.states()["noisy"]).tolist() == [5]


def test_blocks_may_be_cut_anywhere(rng):
    samples = rest(rng, 6)
    samples[200:, 2] -= 50
    whole = RestBaseline(ONE, RATE).apply(samples)
    piecewise = RestBaseline(ONE, RATE)
    cut = [piecewise.apply(part) for part in np.split(samples, [1, 77, 78, 210])]
    np.testing.assert_array_equal(np.concatenate(cut), whole)


def info_of(skin, part, kind="raw"):
    return StreamInfo("test", (part,), (len(skin),), RATE, kind)


def test_a_calibration_is_used_where_the_skin_has_one(prepared, rng):
    skin = prepared("left_hand")
    joined = JoinedSkin({"left_hand": skin})
    n = len(skin)
    calibration = ResponseCalibration.fit(rest(rng, 5, n=n), sign=-1)
    assert isinstance(calibration, Response)
    samples = rest(rng, 4, n=n)
    samples[100:, 11] -= 70
    pressures = Responses(joined, info_of(skin, "left_hand"), {"left_hand": calibration}).apply(
        samples
    )
    np.testing.assert_array_equal(pressures, calibration.apply(samples))
    # From the first sample: it has no rest to learn.
    assert pressures[100, 11] > 60


def test_a_calibration_by_loads_gives_counts(prepared, rng):
    skin = prepared("left_hand")
    n = len(skin)
    loads = np.repeat(np.linspace(0.0, 4.0, 9), 40)[:, None] * np.ones(n)
    reference = ReferenceLoads(np.rint(240.0 - 20.0 * loads), loads)
    calibration = ResponseCalibration.fit(rest(rng, 5, n=n), reference, sign=-1)
    samples = rest(rng, 1, n=n)
    samples[:, 11] -= 60
    pressures = Responses(
        JoinedSkin({"left_hand": skin}), info_of(skin, "left_hand"), {"left_hand": calibration}
    ).apply(samples)
    np.testing.assert_allclose(pressures[:, 11], 60.0, atol=6.0)


@pytest.mark.parametrize(("rate", "told"), [(1000.0, True), (51.0, False), (0.0, False)])
def test_a_calibration_follows_drift_at_the_rate_of_the_stream(prepared, rng, rate, told):
    """Calibrated at 50 Hz; a slow press, 12.5 counts a second, is felt on a stream of 1 kHz."""
    skin = prepared("left_hand")
    n = len(skin)
    calibration = ResponseCalibration.fit(rest(rng, 5, n=n), sign=-1)
    info = StreamInfo("test", ("left_hand",), (n,), rate, "raw")
    joined = JoinedSkin({"left_hand": skin})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        responses = Responses(joined, info, {"left_hand": calibration})
    assert [SkinWarning for _ in caught] == [one.category for one in caught]
    assert bool(caught) == told
    assert not told or "calibrated at 50 samples a second, the stream has 1000" in str(
        caught[0].message
    )
    count = round(10 * (rate or RATE))
    samples = np.rint(240.0 + rng.normal(0, 1.2, (count, n)))
    samples[:, 11] -= np.minimum(np.arange(count) / (rate or RATE) * 12.5, 100.0)
    pressures = responses.apply(samples)
    np.testing.assert_allclose(pressures[-50:, 11], 100.0, atol=8.0)


def test_pressures_pass(prepared):
    skin = prepared("left_hand")
    responses = Responses(
        JoinedSkin({"left_hand": skin}), info_of(skin, "left_hand", "pressure"), None
    )
    samples = np.arange(48, dtype=np.uint8)[None]
    pressures = responses.apply(samples)
    np.testing.assert_array_equal(pressures, samples)


def test_a_calibration_of_another_skin_is_refused(prepared, rng):
    skin = prepared("left_hand")
    joined = JoinedSkin({"left_hand": skin})
    info = info_of(skin, "left_hand")
    short = ResponseCalibration.fit(rest(rng, 2), sign=-1)
    with pytest.raises(SkinMismatchError, match="'left_hand' has 20 channels, the skin has 48"):
        Responses(joined, info, {"left_hand": short})
    other = ResponseCalibration.fit(rest(rng, 2, n=48), sign=-1, fingerprint="f" * 64)
    with pytest.raises(SkinMismatchError, match="calibrated was the skin ffffffffffff"):
        Responses(joined, info, {"left_hand": other})


def test_files_find_their_part_by_its_layout(prepared, rng, tmp_path):
    skins = {part: prepared(part) for part in ("left_hand", "right_hand")}
    own = fingerprint(skins["right_hand"].skin)
    named, nameless = tmp_path / "named.npz", tmp_path / "nameless.npz"
    save_response(ResponseCalibration.fit(rest(rng, 2, n=48), fingerprint=own), named)
    save_response(ResponseCalibration.fit(rest(rng, 2, n=48)), nameless)
    assert list(load_responses([str(named)], skins)) == ["right_hand"]
    assert list(load_responses([f"left_hand={nameless}"], skins)) == ["left_hand"]
    with pytest.raises(SkinMismatchError, match=r"named\.npz: calibrated was the skin"):
        load_responses([f"left_hand={named}"], skins)
    with pytest.raises(InvalidArrayError, match="none of left_hand, right_hand"):
        load_responses([str(nameless)], skins)
    with pytest.raises(UnknownNameError, match="no part to calibrate 'head'"):
        load_responses([f"head={named}"], skins)
    with pytest.raises(MissingFileError):
        load_responses([str(tmp_path / "gone.npz")], skins)


def test_thresholds_lie_above_the_noise(rng):
    response = RestBaseline(ONE, RATE)
    response.apply(rest(rng, 3))
    assert (response.threshold >= MARGIN + 1.0).all()
    assert (response.threshold <= MARGIN + 3.0).all()
