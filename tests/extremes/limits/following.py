"""Laws of the live loop: samples late, lost and stale, contacts and their numbers, baselines."""

from __future__ import annotations

import time
from functools import cache

import numpy as np

from calibration.response import DriftTracker, ReferenceLoads, ResponseCalibration
from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.live.contacts.contact_tracker import ContactTracker
from skinmap.live.loop import TouchLoop
from skinmap.live.response.pressures import RestBaseline
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.source import Block, Counts, Source, SourceEnded, StreamInfo
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin

from .law import Law, Outside
from .shapes import bent_skin, lattice, prepared, press

RATE = 50.0


class OnePart:
    """As much of a robot as the loop asks for."""

    name, parts = "laws", {"bent": None}

    def skin(self, part: str) -> Skin:
        return bent_skin()


class Planted(Source):
    """A source of blocks that are there already; then it is silent, or ends."""

    def __init__(self, blocks: list[Block], channels: int = 144, ends: bool = True) -> None:
        super().__init__(StreamInfo("laws", ("bent",), (channels,), RATE))
        self.blocks, self.ends = blocks, ends

    def read(self, timeout: float) -> Block | None:
        if self.blocks:
            return self.blocks.pop(0)
        if self.ends:
            raise SourceEnded
        return None

    def close(self) -> None:
        """Nothing is open."""


def played(times: np.ndarray, values: np.ndarray | None = None) -> tuple[Counts, list[float]]:
    """Counts of a loop that is given samples one by one, and the times of its moments."""
    values = np.zeros((len(times), 144)) if values is None else values
    now = time.perf_counter()
    blocks = [Block(times[k : k + 1], values[k : k + 1], now) for k in range(len(times))]
    loop = TouchLoop(robot(), Planted(blocks), skins={"bent": prepared()})
    return loop.counts, [moment.time for moment in loop]


def robot() -> Robot:
    return OnePart()  # type: ignore[return-value]


def out_of_order(share: float) -> float:
    """Samples that come after a later one and are not counted as late, and moments backwards."""
    times = np.arange(200) / RATE
    swapped = [k for k in range(2, 198, 3) if np.random.default_rng(k).random() < share]
    for k in swapped:
        times[[k, k + 1]] = times[[k + 1, k]]
    counts, moments = played(times)
    return float(abs(counts.late - len(swapped)) + (np.diff(moments) <= 0).sum())


def doubled(share: float) -> float:
    """Samples that come twice and are not counted as repeated, or used twice."""
    times = np.arange(200) / RATE
    again = np.random.default_rng(0).random(200) < share
    counts, _ = played(np.repeat(times, 1 + again))
    return float(abs(counts.repeated - again.sum()) + abs(counts.used - 200))


def gone(share: float) -> float:
    """Samples that never come, against those counted as lost."""
    keep = np.random.default_rng(0).random(200) >= share
    keep[[0, -1]] = True
    counts, _ = played(np.arange(200)[keep] / RATE)
    return float(abs(counts.lost - (~keep).sum()))


def jittery(share: float) -> float:
    """Samples called lost although none is; times are off by so much of a period."""
    shift = np.random.default_rng(0).uniform(-share, share, 500)
    counts, _ = played((np.arange(500) + shift) / RATE)
    return float(counts.lost + counts.late)


def silent() -> str:
    """What a loop says when nothing comes."""
    loop = TouchLoop(robot(), Planted([], ends=False), skins={"bent": prepared()})
    loop.feed._heard = time.perf_counter() - 10.0  # when it last heard of its source
    moment = loop.step(0.0)
    return "a moment that is stale" if moment is not None and moment.stale else str(moment)


@cache
def joined() -> JoinedSkin:
    return JoinedSkin({"bent": prepared()})


def numbers(samples: list[np.ndarray]) -> int:
    """How many contacts are told apart through some samples, one each 20 ms."""
    tracker = ContactTracker(joined())
    seen = set()
    for step, sample in enumerate(samples):
        tracker.update(step / RATE, sample)
        seen |= {track.identity for track in tracker.present}
    return len(seen)


def held(noise: float) -> float:
    """Numbers beside one of a press of a second; noise is cut off below the threshold."""
    rng = np.random.default_rng(0)
    values = [press() + rng.normal(0, noise, 144) for _ in range(50)]
    return float(numbers([np.where(v > 4 + 1.7 * noise, v, 0.0) for v in values]) - 1)


def with_dead(share: float) -> float:
    values = press()
    values[np.random.default_rng(3).random(144) < share] = 0.0
    return float(numbers([values] * 10) - 1)


def flickering(missing: int) -> float:
    """Numbers beside one of a press that is not felt for some samples."""
    return float(numbers([press()] * 5 + [np.zeros(144)] * missing + [press()] * 5) - 1)


def stroked(speed: float) -> float:
    """Numbers beside one of a finger that moves along a row [m/s]."""
    places = np.linspace(0.0, 0.06, max(2, round(0.06 / max(speed / RATE, 1e-3))))
    way = lattice()[66] + np.array([1.0, 0.0, 0.0]) * places[:, None]
    values = []
    for place in way:
        row = int(np.linalg.norm(lattice()[60:72] - place, axis=1).argmin()) + 60
        values.append(press(row))
    return float(numbers(values) - 1)


