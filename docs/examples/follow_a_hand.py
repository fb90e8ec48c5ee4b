"""A robot that stops for anything that touches it, and follows a hand.

    python docs/examples/follow_a_hand.py [SOURCE] [SECONDS]

SOURCE is anything that `skinmap classify` follows: `sim:whole_hand,elbow` (the default),
`lsl:NAME`, `zmq:HOST:PORT`. The robot stops in the first sample of a touch, whatever it is. It
yields to the touch only when that is answered `hand`, and stays where it is for `other` and
`unsure`. Here the "robot" prints what it would do; put your own `stop`, `follow` and `go_on` in
its place.

The delay is measured from the arrival of a sample here to the command. It holds neither the
sensor's own delay nor the network's (docs/live.md measures these).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np

import skinmap
from skinmap.live import Moment
from skinmap.live.sources.source import SourceEnded
from skinmap.recognition import default_model

GAIN = 0.5  # of the way that the hand goes, so that a push is not answered by a jump
WAIT = 0.2  # so often a silent source lets an interruption through [s]


@dataclass
class PrintedRobot:
    """What a robot's driver would get, printed and kept."""

    done: list[str] = field(default_factory=list)

    def stop(self, part: str) -> None:
        """Stand still, at once."""
        self._do(f"stop: {part} is touched")

    def follow(self, part: str, velocity: np.ndarray) -> None:
        """Move with a hand at a velocity in the frame of the part's link [m/s]."""
        self._do(f"follow the hand on {part} at {1e3 * np.linalg.norm(velocity):.0f} mm/s")

    def go_on(self) -> None:
        """Nothing touches any more."""
        self._do("go on")

    def _do(self, what: str) -> None:
        if not self.done or self.done[-1] != what:
            print(what)  # noqa: T201
            self.done.append(what)


class Follower:
    """Decides from each moment what a robot does.

    Parameters
    ----------
    robot : PrintedRobot
        Or anything with `stop`, `follow` and `go_on`.
    """

    def __init__(self, robot: PrintedRobot) -> None:
        self.robot, self.stopped = robot, False
        self.stop_ms: list[float] = []
        self.follow_ms: list[float] = []

    def decide(self, moment: Moment) -> None:
        """Stop for any touch, also while nothing is heard; follow if all that touch are hands."""
        if moment.stale or moment.touches:
            if not self.stopped:
                self.stopped = True
                self.robot.stop(moment.touches[0].part if moment.touches else "nobody knows what")
                self._measured(self.stop_ms, moment)
            hands = [one.hand is not None and one.hand.answer == "hand" for one in moment.touches]
            if not moment.stale and all(hands):
                touch = moment.touches[0]
                still = np.zeros(3)
                velocity = still if touch.motion is None else touch.motion.velocity
                self.robot.follow(touch.part, GAIN * velocity)
                self._measured(self.follow_ms, moment)
        elif self.stopped:
            self.stopped = False
            self.robot.go_on()

    @staticmethod
    def _measured(delays: list[float], moment: Moment) -> None:
        if np.isfinite(moment.latency):
            delays.append(1e3 * moment.latency)


def follow(source: str, seconds: float, *, speed: float = 1.0, seed: int = 0) -> Follower:
    """Follow a source on the iCub for so long [s] by its own clock."""
    robot = skinmap.load_robot("icub")
    opened = skinmap.open_source(source, robot=robot, speed=speed, seed=seed)
    loop = skinmap.TouchLoop(robot, opened, classifier=default_model())
    follower, end = Follower(PrintedRobot()), float("nan")
    try:
        while True:
            moment = loop.step(WAIT)
            if moment is None:
                continue
            end = moment.time + seconds if end != end else end
            follower.decide(moment)
            if moment.time >= end:
                break
    except (SourceEnded, KeyboardInterrupt):
        pass
    finally:
        loop.close()
    return follower


def main() -> None:
    """As a program."""
    source = sys.argv[1] if len(sys.argv) > 1 else "sim:whole_hand,elbow"
    follower = follow(source, float(sys.argv[2]) if len(sys.argv) > 2 else 15.0)
    for what, delays in (("stop", follower.stop_ms), ("follow", follower.follow_ms)):
        if delays:
            median, most = np.median(delays), max(delays)
            words = f"{what}: {median:.1f} ms from a sample to the command (median)"
            print(f"{words}, {most:.1f} at most")  # noqa: T201


if __name__ == "__main__":
    main()
