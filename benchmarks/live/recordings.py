"""What recordings cost and survive: size, speed, kill -9 at random moments.

`measure` is part of `make bench-live`, and `make soak` runs it with 50 kills. A child process plays
simulated samples of the whole iCub at 50 Hz into a recorder and reports each sample that it has
handed over through a pipe.
"""

from __future__ import annotations

import os
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skinmap
from benchmarks import ROOT
from skinmap.io.mcap.reading import read_track
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.recording.recorder import Recorder
from skinmap.live.sources.open_source import open_source
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Block, StreamInfo, blocks

RATE = 50.0  # samples a second
MINUTES = 10
LONGEST_LOSS = 0.2  # seconds that a killed process may lose
PLAYED = 500  # samples that a child plays over and over
FEWEST, MOST = 10, 120  # samples that a child sends before it is killed
WAIT = 300.0  # for a child to start [s]
LAST = 19  # the lowest priority of all
BUSY = "while True: pass"
REPORT = struct.Struct("<I")


def measure(
    *, kills: int = 50, minutes: float = MINUTES, seed: int = 0, beside: int = 0
) -> dict[str, Any]:
    """All figures of recordings.

    Parameters
    ----------
    kills : int
        Children that are killed.
    minutes : float
        Simulated time that is recorded to measure size and speed.
    seed : int
    beside : int
        Busy programs beside recorders that have the lowest priority; 0 for recorders as they are.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples, size = measure_size(folder, minutes=minutes, seed=seed)
        with busy(beside):
            losses = kill_many(
                folder, samples, kills, rng=np.random.default_rng(seed), last=beside > 0
            )
    return {
        "size": size,
        "kills": {
            "beside": beside,
            "count": len(losses),
            "opened": sum(one["opened"] for one in losses),
            "most_lost_s": max((one["lost_s"] for one in losses), default=None),
            "goal_s": LONGEST_LOSS,
        },
    }


def measure_size(
    folder: Path, *, minutes: float, seed: int
) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """Record the simulator as fast as it goes; some of its samples, and what the file costs."""
    robot = skinmap.load_robot("icub")
    source = open_source("sim", robot=robot, seed=seed, speed=float("inf"))
    path = folder / "size.mcap"
    recorder = Recorder(path, source.info, robot=robot)
    wanted, count, kept = round(minutes * 60 * RATE), 0, []
    for block in blocks(source, timeout=10.0):
        if len(kept) * len(block) < PLAYED:
            kept.append(block.values)
        recorder.put(block, patience=WAIT)
        count += len(block)
        if count >= wanted:
            break
    source.close()
    recorder.close()
    megabytes = path.stat().st_size / 1e6
    return np.concatenate(kept)[:PLAYED], {
        "channels": source.info.channels,
        "samples": count,
        "minutes": count / RATE / 60,
        "megabytes": megabytes,
        "megabytes_in_10_minutes": megabytes * MINUTES / (count / RATE / 60),
        "uncompressed_megabytes_in_10_minutes": 60 * RATE * MINUTES * source.info.channels / 1e6,
    }


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many programs that do nothing but compute."""
    programs = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def kill_many(
    folder: Path,
    samples: NDArray[np.uint8],
    kills: int,
    *,
    rng: np.random.Generator,
    most: int = MOST,
    last: bool = False,
) -> list[dict[str, Any]]:
    """What each of many children lost; they are killed after at most so many samples.

    With `last` they have the lowest priority of all.
    """
    stored = folder / "samples.npy"
    np.save(stored, samples)
    return [
        kill_once(stored, folder / f"kill_{number}.mcap", rng=rng, most=most, last=last)
        for number in range(kills)
    ]


def kill_once(
    stored: Path, path: Path, *, rng: np.random.Generator, most: int = MOST, last: bool = False
) -> dict[str, Any]:
    """Kill a child that records at a random moment; what it had sent and what is found.

    Returns
    -------
    dict
        `found` samples, `lost_s` and `opened`.
    """
    after = int(rng.integers(FEWEST, most))
    child = subprocess.Popen(
        [
            sys.executable, "-m", "benchmarks.live.recordings",
            str(stored.resolve()), str(path.resolve()), *["--last"] * last,
        ],
        stdout=subprocess.PIPE,
        cwd=ROOT,
    )  # fmt: skip
    assert child.stdout is not None
    try:
        sent = _reports(child.stdout.fileno(), after)
        # Anywhere between two samples, and anywhere between two chunks.
        select.select([], [], [], float(rng.uniform(0.0, 2.0 / RATE)))
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    rest = child.stdout.read()
    child.stdout.close()
    sent += len(rest) // REPORT.size
    track = read_track(path)
    found = len(track.times)
    played = np.load(stored, mmap_mode="r")
    expected = played[np.arange(found) % len(played)]
    opened = bool(np.array_equal(track.values[:], expected))
    return {"found": found, "lost_s": max(sent - found, 0) / RATE, "opened": opened}


def _reports(pipe: int, wanted: int) -> int:
    """Wait until so many samples were reported; how many there are."""
    data, deadline = b"", time.monotonic() + WAIT
    while len(data) < wanted * REPORT.size:
        ready, _, _ = select.select([pipe], [], [], max(deadline - time.monotonic(), 0.0))
        piece = os.read(pipe, 4096) if ready else b""
        if not piece:
            raise RuntimeError("the child that records said nothing")
        data += piece
    return len(data) // REPORT.size


def record_until_killed(stored: Path, path: Path, *, last: bool = False) -> None:
    """What a child does: play samples at 50 Hz, record them, report each one.

    Its imports are done before it gives way to others: they take a minute of the lowest priority.
    """
    values = np.load(stored)
    if last:
        os.nice(LAST)  # before any thread is begun, as Linux sets it for one thread alone
    info = StreamInfo("simulated", ("all",), (values.shape[1],), RATE)
    source = Playback(RecordedStream(info, np.arange(len(values)) / RATE, values), loop=True)
    recorder = Recorder(path, info)
    sent = 0
    for block in blocks(source):
        for row in range(len(block)):
            recorder.put(Block(np.array([sent / RATE]), block.values[row : row + 1], 0.0))
            sent += 1
            os.write(1, REPORT.pack(sent))


if __name__ == "__main__":  # a child that is killed
    record_until_killed(Path(sys.argv[1]), Path(sys.argv[2]), last="--last" in sys.argv)