def together(fingers: int) -> float:
    """Numbers of so many fingers, far apart, against how many there are."""
    places = [13, 22, 121, 130][:fingers]
    total = np.sum([press(row) for row in places], axis=0)
    return float(abs(numbers([np.where(total > 5, total, 0.0)] * 5) - fingers))


def followed(rate: float) -> float:
    """Share by which a press of a minute loses height while its skin warms [counts/min]."""
    rng, n, steps = np.random.default_rng(0), 40, 600
    walk = np.linspace(0, rate, steps)[:, None]
    values = 100 + walk + rng.normal(0, 1.2, (steps, n))
    values[50:, :6] += 80.0
    tracker = DriftTracker(np.full(n, 100.0), np.full(n, 6.0), 1, 10.0)
    found = tracker.apply(np.rint(values))
    return float(abs(found[-50:, :6].mean() / 80 - 1))


def calm(noise: float) -> float:
    """Share of untouched samples that a baseline of our own calls touched."""
    rng = np.random.default_rng(0)
    baseline = RestBaseline(np.zeros(40, np.int64), RATE)
    baseline.apply(np.rint(60 + rng.normal(0, noise, (200, 40))))
    return float((baseline.apply(np.rint(60 + rng.normal(0, noise, (400, 40)))) > 0).mean())


def equalised(steepest: float) -> float:
    """Error of loads, in shares, where taxels are so many times as sensitive as others."""
    rng, n = np.random.default_rng(0), 20
    up = np.linspace(0, 10, 200)
    load = np.concatenate([up, up[::-1]])
    gain = np.linspace(4, 4 * steepest, n)
    samples = 20 + np.outer(load, gain) + rng.normal(0, 0.5, (400, n))
    reference = ReferenceLoads(samples, np.repeat(load[:, None], n, axis=1))
    rest = 20 + rng.normal(0, 0.5, (500, n))
    found = ResponseCalibration.fit(rest, reference).apply(20 + np.outer([8.0], gain))
    return float(np.abs(found / 8 - 1).max())


def wrong_loads() -> object:
    reference = ReferenceLoads(np.full((50, 3), np.nan), np.ones((50, 3)))
    return ResponseCalibration.fit(np.full((100, 3), 20.0), reference)


LAWS = [
    Law("TouchLoop", "late samples", "each is left out and counted, time never runs back",
        out_of_order, 0.0, "counted", (0.0, 0.2, 1.0), unit="of every third"),
    Law("TouchLoop", "repeated samples", "each is used once and counted", doubled, 0.0, "counted",
        (0.0, 0.2, 1.0), unit="of the samples"),
    Law("TouchLoop", "lost samples", "each is counted", gone, 0.0, "counted", (0.0, 0.1, 0.5),
        (Outside("no sample for 10 s", "a moment that is stale", silent),
         Outside("143 channels", SkinMismatchError,
                 lambda: TouchLoop(robot(), Planted([], 143), skins={"bent": prepared()}))),
        "of the samples"),
    Law("TouchLoop", "jitter", "none is called lost or late", jittery, 0.0, "counted",
        (0.0, 0.1, 0.3), unit="of a period"),
    Law("ContactTracker", "noise", "one press is one contact", held, 0.0, "counted",
        (0.0, 1.0, 2.0, 5.0),
        (Outside("8 counts", "contacts of noise alone",
                 lambda: "contacts of noise alone" if held(8.0) > 0 else "one"),), "counts"),
    Law("ContactTracker", "dead taxels", "one press is one contact", with_dead, 0.0, "counted",
        (0.0, 0.05, 0.1), unit="of the taxels"),
    Law("ContactTracker", "gaps", "one press is one contact", flickering, 0.0, "counted",
        (0, 1, 4), (Outside("6 samples", "1.0 more", lambda: f"{flickering(6)} more"),),
        "samples at 50 Hz"),
    Law("ContactTracker", "speed", "one stroke is one contact", stroked, 0.0, "counted",
        (0.0, 0.1, 0.5, 1.0), unit="m/s at 50 Hz"),
    Law("ContactTracker", "size", "as many contacts as fingers", together, 0.0, "counted",
        (1, 2, 4), unit="fingers"),
    Law("DriftTracker", "drift", "change of a press held for a minute", followed, 0.05,
        "2 counts of 80, and what comes before the press is known", (-10.0, 0.0, 2.0, 10.0),
        unit="counts a minute, all taxels alike"),
    Law("RestBaseline", "noise", "untouched samples called touched", calm, 1e-3,
        "the threshold is the 95th percentile and 4 counts: 3 standard deviations and more",
        (0.0, 1.2, 2.0), unit="counts"),
    Law("Gain.loads", "scale", "error of loads, in shares", equalised, 0.06,
        "half a count of a baseline and of a knot of 32 counts", (1.0, 3.0, 5.0),
        (Outside("NaN", InvalidArrayError, wrong_loads),), "times the least sensitive"),
]  # fmt: skip
