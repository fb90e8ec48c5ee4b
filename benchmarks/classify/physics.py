"""Our touches beside MuJoCo's at the same places: how far the touched sets overlap.

    python -m benchmarks.classify.physics [--touches 8] [--variants foam,flesh]

writes benchmarks/results/physics.json. Both are simulations; ours varies as it does by default.
A finger or a hand of the same size is put on the same taxel at the same angle, three fingertips on
the same spots; the rest of its shape, its force and all of the contact is each simulator's own.
Touched is what sends more than `ACTIVE` counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.harness.record import RESULTS, about, write
from skinmap.arrays import BoolArray, FloatArray
from skinmap.geometry.log_map import log_map
from skinmap.io.robots.manifest import load_robot
from skinmap.physics.bodies import PRESSERS
from skinmap.physics.simulation import (
    Ground,
    Person,
    draw_people,
    make_ground,
    place_at,
    press_place,
    taxel_loads,
)
from skinmap.physics.variants import TUNING, find_variant
from skinmap.skin.skin import Skin
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.elastic_bed import bed_loads
from skinmap.touch.gestures import FOUR
from skinmap.touch.hands import HANDS, Draw
from skinmap.touch.sensing import FULL_SCALE
from skinmap.touch.simulator import REACH, Stage, prepare
from skinmap.touch.variety import DEFAULT as VARIETY
from skinmap.touch.variety import draw_foam

OUT = RESULTS / "physics.json"
PARTS = ("torso", "left_arm", "left_forearm", "left_leg_upper", "left_leg_lower")
ENOUGH = 0.7  # of a touch lies on the skin
TRIES = 40


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Share of the taxels (n,) touched in either that are touched in both; 1 where none is."""
    either = int((one | other).sum())
    return 1.0 if either == 0 else int((one & other).sum()) / either


def compare(
    skin: Skin,
    *,
    variant: str,
    touches: int,
    gestures: Sequence[str] = FOUR,
    rng: np.random.Generator,
) -> list[dict[str, Any]]:
    """Each gesture some times at random places of a skin, by ours and by MuJoCo.

    Returns
    -------
    list of dict
        gesture, iou, taxels touched by `ours` and by `mujoco`, share of MuJoCo's that is ours too,
        and CPU seconds of MuJoCo.
    """
    ground = make_ground(skin, find_variant(variant), rng=rng)
    stage = prepare(skin, rng=rng)
    people = draw_people(4, ground.variant, rng=rng)
    found = []
    for name in gestures:
        for number in range(touches):
            pair = touched_by_both(stage, ground, name, people[number % len(people)], rng=rng)
            if pair is None:
                continue
            ours, theirs, seconds = pair
            found.append(
                {
                    "gesture": name,
                    "iou": overlap(ours, theirs),
                    "ours": int(ours.sum()),
                    "mujoco": int(theirs.sum()),
                    "within_ours": float(ours[theirs].mean()) if theirs.any() else 1.0,
                    "seconds": seconds,
                }
            )
    return found


def touched_by_both(
    stage: Stage, ground: Ground, name: str, person: Person, *, rng: np.random.Generator
) -> tuple[BoolArray, BoolArray, float] | None:
    """Taxels (n,) touched by ours and by MuJoCo at one place, and MuJoCo's CPU seconds."""
    skin = stage.skin
    for _ in range(TRIES):
        bodies = HANDS[name](Draw(rng, VARIETY, person.hand))
        presser = PRESSERS[name](rng, person.hand, ground.variant)
        middles = np.array([[body.start, body.end] for body in bodies]).mean(axis=1)
        centre = middles.mean(axis=0)
        if len(presser.mounts) == len(bodies):  # tips on the same spots
            spots = [tuple(map(float, middle - centre)) for middle in middles]
            mounts = [
                replace(mount, spot=spot) for mount, spot in zip(presser.mounts, spots, strict=True)
            ]
            presser = replace(presser, mounts=tuple(mounts), footprint=middles - centre)
        taxel, angle = int(rng.integers(len(skin))), float(rng.uniform(0.0, 2.0 * np.pi))
        placed = place_at(ground.bed, presser, taxel, angle)
        if placed is None or placed[1] < ENOUGH:
            continue
        axes = _axes(skin, taxel, angle)
        uv, _ = log_map(skin.positions, skin.normals, stage.graph, taxel, REACH, frame=axes)
        foam = draw_foam(VARIETY, stage.sensors.sensing.foam, rng)
        points = uv + centre
        if name == "whole_hand":  # palm on palm; theirs is a left hand and ours a right one
            points = (uv - presser.mounts[0].spot) * (1.0, -1.0)
        ours = bed_loads(bodies, foam, points, skin).sum(axis=0)
        began = time.process_time()
        pressed = press_place(ground, placed[0], person, rate=50.0, rng=rng)
        theirs = taxel_loads(ground, pressed).max(axis=0)
        seconds = time.process_time() - began
        return FULL_SCALE * ours > ACTIVE, FULL_SCALE * theirs > ACTIVE, seconds
    return None


def _axes(skin: Skin, taxel: int, angle: float) -> FloatArray:
    """(2, 3) the axes that `place_at` lays a presser along."""
    normal = skin.normals[taxel]
    first = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * first + s * second, -s * first + c * second])


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Medians by gesture."""
    names = dict.fromkeys(row["gesture"] for row in rows)
    return {
        name: {
            key: float(np.median([row[key] for row in rows if row["gesture"] == name]))
            for key in ("iou", "ours", "mujoco", "within_ours", "seconds")
        }
        for name in names
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--touches", type=int, default=8, help="of each gesture on each part")
    parser.add_argument("--variants", default="foam,flesh")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    variants = chosen.variants.split(",")
    robot = load_robot("icub")
    found: dict[str, Any] = {}
    for variant in variants:
        if variant not in TUNING:
            parser.error(f"{variant!r} is not one of {', '.join(TUNING)}")
        rngs = np.random.default_rng(chosen.seed).spawn(len(PARTS))
        rows = [
            row
            for part, rng in zip(PARTS, rngs, strict=True)
            for row in compare(robot.skin(part), variant=variant, touches=chosen.touches, rng=rng)
        ]
        found[variant] = summary(rows)
        for name, row in found[variant].items():
            print(f"{variant} {name}: IoU {row['iou']:.2f}, {row['seconds'] * 1e3:.0f} ms")
    write(OUT, {**about("full"), "touches": chosen.touches, "parts": PARTS, "overlap": found})


if __name__ == "__main__":
    main()
