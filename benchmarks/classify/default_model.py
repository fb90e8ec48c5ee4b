"""The model that comes with Skinmap, judged where it did not learn.

    python -m benchmarks.classify.default_model [--touches 4]

writes benchmarks/results/default_model.json. It learnt on the iCub alone, so the other robots'
skins are new to it, their people and sensors too; of MuJoCo it never saw the frozen variant. The
control is the same touch with its samples in random order: what a name owes to how a touch goes on
is gone. Sets of names are promised for 90 %; theirs is a model that takes all touches for familiar.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.harness.record import RESULTS, about, write
from skinmap.io.robots.manifest import load_robot
from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import FROZEN
from skinmap.recognition.classifier import TouchClassifier
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.named_classifiers import DEFAULT_FILE, default_model
from skinmap.recognition.protocols.physics import COVERAGE, judged
from skinmap.recognition.protocols.results import PhysicsRow
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.simulator import simulate

OUT = RESULTS / "default_model.json"
SKINS = {
    "ur10e-cyskin": ("upper_arm_1", "forearm_1"),
    "kaspar": ("torso", "right_arm", "right_hand", "right_foot"),
    "baxter-forearm": ("forearm",),
}
STATES = 3  # of the sensors of each part
PRESSED = ("torso", "left_arm", "left_forearm", "left_leg_upper", "left_leg_lower", "left_foot")
SEED = 4000  # far from those that it was trained with


def other_robot(name: str, count: int) -> list[Touch]:
    """Touches of ours on the skins of a robot that the model never saw."""
    robot = load_robot(name)
    found = []
    for number, part in enumerate(SKINS[name]):
        skin = PreparedSkin(robot.skin(part))
        for state in range(STATES):
            rng = np.random.default_rng([SEED, number, state])
            made = simulate(skin.skin, rng=rng, per_gesture=count, gestures=(*FOUR, *TIME))
            found += recorded_touches(skin, made)
    return found


def frozen_variant(count: int) -> list[Touch]:
    """Touches of the physics that nothing was trained or tuned on, on parts of the iCub."""
    robot = load_robot("icub")
    found = []
    for number, part in enumerate(PRESSED):
        skin, rng = PreparedSkin(robot.skin(part)), np.random.default_rng([SEED, number])
        for gestures, touches in ((FOUR, 2 * count), (TIME, max(1, count // 2))):
            made = press(skin.skin, rng=rng, variant=FROZEN, per_gesture=touches, gestures=gestures)
            found += recorded_touches(skin, made)
    return found


def row(where: str, touches: Sequence[Touch], labels: Sequence[str]) -> dict[str, Any]:
    """How the touches of some labels are named, and with their samples in random order."""
    own = [touch for touch in touches if touch.label in labels]
    rng = np.random.default_rng(SEED)
    mixed = [replace(one, samples=rng.permutation(one.samples)) for one in own]
    found, control = named(where, own), named(where, mixed)
    held, size = sets(own, default_model())
    blind = default_model()
    blind.strangeness = lambda touch: 0.0  # type: ignore[method-assign]
    if blind.sets is not None:
        blind.sets = replace(blind.sets, strange=np.zeros(len(blind.sets.shares)))
    return {
        "tested_on": where,
        "kind": "still" if labels == FOUR else "in time",
        "touches": len(own),
        "mean": found.mean,
        "ece": found.ece,
        "in_random_order": control.mean,
        "sets_held": held,
        "names_in_a_set": size,
        "sets_held_as_familiar": sets(own, blind)[0],
        "per_class": found.per_class,
    }


def named(where: str, touches: Sequence[Touch]) -> PhysicsRow:
    """Names by the model, among all that it knows."""
    model = default_model()
    guesses = [(touch.label, likeliest(model, touch)) for touch in touches]
    said = [(true, one.label, one.confidence) for true, one in guesses]
    return judged("default", where, model.labels, said)


def sets(touches: Sequence[Touch], model: TouchClassifier) -> tuple[float, float]:
    """Share of the touches whose set of names holds the true one, and names in a set."""
    model.promise(COVERAGE)
    found = [model.predict(touch).names or () for touch in touches]
    held = [touch.label in names for touch, names in zip(touches, found, strict=True)]
    return float(np.mean(held)), float(np.mean([len(names) for names in found]))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=4, help="of each gesture on each skin")
    count = parser.parse_args().touches
    began = time.process_time()
    model = default_model()
    loading = time.process_time() - began
    tests = {name: other_robot(name, count) for name in SKINS}
    tests[f"MuJoCo, {FROZEN}"] = frozen_variant(count)
    rows = [row(where, one, kind) for where, one in tests.items() for kind in (FOUR, TIME)]
    for one in rows:
        print(
            f"{one['tested_on']}, {one['kind']}: {100 * one['mean']:.1f} % of {one['touches']}, "
            f"ece {one['ece']:.2f}, in random order {100 * one['in_random_order']:.1f} %; "
            f"sets hold {100 * one['sets_held']:.1f} % by {one['names_in_a_set']:.2f} names, "
            f"as familiar {100 * one['sets_held_as_familiar']:.1f} %"
        )
    size = {
        "kilobytes": DEFAULT_FILE.stat().st_size / 1e3,
        "support_vectors": len(model.estimator.vectors_),
    }
    write(OUT, {**about("full"), **size, "loading_cpu_seconds": loading, "rows": rows})


if __name__ == "__main__":
    main()
