"""Make the model that comes with Skinmap, skinmap/classifiers/default.skinmodel, from its seeds.

    python scripts/default_model.py [FILE]

It learns from simulated touches on all parts of the iCub: ours, that vary, on sensors of six states
a part, and MuJoCo's, in the variants that may be trained on. Both stay and go on in time. Some
eight minutes; `python -m benchmarks.classify.default_model` judges it where it did not learn.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from skinmap.classifiers.classifier import TouchClassifier
from skinmap.classifiers.descriptors import ContactGeometry, Touch, recorded_touches
from skinmap.classifiers.model_file import save_classifier
from skinmap.classifiers.named_classifiers import DEFAULT_FILE
from skinmap.classifiers.protocols.physics import mirror_pairs
from skinmap.classifiers.rbf_machine import RbfMachine
from skinmap.io.robots.manifest import load_robot
from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import TUNING
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.simulator import simulate

ROBOT = "icub"
STATES = 6  # of the sensors of each part: what one state names right, another does not
TOUCHES = 5  # of each gesture in each state: 30 on a part
# MuJoCo's on one part of each pair: gestures, how many of each, in which variants, and the seed.
PRESSED = ((FOUR, 7, TUNING, 100), (TIME, 3, ("foam", "force"), 400))


def our_touches(skin: PreparedSkin, number: int, state: int) -> list[Touch]:
    """Ours on one part, the `number`th of the robot, in one state of its sensors."""
    rng = np.random.default_rng([0, number, state])
    recording = simulate(skin.skin, rng=rng, per_gesture=TOUCHES, gestures=(*FOUR, *TIME))
    return recorded_touches(skin, recording)


def pressed_touches(skin: PreparedSkin, number: int) -> list[Touch]:
    """MuJoCo's on one part, in the variants that may be trained on."""
    found = []
    for gestures, count, variants, seed in PRESSED:
        for variant in variants:
            rng = np.random.default_rng([seed, number, 0])
            made = press(skin.skin, rng=rng, variant=variant, per_gesture=count, gestures=gestures)
            found += recorded_touches(skin, made)
    return found


def all_touches() -> list[Touch]:
    """All that the model learns from."""
    robot = load_robot(ROBOT)
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    first = mirror_pairs(skins)
    found: list[Touch] = []
    for number, (part, skin) in enumerate(skins.items()):
        for state in range(STATES):
            found += our_touches(skin, number, state)
        if first[part] == part:
            found += pressed_touches(skin, number)
        print(f"{part}: {len(found)} touches so far", flush=True)
    return found


def trained(touches: list[Touch]) -> TouchClassifier:
    """The model, with numbers of single precision: half of the file."""
    model = TouchClassifier("contact-geometry", ContactGeometry(motion=True), RbfMachine())
    model.fit(touches, rng=np.random.default_rng(0), sets=True)
    arrays = model.estimator.to_arrays()
    small = {
        name: array.astype(np.float32) if array.dtype == np.float64 and array.ndim else array
        for name, array in arrays.items()
    }
    model.estimator.from_arrays(small)
    return model


def main() -> int:
    """Train and write."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT_FILE
    model = trained(all_touches())
    save_classifier(model, target)
    vectors = len(model.estimator.vectors_)
    print(f"{target}: {vectors} support vectors, {target.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
