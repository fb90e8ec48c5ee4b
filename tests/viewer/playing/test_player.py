"""The player by itself: no picture, no VTK, no clock in any assertion."""

from __future__ import annotations

import queue
import subprocess
import sys
import time

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.sources.source import Seekable, SourceEnded, StreamInfo
from skinmap.recognition.answers import Answer, Answers, HandAnswer
from viewer import Player
from viewer.colours import class_colour, touch_colour
from viewer.playing.recent_moments import LENGTH, MEMORY, MINUTE, History, Timeline, size, small

DEADLINE = 10.0  # far beyond what any machine needs: a test that waits so long has failed
RATE = 50.0


def moment(number: int, *, start: float = 100.0, stale: bool = False) -> Moment:
    pressures = {"arm": np.full(6, number % 256, np.uint8)}
    return Moment(start + number / RATE, pressures, stale=stale)


def number(shown: Moment | None) -> int:
    assert shown is not None
    return round((shown.time - 100.0) * RATE)


def until(player: Player, condition) -> None:
    """Wait until a condition holds, told of each change."""
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        player.wait(player.number, 0.05)


class FakeSource:
    info = StreamInfo("fake", ("arm",), (6,), RATE, clock="local")
    seekable = False


class LiveLoop:
    """A touch loop on a live source that sends what a test puts in."""

    def __init__(self) -> None:
        self.source = FakeSource()
        self.sent: queue.Queue = queue.Queue()
        self.closed = 0

    def step(self, timeout: float) -> Moment | None:
        try:
            item = self.sent.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(item, BaseException | type):
            raise item
        return item

    def close(self) -> None:
        self.closed += 1


class Recording(Seekable):
    """A recording of `count` samples that gives the next one whenever it is asked."""

    speed, loop = 1.0, False

    def __init__(self, count: int) -> None:
        super().__init__(FakeSource.info)
        self.count, self.row = count, 0
        self.sought: list[float] = []

    @property
    def duration(self) -> float:
        return self.count / RATE

    @property
    def position(self) -> float:
        return self.row / RATE

    def read(self, timeout: float):
        raise NotImplementedError

    def close(self) -> None:
        pass

    def seek(self, seconds: float) -> None:
        self.sought.append(seconds)
        self.row = round(seconds * RATE)


class RecordedLoop:
    def __init__(self, count: int = 200) -> None:
        self.source = Recording(count)
        self.closed = 0

    def step(self, timeout: float) -> Moment | None:
        source = self.source
        if source.row >= source.count:
            if not source.loop:
                raise SourceEnded
            source.row = 0
        if source.speed == 0:
            return None
        source.row += 1
        return moment(source.row - 1)

    def close(self) -> None:
        self.closed += 1


def test_player_shows_the_newest_moment_and_leaves_out_the_rest():
    loop = LiveLoop()
    for k in range(5):
        loop.sent.put(moment(k))
    with Player(loop) as player:
        until(player, lambda: player.moment is not None and number(player.moment) == 4)
        assert number(player.take()) == 4
        assert player.take() is None, "nothing new"
        assert not player.seekable
        assert player.span == (0.0, pytest.approx(4 / RATE))
        assert 0 <= player.oldest < DEADLINE
        assert np.isnan(player.duration)
    assert loop.closed == 1


def test_paused_live_source_keeps_its_picture_while_samples_go_on():
    loop = LiveLoop()
    with Player(loop) as player:
        for k in range(4):
            loop.sent.put(moment(k))
        until(player, lambda: player.moment is not None and number(player.moment) == 3)
        player.pause()
        for k in range(4, 8):
            loop.sent.put(moment(k))
        until(player, lambda: loop.sent.empty())
        assert number(player.moment) == 3
        assert player.step(-2)
        assert number(player.take()) == 1
        assert not player.step(-9), "not so far back"
        assert player.step(+2)
        assert number(player.moment) == 3
        assert not player.step(+1), "what came since the pause is not stepped through"
        player.play()
        until(player, lambda: number(player.moment) == 7)


def test_recording_halts_steps_and_seeks():
    loop = RecordedLoop()
    with Player(loop, paused=True) as player:
        until(player, lambda: player.moment is not None)
        assert number(player.moment) == 0
        assert player.step(+1)
        until(player, lambda: number(player.moment) == 1)
        assert player.step(+3)
        until(player, lambda: number(player.moment) == 4)
        assert player.step(-1)
        assert number(player.moment) == 3
        assert player.seek(2.0)
        until(player, lambda: number(player.moment) == 100)
        assert loop.source.sought[-1] < 2.0, "touches are named from their past"
        assert player.position == pytest.approx(2.0)
        assert player.step(-1)
        assert number(player.moment) == 99
        assert player.paused
        assert player.seek(1e9)
        until(player, lambda: number(player.moment) == 199)
        assert player.seek(-5.0)
        until(player, lambda: number(player.moment) == 0)
        assert not player.step(-1) or number(player.moment) == 0


