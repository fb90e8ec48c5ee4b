"""Make the model that comes with Skinmap, skinmap/recognition/default.skinmodel, from its seeds.

    python scripts/default_model.py [--answers] [FILE]

It learns from simulated touches on all parts of the iCub: ours, that vary, on sensors of six states
a part, and MuJoCo's, in the variants that may be trained on. Both stay and go on in time. Some
eight minutes; `python -m benchmarks.classify.default_model` judges it where it did not learn. With
--answers what gives the labels stays as it is in the file, and only what answers kind, motion and
hand is made anew: five minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.io.robots.manifest import load_robot
from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import TUNING
from skinmap.recognition.answering import (
    MOVING,
    STAYS,
    Machine,
    ThreeAnswers,
    shape_row,
    train_machine,
)
from skinmap.recognition.classifier import TouchClassifier
from skinmap.recognition.descriptors import ContactGeometry, Touch, recorded_touches
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.recognition.named_classifiers import DEFAULT_FILE
from skinmap.recognition.protocols.physics import mirror_pairs
from skinmap.recognition.rbf_machine import RbfMachine
from skinmap.recognition.sets.prediction_sets import set_calibration_from
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.simulator import simulate
from skinmap.touch.simulation.things import HAND, OTHER, STILL

ROBOT = "icub"
KIND_ROWS, THING_ROWS, HAND_ROWS = 2400, 500, 3200  # that the machines for answers learn at most
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


# For the answers: all touches that stay, those in time, and the varieties of ours.
ANSWERED = ((STILL, 2), (TIME, 1))
VARIETIES = (1.0, 2.0)
GRIPS = ("three_finger", "whole_hand", "several_fingers", "grasp")
# Things that press alike have one name.
ALIKE = {"hard_ball": "ball", "rod": "cylinder", "table_edge": "edge", "link": "cylinder"}


def answer_touches() -> list[Touch]:
    """All that kind, motion and hand are learnt from."""
    robot = load_robot(ROBOT)
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    first, found = mirror_pairs(skins), []
    for number, (part, skin) in enumerate(skins.items()):
        for state in range(STATES):
            for variety in VARIETIES:
                rng = np.random.default_rng([7, number, state, int(10 * variety)])
                for names, count in ANSWERED:
                    made = simulate(
                        skin.skin, rng=rng, per_gesture=count, gestures=names, variety=variety
                    )
                    found += recorded_touches(skin, made)
        print(f"{part}: {len(found)} touches to answer so far", flush=True)
    for number, (part, skin) in enumerate(skins.items()):
        for variant in TUNING if first[part] == part else ():
            rng = np.random.default_rng([700, number])
            for names, count in ANSWERED:
                made = press(skin.skin, rng=rng, variant=variant, per_gesture=count, gestures=names)
                found += recorded_touches(skin, made)
        print(f"{part}: {len(found)} touches to answer so far", flush=True)
    return found


def answers(touches: Sequence[Touch]) -> ThreeAnswers:
    """What answers kind, motion and hand."""
    felt = [touch for touch in touches if len(shape_row(touch))]
    rows = np.concatenate([shape_row(touch) for touch in felt])
    moving = np.concatenate([MOVING.describe(touch) for touch in felt])
    return answers_of(felt, rows, moving)


def answers_of(touches: Sequence[Touch], rows: Any, moving: Any) -> ThreeAnswers:
    """The same by their contact geometry (m, d) and motion (m, e)."""
    label = np.array([touch.label for touch in touches])
    stays = np.isin(label, STILL)

    def machine(used: Any, names: Any, numbers: Any = rows, **how: Any) -> Machine:
        own = [touch for touch, one in zip(touches, used, strict=True) if one]
        found = train_machine(
            numbers[used], names[used].tolist(), own, rng=np.random.default_rng(0), **how
        )
        found.machine.from_arrays(single(found.machine.to_arrays()))
        if found.sets is not None:  # zeros at the ends of numbers pack well
            found.sets = set_calibration_from(single(found.sets.to_arrays()))
        return found

    def whether(names: Sequence[str]) -> Any:
        return np.where(np.isin(label, names), "hand", "other")

    moves = np.where(stays | (label == "hold"), STAYS, label)
    things = np.array([ALIKE.get(one, one) for one in label.tolist()])
    return ThreeAnswers(
        {
            "kind": machine(np.isin(label, FOUR), label, most_rows=KIND_ROWS),
            "other": machine(np.isin(label, OTHER), things, most_rows=THING_ROWS),
            "motion": machine(label != "", moves, moving, most_rows=KIND_ROWS),
            "hand": machine(stays, whether(HAND), most_rows=HAND_ROWS, sets=False),
            "grip": machine(stays, whether(GRIPS), most_rows=HAND_ROWS, even=1.5, sets=False),
        }
    )


def trained(touches: list[Touch]) -> TouchClassifier:
    """What gives the labels, with numbers of single precision: half of the file."""
    model = TouchClassifier("contact-geometry", ContactGeometry(motion=True), RbfMachine())
    model.fit(touches, rng=np.random.default_rng(0), sets=True)
    model.estimator.from_arrays(single(model.estimator.to_arrays()))
    return model


def single(arrays: dict[str, Any]) -> dict[str, Any]:
    """Arrays in single precision."""
    return {
        name: array.astype(np.float32) if array.dtype == np.float64 and array.ndim else array
        for name, array in arrays.items()
    }


def main() -> int:
    """Train and write."""
    named = [one for one in sys.argv[1:] if one != "--answers"]
    target = Path(named[0]) if named else DEFAULT_FILE
    kept = "--answers" in sys.argv[1:]
    model = load_classifier(DEFAULT_FILE) if kept else trained(all_touches())
    model.own_answers = answers(answer_touches())
    save_classifier(model, target)
    for name, one in model.own_answers.machines.items():
        print(f"{name}: {len(one.machine.vectors_)} support vectors")
    print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
