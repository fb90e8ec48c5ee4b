"""Make the model that comes with Skinmap, skinmap/recognition/default.skinmodel, from its seeds.

    python scripts/default_model.py [FILE]

It learns from simulated touches on all parts of the iCub: ours, that vary, on sensors of six states
a part, and MuJoCo's, in the variants that may be trained on. Both stay and go on in time. The file
that ships keeps the labels of an earlier run: a new one names a touch that is cut off at 0.1 s a
tap. Some twelve minutes; `python -m benchmarks.classify.default_model` judges it where it did not
learn.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier

from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import TUNING
from skinmap.recognition.answering import (
    MOVING,
    STAYS,
    HandNetworks,
    Machine,
    ThreeAnswers,
    hand_row,
    shape_row,
    train_machine,
)
from skinmap.recognition.classifier import TouchClassifier
from skinmap.recognition.descriptors import ContactGeometry, Touch
from skinmap.recognition.model_file import save_classifier
from skinmap.recognition.named_classifiers import DEFAULT_FILE
from skinmap.recognition.prediction_sets import set_calibration_from
from skinmap.recognition.protocols.transfer import mirror_pairs
from skinmap.recognition.rbf_machine import RbfMachine
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.hands import HAND, OTHER, STILL
from skinmap.touch.simulation.simulator import simulate

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # run as a script
    sys.path.insert(0, str(ROOT))

from benchmarks.classify.touches import Wanted, skins_of, touches_of  # noqa: E402

ROBOT = "icub"
KIND_ROWS, THING_ROWS, MOTION_ROWS = 2400, 500, 4800  # that the machines for answers learn at most
STATES = 6  # of the sensors of each part: what one state names right, another does not
TOUCHES = 5  # of each gesture in each state: 30 on a part
# MuJoCo's on one part of each pair: gestures, how many of each, in which variants, and the seed.
PRESSED = ((FOUR, 7, TUNING, 100), (TIME, 3, ("foam", "force"), 400))


def our_touches(skin: PreparedSkin, number: int, state: int) -> list[Touch]:
    """Ours on one part, the `number`th of the robot, in one state of its sensors."""
    rng = np.random.default_rng([0, number, state])
    return touches_of(skin, simulate, [((*FOUR, *TIME), TOUCHES)], rng=rng)


def all_touches() -> list[Touch]:
    """All that the model learns from: ours in some states of the sensors, and MuJoCo's."""
    skins = skins_of(ROBOT)
    first = mirror_pairs(skins)
    found: list[Touch] = []
    for number, (part, skin) in enumerate(skins.items()):
        for state in range(STATES):
            found += our_touches(skin, number, state)
        for gestures, count, variants, seed in PRESSED if first[part] == part else ():
            for variant in variants:
                rng = np.random.default_rng([seed, number, 0])
                found += touches_of(skin, press, [(gestures, count)], rng=rng, variant=variant)
        print(f"{part}: {len(found)} touches so far", flush=True)
    return found


# For the answers, how many of each name: all touches that stay and those in time, in the states of
# the sensors of each part, and of those that stay as many in further states.
BOTH, STAY = ((STILL, 2), (TIME, 1)), ((STILL, 2),)
VARIETIES = (1.0, 2.0)
# Things that press alike have one name.
ALIKE = {"hard_ball": "ball", "rod": "cylinder", "table_edge": "edge", "link": "cylinder"}
FEWER = 4  # touches that stay are so many times too many for sets of motions and things
DEAD, EVERY = 0.2, 3  # share of dead taxels in copies, of every so many touches
NETWORKS, HIDDEN, EPOCHS, BLUR = 4, (128, 64), 30, 0.1
HANDS = 1.25  # counts for more than others: of held-out touches as many of both are right
DECAY, LEAST_SCALE = 0.5, 0.03  # a weaker decay learns the training touches by heart


class Seen(NamedTuple):
    """A touch without its samples, and its numbers for each machine.

    `shapes` are those for networks, of the touch itself and of a copy with dead taxels.
    """

    touch: Touch
    row: Any
    moving: Any
    shapes: tuple[Any, ...]
    ours: bool


def seen(touches: Iterable[Touch], ours: bool) -> list[Seen]:
    """What is learnt of some touches, where anything is felt."""
    found: list[Seen] = []
    rng = np.random.default_rng(99)
    for touch in touches:
        row = shape_row(touch)
        if len(row) == 0:
            continue
        shapes = [hand_row(touch, row)]
        works = rng.random(len(touch.skin)) >= DEAD
        if len(found) % EVERY == 0:
            copy = replace(touch, samples=touch.samples * works.astype(np.uint8))
            worse = shape_row(copy)
            shapes += [hand_row(copy, worse)] if len(worse) else []
        bare = replace(touch, samples=touch.samples[:0])
        found.append(Seen(bare, row[0], MOVING.describe(touch)[0], tuple(shapes), ours))
    return found


