"""What the transports cost: a whole iCub from one process to another, over each that there is.

Over LSL and ZeroMQ the publisher stamps each sample with the monotonic clock of the machine, which
both share, so the latency is from before `send_samples` to after `read` of the receiving thread's
samples. Zenoh and Foxglove stamp what they send by the wall clock themselves; with both, clouds,
transforms and (Foxglove) triangles of the whole robot travel beside the samples and are received.
Writes benchmarks/results/transport.json; `--quick` looks whether it runs.
"""

from __future__ import annotations

import json
import multiprocessing as mp
import socket
import struct
import time
import uuid
from multiprocessing.synchronize import Event
from typing import Any

import numpy as np

from skinmap import load_robot
from skinmap.live import open_publisher, open_source
from skinmap.live.sources.sample_counts import Counts
from skinmap.live.sources.source import Block, StreamInfo

CHANNELS = 4326


def measure(quick: bool, *, seconds: float = 60.0) -> dict[str, Any]:
    """Each transport at each rate."""
    return {"channels": CHANNELS, "dtype": "float32", "runs": rows(1.0 if quick else seconds)}


def rows(seconds: float) -> list[dict[str, Any]]:
    """One row a transport and rate, each for so long [s]."""
    found = [one_way(way, rate, seconds) for way in ("zmq", "lsl") for rate in (50.0, 1000.0)]
    return found + [one_way(way, 50.0, seconds) for way in ("zenoh", "foxglove")]


def one_way(way: str, rate: float, seconds: float) -> dict[str, Any]:
    """Latency, losses, and CPU of both ends of one transport at one rate."""
    spec = f"lsl:bench-{uuid.uuid4().hex[:8]}" if way == "lsl" else f"{way}:{free_port()}"
    clock = time.perf_counter if way in ("zmq", "lsl") else time.time
    go, said = mp.Event(), mp.Queue()
    sender = mp.Process(target=send, args=(spec, rate, seconds, go, said))
    sender.start()
    said.get(timeout=60)
    source: Any = FoxgloveClient(spec) if way == "foxglove" else open_source(spec)
    wanted, got = round(rate * seconds), 0
    latencies = []
    cpu = time.process_time()
    go.set()
    while got < wanted and (block := source.read(2.0)) is not None:
        latencies.append(clock() - block.times[-1])
        got += len(block)
    cpu = time.process_time() - cpu
    counts = source.counts
    sent_cpu = said.get(timeout=60)
    sender.kill()
    died = time.perf_counter()
    while way != "foxglove" and source.alive:
        time.sleep(0.002)
    noticed = time.perf_counter() - died
    source.close()
    sender.join()
    median, p99, most = np.percentile(np.array(latencies) * 1e3, [50, 99, 100]).tolist()
    return {
        "transport": way,
        "rate_hz": rate,
        "sent": wanted,
        "received": got,
        "dropped": counts.dropped + counts.lost,
        "latency_ms": {"median": median, "p99": p99, "max": most},
        "cpu_us_a_sample": {"send": 1e6 * sent_cpu / wanted, "receive": 1e6 * cpu / max(got, 1)},
        "death_noticed_s": noticed,
    }


def send(spec: str, rate: float, seconds: float, go: Event, said: Any) -> None:
    """Publish at a rate once somebody listens, then stay until killed."""
    info, robot = StreamInfo("bench", ("skin",), (CHANNELS,), rate), None
    if spec.startswith(("zenoh", "foxglove")):
        robot = load_robot("icub")
        widths = tuple(len(robot.skin(part)) for part in robot.parts)
        info = StreamInfo("bench", robot.parts, widths, rate)
    publisher = open_publisher(spec, info, topics=["pressure"], robot=robot)
    values = np.random.default_rng(0).uniform(0, 200, (1, CHANNELS)).astype(np.float32)
    said.put("ready")
    go.wait(60)
    began, cpu = time.perf_counter() + 0.2, time.process_time()
    for step in range(round(rate * seconds)):
        time.sleep(max(0.0, began + step / rate - time.perf_counter()))
        publisher.send_samples("pressure", np.array([time.perf_counter()]), values)
    said.put(time.process_time() - cpu)
    go.clear()
    go.wait(600)


class FoxgloveClient:
    """What the app does: subscribe to everything, and take the samples out of it."""

    def __init__(self, spec: str) -> None:
        from websockets.sync.client import connect

        port = spec.partition(":")[2]
        self._socket = connect(
            f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], max_size=None
        )
        self._topics: dict[int, str] = {}
        self.counts, self.alive = Counts(), True

    def read(self, timeout: float) -> Block | None:
        """One sample."""
        until = time.perf_counter() + timeout
        while (left := until - time.perf_counter()) > 0:
            try:
                frame = self._socket.recv(timeout=left)
            except TimeoutError:
                return None
            if isinstance(frame, bytes):
                _, number, stamp = struct.unpack_from("<BIQ", frame)
                if self._topics[number] == "/skin/pressure":
                    values = np.frombuffer(frame, "<f4", offset=13 + 36)
                    return Block(np.array([stamp / 1e9]), values[None], time.perf_counter())
            elif (told := json.loads(frame))["op"] == "advertise":
                self._subscribe(told["channels"])
        return None

    def _subscribe(self, channels: list[dict[str, Any]]) -> None:
        self._topics |= {one["id"]: one["topic"] for one in channels}
        asked = [{"id": one["id"], "channelId": one["id"]} for one in channels]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def close(self) -> None:
        """Go."""
        self._socket.close()


def free_port() -> int:
    """A port that nobody has."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


if __name__ == "__main__":
    from benchmarks.harness.record import command

    command(measure, __doc__, "transport")
