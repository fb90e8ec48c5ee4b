"""All of live: transport, arrival to label, contacts, identities, memory, recordings.

A publisher in another process sends simulated touches on the whole iCub over ZeroMQ on loopback.
Writes benchmarks/results/live.json; `--quick` looks whether it runs.

Touches planted on a skin, sample by sample: what contacts and identities are measured on.
"""

from __future__ import annotations

import multiprocessing as mp
import socket
import subprocess
import sys
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinmap
from benchmarks.harness.record import command
from benchmarks.harness.timing import memory_mb, quartiles, timed
from benchmarks.live import recordings
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live import open_publisher
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.contacts.named_touch import Moment
from skinmap.live.loop import TouchLoop
from skinmap.live.response.pressures import RestBaseline
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.open_source import open_source
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.simulated_source import SimulatedSource
from skinmap.live.sources.source import SourceEnded, StreamInfo, blocks
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

CHANNELS = 4326


def transports(seconds: float) -> list[dict[str, Any]]:
    """One row a transport and rate, each for so long [s]."""
    found = [one_way(way, rate, seconds) for way in ("zmq", "lsl") for rate in (50.0, 1000.0)]
    return [*found, one_way("zenoh", 50.0, seconds)]


def one_way(way: str, rate: float, seconds: float) -> dict[str, Any]:
    """Latency, losses, and CPU of both ends of one transport at one rate."""
    spec = f"lsl:bench-{uuid.uuid4().hex[:8]}" if way == "lsl" else f"{way}:{free_port()}"
    clock = time.time if way == "zenoh" else time.perf_counter
    apart = mp.get_context("spawn")  # a fork of a process that has had a session of Zenoh hangs
    go, said = apart.Event(), apart.Queue()
    sender = apart.Process(target=send, args=(spec, rate, seconds, go, said))
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
        robot = skinmap.load_robot("icub")
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


PRINT = 9e-3  # at this distance from its middle a finger's print has fallen to 1/e [m]
NOISE = 1.2  # counts, as `skinmap.touch.simulation.variety` has it
APART = 0.03  # between two touches [m]


