"""Accuracy of contact geometry, grouping and fusion on simulated touches.

    python -m benchmarks.classify.touches [--seeds 5] [--touches 12]
        [--only patches,robots,pairs,fusion]

writes benchmarks/results/touches.json. All touches are simulated; every score is per touch event,
and "unknown" counts as wrong.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

import skinmap
from benchmarks.harness.record import RESULTS
from skinmap.classify.classifier import classifiers
from skinmap.classify.descriptors import Touch
from skinmap.classify.naming import all_right, name_touches
from skinmap.skin.robot import Robot
from skinmap.touch.gestures import EIGHT, FOUR
from skinmap.touch.pairs import simulate_pairs
from skinmap.touch.patches import cut_into_patches
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulator import simulate

OUT = RESULTS / "touches.json"
TRAINED_PARTS = ("torso", "left_leg_upper", "left_foot", "right_forearm")
FOLDS = 3
HALF_OFF = 0.5  # share on the skin of touches that hang over its edge


def patches_of(robot: Robot) -> list[PreparedSkin]:
    """Every patch of a robot as a skin of its own."""
    cut = [cut_into_patches(skinmap.build_surface(robot.skin(part))) for part in robot.parts]
    return [PreparedSkin(skin) for skins in cut for skin in skins]


def touches_on(
    skins: Sequence[PreparedSkin],
    gestures: Sequence[str],
    count: int,
    seed: int,
    on_skin: float | None = None,
) -> list[list[Touch]]:
    """Simulated touches of each skin."""
    rngs = np.random.default_rng(seed).spawn(len(skins))
    recordings = [
        simulate(skin.skin, rng=rng, per_gesture=count, gestures=gestures, on_skin=on_skin)
        for skin, rng in zip(skins, rngs, strict=True)
    ]
    return [
        [Touch(skin, samples, label) for _, label, samples in recording.touches()]
        for skin, recording in zip(skins, recordings, strict=True)
    ]


def tested(name: str, train: Sequence[Touch], tests: Sequence[Sequence[Touch]]) -> list[list[bool]]:
    """Whether each touch of each test got its name."""
    model = classifiers.get(name)().fit(train, rng=np.random.default_rng(0))
    return [[model.predict(touch).label == touch.label for touch in some] for some in tests]


def leave_one_out(name: str, groups: Sequence[Sequence[Touch]]) -> dict[str, Any]:
    """Each patch tested by what the others taught."""
    right = []
    for k, test in enumerate(groups):
        train = [touch for j, group in enumerate(groups) if j != k for touch in group]
        right.extend(tested(name, train, [test]))
    return summary(groups, right)


def summary(groups: Sequence[Sequence[Touch]], right: Sequence[Sequence[bool]]) -> dict[str, Any]:
    """Mean and worst over patches, and the share right of each label."""
    per_patch = {
        group[0].skin.skin.part: float(np.mean(hit))
        for group, hit in zip(groups, right, strict=True)
        if group
    }
    labels = np.array([touch.label for group in groups for touch in group])
    hits = np.array([one for hit in right for one in hit])
    return {
        "mean": float(np.mean(list(per_patch.values()))),
        "worst": min(per_patch.values()),
        "per_patch": per_patch,
        "per_class": {str(k): float(hits[labels == k].mean()) for k in np.unique(labels)},
        "touches": len(hits),
    }


def over_seeds(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Means over seeds; the worst patch is the worst of the patches' means."""
    per_patch = {
        p: float(np.mean([f["per_patch"][p] for f in found])) for p in found[0]["per_patch"]
    }
    means = [f["mean"] for f in found]
    return {
        "mean": float(np.mean(means)),
        "std": float(np.std(means)),
        "worst": min(per_patch.values()),
        "worst_patch": min(per_patch, key=lambda p: per_patch[p]),
        "worst_of_any_seed": min(f["worst"] for f in found),
        "per_patch": per_patch,
        "per_class": {
            k: float(np.mean([f["per_class"][k] for f in found])) for k in found[0]["per_class"]
        },
        "touches": sum(f["touches"] for f in found),
    }


def bench_patches(seeds: int, count: int) -> dict[str, Any]:
    """Leave one patch out over the iCub, four and eight touches, also half off the edge."""
    skins = patches_of(skinmap.load_robot("icub"))
    rows: dict[str, list[dict[str, Any]]] = {}
    for seed in range(seeds):
        for place, on_skin in (("", None), (", half off the edge", HALF_OFF)):
            if on_skin is not None and seed > 0:
                continue  # one seed shows what that costs
            groups = touches_on(skins, EIGHT, count, seed, on_skin)
            for title, gestures in (("four", FOUR), ("eight", EIGHT)):
                some = [[t for t in group if t.label in gestures] for group in groups]
                found = leave_one_out("contact-geometry", some)
                rows.setdefault(title + place, []).append(found)
                say(f"seed {seed}, {title}{place}", found)
    return {title: over_seeds(found) for title, found in rows.items()}


