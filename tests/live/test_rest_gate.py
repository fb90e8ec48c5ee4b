from __future__ import annotations

import numpy as np
import pytest

from skinmap.live.response.pressures import AROUND, NEVER, REST, TWICE, RestGate
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.skin_geometry import ACTIVE

RATE = 50.0
SECONDS = round(RATE)


@pytest.fixture
def joined(prepared):
    return JoinedSkin({part: prepared(part) for part in ("left_hand", "left_foot")})


def quiet(skin, seconds, seed=0, deviation=1.0):
    rng = np.random.default_rng(seed)
    return np.clip(rng.normal(0, deviation, (round(seconds * RATE), len(skin))), 0, None)


def pair(skin, taxel=30):
    return [taxel, int(skin.beside[taxel][0])]


def test_a_touch_passes_and_noise_does_not(joined):
    gate = RestGate(joined, RATE)
    samples = quiet(joined, 6, deviation=5.0)
    own = pair(joined)
    samples[4 * SECONDS : 5 * SECONDS, own] += 90
    found = np.concatenate([gate.apply(block) for block in np.array_split(samples, 40)])
    after = round((REST + 0.1) * RATE)
    touched = np.zeros(len(samples), bool)
    touched[4 * SECONDS : 5 * SECONDS] = True
    assert (found[touched][:, own] > ACTIVE).all()
    others = np.delete(found[after:], own, axis=1)
    assert (others > ACTIVE).any(axis=1).mean() < 0.02
    assert not any(rows.any() for rows in gate.states().values())


