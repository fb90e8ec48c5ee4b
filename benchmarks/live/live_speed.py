"""One sample of a whole robot to its labels: pressures, contacts, touches, names."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.timing import quartiles
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.naming import name_touches
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

TOUCHED = ("torso", "right_forearm", "left_arm", "left_leg_upper", "right_leg_upper")


def train(
    skins: dict[str, PreparedSkin], name: str = "contact-geometry", each: int = 16
) -> TouchClassifier:
    """A classifier that learnt on two parts."""
    rng = np.random.default_rng(2)
    touches = [
        Touch(skins[part], samples, label, rate=50.0)
        for part in TOUCHED[:2]
        for _, label, samples in simulate(skins[part].skin, rng=rng, per_gesture=each).touches()
    ]
    return classifiers.get(name)().fit(touches, rng=rng)


def live_rows(quick: bool) -> list[dict[str, Any]]:
    """One sample of a touch, without a past, to its labels, by each classifier."""
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in TOUCHED[:2]}
    skin, rng = skins["torso"], np.random.default_rng(3)
    recorded = simulate(skin.skin, rng=rng, per_gesture=4).touches()
    # The middle of each touch: a sample of a hand at rest on the skin.
    middles = [samples[len(samples) // 2] for _, _, samples in recorded]
    rows = []
    for name in ("contact-geometry", "histogram"):
        model = train(skins, name, 8 if quick else 16)
        model.prepare(skin)
        cost = np.zeros(len(middles))
        for _ in range(3):  # the first time warms up
            for number, sample in enumerate(middles):
                start = time.process_time()
                name_touches(model, skin, sample[None])
                cost[number] = (time.process_time() - start) * 1e3
        found = {"mean": float(cost.mean()), "quartiles": quartiles(cost)}
        rows.append({"classifier": name, "one_sample_alone_1_touched_ms": found})
    return rows
