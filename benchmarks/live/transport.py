"""What the transports cost: a whole iCub from one process to another, over each that there is.

Over LSL and ZeroMQ the publisher stamps each sample with the monotonic clock of the machine, which
both share, so the latency is from before `send_samples` to after `read` of the receiving thread's
samples. Zenoh stamps what it sends by the wall clock itself; clouds and transforms of
the whole robot travel beside its samples and are received.
"""

from __future__ import annotations

import multiprocessing as mp
import socket
import time
import uuid
from multiprocessing.synchronize import Event
from typing import Any

import numpy as np

from skinmap import load_robot
from skinmap.live import open_publisher, open_source
from skinmap.live.sources.source import StreamInfo

CHANNELS = 4326


def rows(seconds: float) -> list[dict[str, Any]]:
    """One row a transport and rate, each for so long [s]."""
    found = [one_way(way, rate, seconds) for way in ("zmq", "lsl") for rate in (50.0, 1000.0)]
    return [*found, one_way("zenoh", 50.0, seconds)]


def one_way(way: str, rate: float, seconds: float) -> dict[str, Any]:
    """Latency, losses, and CPU of both ends of one transport at one rate."""
    spec = f"lsl:bench-{uuid.uuid4().hex[:8]}" if way == "lsl" else f"{way}:{free_port()}"
    clock = time.time if way == "zenoh" else time.perf_counter
    go, said = mp.Event(), mp.Queue()
    sender = mp.Process(target=send, args=(spec, rate, seconds, go, said))
    sender.start()
    said.get(timeout=60)
    source = open_source(spec)
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
    while source.alive:
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
    if spec.startswith("zenoh"):
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


def free_port() -> int:
    """A port that nobody has."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
