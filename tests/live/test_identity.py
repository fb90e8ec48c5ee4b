"""Planted touches on a flat sheet of 24 x 30 taxels, 5 mm apart: their numbers are known."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.live.contacts.contact_tracker import BRIDGE, ContactTracker
from skinmap.live.contacts.sample_contacts import SETTLED
from skinmap.live.robot_skin import JoinedSkin
from skinmap.skin.skin import skin_from_points
from skinmap.touch.prepared_skin import PreparedSkin

RATE = 50.0
PRINT = 9e-3


@pytest.fixture(scope="module")
def sheet() -> JoinedSkin:
    row, column = np.divmod(np.arange(24 * 30), 30)
    points = 5e-3 * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75), 0 * row])
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return JoinedSkin({"sheet": PreparedSkin(skin_from_points(points, up, part="sheet"))})


def press(skin, places, load=120.0):
    """Pressures (N,) of fingers at some places [m]."""
    total = np.zeros(len(skin))
    for place in places:
        away = np.linalg.norm(skin.positions[:, :2] - place, axis=1)
        total += load * np.exp(-((away / PRINT) ** 2))
    return total


def run(tracker, samples, start=0):
    """Feed samples (t, N); the numbers present in each, oldest first."""
    seen = []
    for step, sample in enumerate(samples, start):
        tracker.update(step / RATE, sample)
        seen.append([track.identity for track in tracker.present])
    return seen


def told(tracker, *kinds):
    return [(e.kind, e.identity, e.other) for e in tracker.events if e.kind in kinds]


BOTH = ("birth", "merge", "split", "end")


def test_a_stroke_is_one_contact_with_its_way(sheet):
    tracker = ContactTracker(sheet)
    x = np.linspace(0.03, 0.11, 101)  # 40 mm/s
    seen = run(tracker, [press(sheet, [(k, 0.05)]) for k in x])
    assert seen == [[0]] * 101
    (track,) = tracker.tracks
    assert track.stroke is not None
    way = track.stroke.points
    # From where it had landed to the last whole step of 2 mm.
    assert track.stroke.length == pytest.approx(0.08 - 0.8e-3 * 5, abs=3e-3)
    np.testing.assert_allclose(way[:, 1], 0.05, atol=1e-3)
    np.testing.assert_allclose(way[:, 2], 0.0, atol=1e-12)
    assert told(tracker, "motion")
    run(tracker, np.zeros((10, len(sheet))), 101)
    assert tracker.tracks == []
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("end", 0, -1)]
    assert tracker.events[-1].time == pytest.approx(100 / RATE)


def test_a_quick_stroke_without_a_common_taxel_keeps_its_number(sheet):
    """1 m/s at 50 Hz: 20 mm from sample to sample, further than its print is wide."""
    tracker = ContactTracker(sheet)
    samples = [press(sheet, [(x, 0.05)], load=20.0) for x in (0.03, 0.05, 0.07, 0.09)]
    assert run(tracker, samples) == [[0]] * 4


def test_two_at_once_far_from_each_other_have_two_numbers(sheet):
    tracker = ContactTracker(sheet)
    assert run(tracker, [press(sheet, [(0.03, 0.05), (0.1, 0.05)])] * 3) == [[0, 1]] * 3


@pytest.mark.parametrize("missing", [1, 4])
def test_short_gaps_are_bridged(sheet, missing):
    tracker = ContactTracker(sheet)
    held, nothing = press(sheet, [(0.05, 0.05)]), np.zeros(len(sheet))
    seen = run(tracker, [held] * 5 + [nothing] * missing + [held] * 5)
    assert seen == [[0]] * 5 + [[]] * missing + [[0]] * 5
    assert told(tracker, *BOTH) == [("birth", 0, -1)]


def test_long_gaps_end_a_contact(sheet):
    tracker = ContactTracker(sheet)
    held, nothing = press(sheet, [(0.05, 0.05)]), np.zeros(len(sheet))
    gap = round(BRIDGE * RATE) + 1
    seen = run(tracker, [held] * 5 + [nothing] * gap + [held])
    assert seen[-1] == [1]
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("end", 0, -1), ("birth", 1, -1)]


def test_hysteresis_holds_a_touch_at_the_threshold(sheet):
    """11 counts are active only where 13 were before."""
    tracker = ContactTracker(sheet)
    shape = press(sheet, [(0.05, 0.05)], load=1.0)
    assert run(tracker, [11 * shape]) == [[]]
    assert run(tracker, [13 * shape, 11 * shape, 13 * shape, 11 * shape], 1) == [[0]] * 4


def test_two_that_come_together_are_one_after_they_settle(sheet):
    tracker = ContactTracker(sheet)
    apart = np.concatenate([np.full(20, 0.05), np.linspace(0.05, 0.0, 30), np.zeros(20)])
    samples = [press(sheet, [(0.05, 0.05), (0.05 + gap, 0.05)]) for gap in apart]
    seen = run(tracker, samples)
    assert seen[0] == [0, 1]
    assert seen[-1] == [0]
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("birth", 1, -1), ("merge", 0, 1)]
    # While both can be told apart, they are: prints of 9 mm have a valley 18 mm from each other.
    still = [step for step, gap in enumerate(apart) if gap >= 0.018]
    assert all(seen[step] == [0, 1] for step in still)


def test_one_that_parts_is_two_after_it_settles(sheet):
    tracker = ContactTracker(sheet)
    apart = np.concatenate([np.zeros(10), np.linspace(0.0, 0.05, 30), np.full(20, 0.05)])
    samples = [
        press(sheet, [(0.05, 0.05)]) + 0.9 * press(sheet, [(0.05 + gap, 0.05)]) for gap in apart
    ]
    seen = run(tracker, samples)
    assert seen[0] == [0]
    assert seen[-1] == [0, 1]
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("split", 1, 0)]
    first = next(step for step, numbers in enumerate(seen) if len(numbers) == 2)
    index = np.flatnonzero(samples[first - 1] > 12)
    pieces = len(np.unique(tracker._components.label(index)))
    assert pieces == 2, "it was apart before it was called so"


def test_flicker_at_the_rim_makes_no_contacts(sheet, rng):
    tracker = ContactTracker(sheet)
    held = press(sheet, [(0.05, 0.05)])
    seen = run(tracker, [np.maximum(held + rng.normal(0, 1.2, len(sheet)), 0) for _ in range(500)])
    assert all(0 in numbers for numbers in seen)
    assert told(tracker, *BOTH) == [("birth", 0, -1)]


def test_a_hand_that_lands_in_pieces_is_one_contact_soon(sheet):
    tracker = ContactTracker(sheet)
    places = [(0.05 + 0.012 * k, 0.05) for k in range(3)]
    samples = [press(sheet, places, load) for load in np.linspace(12.5, 150, 12)]
    seen = run(tracker, samples)
    assert len(seen[-1]) == 1
    assert len(seen[round(SETTLED * RATE) + 2]) == 1


def test_contacts_are_connected_in_every_sample(sheet, rng):
    tracker = ContactTracker(sheet)
    for step in range(200):
        t = step / RATE
        places = [
            (0.07 + 0.03 * np.cos(2 * t + phase), 0.05 + 0.03 * np.sin(3 * t + phase))
            for phase in (0.0, 2.0, 4.0)
        ]
        sample = press(sheet, places) + rng.normal(0, 1.2, len(sheet))
        tracker.update(t, np.maximum(sample, 0.0))
        owned = np.concatenate([track.taxels for track in tracker.present])
        assert len(np.unique(owned)) == len(owned)
        for track in tracker.present:
            assert tracker._components.label(track.taxels).max() == 0


def test_taxels_of_one_that_is_over_belong_to_nobody(sheet):
    tracker = ContactTracker(sheet)
    here, there = press(sheet, [(0.04, 0.05)]), press(sheet, [(0.1, 0.05)])
    nothing = np.zeros(len(sheet))
    run(tracker, [here] * 3 + [here + there] * 3 + [there] * 20 + [nothing] * 10)
    assert tracker.tracks == []
    assert (tracker._owner == -1).all()
    assert tracker._cutter._meeting == {}


def test_two_touches_30_mm_apart_keep_their_numbers(prepared):
    """The benchmark's pairs on two parts; all 13 parts are in benchmarks/results/live.json."""
    from benchmarks.live import live as planted

    rng = np.random.default_rng(5)
    shares = []
    for part in ("left_foot", "left_forearm"):
        skin = JoinedSkin({part: prepared(part)})
        for pair in planted.pairs(skin, part, 4, rng):
            shares.append(planted.kept_share(skin, part, pair, samples=150, rng=rng))
    assert len(shares) == 8
    assert np.mean(shares) >= 0.99


