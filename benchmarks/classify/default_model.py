"""The model that comes with Skinmap, judged where it did not learn.

    python -m benchmarks.classify.default_model [--touches 4] [--answers]

writes benchmarks/results/default_model.json; with --answers only the part on kind, motion and hand
is measured anew. It learnt on the iCub alone, so the other robots'
skins are new to it, their people and sensors too; of MuJoCo it never saw the frozen variant. The
control is the same touch with its samples in random order: what a name owes to how a touch goes on
is gone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.classify.touches import skins_of, touches_of
from benchmarks.harness.record import RESULTS, about, write
from skinmap.physics.simulation import simulate as press
from skinmap.physics.variants import FROZEN
from skinmap.recognition.answering import shipped_answers
from skinmap.recognition.answers import HandAnswer
from skinmap.recognition.descriptors import Touch
from skinmap.recognition.evaluate import likeliest
from skinmap.recognition.named_classifiers import default_model
from skinmap.recognition.protocols.results import PhysicsRow
from skinmap.recognition.protocols.transfer import judged
from skinmap.touch.simulation.gestures import FOUR, TIME
from skinmap.touch.simulation.hands import HAND, OTHER, STILL
from skinmap.touch.simulation.simulator import simulate

OUT = RESULTS / "default_model.json"
SKINS = {
    "ur10e-cyskin": ("upper_arm_1", "forearm_1"),
    "kaspar": ("torso", "right_arm", "right_hand", "right_foot"),
    "baxter-forearm": ("forearm",),
}
STATES = 3  # of the sensors of each part
PRESSED = ("torso", "left_arm", "left_forearm", "left_leg_upper", "left_leg_lower", "left_foot")
DEAD = 0.2  # share of taxels that fail, to see what that costs
GROUPS = {"single_fingers": HAND[:2], "grips": HAND[2:], "others": OTHER}
SEED = 4000  # far from those that it was trained with


def other_robot(name: str, count: int) -> list[Touch]:
    """Touches of ours on the skins of a robot that the model never saw."""
    found = []
    for number, skin in enumerate(skins_of(name, SKINS[name]).values()):
        for state in range(STATES):
            rng = np.random.default_rng([SEED, number, state])
            found += touches_of(skin, simulate, [((*FOUR, *TIME), count)], rng=rng)
    return found


def frozen_variant(count: int) -> list[Touch]:
    """Touches of the physics that nothing was trained or tuned on, on parts of the iCub."""
    wanted = ((FOUR, 2 * count), (TIME, max(1, count // 2)))
    found = []
    for number, skin in enumerate(skins_of("icub", PRESSED).values()):
        rng = np.random.default_rng([SEED, number])
        found += touches_of(skin, press, wanted, rng=rng, variant=FROZEN)
    return found


def row(where: str, touches: Sequence[Touch], labels: Sequence[str]) -> dict[str, Any]:
    """How the touches of some labels are named, and with their samples in random order."""
    own = [touch for touch in touches if touch.label in labels]
    rng = np.random.default_rng(SEED)
    mixed = [replace(one, samples=rng.permutation(one.samples)) for one in own]
    found, control = named(where, own), named(where, mixed)
    return {
        "tested_on": where,
        "kind": "still" if labels == FOUR else "in time",
        "touches": len(own),
        "mean": found.mean,
        "ece": found.ece,
        "in_random_order": control.mean,
    }


def named(where: str, touches: Sequence[Touch]) -> PhysicsRow:
    """Names by the model, among all that it knows."""
    model = default_model()
    guesses = [(touch.label, likeliest(model, touch)) for touch in touches]
    said = [(true, one.label, one.confidence) for true, one in guesses]
    return judged("default", where, model.labels, said)


def answer_touches(count: int) -> Iterator[tuple[str, list[Touch]]]:
    """Touches of all hands and things, by who made them: ours on each robot, and MuJoCo's."""
    wanted = ((STILL, count), (TIME, 1))
    for name, parts in {**SKINS, "icub": PRESSED}.items():
        skins = skins_of(name, parts).values()
        for who in ("", *(("flesh", FROZEN) if name == "icub" else ())):
            found: list[Touch] = []
            for number, skin in enumerate(skins):
                rng = np.random.default_rng([SEED, 1 + bool(who), number])
                if who:
                    found += touches_of(skin, press, wanted, rng=rng, variant=who)
                else:
                    found += touches_of(skin, simulate, STATES * wanted, rng=rng)
            yield f"MuJoCo, {who}" if who else name, found