def test_steps_right_after_a_seek_go_on_from_there():
    """Asked for before the thread had got there they were lost: Home and then the arrow."""
    loop = RecordedLoop()
    with Player(loop, paused=True) as player:
        until(player, lambda: player.moment is not None)
        player.seek(2.0)
        until(player, lambda: number(player.moment) == 100)
        with player.news:
            assert player.seek(1.0)
            assert player.step(+1)
            assert player.step(+2)
        until(player, lambda: number(player.moment) == 53)
        with player.news:
            assert player.seek(3.0)
            assert player.step(-2)
        until(player, lambda: number(player.moment) == 148)


def test_steps_back_go_beyond_what_is_remembered():
    loop = RecordedLoop()
    with Player(loop, paused=True) as player:
        until(player, lambda: player.moment is not None)
        player.seek(3.0)
        until(player, lambda: number(player.moment) == 150)
        for k in range(149, 100, -1):
            assert player.step(-1)
            until(player, lambda k=k: number(player.moment) == k)


def test_recording_ends_with_its_last_moment_and_plays_again():
    loop = RecordedLoop(30)
    with Player(loop) as player:
        until(player, lambda: player.ended)
        assert number(player.moment) == 29
        assert not player.step(+1)
        loop.source.sought.clear()
        player.play()
        until(player, lambda: loop.source.sought == [0.0] and player.ended)


def test_looping_recording_never_ends():
    loop = RecordedLoop(10)
    with Player(loop) as player:
        player.loop = True
        first = player.number
        until(player, lambda: player.number > first + 50)
        assert not player.ended
        assert player.loop


def test_speed_is_the_recordings_and_bounded():
    loop = RecordedLoop()
    with Player(loop, paused=True) as player:
        player.speed = 4.0
        assert player.speed == 4.0
        player.speed = 1e9
        assert player.speed == 16.0
        for speed in (0.0, -1.0, float("nan"), float("inf")):
            with pytest.raises(InvalidArrayError, match="speed must be above 0"):
                player.speed = speed
        with pytest.raises(InvalidArrayError, match="must be a number"):
            player.seek(float("nan"))
    live = Player(LiveLoop())
    live.speed = 3.0
    assert live.speed == 1.0


def test_failing_source_is_told_and_its_last_moment_stays():
    loop = LiveLoop()
    with Player(loop) as player:
        loop.sent.put(moment(0))
        loop.sent.put(SkinMismatchError("another skin"))
        until(player, lambda: player.error is not None)
        assert isinstance(player.error, SkinMismatchError)
        assert player.ended
        assert number(player.moment) == 0
    player.close()


def test_plain_moments_are_played_in_order_and_sequences_are_seekable():
    shown = []
    with Player([moment(k) for k in range(12)]) as player:
        player.speed = 16.0
        while not player.ended:
            before = player.number
            if (taken := player.take()) is not None:
                shown.append(number(taken))
            player.wait(before, 0.2)
        assert shown == sorted(shown)
        assert number(player.moment) == 11
        player.pause()
        assert player.seek(0.1)
        until(player, lambda: number(player.moment) == 5)
        assert player.duration == pytest.approx(11 / RATE)


def test_iterator_of_moments_goes_on_only():
    with Player((moment(k) for k in range(5)), paused=True) as player:
        until(player, lambda: player.moment is not None)
        assert player.step(+1)
        until(player, lambda: number(player.moment) == 1)
        assert not player.seek(0.0)
        assert player.step(-1)
        assert number(player.moment) == 0
        assert not player.step(-1)


def test_history_keeps_within_its_bounds():
    history = History()
    for k in range(3 * LENGTH):
        history.add(moment(k))
    kept = history.moments()
    assert len(history) <= LENGTH
    assert kept[-1].time - kept[0].time == pytest.approx(MINUTE, abs=0.021)
    assert number(history.newest) == 3 * LENGTH - 1
    big = Moment(0.0, {"arm": np.zeros(1_000_000)})
    for _ in range(5):
        history.add(big)
    assert sum(size(one) for one in history.moments()) <= MEMORY
    history.clear()
    assert history.newest is None