def test_a_finger_whose_summit_weak_taxels_hide_keeps_its_number(sheet):
    """Two come to 20 mm; then the taxels fall from the one to the other for 0.2 s."""
    tracker = ContactTracker(sheet)
    gaps = np.linspace(0.05, 0.02, 16)
    samples = [press(sheet, [(0.05, 0.05), (0.05 + gap, 0.05)]) for gap in gaps]
    both = samples[-1]
    beyond = sheet.positions[:, 0] - 0.05
    fall = np.clip(110.0 - 2.2e3 * beyond, 13.0, None)
    hidden = np.where((beyond > 0) & (both > 12), fall, both)
    seen = run(tracker, [*samples, *[hidden] * 10, *[both] * 10])
    assert seen == [[0, 1]] * 36
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("birth", 1, -1)]


def test_a_spike_of_one_taxel_is_no_contact(sheet):
    """However high it is; with half as much all round it a light touch is felt there."""
    tracker = ContactTracker(sheet)
    spike = np.zeros(len(sheet))
    spike[[100, 400]] = 14.0, 250.0
    assert run(tracker, [spike] * 5) == [[]] * 5
    light = spike.copy()
    light[sheet.neighbours[400]] = 7.0
    assert run(tracker, [light] * 5, 5) == [[]] * 5
    light[400] = 13.0
    assert run(tracker, [light] * 5, 10) == [[0]] * 5
    assert told(tracker, *BOTH) == [("birth", 0, -1)]


