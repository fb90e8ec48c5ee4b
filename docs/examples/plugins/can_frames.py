"""A source: frames of a CAN bus, seven taxels each, from SocketCAN or a log of `candump -l`."""

import select
import socket
import struct
import time
from pathlib import Path

import numpy as np

from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo

FRAME = struct.Struct("<IB3x8s")  # struct can_frame of linux/can.h: number, length, data
FIRST, TAXELS = 0x200, 7  # frame 0x200 + k holds a sample's number and taxels 7k to 7k + 6


class CanFrames(Source):
    """A sample is whole when frames of one number have brought all its taxels."""

    def __init__(self, receive, part, width):
        super().__init__(StreamInfo("can", (part,), (width,), 0.0, "raw", clock="local"))
        self._receive, self._number, self._closed = receive, None, False
        self._row, self._missing = np.zeros(width, np.uint8), set()

    def read(self, timeout):
        """The sample that the next frames make whole; None where none does in time."""
        end = time.perf_counter() + timeout
        while not self._closed and (frame := self._receive(end - time.perf_counter())):
            now, (number, length, data) = time.perf_counter(), FRAME.unpack(frame)
            start = TAXELS * ((number & 0x7FF) - FIRST)
            if length != 8 or not 0 <= start < len(self._row):
                self._counts.refused += 1
                continue
            if data[0] != self._number:  # another sample begins: what was not whole is lost
                self._counts.lost += bool(self._missing)
                self._number, self._missing = data[0], set(range(0, len(self._row), TAXELS))
            self._row[start : start + TAXELS] = list(data[1:])[: len(self._row) - start]
            self._missing.discard(start)
            if not self._missing:
                return Block(np.array([now]), self._row[None].copy(), now)
        if self._closed or frame == b"":
            raise SourceEnded
        return None

    def close(self):
        """Read no more; any number of times."""
        self._closed = True


def bus(name):
    """Frames of an interface: None where none comes in time."""
    port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    port.bind((name,))
    return lambda left: port.recv(16) if select.select([port], [], [], max(left, 0))[0] else None


def log(path):
    """Frames of a log, `(1700000000.00) can0 200#00112233`; b"" at its end."""
    fields = (line.split()[2].split("#") for line in Path(path).read_text().splitlines())
    frames = (FRAME.pack(int(n, 16), len(d) // 2, bytes.fromhex(d)) for n, d in fields)
    return lambda left: next(frames, b"")


def open_can(address, *, robot, parts, seed, speed, loop):
    """`can:can0`, or `can:touch.log`, of the part that --robot and --part name."""
    part = (parts or robot.parts)[0]
    receive = log(address) if Path(address).is_file() else bus(address)
    return CanFrames(receive, part, len(robot.skin(part)))
