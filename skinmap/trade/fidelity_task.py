"""The task `fidelity`: touches to learn from that cost more to simulate, judged one level up.

Trained on clean pads, tested on varied bodies; trained on those, tested on what MuJoCo presses;
trained on that, tested on another of its variants. Each level pays for the next one's trust.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.recognition.catalogue import DEFAULT, classifiers
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.evaluate import score
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate
from skinmap.trade.task import Knob, Outcome, Setting

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

LEARNT, TESTED = 8, 8  # touches of each gesture that are trained on, and named
SETTINGS: dict[str, Setting] = {  # of `skinmap simulate`
    "clean": {"physics": "ours", "variety": "none"},
    "varied": {"physics": "ours", "variety": "wide"},
    "mujoco": {"physics": "mujoco"},
}
LEVELS = tuple(SETTINGS)
UP = {"clean": "varied", "varied": "mujoco", "mujoco": "mujoco:flesh"}
VARIETY = {"clean": 0.0, "varied": 1.0}


@dataclass(frozen=True, eq=False, slots=True)
class Skins:
    """Skins to learn on and one to test on, the same one where there is no other."""

    learn: tuple[PreparedSkin, ...]
    test: PreparedSkin


class FidelityTask:
    """How touches to learn from are simulated."""

    name = "fidelity"
    unit = "%"
    work = "simulating one touch to learn from"
    truth = "touches of the next level up named wrong, on touches (of several parts: on a part) "
    truth += "held out; clean is tested on varied, varied on MuJoCo, MuJoCo on another variant"
    knobs = (
        Knob("physics", ("ours", "mujoco"), "ours", "the physics of the training touches"),
        Knob("variety", ("none", "some", "wide"), "wide", "how far our own touches are drawn"),
    )

    def settings(self) -> Sequence[Setting]:
        """All levels whose next one can be simulated here."""
        levels = LEVELS if find_spec("mujoco") else LEVELS[:1]
        return [SETTINGS[level] for level in levels]

    def prepare(self, robot: Robot, parts: tuple[str, ...], *, seed: int) -> Skins:
        """Skins that are meshed; of several parts another one is held out for each seed."""
        held_out = parts[seed % len(parts)]
        learn = tuple(part for part in parts if part != held_out) or (held_out,)
        skins = {part: PreparedSkin(robot.skin(part)) for part in parts}
        for skin in skins.values():
            _ = skin.geometry
        return Skins(tuple(skins[part] for part in learn), skins[held_out])

    def run(self, prepared: Skins, setting: Setting, *, seed: int) -> Outcome:
        """Simulate touches, learn from them, and name those of the next level."""
        level = next((name for name, one in SETTINGS.items() if one == setting), None)
        if level is None:
            raise InvalidArrayError(f"no fidelity {dict(setting)}; the settings are {SETTINGS}")
        learnt: list[Touch] = []
        started = time.process_time()
        for number, skin in enumerate(prepared.learn):
            learnt += simulated_at(level, skin, LEARNT, np.random.default_rng([seed, number]))
        simulating = time.process_time() - started
        started = time.process_time()
        model = classifiers.get(DEFAULT)().fit(learnt, rng=np.random.default_rng(seed))
        training = time.process_time() - started
        rng = np.random.default_rng([seed, len(prepared.learn)])
        tested = simulated_at(UP[level], prepared.test, TESTED, rng)
        wrong = 1.0 - score(model, tested).accuracy
        beside = {"training_seconds": training}
        return Outcome(simulating / max(len(learnt), 1), 100.0 * wrong, beside=beside)


def simulated_at(
    level: str, skin: PreparedSkin, per_gesture: int, rng: np.random.Generator
) -> list[Touch]:
    """Touches of the four gestures by a level of `LEVELS`, or `mujoco:VARIANT`."""
    name, _, variant = level.partition(":")
    if name in VARIETY:
        variety = VARIETY[name]
        recording = simulate(skin.skin, rng=rng, per_gesture=per_gesture, variety=variety)
    elif name == "mujoco":
        from skinmap.physics.simulation import simulate as press
        from skinmap.physics.variants import DEFAULT as FIRST

        recording = press(skin.skin, rng=rng, per_gesture=per_gesture, variant=variant or FIRST)
    else:
        raise InvalidArrayError(f"no fidelity {level!r}; the levels are {', '.join(LEVELS)}")
    return recorded_touches(skin, recording)


fidelity_task = FidelityTask()
