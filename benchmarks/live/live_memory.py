"""Memory of the live loop over many samples, and whether its end is that of a fresh start."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.timing import memory_mb
from skinmap.live.loop import TouchLoop
from skinmap.live.moment import Moment
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.simulated_source import SimulatedSource
from skinmap.live.sources.source import SourceEnded, StreamInfo
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

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
    blocks = []
    try:
        while True:
            block = made.read(5.0)
            if block is not None:
                blocks.append(block.values)
    except SourceEnded:
        made.close()
    values = np.concatenate(blocks)
    info = StreamInfo("soak", made.info.parts, made.info.widths, 50.0)

    def begun(first: int) -> TouchLoop:
        times = np.arange(first, samples) / 50.0
        played = Repeated(values, samples - first, first)
        source = Playback(info, times, played, speed=float("inf"))
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
