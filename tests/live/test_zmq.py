from __future__ import annotations

import socket
import threading
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from skinmap.errors import MessageError, OutputError, SkinMismatchError, UnreachableError
from skinmap.live import check_source, open_publisher, open_source
from skinmap.live.network.network_messages import Address, pack_info
from skinmap.live.network.zmq_stream import Header, ZmqSource
from skinmap.live.sources.source import SILENT, StreamInfo

DEADLINE = 30.0  # [s]; only a fault takes as long
INFO = StreamInfo("demo", ("arm", "hand"), (3, 2), 50.0, fingerprints={"arm": "ab"})
MARK = 99  # first channel of samples that only tell that somebody listens


@pytest.fixture
def port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def connect(publisher, source, topic="pressure") -> None:
    """Send marks until one has come: then nothing more is lost."""
    until = time.perf_counter() + DEADLINE
    while time.perf_counter() < until:
        mark = np.full((1, INFO.channels), MARK, np.uint8)
        publisher.send_samples(topic, np.zeros(1), mark)
        if source.read(0.05) is not None:
            return
    raise AssertionError("nothing came")


def collect(source, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of so many samples without marks."""
    times, values, until = [], [], time.perf_counter() + DEADLINE
    while sum(map(len, times)) < count and time.perf_counter() < until:
        block = source.read(0.2)
        if block is not None:
            real = block.values[:, 0] != MARK
            times.append(block.times[real])
            values.append(block.values[real])
    return np.concatenate(times), np.concatenate(values)


def wait_until(holds) -> bool:
    until = time.perf_counter() + DEADLINE
    while not holds() and time.perf_counter() < until:
        threading.Event().wait(0.01)
    return holds()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_samples_arrive_whole_and_in_order(port, dtype):
    sent = np.random.default_rng(3).integers(0, 90, (500, 5)).astype(dtype)
    with open_publisher(f"zmq:{port}", INFO) as publisher:
        source = open_source(f"zmq:{port}")
        for name in ("name", "parts", "widths", "rate", "kind", "fingerprints"):
            assert getattr(source.info, name) == getattr(INFO, name)
        connect(publisher, source)
        publisher.send_samples("pressure", np.arange(500) / 50, sent)
        times, values = collect(source, 500)
        assert values.dtype == dtype
        np.testing.assert_array_equal(values, sent)
        np.testing.assert_array_equal(times, np.arange(500) / 50)
        counts = source.counts
        assert (counts.lost, counts.dropped, counts.refused) == (0, 0, 0)
        assert source.alive
        source.close()


def test_stream_describes_its_skin_and_gives_the_parts_asked_for(port):
    with open_publisher(f"zmq:{port}", INFO) as publisher:
        source = open_source(f"zmq:{port}", parts=["hand"])
        assert (source.info.parts, source.info.widths) == (("hand",), (2,))
        assert source.info.fingerprints == {}
        connect(publisher, source)
        publisher.send_samples("pressure", np.ones(1), np.arange(5, dtype=np.uint8)[None])
        (values,) = [values for values in collect_all(source, 1) if values[0] != MARK]
        assert values.tolist() == [3, 4]
        source.close()


def collect_all(source, count: int) -> list[np.ndarray]:
    rows: list[np.ndarray] = []
    until = time.perf_counter() + DEADLINE
    while sum(row[0] != MARK for row in rows) < count and time.perf_counter() < until:
        block = source.read(0.2)
        rows.extend([] if block is None else list(block.values))
    return rows


def test_stream_keeps_the_contract_of_sources(port):
    stop = threading.Event()
    publisher = open_publisher(f"zmq:{port}", INFO)

    def send():
        step = 0
        while not stop.wait(0.002):
            publisher.send_samples("pressure", np.array([step / 500]), np.ones((1, 5), np.uint8))
            step += 1

    sending = threading.Thread(target=send)
    sending.start()
    check_source(lambda: open_source(f"zmq:{port}"))
    stop.set()
    sending.join()
    publisher.close()


def test_stream_of_another_skin_is_refused(port, icub):
    hand = len(icub.skin("left_hand"))
    for info, said in [
        (StreamInfo("x", ("left_hand",), (hand - 1,), 50.0), "has 47 channels for 'left_hand'"),
        (
            StreamInfo("x", ("left_hand",), (hand,), 50.0, fingerprints={"left_hand": "other"}),
            "comes from another skin: the layout of 'left_hand'",
        ),
    ]:
        refused = pytest.raises(SkinMismatchError, match=said)
        with open_publisher(f"zmq:{port}", info), refused:
            open_source(f"zmq:{port}", robot=icub)


def test_nobody_there_is_said_within_seconds(port):
    with pytest.raises(
        UnreachableError, match=rf"nothing is published at tcp://127\.0\.0\.1:{port}"
    ):
        ZmqSource(Address("127.0.0.1", port), wait=0.2)


def test_port_in_use_is_one_line(port):
    refused = pytest.raises(OutputError, match=rf":{port}: the port is in use; choose another$")
    with open_publisher(f"zmq:{port}", INFO), refused:
        open_publisher(f"zmq:{port}", INFO)


def test_publisher_listens_on_this_machine_only(port):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        publisher = open_publisher(f"zmq:{port}", INFO)
    endpoint = publisher._socket.getsockopt(zmq.LAST_ENDPOINT)
    assert endpoint == f"tcp://127.0.0.1:{port}".encode()
    publisher.close()
    publisher.close()


def test_dead_publisher_is_noticed_and_its_return_too(port):
    first = open_publisher(f"zmq:{port}", INFO)
    source = open_source(f"zmq:{port}")
    connect(first, source)
    first.close()
    died = time.perf_counter()
    assert wait_until(lambda: not source.alive)
    # What counts is the time since the last sign of life, and the looking must not be slow.
    assert time.perf_counter() - source.last_seen >= SILENT
    assert source.last_seen <= died + SILENT
    assert wait_until(lambda: source.read(0.0) is None)
    with open_publisher(f"zmq:{port}", INFO) as second:
        connect(second, source)
        assert source.alive
        assert source.counts.reconnects == 1
    source.close()


def test_publisher_that_returns_with_another_skin_is_refused(port):
    first = open_publisher(f"zmq:{port}", INFO)
    source = open_source(f"zmq:{port}")
    connect(first, source)
    first.close()
    refused = pytest.raises(SkinMismatchError, match="sends another skin now: 10 pressure channels")
    with open_publisher(f"zmq:{port}", replace(INFO, widths=(3, 7))), refused:
        collect(source, 1)
    source.close()


class Rogue:
    """A publisher that describes a skin and then sends what it likes."""

    def __init__(self, port: int, info: bytes) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.PUB)
        self.socket.bind(f"tcp://127.0.0.1:{port}")
        self.info = info

    def send(self, *frames: bytes) -> None:
        self.socket.send_multipart([b"info", self.info])
        self.socket.send_multipart(list(frames))

    def close(self) -> None:
        self.context.destroy(linger=0)


def opened(rogue: Rogue, port: int) -> ZmqSource:
    """A source of a rogue, which describes itself meanwhile."""
    stop = threading.Event()

    def describe():
        while not stop.wait(0.01):
            rogue.socket.send_multipart([b"info", rogue.info])

    describing = threading.Thread(target=describe)
    describing.start()
    try:
        return ZmqSource(Address("127.0.0.1", port))
    finally:
        stop.set()
        describing.join()


def test_message_larger_than_the_declared_skin_is_never_read(port):
    rogue = Rogue(port, pack_info(INFO, session=1, heartbeat=0.2))
    source = opened(rogue, port)
    # The limit is ZeroMQ's own: it cuts the connection instead of reading the frame.
    limit = source._socket.maxmsgsize
    assert limit == 65536
    events = source._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    header = Header(2, 5, 1, 0, 0.0, 0.0).pack()
    until = time.perf_counter() + DEADLINE
    while not events.poll(20) and time.perf_counter() < until:
        rogue.send(b"pressure", header, bytes(limit + 1))
        assert source.read(0.0) is None
    assert events.poll(0)
    events.close()
    source.close()
    rogue.close()


def test_wrong_samples_are_refused_and_right_ones_follow(port):
    rogue = Rogue(port, pack_info(INFO, session=1, heartbeat=0.2))
    source = opened(rogue, port)
    good = Header(1, 5, 1, 0, 0.0, 0.0).pack()
    bad = [
        (b"pressure", good, bytes(4)),
        (b"pressure", good, bytes(6)),
        (b"pressure", Header(1, 6, 1, 0, 0.0, 0.0).pack(), bytes(6)),
        (b"pressure", b"", bytes(5)),
        (b"pressure", good),
        (b"pressure", good, bytes(5), b"more", b"and", b"more"),
        (b"pressure",),
        (b"info", b"{"),
        (b"info",),
    ]
    until = time.perf_counter() + DEADLINE
    while source.counts.refused < len(bad) and time.perf_counter() < until:
        for frames in bad:
            rogue.send(*frames)
        source.read(0.05)
    assert source.counts.refused >= len(bad)
    while (block := source.read(0.05)) is None and time.perf_counter() < until:
        rogue.send(b"pressure", good, bytes(range(5)))
    assert block.values[0].tolist() == [0, 1, 2, 3, 4]
    source.close()
    rogue.close()


def test_the_first_reason_to_refuse_a_sample_is_named_once(port, caplog):
    rogue = Rogue(port, pack_info(INFO, session=1, heartbeat=0.2))
    source = opened(rogue, port)
    doubles = Header(3, 5, 1, 0, 0.0, 0.0).pack()
    until = time.perf_counter() + DEADLINE
    while source.counts.refused < 3 and time.perf_counter() < until:
        rogue.send(b"pressure", doubles, bytes(40))
        source.read(0.05)
    (said,) = caplog.messages
    assert "refused: values of type 3; expected 1 (uint8) or 2 (float32)" in said
    source.close()
    rogue.close()


def test_a_flood_of_wrong_samples_does_not_hold_the_reader(port):
    rogue = Rogue(port, pack_info(INFO, session=1, heartbeat=0.2))
    source = opened(rogue, port)
    stop, ended = threading.Event(), threading.Event()

    def flood():
        while not stop.is_set():
            rogue.send(b"pressure", b"no header", bytes(5))

    def read():
        while source.counts.refused == 0:
            assert source.read(0.01) is None
        ended.set()

    threads = [threading.Thread(target=flood), threading.Thread(target=read, daemon=True)]
    for thread in threads:
        thread.start()
    assert ended.wait(DEADLINE)
    stop.set()
    for thread in threads:
        thread.join()
    source.close()
    rogue.close()


def test_values_of_two_types_come_as_the_wider_one(port):
    with open_publisher(f"zmq:{port}", INFO) as publisher:
        source = ZmqSource(Address("127.0.0.1", port))
        connect(publisher, source)
        publisher.send_samples("pressure", np.zeros(1), np.full((1, 5), 7, np.uint8))
        publisher.send_samples("pressure", np.ones(1), np.full((1, 5), 8.5, np.float32))
        assert collect(source, 2)[1].tolist() == [[7.0] * 5, [8.5] * 5]
        source.close()


def test_gaps_in_the_numbers_are_counted_as_lost(port):
    with open_publisher(f"zmq:{port}", INFO):
        source = ZmqSource(Address("127.0.0.1", port))
    for session, sequence in [(1, 5), (1, 6), (1, 9), (1, 9), (2, 0), (2, 1)]:
        header = Header(1, 5, session, sequence, 0.0, 0.0).pack()
        assert source.take([b"pressure", header, bytes(5)]) is not None
    assert source.counts.lost == 2
    assert source.counts.reconnects == 1
    source.close()


def test_somebody_who_speaks_otherwise_is_refused(port):
    for info, said in [(b"hello", "no JSON"), (b"{}", "a description of version None")]:
        rogue = Rogue(port, info)
        with pytest.raises(MessageError, match=said):
            opened(rogue, port)
        rogue.close()


@pytest.fixture(scope="module")
def silent():
    """A source whose publisher has gone: frames are handed to it."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    with open_publisher(f"zmq:{port}", INFO):
        source = ZmqSource(Address("127.0.0.1", port))
    yield source
    source.close()


topics = st.sampled_from([b"pressure", b"info", b"pressurex", b""])
frames = st.binary(max_size=64) | st.just(Header(1, 5, 1, 0, 0.0, 0.0).pack())


@pytest.mark.fuzz
@given(topics, st.lists(frames, max_size=4))
def test_any_frames_are_taken_or_counted(silent, topic, rest):
    before = silent.counts.refused
    sample = silent.take([topic, *rest])
    assert (sample is None) == (silent.counts.refused == before + 1)
    if sample is not None:
        assert sample[1].shape == (5,)
