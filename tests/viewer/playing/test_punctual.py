"""No picture is shown as live whose sample is older than a tenth of a second: without clocks."""

import math

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment
from viewer.playing.recent_moments import Outlet
from viewer.window import OLDEST, PATIENCE, Punctual

PERIOD = 0.02


class Screen:
    """A machine that needs so long for each picture, and a source at 50 Hz beside it."""

    def __init__(self) -> None:
        self.now = 0.0
        self.outlet, self.punctual = Outlet(lambda: self.now), Punctual()
        self.sent = -1
        self.pictures: list[tuple[float, bool, int, int]] = []  # age, marked, sample, newest then

    def send(self) -> None:
        """All samples that are due by now; each is told how late it is."""
        while (self.sent + 1) * PERIOD <= self.now:
            self.sent += 1
            due = self.sent * PERIOD
            moment = Moment(due, {}, latency=self.now - due)
            self.outlet.show(moment, fresh=True)

    def draw(self, seconds: float) -> bool:
        self.send()
        moment, newest = self.outlet.take(), self.sent
        marked = self.punctual.marked
        self.now += seconds
        self.send()  # the thread goes on meanwhile
        shown = self.punctual.shows(self.outlet.age, rate=1 / PERIOD, news=moment is not None)
        if shown and moment is not None:
            self.pictures.append(
                (self.now - moment.time, marked, round(moment.time / PERIOD), newest)
            )
        return shown


@pytest.mark.parametrize("seed", range(5))
def test_every_picture_shown_is_young_or_says_that_it_is_late(seed):
    rng = np.random.default_rng(seed)
    screen = Screen()
    for seconds in rng.exponential([0.02, 0.06, 0.1, 0.15, 0.3][seed], 300):
        screen.draw(seconds)
        screen.now += 0.005
    assert len(screen.pictures) > 50
    for age, marked, sample, newest in screen.pictures:
        assert marked or age <= OLDEST + 1e-9
        assert sample == newest, "what is drawn is always the newest there was"


def test_one_picture_that_took_too_long_is_left_out_and_nothing_is_marked():
    screen = Screen()
    shown = [screen.draw(seconds) for seconds in (0.01, 0.15, 0.01, 0.03)]
    assert shown == [True, False, True, True]
    assert (screen.punctual.held, screen.punctual.late) == (1, 0)


def test_machine_that_is_always_too_slow_shows_all_it_can_with_a_mark():
    screen = Screen()
    shown = [screen.draw(0.2) for _ in range(10)]
    assert shown == [False] * PATIENCE + [True] * (10 - PATIENCE)
    assert all(marked for _, marked, _, _ in screen.pictures)
    screen.draw(0.03)  # quick again: this one still says so, the next does not
    screen.draw(0.03)
    assert [marked for _, marked, _, _ in screen.pictures[-2:]] == [True, False]


def test_slow_source_and_halted_picture_are_not_late():
    punctual = Punctual()
    assert punctual.shows(math.nan)
    assert punctual.shows(0.3, rate=5.0, news=False), "one sample in 0.2 s: the next is due"
    assert punctual.shows(3.0, news=False), "nobody knows when the next is due"
    assert not punctual.shows(0.6, rate=5.0, news=False)
    assert not Punctual().shows(0.11, rate=5.0)