def test_two_that_land_as_one_piece_are_two(sheet):
    """24 mm apart: active taxels join them, and the saddle lies at a third of the summits."""
    tracker = ContactTracker(sheet)
    both = press(sheet, [(0.05, 0.05), (0.074, 0.05)])
    index = np.flatnonzero(both > 12)
    assert tracker._components.label(index).max() == 0
    assert run(tracker, [both] * 20) == [[0, 1]] * 20
    # A finger that lies flat is a ridge: no saddle, one contact.
    flat = press(sheet, [(x, 0.05) for x in np.linspace(0.05, 0.09, 9)], load=40.0)
    assert run(ContactTracker(sheet), [flat] * 20) == [[0]] * 20


def test_one_that_gets_a_deep_saddle_is_two_once_it_stays(sheet):
    tracker = ContactTracker(sheet)
    wide = press(sheet, [(0.05, 0.05), (0.064, 0.05), (0.078, 0.05)])
    both = press(sheet, [(0.05, 0.05), (0.078, 0.05)])
    both[(both > 10) & (both < 13)] = 13.0
    seen = run(tracker, [wide] * 10 + [both] + [wide] * 40 + [both] * 40)
    assert seen[:51] == [[0]] * 51
    assert seen[-1] == [0, 1]
    assert told(tracker, *BOTH) == [("birth", 0, -1), ("split", 1, 0)]


def test_a_piece_that_a_weak_taxel_breaks_off_is_no_contact_of_its_own(sheet):
    """Of a ridge 8 taxels long the sixth reads nothing, from the beginning or for a while."""
    row = np.flatnonzero(np.abs(sheet.positions[:, 1] - 10 * 5e-3 * np.sqrt(0.75)) < 1e-6)[8:16]
    ridge = np.zeros(len(sheet))
    ridge[row] = 90.0
    broken = ridge.copy()
    broken[row[5]] = 0.0
    assert run(ContactTracker(sheet), [broken] * 20) == [[0]] * 20
    tracker = ContactTracker(sheet)
    assert run(tracker, [ridge] * 5 + [broken] * 20) == [[0]] * 25
    assert len(tracker.tracks[0].taxels) == 7
    # Further away than a finger's breadth it is something else.
    broken[row[3:7]] = 0.0
    broken[row[7] + np.arange(2)] = 90.0
    assert run(ContactTracker(sheet), [broken] * 3) == [[0, 1]] * 3


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_islands_of_a_palm_are_one_contact(sheet, rate):
    """They land one after the other and grow together, with taxels of little gain between."""
    tracker = ContactTracker(sheet)
    places = [(0.03 + 0.022 * k, 0.02 + 0.022 * m) for m in range(3) for k in range(5)]
    order = [0, 4, 10, 14, 2, 12, 5, 9, 7, 1, 3, 11, 13, 6, 8]
    seen = []
    for step in range(round(2.0 * rate)):
        landed = [places[k] for k in order[: 1 + round(step / rate / 0.02)]]
        tracker.update(step / rate, press(sheet, landed))
        seen.append(len(tracker.present))
    assert max(seen) >= 3
    assert seen[-1] == 1


def test_two_hands_that_meet_stay_two(sheet):
    """They were there at different times, so they are no islands of one palm."""
    tracker = ContactTracker(sheet)
    hand = np.array([(0.03 + 0.015 * k, 0.02 + 0.015 * m) for m in range(3) for k in range(2)])
    gaps = np.concatenate([np.full(50, 0.07), np.linspace(0.07, 0.044, 20), np.full(30, 0.044)])
    for step, gap in enumerate(gaps):
        both = np.concatenate([hand, hand + [gap, 0.0]])
        tracker.update(step / RATE, press(sheet, hand if step < 40 else both))
    index = np.concatenate([track.taxels for track in tracker.present])
    assert tracker._components.label(index).max() == 0
    assert [track.identity for track in tracker.present] == [0, 1]