def answer_row(where: str, touches: Sequence[Touch]) -> dict[str, Any]:
    """How kind, motion and hand of touches are answered; means of classes."""
    ask, rng = shipped_answers(), np.random.default_rng(SEED)
    said = [(one.label, found) for one in touches if (found := ask.of(one)) is not None]
    works = [(rng.random(len(one.skin)) >= DEAD).astype(np.uint8) for one in touches]
    broken = [replace(a, samples=a.samples * b) for a, b in zip(touches, works, strict=True)]
    worse = [(one.label, found) for one in broken if (found := ask.of(one)) is not None]
    kinds = [(true, found.kind) for true, found in said if true in FOUR]
    moves = [("still" if t == "hold" else t, found.motion) for t, found in said if t in TIME]
    hands = [(true, found.hand) for true, found in said if true in STILL]
    mixed = rng.permutation(len(hands))
    row: dict[str, Any] = {
        "tested_on": where,
        "hands_and_things": len(hands),
        "balanced": balanced(hands),
        "shuffled": balanced([(hands[k][0], hands[row][1]) for row, k in enumerate(mixed)]),
        "with_dead_taxels": balanced([(t, one.hand) for t, one in worse if t in STILL]),
    }
    for name, own in (("kind", kinds), ("motion", moves)):
        row[f"{name}s"] = len(own)
        row[f"{name}_mean"] = by_class([(true, one.answer == true) for true, one in own])
        row[f"{name}_sets_held"] = float(np.mean([true in one.set for true, one in own]))
        row[f"{name}_names_in_a_set"] = float(np.mean([len(one.set) for _, one in own]))
    for who, names in GROUPS.items():
        words = [one.answer for true, one in hands if true in names]
        row[who] = {word: words.count(word) / len(words) for word in ("hand", "unsure", "other")}
    return row


def balanced(said: Sequence[tuple[str, HandAnswer]]) -> float:
    """Mean of the shares of hands above one half and of others below."""
    right = [(true, (one.probability > 0.5) == (true in HAND)) for true, one in said]
    sides = ([one for one in right if (one[0] in HAND) == hand] for hand in (True, False))
    return float(np.mean([by_class(side) for side in sides]))


def by_class(right: Sequence[tuple[str, bool]]) -> float:
    """Mean of the shares of each class that are right."""
    names = sorted({true for true, _ in right})
    return float(np.mean([np.mean([ok for one, ok in right if one == name]) for name in names]))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=4, help="of each gesture on each skin")
    parser.add_argument("--answers", action="store_true", help="only kind, motion and hand")
    asked = parser.parse_args()
    told = [answer_row(*one) for one in answer_touches(asked.touches)]
    for one in told:
        print(json.dumps(one))
    kept = json.loads(OUT.read_text()) if asked.answers else named_rows(asked.touches)
    write(OUT, {**kept, "answers": {**about("full"), "rows": told}})


def named_rows(count: int) -> dict[str, Any]:
    """Head and rows of all that is named, printed too."""
    tests = {name: other_robot(name, count) for name in SKINS}
    tests[f"MuJoCo, {FROZEN}"] = frozen_variant(count)
    rows = [row(where, one, kind) for where, one in tests.items() for kind in (FOUR, TIME)]
    for one in rows:
        print(json.dumps(one))
    return {**about("full"), "rows": rows}


if __name__ == "__main__":
    main()