def test_player_needs_no_vtk():
    heavy = "{'vtkmodules', 'pyvista'}"
    code = f"import sys, viewer.playing.player; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_real_recording_is_led_to_the_sample(icub, rate):
    """Through playback and touch loop: what is sought and stepped to is that very sample."""
    from skinmap.live.loop import TouchLoop
    from skinmap.live.sources.playback import Playback

    n = len(icub.skin("left_hand"))
    count = 400
    times = 7.0 + np.arange(count) / rate
    values = np.zeros((count, n), np.uint8)
    values[:, 3] = np.arange(count) % 200
    info = StreamInfo("rising", ("left_hand",), (n,), rate)
    loop = TouchLoop(icub, Playback(RecordedStream(info, times, values)))
    with Player(loop, paused=True) as player:

        def row() -> int:
            return round((player.moment.time - 7.0) * rate)

        until(player, lambda: player.moment is not None)
        assert row() == 0
        for wanted in (300, 17, 399, 150):
            assert player.seek(wanted / rate)
            until(player, lambda wanted=wanted: row() == wanted)
            assert player.moment.pressures["left_hand"][3] == wanted % 200
            assert player.position == pytest.approx(wanted / rate)
        player.step(+1)
        until(player, lambda: row() == 151)
        player.step(+5)
        until(player, lambda: row() == 156)
        player.step(-3)
        assert row() == 153
        player.speed = 16.0
        player.play()
        until(player, lambda: player.ended)
        assert row() == 399


def test_one_by_one_passes_no_sample_over():
    from skinmap.live.sources.playback import Playback

    values = np.arange(300, dtype=np.float32)[:, None]
    info = StreamInfo("numbers", ("arm",), (1,), RATE)
    source = Playback(RecordedStream(info, np.arange(300) / RATE, values), speed=np.inf)
    source.most = 1
    seen = []
    with pytest.raises(SourceEnded):
        while True:
            block = source.read(0.1)
            assert len(block) == 1
            seen.append(float(block.values[0, 0]))
    assert seen == list(range(300))


def test_a_live_source_is_led_back_through_what_is_remembered():
    loop = LiveLoop()
    with Player(loop) as player:
        for k in range(100):
            loop.sent.put(moment(k))
        until(player, lambda: player.moment is not None and number(player.moment) == 99)
        assert player.seek(20 / RATE)
        assert player.paused
        assert number(player.moment) == 20
        assert player.position == pytest.approx(20 / RATE)
        assert player.step(-1)
        assert number(player.moment) == 19
        loop.sent.put(moment(100))
        until(player, lambda: player.span[1] == pytest.approx(100 / RATE))
        assert number(player.moment) == 19, "samples go on unseen"
        player.play()
        until(player, lambda: number(player.moment) == 100)


def test_what_is_remembered_is_what_was_seen(rng):
    exact = rng.integers(0, 256, 50).astype(float)
    part = np.array([0.5, np.nan, 254.75])
    kept = small({"arm": exact, "leg": part})
    assert kept["arm"].dtype == np.uint8
    np.testing.assert_array_equal(kept["arm"], exact)
    np.testing.assert_array_equal(kept["leg"], part)  # halves and quarters are exact in float32


def test_touches_stand_on_the_time_line_once_however_often_they_are_played():
    line, press = Timeline(), np.arange(3)
    for again in range(2):
        for k in range(60):
            touch = NamedTouch("arm", press, np.zeros(3), "poke", 0.9, identity=again)
            touches = (touch,) if 10 <= k < 30 or k >= 50 else ()
            line.see(Moment(k / RATE, {}, touches))
    found = [(span.began * RATE, span.ended * RATE) for span in line.spans()]
    np.testing.assert_allclose(found, [(10, 29), (50, 59)], atol=1e-9)
    assert line.spans()[0].to_json(0.1)[0] == pytest.approx(10 / RATE - 0.1, abs=1e-3)


def test_a_touch_has_one_colour_on_the_time_line_and_on_the_body():
    """That of its kind, where a model answers it, whatever its label."""
    answers = Answers(
        Answer("poke", 0.9, ("poke",)), Answer("still", 0.9, ("still",)), HandAnswer("hand", 0.9)
    )
    touch = NamedTouch("arm", np.arange(3), np.zeros(3), "hold", 0.9, answers=answers)
    line = Timeline()
    line.see(Moment(0.0, {}, (touch,)))
    _, _, tint, words, *_ = line.spans()[0].to_json(0.0)
    assert (tint, words) == (touch_colour(touch), "hold on arm")
    assert tint == class_colour("poke") != class_colour("hold")


def test_the_beginning_is_the_recordings_own_where_its_first_samples_were_not_shown():
    loop = RecordedLoop(200)
    loop.source.began = moment(0).time
    loop.source.row = 30  # a machine that was busy begins here
    with Player(loop, paused=True) as player:
        until(player, lambda: player.moment is not None)
        assert player.position == pytest.approx(30 / RATE)
        assert player.seek(1.0)
        until(player, lambda: number(player.moment) == 50)
        assert player.position == pytest.approx(1.0)
