"""A source: lines of numbers such as 12,0,255,7 from a serial port (or a pipe), one a sample."""

import os
import select
import tty

from skinmap.live import PolledSource


def open_serial(address, *, robot, parts, seed, speed, loop):
    """`serial:/dev/ttyUSB0`, of the part that --robot and --part name."""
    part = (parts or robot.parts)[0]
    port, rest = os.open(address, os.O_RDONLY | os.O_NOCTTY), b""
    if os.isatty(port):
        tty.setraw(port)  # the speed is the port's: stty -F PORT 115200

    def lines(timeout, counts):
        """Those that are whole by now."""
        nonlocal rest
        if not select.select([port], [], [], timeout)[0]:
            return []
        if not (came := os.read(port, 1 << 16)):
            raise EOFError
        *whole, rest = (rest + came)[-(1 << 20) :].split(b"\n")
        return [line.replace(b",", b" ").split() for line in whole if line.strip()]

    taxels = len(robot.skin(part))
    return PolledSource(f"serial {address}", part, taxels, lines, lambda: os.close(port))
