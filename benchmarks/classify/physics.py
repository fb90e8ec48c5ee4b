"""Our touches beside MuJoCo's at the same places: how far the touched sets overlap.

    python -m benchmarks.classify.physics [--touches 8] [--variants foam,flesh]

writes benchmarks/results/physics.json. Both are simulations. MuJoCo's pieces (fingertips,
phalanges, pads of a palm) are laid on our skin where its hand lies, each with the force that
MuJoCo's springs carried under it, on the same foam: what differs is how a skin answers. A control
lays them beside the place. `drawn` is a hand of our own there, of its own shape, force and foam,
and `again` MuJoCo's own with another hand of the same person there.
Touched is what sends more than `ACTIVE` counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.harness.record import RESULTS, about, write
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.log_map import log_map
from skinmap.io.robots.manifest import load_robot
from skinmap.physics.bodies import PRESSERS, Piece, Presser
from skinmap.physics.pressing import Pressed
from skinmap.physics.simulation import (
    FULL_PRESSURE,
    Ground,
    Person,
    Place,
    draw_people,
    make_ground,
    place_at,
    press_place,
    taxel_loads,
)
from skinmap.physics.spring_bed import PAD
from skinmap.physics.variants import TUNING, find_variant
from skinmap.skin.skin import Skin
from skinmap.touch.contacts import ACTIVE
from skinmap.touch.elastic_bed import FIRM, Foam, bed_loads
from skinmap.touch.gestures import FOUR
from skinmap.touch.hands import HANDS, Body, Draw
from skinmap.touch.sensing import FULL_SCALE
from skinmap.touch.simulator import REACH, Stage, prepare
from skinmap.touch.variety import DEFAULT as VARIETY
from skinmap.touch.variety import draw_foam

OUT = RESULTS / "physics.json"
PARTS = ("torso", "left_arm", "left_forearm", "left_leg_upper", "left_leg_lower")
ENOUGH = 0.7  # of a touch lies on the skin
TRIES = 40
FOLLOWS = 0.0  # bones do not bend with the skin
LEAST = 0.02  # a piece that carries less is not there [N]
ASIDE = (0.0, 20e-3)  # where the control lays the same pieces [m]


def overlap(one: BoolArray, other: BoolArray) -> float:
    """Share of the taxels (n,) touched in either that are touched in both; 1 where none is."""
    either = int((one | other).sum())
    return 1.0 if either == 0 else int((one & other).sum()) / either


@dataclass(frozen=True, eq=False, slots=True)
class Touched:
    """Taxels (n,) touched at one place, by MuJoCo and by ours, and MuJoCo's CPU seconds.

    `same` is of the same pieces under the same forces, `beside` of them laid beside the place,
    `drawn` of a hand of ours, and `again` of another of MuJoCo's.
    """

    theirs: BoolArray
    same: BoolArray
    beside: BoolArray
    drawn: BoolArray
    again: BoolArray
    seconds: float


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
        gesture, intersection over union `iou` of the same pieces, of those laid `beside`, of hands
        `drawn` by ours and `again` by MuJoCo, taxels touched by `ours` and by `mujoco`, and CPU
        seconds of MuJoCo.
    """
    ground = make_ground(skin, find_variant(variant), rng=rng)
    stage = prepare(skin, rng=rng)
    people = draw_people(4, ground.variant, rng=rng)
    found = []
    for name in gestures:
        for number in range(touches):
            one = touched_by_both(stage, ground, name, people[number % len(people)], rng=rng)
            if one is None:
                continue
            found.append(
                {
                    "gesture": name,
                    "iou": overlap(one.same, one.theirs),
                    "beside": overlap(one.beside, one.theirs),
                    "drawn": overlap(one.drawn, one.theirs),
                    "again": overlap(one.again, one.theirs),
                    "ours": int(one.same.sum()),
                    "mujoco": int(one.theirs.sum()),
                    "seconds": one.seconds,
                }
            )
    return found


def touched_by_both(
    stage: Stage, ground: Ground, name: str, person: Person, *, rng: np.random.Generator
) -> Touched | None:
    """One touch by both; None where no place was found for it."""
    for _ in range(TRIES):
        presser = PRESSERS[name](rng, person.hand, ground.variant)
        taxel, angle = int(rng.integers(len(stage.skin))), float(rng.uniform(0.0, 2.0 * np.pi))
        placed = place_at(ground.bed, presser, taxel, angle)
        if placed is not None and placed[1] >= ENOUGH:
            return _touched_at(stage, ground, name, person, placed[0], taxel, angle, rng)
    return None


