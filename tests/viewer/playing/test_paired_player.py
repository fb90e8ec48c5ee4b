"""Two players in step: no picture, no clock in any assertion."""

from __future__ import annotations

import threading

import pytest

from tests.viewer.playing.test_player import RecordedLoop, number, until
from viewer.playing.overview import PairedPlayer, in_step
from viewer.playing.player import Player


@pytest.fixture
def pair():
    left, right = (
        PairedPlayer(RecordedLoop(200), paused=True),
        PairedPlayer(RecordedLoop(150), paused=True),
    )
    in_step(left, right)
    with left, right:
        for one in (left, right):
            until(one, lambda one=one: one.moment is not None)
        yield left, right


def test_what_one_is_asked_for_both_do(pair):
    left, right = pair
    assert right.seek(1.0)
    for one in pair:
        until(one, lambda one=one: number(one.moment) == 50)
    assert left.step(3)
    for one in pair:
        until(one, lambda one=one: number(one.moment) == 53)
    right.speed, left.loop = 4.0, True
    assert (left.speed, right.speed, left.loop, right.loop) == (4.0, 4.0, True, True)


def test_a_pause_brings_both_to_one_time_and_the_longer_goes_on_alone(pair):
    left, right = pair
    left.play()
    until(right, lambda: right.ended)
    until(left, lambda: left.ended)
    left.seek(3.6)  # behind the end of the right one
    left.pause()
    until(left, lambda: number(left.moment) == 180)
    until(right, lambda: number(right.moment) == 149)
    left.play()
    until(left, lambda: left.ended)
    assert number(left.moment) == 199
    assert number(right.moment) == 149, "it stays at its end"


def test_play_right_after_a_jump_from_the_end_does_not_wait_for_the_other_one(pair, monkeypatch):
    """The other one had ended, and is still on its way when both are let go on."""
    left, right = pair
    left.play()
    until(right, lambda: right.ended)
    until(left, lambda: left.ended)
    lead, held = right._lead, threading.Event()
    monkeypatch.setattr(right, "_lead", lambda goal: held.wait(60.0) and lead(goal))
    left.pause()
    left.seek(3.6)
    until(left, lambda: number(left.moment) == 180)
    left.play()
    held.set()
    until(left, lambda: left.ended)
    assert (number(left.moment), number(right.moment)) == (199, 149)


def test_a_later_one_begins_and_stays_later():
    left, right = (
        PairedPlayer(RecordedLoop(200), paused=True),
        PairedPlayer(RecordedLoop(200), paused=True),
    )
    for one in (left, right):
        one._origin = 100.0  # known of a recording before its first sample
    in_step(left, right, later=0.4)
    with left, right:
        until(right, lambda: right.moment is not None and number(right.moment) == 20)
        right.seek(2.0)
        until(left, lambda: left.moment is not None and number(left.moment) == 80)
        left.seek(2.0)
        until(right, lambda: number(right.moment) == 120)


def test_no_sample_is_lost_between_a_pause_and_a_step():
    """A sample that comes while the player is paused is the next one to be shown."""

    class Slow(RecordedLoop):
        paused_by: Player | None = None

        def step(self, timeout):
            found = super().step(timeout)
            if found is not None and number(found) == 5 and self.paused_by is not None:
                self.paused_by, player = None, self.paused_by
                player.pause()
            return found

    loop = Slow()
    player = Player(loop)
    loop.paused_by = player
    with player:
        until(player, lambda: player.paused)
        shown = number(player.moment)
        assert shown == 4
        assert player.step(1)
        until(player, lambda: number(player.moment) == shown + 1)
