"""Few touches a class, of some people, and touches of other people to judge by (simulated).

Half of ten simulated people give the training, the other half the test, on the same skin, with
variety on. The control permutes the labels of the training. Prints one JSON object:
`python -m benchmarks.classify.few_shot > benchmarks/results/few_shot.json` (3 minutes).
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.record import about
from skinmap.recognition.classifier import DEFAULT, classifiers
from skinmap.recognition.descriptors import ContactGeometry, Touch, recorded_touches
from skinmap.recognition.evaluate import score
from skinmap.touch.prepared_skin import PreparedSkin

ROBOT = "icub"
PARTS = ("torso", "left_arm", "right_forearm", "left_hand")
COUNTS = (5, 10, 20)
PER_GESTURE = 70  # of each on each part: 7 of a person
TRIALS = 8  # splits of the people of each drawing
SEEDS = (0, 1, 2)


def draw(part: str, *, seed: int, per_gesture: int = PER_GESTURE) -> list[Touch]:
    """Touches of ten people on a part."""
    skin = PreparedSkin(skinmap.load_robot(ROBOT).skin(part))
    made = skinmap.simulate(skin.skin, rng=seed, per_gesture=per_gesture)
    return recorded_touches(skin, replace(made, people=tuple(map(str, made.subjects))))


def judge(touches: Sequence[Touch], count: int, *, seed: int, mixed: bool = False) -> float:
    """Mean of the classes, of people left out, by a model of `count` touches a class.

    With `mixed` the labels of the training are permuted: the control.
    """
    rng = np.random.default_rng(seed)
    people = rng.permutation(sorted({touch.person for touch in touches}))
    learn = set(people[: len(people) // 2].tolist())
    own = [touches[k] for k in rng.permutation(len(touches)) if touches[k].person in learn]
    # Nobody marks what the skin did not feel; in the test it counts as wrong.
    own = [touch for touch in own if len(ContactGeometry().describe(touch))]
    # A gesture that hardly fits on a part (a hand on a small one) is no class there.
    labels = [name for name, have in Counter(t.label for t in own).items() if have >= COUNTS[0]]
    train = [one for name in labels for one in [t for t in own if t.label == name][:count]]
    if mixed:
        words = rng.permutation([one.label for one in train])
        train = [replace(t, label=str(w)) for t, w in zip(train, words, strict=True)]
    model = classifiers.get(DEFAULT)().fit(train, rng=rng)
    judged = [t for t in touches if t.person not in learn and t.label in labels]
    found = score(model, judged)
    return float(np.mean(list(found.per_label.values())))


def measure(
    *,
    parts: Sequence[str] = PARTS,
    trials: int = TRIALS,
    per_gesture: int = PER_GESTURE,
    seeds: Sequence[int] = SEEDS,
) -> dict[str, Any]:
    """Accuracy by number of touches a class, of each part and of all, and the control.

    A seed draws people, touches and sensors anew; its figure is the mean over parts and trials.
    """
    found: dict[tuple[int, str, int], list[float]] = {}
    mixed = []
    for seed in seeds:
        for number, part in enumerate(parts):
            touches = draw(part, seed=1000 * seed + 100 * number, per_gesture=per_gesture)
            for count in COUNTS:
                found[seed, part, count] = [judge(touches, count, seed=t) for t in range(trials)]
            mixed += [judge(touches, COUNTS[0], seed=t, mixed=True) for t in range(min(trials, 3))]
    by_seed = {
        count: [float(np.mean([found[seed, part, count] for part in parts])) for seed in seeds]
        for count in COUNTS
    }
    return {
        "simulated": True,
        "trials": trials,
        "seeds": list(seeds),
        "mean": {str(count): float(np.mean(means)) for count, means in by_seed.items()},
        "by_seed": {str(count): means for count, means in by_seed.items()},
        "spread": {str(count): float(np.std(means)) for count, means in by_seed.items()},
        "control_permuted_labels": float(np.mean(mixed)),
        "parts": [
            {
                "part": part, "touches_a_class": count,
                "mean": float(np.mean([found[seed, part, count] for seed in seeds])),
            }
            for part in parts
            for count in COUNTS
        ],
    }  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--seeds", type=int, default=len(SEEDS))
    chosen = parser.parse_args()
    result = measure(trials=chosen.trials, seeds=range(chosen.seeds))
    print(json.dumps({**about("full"), **result}, indent=1))
