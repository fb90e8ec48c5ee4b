"""A robot's MuJoCo model as a live source: `mujoco:FILE`.

Bodies of ours touch it, one gesture after another, unless the model has bodies of its own that
move freely: then those do.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.sources.simulated_source import MadeSource, TrueTouch
from skinmap.live.sources.source import SIMULATION, describe_skins
from skinmap.physics.pressing import SpringBed
from skinmap.physics.robot_model import RobotModel
from skinmap.physics.simulation import place_at
from skinmap.skin.robot import Robot
from skinmap.touch.simulation.gestures import LONG_ON_SKIN, ON_SKIN
from skinmap.touch.simulation.simulator import TRIES
from skinmap.touch.simulation.variety import Sensing, Sensors

ABOVE = 6e-3  # pressers come from so far above the skin [m]
REMEMBERED = 1000  # touches in `truth`, and poses kept for who draws them
# Arrives, presses fully, lets go, leaves, is gone [s], and shares of the full force then.
COURSE = (0.0, 0.2, 0.4, 1.2, 1.35, 1.6)
SHARES = (0.6, 0.6, 1.0, 1.0, 0.0, -1.0)
PAUSE = 0.3  # mean time between two touches [s]


class MujocoTouching:
    """Makes samples of a stepped model, chunk by chunk; the same ones for the same seed.

    Parameters
    ----------
    robot : Robot
    path : Path
        Its model.
    parts : sequence of str, optional
        Only these.
    seed : int
    """

    def __init__(self, robot: Robot, path: Path, *, parts: Sequence[str] | None, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self.model = RobotModel(path, robot, parts=parts, rng=self._rng)
        sensing = Sensing(rate=self.model.rate)
        self._skins = [robot.skin(part) for part in self.model.parts]
        self._sensors = [Sensors(skin, sensing, rng=self._rng) for skin in self._skins]
        self._beds: dict[int, SpringBed] = {}
        self._playing: tuple[str, int] | None = None  # presser, and the sample that it began with
        self._next, self._now = 0, 0
        self.truth: deque[TrueTouch] = deque(maxlen=REMEMBERED)
        self.angles: deque[tuple[float, dict[str, float]]] = deque(maxlen=REMEMBERED)

    def make(self, count: int) -> NDArray[np.uint8]:
        """The next samples (count, channels), 0 at rest to 255."""
        loads = [np.zeros((count, len(skin))) for skin in self._skins]
        for row in range(count):
            for one, felt in zip(loads, self.model.sample(self._shares()), strict=True):
                one[row] = felt
            self.angles.append((self._now / self.model.rate, self.model.angles()))
            self._now += 1
        read = [
            sensors.read(one, rng=self._rng)
            for sensors, one in zip(self._sensors, loads, strict=True)
        ]
        return np.concatenate(read, axis=1)

    def _shares(self) -> FloatArray | None:
        """Share of the full force of each of our motors at the next sample."""
        if self.model.own:
            return None
        shares = np.zeros(self.model.motor_count)
        if self._playing is None and self._now >= self._next:
            self._begin()
        if self._playing is not None:
            name, began = self._playing
            time = (self._now - began) / self.model.rate
            if time >= COURSE[-1]:
                self.model.put(name, None)
                self._playing = None
                pause = float(self._rng.exponential(PAUSE))
                self._next = self._now + 1 + round(pause * self.model.rate)
            else:
                shares[self.model.motors(name)] = np.interp(time, COURSE, SHARES)
        return shares

    def _begin(self) -> None:
        """Put the presser of a gesture above a place that it fits."""
        name = str(self._rng.choice(list(self.model.pressers)))
        presser = self.model.pressers[name]
        for _ in range(TRIES):
            part = int(self._rng.integers(len(self._skins)))
            if part not in self._beds:
                self._beds[part] = SpringBed(self._skins[part])
            taxel = int(self._rng.integers(len(self._skins[part])))
            angle = float(self._rng.uniform(0.0, 2.0 * np.pi))
            found = place_at(self._beds[part], presser, taxel, angle)
            if found is not None and found[1] >= LONG_ON_SKIN.get(name, ON_SKIN):
                frames = self.model.link_pose(part) @ found[0].frames
                frames[:, :3, 3] += (ABOVE + _lowest(name)) * frames[:, :3, 2]
                self.model.put(name, frames)
                self._playing = name, self._now
                began = (self._now / self.model.rate) + COURSE[1]
                ended = began + COURSE[-2] - COURSE[1]
                self.truth.append(TrueTouch(self._skins[part].part, name, began, ended))
                return
        self._next = self._now + 1


def _lowest(name: str) -> float:
    """How far a presser reaches below its mount [m]."""
    return 12e-3 if name == "whole_hand" else 8e-3


class MujocoSource(MadeSource):
    """A stepped MuJoCo model: a `Source`.

    Parameters
    ----------
    robot : Robot
    path : Path
        MJCF with tactile sensors of the parts' names.
    parts : sequence of str, optional
        Only these.
    seed : int
    speed : float
        Speed as a multiple of the clock's; `inf` gives samples as soon as they are read.
    """

    def __init__(
        self, robot: Robot, path: Path, *, parts: Sequence[str] | None, seed: int, speed: float
    ) -> None:
        touching = MujocoTouching(robot, path, parts=parts, seed=seed)
        name, skins = f"mujoco {path.name}", [robot.skin(part) for part in touching.model.parts]
        info = describe_skins(name, robot.name, skins, touching.model.rate, "pressure", SIMULATION)
        self._angles = touching.angles
        super().__init__(info, touching.make, touching.truth, speed=speed)

    def angles_at(self, time: float) -> Mapping[str, float]:
        """Joint angles [rad] at a sample's time [s]."""
        return min(tuple(self._angles), key=lambda one: abs(one[0] - time), default=(time, {}))[1]


def open_mujoco(address: str, *, robot: Robot | None, loop: bool, **wish: Any) -> MujocoSource:
    """Open `mujoco:FILE`, which never ends."""
    if not address:
        raise InvalidArrayError("a MuJoCo source names its model: 'mujoco:robot.xml'")
    return MujocoSource(robot or load_robot("icub"), Path(address), **wish)
