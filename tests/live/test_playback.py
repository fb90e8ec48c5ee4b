from __future__ import annotations

import threading

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import MAX_BLOCK, Seekable, SourceEnded, StreamInfo, blocks


def info(channels: int = 3, rate: float = 50.0) -> StreamInfo:
    return StreamInfo("planted", ("arm",), (channels,), rate)


def planted(count: int = 20, rate: float = 50.0, **how) -> Playback:
    values = np.arange(3 * count, dtype=np.uint8).reshape(count, 3)
    return Playback(RecordedStream(info(rate=rate), 5.0 + np.arange(count) / rate, values), **how)


def test_playback_is_a_seekable_source():
    assert isinstance(planted(), Seekable)


def test_playback_gives_every_sample_once_in_order_at_any_speed():
    for speed in (np.inf, 2000.0):
        played = list(blocks(planted(speed=speed)))
        assert np.array_equal(np.concatenate([b.times for b in played]), 5 + np.arange(20) / 50)
        values = np.concatenate([b.values for b in played])
        assert np.array_equal(values.ravel(), np.arange(60))


def test_playback_keeps_blocks_small():
    sizes = [len(block) for block in blocks(planted(3 * MAX_BLOCK + 1, speed=np.inf))]
    assert sizes == [MAX_BLOCK, MAX_BLOCK, MAX_BLOCK, 1]


def test_playback_gives_nothing_before_it_is_due():
    slow = planted(rate=1e-3)  # the second sample is due in a thousand seconds
    assert len(slow.read(5.0)) == 1
    assert slow.read(0.01) is None
    slow.speed = 1e9
    assert len(slow.read(5.0)) >= 1


def test_playback_halts_at_speed_zero_and_goes_on():
    source = planted(speed=0.0)
    assert source.read(0.01) is None
    source.speed = np.inf
    assert len(source.read(5.0)) == 20


def test_playback_wakes_a_waiting_reader_when_the_speed_changes():
    source = planted(speed=0.0)
    got = []
    reader = threading.Thread(target=lambda: got.append(source.read(60.0)))
    reader.start()
    source.speed = np.inf
    reader.join(30.0)
    assert [len(block) for block in got] == [20]


def test_playback_ends_for_a_waiting_reader_when_closed():
    source = planted(speed=0.0)
    ended = threading.Event()

    def wait():
        with pytest.raises(SourceEnded):
            source.read(60.0)
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    source.close()
    source.close()
    assert ended.wait(30.0)


def test_playback_seeks_to_the_sample_of_a_time_and_back_from_the_end():
    source = planted(speed=np.inf)
    assert source.duration == pytest.approx(20 / 50, abs=1e-12)
    for row in (7, 0, 19):
        source.seek(row / 50)
        assert source.position == pytest.approx(row / 50, abs=1e-12)
        assert source.read(1.0).values[0, 0] == 3 * row
    with pytest.raises(SourceEnded):
        source.read(1.0)
    source.seek(-3.0)
    assert len(source.read(1.0)) == 20
    source.seek(99.0)
    with pytest.raises(SourceEnded):
        source.read(0.0)
    with pytest.raises(InvalidArrayError, match="cannot seek to nan"):
        source.seek(float("nan"))


def test_playback_loops_from_the_end_to_the_beginning():
    source = planted(speed=np.inf, loop=True)
    firsts = [source.read(1.0).times[0] for _ in range(3)]
    assert firsts == [5.0, 5.0, 5.0]
    source.loop = False
    with pytest.raises(SourceEnded):
        source.read(1.0)


def test_playback_of_nothing_ends_at_once():
    for loop in (False, True):
        with pytest.raises(SourceEnded):
            Playback(RecordedStream(info(), [], np.zeros((0, 3), np.uint8)), loop=loop).read(1.0)


def test_playback_refuses_what_cannot_be_played():
    values = np.zeros((2, 3), np.uint8)
    with pytest.raises(InvalidArrayError, match="must not run backwards"):
        Playback(RecordedStream(info(), [1.0, 0.0], values))
    with pytest.raises(InvalidArrayError, match="3 times for 2 samples"):
        Playback(RecordedStream(info(), [0.0, 1.0, 2.0], values))
    with pytest.raises(InvalidArrayError, match="speed must not be negative, got -1"):
        Playback(RecordedStream(info(), [0.0, 1.0], values), speed=-1.0)
