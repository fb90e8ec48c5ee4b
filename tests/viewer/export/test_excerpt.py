"""A short list of moments out of many."""

from __future__ import annotations

import numpy as np

from skinmap.live.contacts.named_touch import Moment
from viewer.playing.recent_moments import Excerpt


def test_excerpt_is_spread_over_all_that_passed():
    excerpt = Excerpt(most=20)
    passed = [Moment(0.02 * k, {}) for k in range(3000)]
    assert list(excerpt.watch(passed)) == passed
    times = np.array([moment.time for moment in excerpt.moments])
    assert 10 <= len(times) <= 20
    assert times[0] == 0
    assert times[-1] > 0.85 * passed[-1].time
    # Moments come every 0.02 s, so each is kept that much late at most.
    assert np.ptp(np.diff(times)) <= 0.02 + 1e-9


def test_around_puts_the_chosen_moment_in_its_place():
    excerpt = Excerpt()
    for k in range(5):
        excerpt.add(Moment(float(k), {}))
    chosen = Moment(2.5, {})
    played, now = excerpt.around(chosen)
    assert played[now] is chosen
    assert [moment.time for moment in played] == [0.0, 1.0, 2.0, 2.5, 3.0, 4.0]
    again, now = excerpt.around(excerpt.moments[3])
    assert ([moment.time for moment in again], now) == ([0.0, 1.0, 2.0, 3.0, 4.0], 3)


def test_around_nothing_is_nothing():
    assert Excerpt().around(None) == ([], None)
    assert Excerpt().around(Moment(1.0, {})) == ([], None)
