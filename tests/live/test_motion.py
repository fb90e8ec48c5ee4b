from __future__ import annotations

import numpy as np
import pytest

from skinmap.cli.evaluate.protocol_simulated import stroke_errors
from skinmap.live.contacts.contact_motion import MotionBook, RolledWay, heading, recorded_course
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.contacts.touch_history import TouchBook
from skinmap.live.robot_skin import JoinedSkin
from skinmap.recognition.descriptors import recorded_touches
from skinmap.touch.contacts.motion_features import presses
from skinmap.touch.simulation.simulator import simulate

SPACING = 5e-3


def followed(places: np.ndarray, normals: np.ndarray, rate: float = 50.0) -> RolledWay:
    way = RolledWay(SPACING)
    for k, (place, normal) in enumerate(zip(places.tolist(), normals.tolist(), strict=True)):
        way.add(k / rate, tuple(place), tuple(normal), 1.0)
    return way


def test_velocity_of_an_even_stroke_is_exact():
    t = np.arange(40) / 50.0
    places = np.outer(t, [0.06, -0.08, 0.0])
    velocity, error = followed(places, np.tile([0.0, 0, 1], (40, 1))).velocity()
    np.testing.assert_allclose(velocity, [0.06, -0.08, 0.0], atol=1e-9)
    assert 0 < error < 0.03


def test_a_stroke_round_a_limb_keeps_its_speed_and_turns_with_the_skin():
    t = np.arange(60) / 50.0
    angle = 0.1 / 0.04 * t  # 100 mm/s round a limb of 40 mm
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    way = followed(0.04 * normals, normals)
    velocity, _ = way.velocity()
    assert np.linalg.norm(velocity) == pytest.approx(0.1, rel=5e-3)
    ahead = np.array([-np.sin(angle[-1]), np.cos(angle[-1]), 0.0])
    assert velocity @ ahead > 0.99 * np.linalg.norm(velocity)
    assert way.length == pytest.approx(0.1 * t[-1], rel=5e-3)
    assert way.speed == pytest.approx(0.1, rel=5e-3)


def test_a_contact_that_jumps_makes_no_speed():
    places = np.zeros((40, 3))
    places[20:, 0] = 0.05
    way = followed(places, np.tile([0.0, 0, 1], (40, 1)))
    assert way.length == 0.0
    assert np.linalg.norm(way.velocity()[0]) < 1e-9


def test_headings_are_words_of_the_part():
    assert heading(0.1, 0.02, 0.1, 0.01) == "up"
    assert heading(-0.1, 0.02, 0.1, 0.01) == "down"
    assert heading(0.01, 0.1, 0.1, 0.01) == "round right"
    assert heading(0.01, -0.1, 0.1, 0.01) == "round left"
    assert heading(0.1, 0.0, 0.1, 0.11) == "still"  # no more than its error


@pytest.fixture(scope="module")
def hand(prepared):
    return prepared("left_forearm")


def test_up_is_what_the_robot_at_rest_has_up(hand):
    book = MotionBook(JoinedSkin({"left_forearm": hand}))
    for normal in hand.skin.normals[::40]:
        up, right = book._axes_at(0, tuple(normal.tolist()))
        assert np.dot(up, normal) == pytest.approx(0.0, abs=1e-9)
        # Who looks at the skin has the normal towards them: right, up and normal are right-handed.
        np.testing.assert_allclose(np.cross(right, up), normal, atol=1e-9)


def test_strokes_are_followed_within_the_asked_errors(hand):
    made = simulate(hand.skin, rng=21, gestures=["stroke"], per_gesture=10)
    errors = stroke_errors(hand, made)
    assert len(errors) >= 6
    assert np.median([abs(one.speed) for one in errors]) <= 0.15
    assert np.median([one.direction for one in errors]) <= 15.0
    # The control: the same strokes against the truth of the next ones.
    wrong = type(made)(
        made.part, made.times, made.pressures, made.events, made.labels, made.subjects,
        motions=tuple(_at(made, event) for event in range(len(made.labels))),
    )  # fmt: skip
    assert np.nanmedian([one.direction for one in stroke_errors(hand, wrong)]) > 30.0