def _touched_at(
    stage: Stage,
    ground: Ground,
    name: str,
    person: Person,
    place: Place,
    taxel: int,
    angle: float,
    rng: np.random.Generator,
) -> Touched:
    """One touch by both at a taxel, along an angle [rad]."""
    skin, presser = stage.skin, place.presser
    axes = _axes(skin, taxel, angle)
    uv, _ = log_map(skin.positions, skin.normals, stage.graph, taxel, REACH, frame=axes)
    began = time.process_time()
    pressed, load = _strongest(ground, place, person, rng)
    seconds = time.process_time() - began
    places = _spring_places(ground, pressed.springs, uv)
    bodies = carried(flat_bodies(presser, person.flesh), places, pressed.loads.max(axis=0))
    foam = Foam(ground.foam, float(np.hypot(ground.spread, PAD / 2.0)))
    scale = FIRM / ground.full_scale * FULL_PRESSURE

    def ours(points: FloatArray) -> BoolArray:
        return _touched(scale * bed_loads(bodies, foam, points, skin).sum(axis=0))

    drawn = _drawn(stage, name, presser, person, uv, rng)
    other = place_at(ground.bed, PRESSERS[name](rng, person.hand, ground.variant), taxel, angle)
    again = drawn * 0.0 if other is None else _strongest(ground, other[0], person, rng)[1]
    return Touched(
        _touched(load), ours(uv), ours(uv + ASIDE), _touched(drawn), _touched(again), seconds
    )


def _strongest(
    ground: Ground, place: Place, person: Person, rng: np.random.Generator
) -> tuple[Pressed, FloatArray]:
    """A touch by MuJoCo in its strongest sample alone, and the loads (n,) of the taxels then."""
    pressed = press_place(ground, place, person, rate=50.0, rng=rng)
    loads = taxel_loads(ground, pressed)
    row = int(loads.sum(axis=1).argmax())
    return replace(pressed, loads=pressed.loads[row : row + 1]), loads[row]


def _touched(load: FloatArray) -> BoolArray:
    return np.asarray(FULL_SCALE * load > ACTIVE)


def flat_bodies(presser: Presser, flesh: float) -> list[Body]:
    """A presser's capsules as they lie in the plane of the skin, without their forces.

    What stands on its tip is a ball there.
    """
    found: list[Body] = []

    def lay(piece: Piece, at: FloatArray, turned: float) -> None:
        at = at + _turn(turned) @ piece.at[:2]
        turn = _turn(turned + piece.turn)
        for one in piece.flesh:
            ends = [at + turn @ end[:2] for end in (one.start, one.end)]
            stands = one.start[2] != one.end[2]
            start, end = _pair(ends[0]), _pair(ends[0 if stands else 1])
            found.append(Body(start, end, one.radius, 0.0, 0.0, flesh * piece.firm, FOLLOWS))
        for further in piece.further:
            lay(further, at, turned + piece.turn)

    for mount in presser.mounts:
        lay(mount.piece, np.array(mount.spot), 0.0)
    return found


def carried(bodies: Sequence[Body], places: FloatArray, forces: FloatArray) -> list[Body]:
    """The bodies with what springs (k, 2) [m] under them carry, (k,) [N]; none without a force.

    A spring is under the body whose axis is nearest.
    """
    known = np.isfinite(places[:, 0]) & (forces > 0)
    distance = [_from_axis(body, places[known]) for body in bodies]
    own = np.argmin(distance, axis=0)
    total = np.bincount(own, forces[known], minlength=len(bodies))
    return [
        replace(body, force=float(force))
        for body, force in zip(bodies, total, strict=True)
        if force > LEAST
    ]


def _drawn(
    stage: Stage,
    name: str,
    presser: Presser,
    person: Person,
    uv: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """(n,) load of a hand of ours, of the person's size, at the presser's place."""
    bodies = HANDS[name](Draw(rng, VARIETY, person.hand))
    middles = np.array([body.middle for body in bodies])
    foam = draw_foam(VARIETY, stage.sensors.sensing.foam, rng)
    points = uv + middles.mean(axis=0)
    if name == "whole_hand":  # palm on palm; theirs is a left hand and ours a right one
        points = (uv - presser.mounts[0].spot) * (1.0, -1.0)
    elif len(bodies) == len(presser.mounts):  # tips on the same spots
        shifts = np.array([mount.spot for mount in presser.mounts]) - middles
        bodies = [_moved(body, shift) for body, shift in zip(bodies, shifts, strict=True)]
        points = uv
    return bed_loads(bodies, foam, points, stage.skin).sum(axis=0)


def _moved(body: Body, shift: FloatArray) -> Body:
    start, end = np.array([body.start, body.end]) + shift
    return replace(body, start=_pair(start), end=_pair(end))


def _pair(point: FloatArray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _spring_places(ground: Ground, springs: IntArray, uv: FloatArray) -> FloatArray:
    """(k, 2) some springs in the plane, between the three taxels nearest to them."""
    bed = ground.bed
    far, nearest = cKDTree(bed.skin.positions).query(bed.places[springs], k=3)
    weight = 1.0 / np.maximum(far, 1e-6)
    weight /= weight.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("kt,ktd->kd", weight, uv[nearest]))


def _from_axis(body: Body, points: FloatArray) -> FloatArray:
    """(k,) distances of points (k, 2) from the axis of a body [m]."""
    start = np.array(body.start)
    axis = np.array(body.end) - start
    along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - along[:, None] * axis, axis=1))


def _turn(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


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
            for key in ("iou", "beside", "drawn", "again", "ours", "mujoco", "seconds")
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
            print(
                f"{variant} {name}: IoU {row['iou']:.2f}, laid beside {row['beside']:.2f}, drawn "
                f"{row['drawn']:.2f}, again {row['again']:.2f}; {row['seconds'] * 1e3:.0f} ms"
            )
    write(OUT, {**about("full"), "touches": chosen.touches, "parts": PARTS, "overlap": found})


if __name__ == "__main__":
    main()
