"""Two touches at once, grouped and named right on parts of the iCub that hold two (simulated).

    python -m benchmarks.classify.touches [--seeds 5] [--touches 12]

writes benchmarks/results/touches.json. Scores are per touch event, and "unknown" counts as wrong.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.origin import watched
from benchmarks.harness.record import RESULTS, about, write
from skinmap.classifiers.classifier import classifiers
from skinmap.classifiers.descriptors import Touch
from skinmap.classifiers.naming import all_right, name_touches
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR
from skinmap.touch.simulation.pairs import simulate_pairs
from skinmap.touch.simulation.simulator import simulate

TRAINED_PARTS = ("torso", "left_leg_upper", "left_foot", "right_forearm")


def touches_on(skin: PreparedSkin, count: int, rng: np.random.Generator) -> list[Touch]:
    """Simulated touches of a skin, as they were recorded."""
    recording = simulate(skin.skin, rng=rng, per_gesture=count, gestures=FOUR)
    return [
        Touch(skin, samples, label, rate=recording.rate)
        for _, label, samples in recording.touches()
    ]


def measure(seeds: int, count: int) -> dict[str, Any]:
    """Shares of pairs with both names right, and of single touches under the same grouping."""
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    right: dict[str, list[bool]] = {part: [] for part in skins}
    two: list[bool] = []
    alone: list[bool] = []
    for seed in range(seeds):
        rngs = np.random.default_rng(seed).spawn(len(TRAINED_PARTS))
        train = [
            touch
            for part, rng in zip(TRAINED_PARTS, rngs, strict=True)
            for touch in touches_on(skins[part], 2 * count, rng)
        ]
        model = classifiers.get("contact-geometry")().fit(train, rng=np.random.default_rng(seed))
        for number, (part, skin) in enumerate(skins.items()):
            rng = np.random.default_rng([seed, number])
            recording = simulate_pairs(skin.skin, rng=rng, count=count)
            owners = recording.owners
            for event, label, samples in recording.touches():
                named = name_touches(model, skin, samples)
                own = None if owners is None else owners[event]
                right[part].append(all_right(named, samples, label, own))
                two.append(len(named) == 2)
            for touch in touches_on(skin, max(2, count // 3), np.random.default_rng(50 + seed)):
                named = name_touches(model, skin, touch.samples)
                alone.append(all_right(named, touch.samples, touch.label))
    every = [one for hits in right.values() for one in hits]
    return {
        "trained_on": TRAINED_PARTS,
        "both_right": float(np.mean(every)),
        "two_touches_found": float(np.mean(two)),
        "single_touches_right": float(np.mean(alone)),
        "pairs": len(every),
        "per_part": {part: float(np.mean(hits)) for part, hits in right.items() if hits},
        "run": {"seeds": seeds, "touches_per_gesture": count},
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--touches", type=int, default=12)
    options = parser.parse_args()
    head = about("full")
    with watched() as pieces:
        pairs = measure(options.seeds, options.touches)
    made = {**head, "code": " ".join(sorted(pieces))}
    write(RESULTS / "touches.json", {"made": made, "accuracy_is": "simulated", "pairs": pairs})
