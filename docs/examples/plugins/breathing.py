"""A source: all taxels of a part go up and down together, 50 times a second."""

import time

import numpy as np

import skinmap
from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo


class Breathing(Source):
    """What a source defines: `info`, `read` and `close`."""

    def __init__(self, robot, part, seconds):
        super().__init__(StreamInfo("breathing", (part,), (len(robot.skin(part)),), 50.0))
        self._began, self._sent = time.monotonic(), 0
        self._last = int(50 * seconds)
        self._closed = False

    def read(self, timeout):
        """All samples that are due by now; None where there are none within the timeout."""
        if self._closed or self._sent >= self._last:
            raise SourceEnded("breathing")
        due = self._began + self._sent / 50.0
        time.sleep(min(timeout, max(0.0, due - time.monotonic())))
        ready = min(int(50 * (time.monotonic() - self._began)) + 1, self._last) - self._sent
        if ready <= 0:
            return None
        times = (self._sent + np.arange(ready)) / 50.0
        self._sent += ready
        level = (60 * (1 - np.cos(2 * np.pi * times / 2.0))).astype(np.float32)
        values = np.repeat(level[:, None], self.info.channels, axis=1)
        return Block(times, values, time.perf_counter())

    def close(self):
        """Stop; any number of times."""
        self._closed = True


def open_breathing(address, *, robot, parts, seed, speed, loop):
    """`breathing:3` breathes for three seconds on the first part asked for."""
    robot = skinmap.load_robot("icub") if robot is None else robot
    part = (parts or robot.parts)[0]
    return Breathing(robot, part, float(address or "inf"))
