"""Drift: held presses keep their value, free baselines follow, nothing touches by itself."""

import numpy as np
import pytest

from calibration.response import DriftTracker, ResponseCalibration

RATE, MINUTES, N, HELD = 10.0, 10.0, 40, 6
PRESS = 80.0


def ten_minutes(walk: np.ndarray, rng, *, noise=1.2, base=100.0):
    """Samples at rest, and ten minutes in which the first taxels are held and baselines walk."""
    t = len(walk)
    press = np.zeros_like(walk)
    press[100:-100, :HELD] = PRESS
    samples = np.rint(base + walk + press + rng.normal(0, noise, walk.shape))
    return np.rint(base + rng.normal(0, noise, (100, walk.shape[1]))), samples, t


def walks(kind: str, rng) -> np.ndarray:
    """Baselines (t, n) that end 20 counts from where they began."""
    t = int(RATE * 60 * MINUTES)
    ramp = np.linspace(0.0, 20.0, t)[:, None]
    free = (np.arange(N) >= HELD).astype(float)
    return {
        "free baselines rise": ramp * free,
        "free baselines fall": -ramp * free,
        "all rise": ramp * np.ones(N),
        "all fall": -ramp * np.ones(N),
        "each its own way": ramp * free * rng.choice([-1.0, 1.0], N),
        "up and down": 20 * np.sin(np.linspace(0, 2 * np.pi, t))[:, None] * np.ones(N),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "sign"),
    [
        ("free baselines rise", 1),
        ("free baselines fall", -1),
        ("all rise", -1),
        ("all fall", 1),
        ("each its own way", 1),
        ("up and down", 1),
    ],
)
def test_a_press_held_for_ten_minutes_keeps_its_value(rng, kind, sign):
    rest, samples, _ = ten_minutes(walks(kind, rng), rng)
    if sign < 0:
        rest, samples = 255 - rest, 255 - samples
    response = ResponseCalibration.fit(rest, rate=RATE, sign=sign)
    pressure = response.apply(samples)
    for stretch in (slice(120, 620), slice(2500, 3000), slice(-620, -120)):
        kept = pressure[stretch, :HELD].mean() / PRESS
        assert 0.95 < kept < 1.05
    assert (pressure[:, HELD:] > 0).mean() < 1e-3
    assert (pressure[-90:, :HELD] > 0).mean() < 1e-2  # and lets go


def test_a_module_drifts_by_itself(rng):
    """Half the modules warm up; a held taxel of a cold one must not follow them."""
    modules = np.arange(N) % 4
    walk = np.linspace(0, 20, 6000)[:, None] * (modules < 2)
    rest, samples, _ = ten_minutes(walk, rng)
    response = ResponseCalibration.fit(rest, rate=RATE, modules=modules)
    kept = response.apply(samples)[-620:-120, :HELD].mean(axis=0) / PRESS
    np.testing.assert_allclose(kept, 1.0, rtol=0, atol=0.05)  # the 95 %


def test_thermal_channels_tell_the_drift_of_a_module_that_is_pressed_all_over(rng):
    """Two modules: all tactile channels of the first are held and warm, the second stays cold."""
    modules = np.repeat([0, 1], 12)
    thermal = np.arange(24) % 12 >= 10
    warm = np.linspace(0, 20, 6000)[:, None] * (modules == 0)
    press = np.zeros_like(warm)
    press[100:-100, (modules == 0) & ~thermal] = PRESS
    rest = np.rint(100 + rng.normal(0, 1.2, (100, 24)))
    samples = np.rint(100 + warm + press + rng.normal(0, 1.2, warm.shape))
    held = np.flatnonzero((modules == 0) & ~thermal)
    kept = {}
    for name, flags in (("with", thermal), ("without", None)):
        response = ResponseCalibration.fit(rest, rate=RATE, modules=modules, thermal=flags)
        pressure = response.apply(samples)
        kept[name] = pressure[-620:-120, held].mean() / PRESS
        if flags is not None:
            assert (pressure[:, thermal] == 0).all()
    assert 0.97 < kept["with"] < 1.03
    assert kept["without"] > 1.15  # two unflagged channels are too few to speak for a module


def test_blocks_give_what_the_whole_gives(rng):
    rest, samples, _ = ten_minutes(walks("all rise", rng)[:2000], rng)
    response = ResponseCalibration.fit(rest, rate=RATE)
    tracker = response.track()
    pieces = [response.apply(part, tracker=tracker) for part in np.split(samples, [7, 500, 501])]
    np.testing.assert_array_equal(np.concatenate(pieces), response.apply(samples))


def test_a_free_baseline_follows(rng):
    """At a steady rate the reading lags by rate times the time constant, closed form."""
    slope = 0.2  # counts/s
    ramp = slope * np.arange(1200)[:, None] / RATE * np.ones(3)
    tracker = DriftTracker(np.zeros(3), np.full(3, 6.0), 1, RATE)
    lag = tracker.apply(ramp)[-1]
    share = 1.0 / RATE / 2.5
    np.testing.assert_allclose(lag, slope / RATE * (1 - share) / share, rtol=1e-6)


def test_what_is_left_after_a_long_press_is_drift(rng):
    """A taxel that drifted alone under a press is calm again at its new baseline."""
    samples = np.full((6000, 5), 100.0)
    samples[100:5000, 0] += PRESS + np.linspace(0, 15, 4900)
    samples[5000:, 0] += 15
    tracker = DriftTracker(np.full(5, 100.0), np.full(5, 6.0), 1, RATE)
    out = tracker.apply(samples)
    assert out[4990, 0] > PRESS  # alone, so nothing says that it is drift
    assert np.abs(out[5001:, 0]).max() < 6.0


def test_a_partial_release_is_still_a_press():
    samples = np.full((3000, 5), 100.0)
    samples[100:1000, 0] += 100
    samples[1000:, 0] += 40
    tracker = DriftTracker(np.full(5, 100.0), np.full(5, 6.0), 1, RATE)
    np.testing.assert_allclose(tracker.apply(samples)[2900:, 0], 40.0, rtol=0, atol=0.5)


def test_dead_channels_do_not_speak_for_the_drift_of_others(rng):
    """Half of the free channels stand still; the rest warm up with the held ones."""
    walk = np.linspace(0, 20, 6000)[:, None] * np.ones(N)
    rest, samples, _ = ten_minutes(walk, rng)
    still = np.arange(N) >= HELD + (N - HELD) // 2
    samples[:, still] = rest[np.arange(6000) % len(rest)][:, still]
    kept = {}
    for name, health in (("known", "dead"), ("unknown", "ok")):
        fitted = ResponseCalibration.fit(rest, rate=RATE)
        state = np.where(still, health, "ok")
        response = ResponseCalibration(
            fitted.baseline, fitted.noise, fitted.threshold, 1, state, rate=RATE
        )
        kept[name] = response.apply(samples)[-620:-120, :HELD].mean() / PRESS
    np.testing.assert_allclose(kept["known"], 1.0, rtol=0, atol=0.03)
    assert kept["unknown"] > 1.05