def our_answers(
    skins: Mapping[str, PreparedSkin], variety: float, states: Iterable[int], wanted: Wanted
) -> Iterator[Touch]:
    """Ours on all parts, in some states of their sensors."""
    for number, skin in enumerate(skins.values()):
        for state in states:
            rng = np.random.default_rng([7, number, state, int(10 * variety)])
            yield from touches_of(skin, simulate, wanted, rng=rng, variety=variety)


def pressed_answers(skins: Mapping[str, PreparedSkin], variety: float) -> Iterator[Touch]:
    """MuJoCo's on one part of each pair, in the variants that may be trained on."""
    first = mirror_pairs(skins)
    for number, (part, skin) in enumerate(skins.items()):
        for variant in TUNING if first[part] == part else ():
            rng = np.random.default_rng([700, number, *([20] if variety > 1.0 else [])])
            yield from touches_of(skin, press, BOTH, rng=rng, variant=variant, variety=variety)


def answer_touches() -> list[Seen]:
    """All that kind, motion and hand are learnt from."""
    skins = skins_of(ROBOT)
    found: list[Seen] = []
    further = range(STATES, 2 * STATES)
    for variety in VARIETIES:
        found += seen(our_answers(skins, variety, range(STATES), BOTH), True)
        found += seen(our_answers(skins, variety, further, STAY), True)
        found += seen(pressed_answers(skins, variety), False)
        print(f"variety {variety:g}: {len(found)} touches to answer so far", flush=True)
    return found


def answers(touches: Sequence[Seen]) -> ThreeAnswers:
    """What answers kind, motion and hand."""
    label = np.array([one.touch.label for one in touches])
    rows = np.stack([one.row for one in touches])
    moving = np.stack([one.moving for one in touches])

    def machine(used: Any, names: Any, numbers: Any = rows, **how: Any) -> Machine:
        own = [one.touch for one, wanted in zip(touches, used, strict=True) if wanted]
        found = train_machine(
            numbers[used], names[used].tolist(), own, rng=np.random.default_rng(0), **how
        )
        found.machine.from_arrays(single(found.machine.to_arrays()))
        if found.sets is not None:  # zeros at the ends of numbers pack well
            found.sets = set_calibration_from(single(found.sets.to_arrays()))
        return found

    moves = np.where(np.isin(label, TIME) & (label != "hold"), label, STAYS)
    some = np.arange(len(label)) % FEWER == 0
    things = np.array([ALIKE.get(one, one) for one in label.tolist()])
    return ThreeAnswers(
        {
            "kind": machine(np.isin(label, FOUR), label, most_rows=KIND_ROWS),
            "other": machine(np.isin(label, OTHER) & some, things, most_rows=THING_ROWS),
            "motion": machine(
                np.isin(label, TIME) | some, moves, moving, most_rows=MOTION_ROWS, even=1.5
            ),
        },
        hand_networks(touches),
    )


def hand_networks(touches: Sequence[Seen]) -> HandNetworks:
    """Networks that name hands and things; ours, MuJoCo's, hands and others count alike."""
    known = [(o, shape) for o in touches if o.touch.label not in TIME for shape in o.shapes]
    label = np.array([one.touch.label for one, _ in known])
    group = 2 * np.isin(label, HAND) + np.array([one.ours for one, _ in known])
    weight = (len(known) / np.bincount(group))[group] / len(np.unique(group))
    weight = weight * np.where(group >= 2, HANDS, 1.0)
    rows = np.stack([shape for _, shape in known])
    mean, scale = rows.mean(axis=0), np.maximum(rows.std(axis=0), LEAST_SCALE)
    layers: list[list[Any]] = []
    for number in range(NETWORKS):
        blur = np.random.default_rng(number).normal(0.0, BLUR, rows.shape)
        network = MLPClassifier(
            HIDDEN, alpha=DECAY, batch_size=128, learning_rate_init=2e-3, max_iter=EPOCHS,
            n_iter_no_change=EPOCHS, tol=0.0, random_state=number,
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # as many epochs as wanted
            network.fit((rows - mean) / scale + blur, label, sample_weight=weight)
        pairs = zip(network.coefs_, network.intercepts_, strict=True)
        layers.append([np.concatenate([one, more[None]]) for one, more in pairs])
    made = [np.stack(one).astype(np.float16) for one in zip(*layers, strict=True)]
    return HandNetworks(network.classes_, mean.astype(np.float32), scale.astype(np.float32), *made)


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
    target = Path(sys.argv[1]) if sys.argv[1:] else DEFAULT_FILE
    model = trained(all_touches())
    model.own_answers = answers(answer_touches())
    save_classifier(model, target)
    for name, one in model.own_answers.machines.items():
        print(f"{name}: {len(one.machine.vectors_)} support vectors")
    print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