def test_blocks_of_any_size_give_the_same(joined):
    samples = quiet(joined, 5, deviation=6.0)
    samples[200:, pair(joined)] = 120
    one = RestGate(joined, RATE)
    found = np.concatenate([one.apply(row[None]) for row in samples])
    other = RestGate(joined, RATE)
    blocks = np.concatenate([other.apply(block) for block in np.array_split(samples, 50)])
    np.testing.assert_array_equal(one.rest.begins, other.rest.begins)
    # Levels change at the end of a block that fills the window: only there may they differ.
    differ = np.flatnonzero((found != blocks).any(axis=1))
    assert set((differ // 5).tolist()) <= {int(REST * RATE) // 5}


def test_what_hangs_from_the_beginning_is_never_a_touch(joined):
    samples = quiet(joined, REST + 1)
    own = pair(joined)
    samples[:, own] = 120
    gate = RestGate(joined, RATE)
    found = np.concatenate([gate.apply(block) for block in np.array_split(samples, 30)])
    assert not found[:, own].any()
    assert np.flatnonzero(gate.states()["stuck"]).tolist() == sorted(own)
    assert not gate.apply(quiet(joined, 0.1)).any()
    assert not gate.states()["stuck"].any()  # seen at rest: it is well again


def test_what_is_high_before_it_was_seen_at_rest_is_unheard(joined):
    samples = quiet(joined, 1)
    own = pair(joined)
    samples[:30, own] = 120
    samples[40:, own] = 120
    gate = RestGate(joined, RATE)
    found = gate.apply(samples[:30])
    assert not found.any()
    assert np.flatnonzero(gate.states()["unheard"]).tolist() == sorted(own)
    found = gate.apply(samples[30:])
    assert (found[10:, own] == 120).all()  # it was let go, and is a touch from now on
    assert not gate.states()["unheard"].any()


def test_a_taxel_that_reads_nothing_while_all_beside_it_are_pressed_is_dead(joined):
    beside = [row[row < len(joined)] for row in joined.beside]
    taxel = next(row for row, own in enumerate(beside) if len(own) >= AROUND)
    samples = quiet(joined, 8)
    for start in (150, 250):
        samples[start : start + 40, beside[taxel]] += 60
    well = RestGate(joined, RATE)
    well.apply(samples)
    assert not well.states()["dead"].any()
    samples[:, taxel] = 0
    gate = RestGate(joined, RATE)
    gate.apply(samples)
    assert np.flatnonzero(gate.states()["dead"]).tolist() == [taxel]


def test_a_finger_that_rests_long_stays_a_finger(joined):
    """It trembles; a taxel that was seen at rest and stands still to the count does not."""
    rng = np.random.default_rng(1)
    finger, stone = pair(joined), pair(joined, 90)
    seconds = REST * (TWICE + NEVER + 2)
    samples = quiet(joined, REST + seconds)
    start = round(REST * RATE) + 5
    shape = (len(samples) - start, 2)
    samples[start:, finger] = 100 * (1.0 + 0.05 * rng.standard_normal(shape))
    samples[start:, stone] = 100
    gate = RestGate(joined, RATE)
    found = np.concatenate([gate.apply(block) for block in np.array_split(samples, 100)])
    assert (found[-1, finger] > ACTIVE).all()
    assert not found[-1, stone].any()


@pytest.mark.parametrize(("end", "noise"), [(15.0, 0.7), (-6.0, 0.7), (15.0, 0.0), (55.0, 0.7)])
def test_levels_follow_slow_drift_and_touches_stay_what_they_are(joined, end, noise):
    rate, seconds = 10.0, 900 if end < 50 else 1500
    gate, own = RestGate(joined, rate), pair(joined)
    rng = np.random.default_rng(4)
    drift = np.linspace(max(0.0, -end), max(0.0, end), round(seconds * rate))
    samples = drift[:, None] + noise * rng.normal(size=(len(drift), len(joined)))
    pressed = slice(len(drift) - 500, len(drift) - 480)
    samples[pressed, own] += 60.0
    counts = np.clip(np.rint(samples), 0, 255).astype(np.uint8)
    found = np.concatenate([gate.apply(block) for block in np.array_split(counts, 450)])
    felt = found[pressed][:, own]
    assert np.abs(felt - (60.0 + drift[0])).max() < 4.0  # as at the beginning
    found[pressed, own] = 0
    assert not found.any()  # 15 counts of drift were touches on the whole skin
    assert not any(rows.any() for rows in gate.states().values())  # neither stuck nor noisy


def test_a_finger_that_rests_for_minutes_is_not_taken_for_drift(joined):
    rate = 10.0
    gate, own = RestGate(joined, rate), pair(joined)
    samples = np.zeros((6000, len(joined)), np.uint8)
    samples[300:, own] = 30
    samples[300::7, own] = 33  # it breathes: what stands still hangs
    found = np.concatenate([gate.apply(block) for block in np.array_split(samples, 300)])
    assert (found[300:, own] >= 30).all()


@pytest.mark.parametrize(("rise", "warmth"), [(0.3, True), (0.8, True), (2.0, False), (6.0, False)])
def test_warmth_of_a_whole_part_is_followed_and_a_slow_press_of_it_is_not(joined, rise, warmth):
    gate, rng = RestGate(joined, RATE), np.random.default_rng(5)
    gains = np.where(joined.part_of == 0, rng.normal(1, 0.3, len(joined)).clip(0.2, 2), 0.0)
    seconds = np.arange(40 * SECONDS)[:, None] / RATE
    counts = gains * rise * (np.clip(seconds - 6, 0, 20) - np.clip(seconds - 28, 0, 9))
    counts = np.clip(np.rint(counts + rng.normal(0, 1, counts.shape)), 0, 255).astype(np.uint8)
    found = np.concatenate([gate.apply(block) for block in np.array_split(counts, 400)])
    assert (not found[4 * SECONDS :].any()) == warmth
    if not warmth:  # pressed to 40 or 120 counts
        assert (found[27 * SECONDS][gains > 0.6] > 15).all()


def test_a_press_at_the_end_of_the_range_stays_there_after_the_skin_cooled(joined):
    gate = RestGate(joined, RATE)
    counts = np.full((8 * SECONDS, len(joined)), 3, np.uint8)
    counts[4 * SECONDS :] = 0
    own = pair(joined)
    counts[7 * SECONDS :, own] = 255
    found = np.concatenate([gate.apply(block) for block in np.array_split(counts, 80)])
    assert (found[7 * SECONDS + 20 :, own] == 255).all()
