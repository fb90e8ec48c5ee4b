"""Clocks that step by an hour either way: those of senders, and the one of this machine."""

from __future__ import annotations

import time

import numpy as np
import pytest

from skinmap.io.mcap.reading import read_track
from skinmap.live.loop import TouchLoop
from skinmap.live.recording.recorder import Recorder
from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo
from skinmap.touch.prepared_skin import PreparedSkin

HOUR, COUNT, RATE = 3600.0, 100, 50.0


class Stepping(Source):
    """Samples at 50 Hz whose clock steps once, in the middle."""

    def __init__(self, info: StreamInfo, step: float) -> None:
        super().__init__(info)
        times = 1e5 + np.arange(COUNT) / RATE
        times[COUNT // 2 :] += step
        self._blocks = [Block(times[k : k + 1], np.zeros((1, info.channels)), 0.0)
                        for k in range(COUNT)]  # fmt: skip

    def read(self, timeout: float) -> Block | None:
        if not self._blocks:
            raise SourceEnded("all was sent")
        return self._blocks.pop(0)

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def skins(icub):
    return {"left_hand": PreparedSkin(icub.skin("left_hand"))}


@pytest.mark.parametrize("step", [HOUR, 2.5, -0.9, -HOUR])
def test_no_sample_is_lost_where_a_senders_clock_steps(icub, skins, step):
    width = len(skins["left_hand"].skin)
    source = Stepping(StreamInfo("t", ("left_hand",), (width,), RATE), step)
    loop = TouchLoop(icub, source, skins=skins)
    moments = sum(1 for _ in loop)
    counts = loop.counts
    assert moments == COUNT
    assert (counts.lost, counts.late, counts.restarts) == (0, 0, 1)


def test_samples_that_are_missing_for_seconds_are_lost(icub, skins):
    width = len(skins["left_hand"].skin)
    info = StreamInfo("t", ("left_hand",), (width,), RATE)
    source = Stepping(info, 2.5)
    source._blocks = [
        Block(one.times, one.values, float(one.times[0])) for one in source._blocks
    ]  # it took as long
    loop = TouchLoop(icub, source, skins=skins)
    assert sum(1 for _ in loop) == COUNT
    assert (loop.counts.lost, loop.counts.restarts) == (125, 0)


@pytest.mark.parametrize("step", [HOUR, -HOUR])
def test_a_recording_holds_every_sample_where_a_senders_clock_steps(tmp_path, step):
    info = StreamInfo("t", ("a",), (3,), RATE)
    recorder = Recorder(tmp_path / "t.mcap", info)
    source = Stepping(info, step)
    for block in source._blocks:
        recorder.put(block)
    recorder.close()
    assert sum(len(read_track(path).times) for path in recorder.files) == COUNT
    # Time that starts again gets a file of its own.
    assert len(recorder.files) == (2 if step < 0 else 1)


@pytest.mark.parametrize("step", [HOUR, -HOUR])
def test_the_machines_own_clock_may_step(tmp_path, monkeypatch, step):
    info, clock = StreamInfo("t", ("a",), (3,), RATE), time.time
    recorder = Recorder(tmp_path / "t.mcap", info)
    for number, block in enumerate(Stepping(info, 0.0)._blocks):
        if number == COUNT // 2:
            monkeypatch.setattr(time, "time", lambda: clock() + step)
        recorder.put(block)
    recorder.close()
    times = read_track(recorder.files[0]).times
    np.testing.assert_allclose(np.diff(times), 1.0 / RATE, rtol=0.0, atol=1e-6)  # a 32-bit float's
