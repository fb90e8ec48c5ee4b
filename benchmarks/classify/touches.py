"""Two touches at once, grouped and named right on parts of the iCub that hold two (simulated).

    python -m benchmarks.classify.touches [--quick]

writes benchmarks/results/touches.json: touches that vary, and plain ones of fixed pads on clean
sensors, each learnt from their own kind. Scores are per touch event, and "unknown" counts as wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.record import command
from skinmap.recognition.classifier import TouchClassifier
from skinmap.recognition.descriptors import Touch, recorded_touches
from skinmap.recognition.naming import all_right, name_touches
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate, simulate_pairs

Wanted = Sequence[tuple[Sequence[str], int]]  # gestures, and how many touches of each
TRAINED_PARTS = ("torso", "left_leg_upper", "left_foot", "right_forearm")


def touches_of(
    skin: PreparedSkin, make: Callable[..., Recording], wanted: Wanted, **how: Any
) -> list[Touch]:
    """Touches that a simulator makes on one skin: gestures, and how many of each, in turn."""
    found = []
    for gestures, count in wanted:
        made = make(skin.skin, gestures=gestures, per_gesture=count, **how)
        found += recorded_touches(skin, made)
    return found


def skins_of(robot: str, parts: Sequence[str] = ()) -> dict[str, PreparedSkin]:
    """Some parts of a robot, or all, ready to be touched."""
    loaded = skinmap.load_robot(robot)
    return {part: PreparedSkin(loaded.skin(part)) for part in parts or loaded.parts}


def measure(quick: bool) -> dict[str, Any]:
    """Touches that vary, and plain ones."""
    seeds, count = (1, 2) if quick else (5, 12)
    pairs = {"pairs": 1.0, "plain_pairs": 0.0}
    rows = {name: pair_row(variety, seeds, count) for name, variety in pairs.items()}
    return {"accuracy_is": "simulated", **rows}


def pair_row(variety: float, seeds: int, count: int) -> dict[str, Any]:
    """Shares of pairs with both names right, and of single touches under the same grouping."""
    robot, skins = skinmap.load_robot("icub"), skins_of("icub")
    both: list[bool] = []
    two: list[bool] = []
    alone: list[bool] = []
    for seed in range(seeds):
        rngs = np.random.default_rng(seed).spawn(len(TRAINED_PARTS))
        train = [
            simulate(robot.skin(part), rng=rng, per_gesture=2 * count, variety=variety)
            for part, rng in zip(TRAINED_PARTS, rngs, strict=True)
        ]
        model = skinmap.train(train, robot, classifier="contact-geometry", rng=seed)
        for number, skin in enumerate(skins.values()):
            rng = np.random.default_rng([seed, number])
            pairs = simulate_pairs(skin.skin, rng=rng, count=count, variety=variety)
            hits, found = named(model, skin, pairs)
            both += hits
            two += [touches == 2 for touches in found]
            rng = np.random.default_rng([50 + seed, number])
            single = simulate(skin.skin, rng=rng, per_gesture=max(2, count // 3), variety=variety)
            alone += named(model, skin, single)[0]
    return {
        "variety": variety,
        "trained_on": TRAINED_PARTS,
        "both_right": float(np.mean(both)),
        "two_touches_found": float(np.mean(two)),
        "single_touches_right": float(np.mean(alone)),
        "pairs": len(both),
    }


def named(
    model: TouchClassifier, skin: PreparedSkin, recording: Recording
) -> tuple[list[bool], list[int]]:
    """Of each event whether it was understood in full, and how many touches were found."""
    rest, hits, found = recording.rest(), [], []
    for event, label, samples in recording.touches():
        owners = None if recording.owners is None else recording.owners[event]
        touches = name_touches(model, skin, samples, rest=rest)
        hits.append(all_right(touches, samples, label, owners))
        found.append(len(touches))
    return hits, found


if __name__ == "__main__":
    command(measure, __doc__, "touches")
