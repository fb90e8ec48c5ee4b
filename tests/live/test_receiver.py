from __future__ import annotations

import threading
import time
from collections import deque

import numpy as np
import pytest

from skinmap.errors import UnreachableError
from skinmap.live.sources.source import (
    OVERHEAD,
    Block,
    Counts,
    Receiver,
    Source,
    SourceEnded,
    StreamInfo,
)

WIDTH = 4


class Scripted(Source):
    """Gives planted blocks, then ends, raises or stays silent."""

    def __init__(self, blocks, then: object = "silence", rate: float = 0.0, kind="pressure"):
        super().__init__(StreamInfo("planted", ("arm",), (WIDTH,), rate, kind))
        self.blocks = deque(blocks)
        self.then = then
        self.empty = threading.Event()
        self.closed = 0

    def read(self, timeout: float) -> Block | None:
        if self.blocks:
            return self.blocks.popleft()
        self.empty.set()
        if isinstance(self.then, BaseException):
            raise self.then
        time.sleep(1e-3)
        return None

    def close(self) -> None:
        self.closed += 1


def block(*times: float, values=None, arrived: float = 0.0) -> Block:
    if values is None:
        values = np.tile(np.float32(times)[:, None] % 200, (1, WIDTH))
    return Block(np.array(times), np.asarray(values), arrived)


def received(blocks, **how) -> tuple[Receiver, Scripted]:
    source = Scripted(blocks, **how)
    receiver = Receiver(source)
    assert source.empty.wait(30.0)
    return receiver, source


def test_receiver_gives_all_that_came_in_order_and_then_nothing():
    receiver, source = received([block(1.0), block(2.0, 3.0), block(4.0)])
    got = receiver.read(5.0)
    assert got.times.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert got.values[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert receiver.read(0.0) is None
    assert receiver.counts == Counts(received=4)
    receiver.close()
    receiver.close()
    assert source.closed >= 1
    with pytest.raises(SourceEnded):
        receiver.read(60.0)


def test_receiver_keeps_within_its_bytes_and_drops_the_oldest():
    source = Scripted([block(float(step)) for step in range(100)])
    receiver = Receiver(source, most_bytes=10 * (WIDTH * 4 + 8 + OVERHEAD))
    assert source.empty.wait(30.0)
    got = receiver.read(5.0)
    assert got.times.tolist() == list(map(float, range(90, 100)))
    assert receiver.counts == Counts(received=100, dropped=90)
    receiver.close()


def test_receiver_keeps_one_block_however_large():
    source = Scripted([block(1.0, 2.0, 3.0), block(4.0, 5.0, 6.0)])
    receiver = Receiver(source, most_bytes=1)
    assert source.empty.wait(30.0)
    assert receiver.read(5.0).times.tolist() == [4.0, 5.0, 6.0]
    receiver.close()


@pytest.mark.parametrize(
    "blocks", [[block(1.0), block(1.0, 2.0)], [block(1.0, values=[[1.0, np.nan, 3.0, np.inf]])]]
)
def test_receiver_hands_on_what_came(blocks):
    receiver, _ = received(blocks)
    got = receiver.read(5.0)
    samples = sum(map(len, blocks))
    assert len(got) == samples
    assert receiver.counts == Counts(received=samples)
    receiver.close()


@pytest.mark.parametrize("error", [SourceEnded(), UnreachableError("gone"), KeyError("fault")])
def test_receiver_raises_what_its_source_raised_after_all_samples(error):
    receiver, _ = received([block(1.0)], then=error)
    assert len(receiver.read(5.0)) == 1
    for _ in range(2):
        with pytest.raises(type(error)):
            receiver.read(60.0)
    receiver.close()


def test_receiver_wakes_who_waits_when_closed():
    receiver, _ = received([])
    ended = threading.Event()

    def wait():
        with pytest.raises(SourceEnded):
            receiver.read(60.0)
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    receiver.close()
    assert ended.wait(30.0)


def test_receiver_believes_a_source_that_says_when_it_was_last_seen():
    source = Scripted([block(1.0)])
    source._last_seen = seen = time.perf_counter() - 100.0
    receiver = Receiver(source)
    assert receiver.read(30.0) is not None
    # A block taken later than it came must not make the source seem younger.
    assert receiver.last_seen == seen
    assert not receiver.alive
    receiver.close()


def test_receiver_tells_a_silent_source_from_a_living_one():
    receiver, _ = received([block(1.0)])
    seen = receiver.last_seen
    until = time.perf_counter() + 30.0
    while receiver.alive and time.perf_counter() < until:
        receiver.read(0.05)
    assert not receiver.alive
    # The issue asks for a second; that is counted from the last sign of life, not from a look.
    assert time.perf_counter() - seen >= 0.8
    receiver.close()


def test_narrow_blocks_weigh_what_they_weigh():
    """Blocks of one sample of four bytes: what holds them weighs a hundred times as much."""
    values = np.zeros((1, WIDTH), np.uint8)
    most = 1_000_000
    source = Scripted([block(float(k), values=values) for k in range(5000)])
    receiver = Receiver(source, most_bytes=most)
    assert source.empty.wait(30.0)
    kept = receiver.read(1.0)
    assert len(kept) + receiver.counts.dropped == 5000
    assert 0.5 * most / 530 < len(kept) <= most / 512
