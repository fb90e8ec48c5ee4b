"""A source: frames of a CAN bus, seven taxels each, from SocketCAN or a log of `candump -l`."""

import select
import socket
import struct
from pathlib import Path

import numpy as np

from skinmap.live import PolledSource

FRAME = struct.Struct("<IB3x8s")  # struct can_frame of linux/can.h: number, length, data
FIRST, TAXELS = 0x200, 7  # frame 0x200 + k holds a sample's number and taxels 7k to 7k + 6


def open_can(address, *, robot, parts, seed, speed, loop):
    """`can:can0`, or `can:touch.log`, of the part that --robot and --part name."""
    part = (parts or robot.parts)[0]
    row, number, missing = np.zeros(len(robot.skin(part)), np.uint8), None, set()
    receive = log(address) if Path(address).is_file() else bus(address)

    def samples(timeout, counts):
        """A sample that the next frame makes whole: all its taxels came under one number."""
        nonlocal number, missing
        if (frame := receive(timeout)) is None:
            return []
        place, length, data = FRAME.unpack(frame)
        start = TAXELS * ((place & 0x7FF) - FIRST)
        if length != 8 or not 0 <= start < len(row):
            counts.refused += 1
            return []
        if data[0] != number:  # another sample begins: what was not whole is lost
            counts.lost += bool(missing)
            number, missing = data[0], set(range(0, len(row), TAXELS))
        row[start : start + TAXELS] = list(data[1:])[: len(row) - start]
        missing.discard(start)
        return [] if missing else [row.copy()]

    return PolledSource("can", part, len(row), samples)


def bus(name):
    """Frames of an interface: None where none comes in time."""
    port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    port.bind((name,))
    return lambda left: port.recv(16) if select.select([port], [], [], left)[0] else None


def log(path):
    """Frames of a log, `(1700000000.00) can0 200#00112233`, to its end."""
    fields = (line.split()[2].split("#") for line in Path(path).read_text().splitlines())
    frames = (FRAME.pack(int(n, 16), len(d) // 2, bytes.fromhex(d)) for n, d in fields)
    return lambda left: next(frames, None) or end()


def end():
    """No frame more."""
    raise EOFError