def bench_robots(seeds: int, count: int) -> dict[str, Any]:
    """Trained on all of the KASPAR-like robot, tested on all patches of the iCub."""
    kaspar, icub = (patches_of(skinmap.load_robot(name)) for name in ("kaspar", "icub"))
    rows: dict[str, list[dict[str, Any]]] = {}
    for seed in range(seeds):
        train = [t for g in touches_on(kaspar, EIGHT, count, 100 + seed) for t in g]
        groups = touches_on(icub, EIGHT, count, seed)
        for name, title, gestures in (
            ("contact-geometry", "four", FOUR),
            ("contact-geometry", "eight", EIGHT),
            ("histogram", "four", FOUR),
        ):
            if name == "histogram" and seed > 0:
                continue  # slow, and beside the point
            some = [[t for t in group if t.label in gestures] for group in groups]
            right = tested(name, [t for t in train if t.label in gestures], some)
            rows.setdefault(f"{name}, {title}", []).append(summary(some, right))
            say(f"kaspar > icub, seed {seed}, {name}, {title}", rows[f"{name}, {title}"][-1])
    return {title: over_seeds(found) for title, found in rows.items()}


def bench_pairs(seeds: int, count: int) -> dict[str, Any]:
    """Two touches at once, both right, on parts of the iCub that can hold two."""
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in robot.parts}
    right: dict[str, list[bool]] = {}
    two: list[bool] = []
    alone: list[bool] = []
    for seed in range(seeds):
        train = touches_on([skins[part] for part in TRAINED_PARTS], FOUR, 2 * count, seed)
        model = classifiers.get("contact-geometry")().fit(
            [touch for group in train for touch in group], rng=np.random.default_rng(seed)
        )
        for number, (part, skin) in enumerate(skins.items()):
            rng = np.random.default_rng([seed, number])
            recording = simulate_pairs(skin.skin, rng=rng, count=count)
            assert recording.owners is not None
            for event, label, samples in recording.touches():
                named = name_touches(model, skin, samples)
                right.setdefault(part, []).append(
                    all_right(named, samples, label, recording.owners[event])
                )
                two.append(len(named) == 2)
            for touch in touches_on([skin], FOUR, max(2, count // 3), 50 + seed)[0]:
                alone.append(
                    all_right(name_touches(model, skin, touch.samples), touch.samples, touch.label)
                )
    every = [one for part in right.values() for one in part]
    found = {
        "trained_on": TRAINED_PARTS,
        "both_right": float(np.mean(every)),
        "two_touches_found": float(np.mean(two)),
        "single_touches_right": float(np.mean(alone)),
        "pairs": len(every),
        "per_part": {part: float(np.mean(hits)) for part, hits in right.items()},
    }
    print("pairs", {k: v for k, v in found.items() if k != "per_part"}, flush=True)
    return found


def bench_fusion(seeds: int, count: int) -> dict[str, Any]:
    """The fusion beside its parts: a third of the 23 patches left out at a time."""
    skins = patches_of(skinmap.load_robot("icub"))
    rows: dict[str, list[dict[str, Any]]] = {}
    for seed in range(seeds):
        groups = touches_on(skins, FOUR, count, 30 + seed)
        fold = np.random.default_rng(seed).permutation(len(groups)) % FOLDS
        for name in ("contact-geometry", "histogram", "fusion"):
            right: dict[int, list[bool]] = {}
            for number in range(FOLDS):
                held = np.flatnonzero(fold == number).tolist()
                train = [t for k, g in enumerate(groups) if k not in held for t in g]
                hits = tested(name, train, [groups[k] for k in held])
                right.update(zip(held, hits, strict=True))
            found = summary(groups, [right[k] for k in range(len(groups))])
            rows.setdefault(name, []).append(found)
            say(f"fusion, seed {seed}, {name}", found)
    return {name: over_seeds(found) for name, found in rows.items()}


def say(title: str, row: dict[str, Any]) -> None:
    """One line for people."""
    classes = {k: round(v, 2) for k, v in row["per_class"].items()}
    print(f"{title}: mean {row['mean']:.3f}, worst {row['worst']:.3f}", classes, flush=True)


def main() -> None:
    """Run what was asked for and keep what other runs found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--touches", type=int, default=12)
    parser.add_argument("--only", default="patches,robots,pairs,fusion")
    options = parser.parse_args()
    benches = {
        "patches": bench_patches,
        "robots": bench_robots,
        "pairs": bench_pairs,
        "fusion": bench_fusion,
    }
    for name in options.only.split(","):
        begun = time.process_time()
        found = benches[name](options.seeds, options.touches)
        found["run"] = {
            "seeds": options.seeds,
            "touches_per_gesture": options.touches,
            "cpu_seconds": round(time.process_time() - begun, 1),
        }
        result = json.loads(OUT.read_text()) if OUT.is_file() else {"accuracy_is": "simulated"}
        result[name] = found
        OUT.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