def test_a_recorded_stroke_has_the_heading_of_its_truth(hand):
    made = simulate(hand.skin, rng=21, gestures=["stroke"], per_gesture=8)
    book = MotionBook(JoinedSkin({"left_forearm": hand}))
    away, back = [], []
    for touch, truth in zip(recorded_touches(hand, made), made.motions, strict=True):
        away_from = np.linalg.norm(hand.skin.positions - truth.places[0], axis=1)
        normal = hand.skin.normals[np.argmin(away_from)]
        axes = [np.array(one) for one in book._axes_at(0, tuple(normal.tolist()))]
        way = np.array([axis @ (truth.places[-1] - truth.places[0]) for axis in axes])
        course = recorded_course(book, touch.samples, touch.rate)
        turned = recorded_course(book, touch.samples[::-1], touch.rate)
        found = np.array([course.up, course.right])
        away.append(found @ way / np.linalg.norm(found) / np.linalg.norm(way))
        back.append(np.array([turned.up, turned.right]) @ found / np.linalg.norm(found) ** 2)
        assert course.heading != "still"
    # Up is not the same all the way round the arm: the whole way is judged by its half-plane.
    assert np.median(away) > np.cos(np.radians(30.0))
    assert np.median(back) < -0.8  # the control: played backwards it goes back


def test_a_recorded_touch_that_stays_is_still(hand):
    made = simulate(hand.skin, rng=2, gestures=["hold"], per_gesture=2)
    book = MotionBook(JoinedSkin({"left_forearm": hand}))
    for touch in recorded_touches(hand, made):
        assert recorded_course(book, touch.samples, touch.rate).heading == "still"
    nothing = np.zeros((0, len(hand.skin)), np.uint8)
    assert recorded_course(book, nothing, 50.0).heading == "still"


def test_a_press_that_leaves_off_for_a_sample_has_a_course(hand):
    """One touch of 12,000 had such a gap: an IndexError."""
    made = simulate(hand.skin, rng=2, gestures=["hold"], per_gesture=1)
    samples = recorded_touches(hand, made)[0].samples.copy()
    samples[len(samples) // 2] = 0
    book = MotionBook(JoinedSkin({"left_forearm": hand}))
    assert len(presses(samples.sum(axis=1).astype(float), made.rate)) == 1
    assert recorded_course(book, samples, made.rate).heading == "still"


def _at(made, event):
    """The truth of another stroke, at the times of this one."""
    own, other = made.motions[event], made.motions[(event + 1) % len(made.motions)]
    share = np.linspace(0.0, 1.0, len(own.times))
    old = np.linspace(0.0, 1.0, len(other.times))
    places = np.column_stack([np.interp(share, old, one) for one in other.places.T])
    return type(own)(own.onsets, own.ends, own.times, places)


def played(hand, pressed: list[tuple[float, float, int]], seconds: float):
    """Presses (from, to, taxel) of a skin, taken through contacts and touches."""
    joined = JoinedSkin({"left_forearm": hand})
    tracker, book = ContactTracker(joined), TouchBook(joined)
    near = np.linalg.norm(hand.skin.positions[:, None] - hand.skin.positions[None], axis=2)
    for k in range(round(50 * seconds)):
        now, sample = k / 50.0, np.zeros(len(joined))
        for begin, end, taxel in pressed:
            if begin <= now < end:
                sample[near[taxel] < 8e-3] = 100.0
        tracker.update(now, sample)
        book.update(tracker.tracks, None, tracker.swallowed, time=now, pressures=sample)
    tracker.forget()
    book.update([])
    return list(book.ended)


def test_three_taps_are_one_touch_with_its_rhythm(hand):
    (one,) = played(hand, [(0.1, 0.2, 9), (0.5, 0.6, 9), (0.9, 1.0, 9)], 2.0)
    assert one.presses == 3
    assert one.period == pytest.approx(0.4)
    assert (one.began, one.heading) == (pytest.approx(0.1), "still")


def test_taps_far_apart_in_time_are_touches_of_their_own(hand):
    assert [one.presses for one in played(hand, [(0.1, 0.2, 9), (1.0, 1.1, 9)], 2.0)] == [1, 1]


def test_a_long_press_after_a_tap_is_no_second_tap(hand):
    first, second = played(hand, [(0.1, 0.2, 9), (0.5, 1.8, 9)], 2.5)
    assert (first.presses, second.presses) == (1, 1)
    assert first.ended < 0.25
    assert second.began == pytest.approx(0.5)


def test_a_held_touch_is_still(hand):
    (one,) = played(hand, [(0.1, 1.5, 9)], 2.0)
    assert (one.heading, one.speed, one.presses) == ("still", 0.0, 1)
