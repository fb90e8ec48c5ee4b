"""A source: lines of numbers from a serial port (or a pipe), one line a sample."""

import os
import select
import time
import tty

import numpy as np

from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo


class SerialNumbers(Source):
    """Lines such as 12,0,255,7: raw values of one part, separated by commas or spaces."""

    def __init__(self, port, part, width):
        super().__init__(StreamInfo(f"serial {port}", (part,), (width,), 0.0, "raw", clock="local"))
        self._port, self._rest = os.open(port, os.O_RDONLY | os.O_NOCTTY), b""
        if os.isatty(self._port):
            tty.setraw(self._port)  # the speed is the port's: stty -F PORT 115200

    def read(self, timeout):
        """The lines that are whole by now; a line that is no sample counts as refused."""
        if self._port is None:
            raise SourceEnded
        rows = []
        if select.select([self._port], [], [], timeout)[0]:
            came = os.read(self._port, 1 << 16)
            if not came:
                raise SourceEnded
            *lines, self._rest = (self._rest + came)[-(1 << 20) :].split(b"\n")
            for line in filter(bytes.strip, lines):
                try:
                    row = np.array(line.replace(b",", b" ").split(), np.float32)
                except ValueError:
                    row = np.zeros(0)
                if len(row) == self.info.channels and np.isfinite(row).all():
                    rows.append(row)
                else:
                    self._counts.refused += 1
        now = time.perf_counter()
        return Block(np.full(len(rows), now), np.array(rows), now) if rows else None

    def close(self):
        """Give the port back; any number of times."""
        if self._port is not None:
            os.close(self._port)
            self._port = None


def open_serial(address, *, robot, parts, seed, speed, loop):
    """`serial:/dev/ttyUSB0`, of the part that --robot and --part name."""
    part = (parts or robot.parts)[0]
    return SerialNumbers(address, part, len(robot.skin(part)))
