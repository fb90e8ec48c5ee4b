"""Memory of the live loop over many samples."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.classify.classifier import TouchClassifier
from skinmap.live.loop import TouchLoop
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.simulator import SimulatedSource
from skinmap.live.sources.source import SourceEnded, StreamInfo
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin

PAGE = 4096


def soak(
    robot: Robot, skins: dict[str, PreparedSkin], model: TouchClassifier, samples: int
) -> dict[str, Any]:
    """Resident memory over many samples through the whole loop."""
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
    source = Playback(
        StreamInfo("soak", made.info.parts, made.info.widths, 50.0),
        np.arange(samples) / 50.0,
        Repeated(values, samples),
        speed=float("inf"),
    )
    # Ten labels a second: it is memory that is looked at, and 200,000 samples are 67 minutes.
    loop = TouchLoop(robot, source, classifier=model, skins=skins, pace=10.0)
    early = float("nan")
    steady = min(10_000, samples // 4)
    start = time.process_time()
    moments = ended = 0
    most = 0.0
    for _ in loop:
        moments += 1
        ended += len(loop.finished())
        if moments == steady:
            early = resident_mb()
        if moments >= steady and moments % 1000 == 0:
            most = max(most, resident_mb() - early)
    return {
        "samples": moments,
        "touches": ended,
        "cpu_ms_a_sample": (time.process_time() - start) / moments * 1e3,
        "resident_mb": early,
        "grown_mb": resident_mb() - early,
        "most_grown_mb": most,
    }


class Repeated:
    """Samples over and over: `Samples` of a playback."""

    def __init__(self, values: np.ndarray, count: int) -> None:
        self._values, self._count = values, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, rows: slice) -> np.ndarray:
        return self._values[np.arange(*rows.indices(self._count)) % len(self._values)]


def resident_mb() -> float:
    """Resident memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 1e6