def finger(skin: JoinedSkin, part: str, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares (N,) of a finger's pressure on the taxels of a part, 1 in its middle."""
    rows = skin.slices[part]
    away = np.linalg.norm(skin.positions[rows] - place, axis=1)
    shares = np.zeros(len(skin))
    shares[rows] = np.exp(-((away / PRINT) ** 2))
    return shares


def read(
    loads: NDArray[np.float64], gains: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Counts (N,) as taxels send them: gains, noise, whole numbers of 0 to 255."""
    counts = loads * gains + rng.normal(0.0, NOISE, len(loads))
    return np.rint(np.clip(counts, 0.0, 255.0))


def pairs(skin: JoinedSkin, part: str, count: int, rng: np.random.Generator) -> Iterator[list[int]]:
    """Pairs of taxels on one sheet, 30 mm apart and facing the same way."""
    rows = skin.slices[part]
    points, normals = skin.positions[rows], skin.normals[rows]
    sheet = skin.patch_of[rows]
    found = 0
    for one in rng.permutation(len(points)).tolist():
        away = np.linalg.norm(points - points[one], axis=1)
        fits = (sheet == sheet[one]) & (normals @ normals[one] > 0.7)
        fits &= np.abs(away - APART) < 2e-3
        if not fits.any():
            continue
        yield [one, int(rng.choice(np.flatnonzero(fits)))]
        found += 1
        if found == count:
            return


def kept_share(
    skin: JoinedSkin, part: str, pair: list[int], *, samples: int, rng: np.random.Generator
) -> float:
    """Share of samples in which two wandering fingers keep the numbers that they began with."""
    tracker = ContactTracker(skin)
    gains = np.clip(rng.normal(1.0, 0.15, len(skin)), 0.4, 1.6)
    middle = skin.positions[skin.slices[part]][pair]
    first: list[int] = []
    kept = 0
    landed = 10  # then both press in full
    for step in range(samples):
        time = step / 50.0
        turn = 2.0 * np.pi * (0.3 * time + np.array([0.0, 0.4]))
        sway = 3e-3 * np.column_stack([np.cos(turn), np.sin(turn), np.cos(2.0 * turn)])
        press = 120.0 * (1.0 + 0.1 * rng.standard_normal(2)) * min(1.0, (step + 1) / landed)
        loads = sum(press[k] * finger(skin, part, middle[k] + sway[k]) for k in range(2))
        tracker.update(time, read(loads, gains, rng))
        present = tracker.present
        if step < landed or len(present) < 2:
            continue
        centres = np.stack([track.centre for track in present])
        near = [
            int(np.linalg.norm(centres - middle[k] - sway[k], axis=1).argmin()) for k in range(2)
        ]
        numbers = [present[k].identity for k in near]
        first = first or numbers
        kept += numbers == first and numbers[0] != numbers[1]
    return kept / (samples - landed)


WARM = 2.0  # seconds of a stream that are left out: who joins works off what waited


def measure(
    quick: bool,
    *,
    minutes: float = 10.0,
    seconds: float = 60.0,
    soaked: int = 200_000,
    each: float = 10.0,
    kills: int = 10,
    pairs: int = 10,
) -> dict[str, Any]:
    """All parts.

    Parameters
    ----------
    quick : bool
        Seconds of each.
    minutes, seconds : float
        Length of the streams at 50 Hz, at 1 kHz.
    soaked : int
        Samples that memory is watched over.
    each : float
        Seconds of each transport at each rate.
    kills, pairs : int
        Recorders killed; pairs of touches on each part.
    """
    if quick:
        minutes, seconds, soaked, each, kills, pairs = 0.1, 3.0, 2000, 1.0, 1, 1
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    model = train(skins)
    joined = JoinedSkin(skins)
    parts: dict[str, Callable[[], Any]] = {
        "transport": lambda: transports(each),
        "contacts": lambda: contacts(joined, 50 if quick else 2000),
        "identities": lambda: identities(joined, pairs),
        "press": lambda: press(skins["torso"], minutes),
        "live_50_hz": lambda: live(robot, skins, model, 50.0, 60.0 * minutes),
        "live_1_khz": lambda: live(robot, skins, model, 1000.0, seconds),
        "live_1_khz_raw": lambda: live(robot, skins, model, 1000.0, seconds, raw=True),
        "soak": lambda: soak(robot, skins, model, soaked),
        "recordings": lambda: recordings.measure(kills=kills, minutes=minutes),
    }
    result: dict[str, Any] = {"channels": len(joined)}
    for name, part in parts.items():
        result[name], cpu, wall = timed(part)
        print(f"{name}: {wall:.0f} s, {cpu:.0f} s CPU", file=sys.stderr, flush=True)
    return result


def contacts(skin: JoinedSkin, repeats: int) -> dict[str, Any]:
    """CPU time for the contacts of one sample with five touches that tremble."""
    rng = np.random.default_rng(0)
    gains = np.clip(rng.normal(1.0, 0.15, len(skin)), 0.4, 1.6)
    parts = ("torso", "left_arm", "right_forearm", "left_leg_upper", "left_foot")
    prints = [
        finger(skin, part, skin.positions[skin.slices[part]][rng.integers(len(skin.skins[part]))])
        for part in parts
    ]
    tracker = ContactTracker(skin)
    times = []
    for step in range(repeats + 50):
        press = 140.0 * (1.0 + 0.05 * rng.standard_normal(len(prints)))
        sample = read(press @ np.stack(prints), gains, rng)
        start = time.process_time()
        tracker.update(step / 50.0, sample)
        times.append((time.process_time() - start) * 1e3)
    cost = np.array(times[50:])
    return {
        "median_ms": float(np.median(cost)),
        "quartiles_ms": quartiles(cost),
        "p95_ms": float(np.percentile(cost, 95)),
    }


def identities(skin: JoinedSkin, count: int) -> dict[str, Any]:
    """Share of samples in which two wandering touches 30 mm apart keep their numbers."""
    rng = np.random.default_rng(1)
    shares = []
    for part in skin.parts:
        own = JoinedSkin({part: skin.skins[part]})
        shares += [
            kept_share(own, part, pair, samples=500, rng=rng)
            for pair in pairs(own, part, count, rng)
        ]
    return {"pairs": len(shares), "share": float(np.mean(shares))}


def press_of_torso(minutes: float) -> dict[str, Any]:
    """A press that is held on the torso of the iCub."""
    return press(PreparedSkin(skinmap.load_robot("icub").skin("torso")), minutes)


def press(skin: PreparedSkin, minutes: float) -> dict[str, Any]:
    """A press that is held, raw values without a calibration: contacts, and what is left of it."""
    rng = np.random.default_rng(3)
    part = skin.skin.part
    own = JoinedSkin({part: skin})
    gains = np.clip(rng.normal(1.0, 0.15, len(own)), 0.4, 1.6)
    shares = finger(own, part, own.positions[100])
    response = RestBaseline(own.part_of, 50.0)
    tracker = ContactTracker(own)
    numbers: set[int] = set()
    peaks = []
    held = round(60.0 * minutes * 50.0)
    for step in range(200 + held):
        load = 120.0 * shares if step >= 200 else np.zeros(len(own))
        raw = 240.0 - read(load, gains, rng)
        tracker.update(step / 50.0, response.apply(raw[None])[0])
        if step >= 250:
            numbers |= {track.identity for track in tracker.tracks}
            peaks.append(max((track.peak for track in tracker.present), default=0.0))
    return {
        "minutes": minutes,
        "contacts": len(numbers),
        "samples_without": int(np.sum(np.array(peaks) == 0.0)),
    }


def live(
    robot: Robot,
    skins: dict[str, PreparedSkin],
    model: TouchClassifier,
    rate: float,
    seconds: float,
    *,
    raw: bool = False,
) -> dict[str, Any]:
    """Follow a publisher in another process, and measure in this one."""
    port = free_port()
    command = [
        str(Path(sys.executable).with_name("skinmap")), "simulate", "icub",
        "--fault", f"rate={rate}", "--publish", f"zmq:{port}", "--seconds", str(seconds + 4.0),
        *["--fault", "raw=yes"] * raw,
    ]  # fmt: skip
    publisher = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        assert publisher.stderr is not None
        publisher.stderr.readline()  # it says so when it publishes
        source = open_source(f"zmq:127.0.0.1:{port}", robot=robot)
        loop = TouchLoop(robot, source, classifier=model, skins=skins)
        return follow(loop, seconds)
    finally:
        publisher.terminate()
        publisher.wait()


def follow(loop: TouchLoop, seconds: float) -> dict[str, Any]:
    """Latencies, losses and CPU of a loop for some seconds of its stream, after the first ones."""
    latencies: list[float] = []
    touched, begun = 0, (float("inf"), 0.0, 0.0, 0)  # time, CPU, clock, labels
    first = now = float("nan")
    try:
        while not now >= begun[0] + seconds:
            moment = loop.step(0.2)
            loop.finished()
            if moment is None or moment.stale:
                continue
            now = moment.time
            first = now if first != first else first
            if now - first < WARM:
                continue
            if not latencies:
                begun = now, time.process_time(), time.perf_counter(), loop.labels_given
            latencies.append(moment.latency)
            touched += bool(moment.touches)
    except SourceEnded:
        pass
    finally:
        loop.close()
    since, cpu, clock, labels = begun
    cpu_share = (time.process_time() - cpu) / (time.perf_counter() - clock)
    median, p99, most = np.percentile(np.array(latencies) * 1e3, (50, 99, 100)).tolist()
    share = touched / len(latencies)
    return {
        "seconds": now - since,
        "lost": loop.totals()["lost"],
        "labels_a_second_while_touched": (loop.labels_given - labels) / seconds / share,
        "latency_ms": {"median": median, "p99": p99, "max": most},
        "cpu_share_of_one_core": cpu_share,
    }


TAIL = 500  # moments that are compared with those of a fresh start
TAUGHT = ("torso", "right_forearm")  # parts that a classifier learns on


def train(
    skins: dict[str, PreparedSkin], name: str = "contact-geometry", each: int = 16
) -> TouchClassifier:
    """A classifier that learnt on two parts."""
    rng = np.random.default_rng(2)
    touches = [
        Touch(skins[part], samples, label, rate=50.0)
        for part in TAUGHT
        for _, label, samples in simulate(skins[part].skin, rng=rng, per_gesture=each).touches()
    ]
    return classifiers.get(name)().fit(touches, rng=rng)


def soak(
    robot: Robot, skins: dict[str, PreparedSkin], model: TouchClassifier, samples: int
) -> dict[str, Any]:
    """Resident memory over many samples through the whole loop, and its last moments."""
    made = SimulatedSource(robot, seed=5, speed=float("inf"), seconds=60.0)
    values = np.concatenate([block.values for block in blocks(made, timeout=5.0)])
    made.close()
    info = StreamInfo("soak", made.info.parts, made.info.widths, 50.0)

    def begun(first: int) -> TouchLoop:
        times = np.arange(first, samples) / 50.0
        played = Repeated(values, samples - first, first)
        source = Playback(RecordedStream(info, times, played), speed=float("inf"))
        # Ten labels a second: it is memory that is looked at, and 200,000 samples are 67 minutes.
        return TouchLoop(robot, source, classifier=model, skins=skins, pace=10.0)

    loop, last = begun(0), deque[Moment](maxlen=TAIL)
    early = float("nan")
    steady = min(10_000, samples // 4)
    start = time.process_time()
    moments = ended = 0
    most = 0.0
    for moment in loop:
        last.append(moment)
        moments += 1
        ended += len(loop.finished())
        if moments == steady:
            early = memory_mb()
        if moments >= steady and moments % 1000 == 0:
            most = max(most, memory_mb() - early)
    resident = memory_mb()
    spent = time.process_time() - start
    # Begun where the minute begins, before any touch: a loop that is begun within one takes it for
    # the skin's rest, and finds other contacts for a while.
    first = max(0, samples // len(values) - 2) * len(values)
    fresh = deque(begun(first), maxlen=TAIL)
    return {
        "samples": moments,
        "touches": ended,
        "cpu_ms_a_sample": spent / moments * 1e3,
        "resident_mb": early,
        "grown_mb": resident - early,
        "most_grown_mb": most,
        "same_as_fresh": same(last, fresh),
    }


def same(some: Iterable[Moment], others: Iterable[Moment]) -> bool:
    """Whether moments show the same pressures to the bit, and touches at the same taxels."""
    return [_shown(one) for one in some] == [_shown(one) for one in others]


def _shown(moment: Moment) -> tuple[object, ...]:
    touches = sorted((one.part, one.taxels.tobytes()) for one in moment.touches)
    return moment.time, {p: one.tobytes() for p, one in moment.pressures.items()}, touches


class Repeated:
    """Samples over and over: `Samples` of a playback."""

    def __init__(self, values: np.ndarray, count: int, first: int = 0) -> None:
        self._values, self._count, self._first = values, count, first

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, rows: slice) -> np.ndarray:
        places = np.arange(*rows.indices(self._count)) + self._first
        return self._values[places % len(self._values)]


def soak_icub(samples: int) -> dict[str, Any]:
    """The same of the whole iCub."""
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    return soak(robot, skins, train(skins), samples)


if __name__ == "__main__":
    command(measure, __doc__, "live")
