"""The task `motion`: which way a touch moves, by window and by where velocities come from."""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

import numpy as np

from skinmap.live.contacts.stroke_errors import StrokeError, stroke_errors
from skinmap.profile import Value
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulator import simulate
from skinmap.trade.task import Knob, Outcome, Setting, product

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

STROKES = 12  # on each part
Strokes = tuple[tuple[PreparedSkin, Recording], ...]


class MotionTask:
    """Following simulated strokes."""

    name = "motion"
    unit = "%"
    work = "following one sample of a stroke"
    truth = "speed of simulated strokes of 5 cm or more, median error"
    knobs = (
        Knob("motion", ("places", "flow"), "places", "where velocities come from"),
        Knob("window_ms", (100.0, 200.0, 400.0), 200.0, "that velocities are taken from, at least"),
    )

    def settings(self) -> Sequence[Setting]:
        """Every combination; flow only where OpenCV is installed."""
        every = product(self.knobs)
        return [one for one in every if one["motion"] == "places" or find_spec("cv2")]

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Strokes:
        """Strokes on each part."""
        found = []
        for number, name in enumerate(parts):
            skin = PreparedSkin(robot.skin(name))
            rng = np.random.default_rng([seed, number])
            made = simulate(skin.skin, rng=rng, gestures=["stroke"], per_gesture=STROKES)
            found.append((skin, made))
        return tuple(found)

    def run(self, prepared: Strokes, setting: Setting, *, seed: int) -> Outcome:
        """Follow every stroke once."""
        del seed
        value: Value = setting["motion"]
        method: Literal["places", "flow"] = "flow" if value == "flow" else "places"
        errors: list[StrokeError] = []
        began = time.process_time()
        for skin, made in prepared:
            window = float(setting["window_ms"]) / 1e3
            errors += stroke_errors(skin, made, window=window, method=method)
        samples = sum(int((made.events >= 0).sum()) for _, made in prepared)
        seconds = (time.process_time() - began) / max(samples, 1)
        speed = 100.0 * float(np.median([abs(one.speed) for one in errors])) if errors else 100.0
        direction = float(np.nanmedian([one.direction for one in errors])) if errors else 180.0
        return Outcome(seconds, speed, beside={"direction_deg": direction})


motion_task = MotionTask()
