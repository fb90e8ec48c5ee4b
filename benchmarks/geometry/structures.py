"""Periodic structures: how many there are, how firm under noise, and how long they take.

`benchmarks/classify/classify.py` takes the rows from `structure_rows`. CPU time of one thread,
median of three after a warm-up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.metrics import adjusted_rand_score

import skinmap
from benchmarks.harness.timing import quartiles, timed
from skinmap.arrays import FloatArray
from skinmap.neighbours.offsets import (
    BAND,
    LATTICE,
    Neighbourhoods,
    concatenate,
    flat_map_directions,
    neighbourhoods,
)
from skinmap.neighbours.structures import RADIUS, Structures, find_structures
from skinmap.skin.layouts import module_layout
from skinmap.skin.modules import taxel_table, triangle_sheet
from skinmap.touch.prepared_skin import PreparedSkin

REPEATS = 3
NOISE = 0.25e-3  # of the positions [m]
Placed = tuple[FloatArray, FloatArray, FloatArray]  # positions, normals, reference directions
PARTS = ("right_arm", "right_leg_upper", "torso")
LATTICES = {"triangle_12pad": 8e-3, "triangle_10pad": 9.15e-3}  # radius [m]


def structure_rows(*, seeds: int = 5) -> list[dict[str, Any]]:
    """Rows with the key `what`: time, part or noise, and what was measured beside the bound."""
    icub = placed("icub")
    sheet = {"sheet": noisy(tiling("triangle_10pad", 100), 0.1e-3, 0)}
    return [
        time_row("icub", icub),
        time_row("100,000 taxels of 10-pad tiling", sheet),
        *(part_row(part, icub[part]) for part in PARTS),
        *(noise_row(name, radius, seeds) for name, radius in LATTICES.items()),
    ]


def placed(name: str) -> dict[str, Placed]:
    """Positions, normals and reference directions of each part of a robot."""
    robot = skinmap.load_robot(name)
    found = {}
    for part in robot.parts:
        skin = PreparedSkin(robot.skin(part))
        directions = flat_map_directions(skin.flat)
        found[part] = (skin.skin.positions, skin.skin.normals, directions)
    return found


def tiling(name: str, rows: int, *, most: int = 100_000) -> Placed:
    """A flat sheet of `rows` rows of twice as many boards, of at most so many taxels."""
    layout = module_layout(name)
    centres, angles = triangle_sheet([(0, 2 * rows)] * rows, layout.side or 0.0)
    poses = np.tile(np.eye(4), (len(centres), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    poses[:, :2, 3] = centres
    points = taxel_table(poses, layout).positions[:most]
    n = len(points)
    return points, np.tile([0.0, 0.0, 1.0], (n, 1)), np.tile([0.0, 1.0, 0.0], (n, 1))


def noisy(skin: Placed, noise: float, seed: int) -> Placed:
    """The same with normal noise on the positions in the plane [m]."""
    points, normals, reference = skin
    shift = np.random.default_rng(seed).normal(scale=noise, size=points.shape)
    return points + shift * [1.0, 1.0, 0.0], normals, reference


def hoods_of(skins: dict[str, Placed], radius: float) -> Neighbourhoods:
    """Neighbourhoods of several parts."""
    return concatenate([neighbourhoods(*skin, radius=radius) for skin in skins.values()])


def time_row(name: str, skins: dict[str, Placed]) -> dict[str, Any]:
    """CPU time of neighbourhoods and structures together, compiled and, of a robot, not."""
    row: dict[str, Any] = {"what": "time", "skin": name}
    for key, compiled in (("compiled", True), ("numpy", False)):
        if key == "numpy" and name != "icub":
            continue  # minutes
        seconds = []
        for _ in range(REPEATS + 1 if compiled else 1):
            found, cpu, _ = timed(
                lambda how=compiled: find_structures(
                    hoods_of(skins, RADIUS), rotations=LATTICE, compiled=how
                )
            )
            seconds.append(cpu)
        tail = seconds[1:] or seconds
        row[f"cpu_s_{key}_rotations_6"] = round(float(np.median(tail)), 3)
        row[f"quartiles_s_{key}_rotations_6"] = quartiles(tail)
        row["taxels"] = len(found.labels)
    return row


def part_row(part: str, skin: Placed) -> dict[str, Any]:
    """Structures of one part of the iCub without rotation, with a hard and a soft radius."""
    hard, soft = (
        len(find_structures(neighbourhoods(*skin, radius=RADIUS, band=band)).prototypes)
        for band in (0.0, BAND)
    )
    radius_mm = 1e3 * RADIUS
    return {"what": "part", "part": part, "radius_mm": radius_mm, "hard_radius": hard,
            "rotations_1": soft}  # fmt: skip


def noise_row(name: str, radius: float, seeds: int) -> dict[str, Any]:
    """Adjusted Rand index of labels against the noise-free ones, worst of several seeds."""
    skin = tiling(name, 6)

    def found(placed: Placed) -> Structures:
        return find_structures(neighbourhoods(*placed, radius=radius), rotations=LATTICE)

    quiet = found(skin)
    index = [
        float(adjusted_rand_score(quiet.labels, found(noisy(skin, NOISE, seed)).labels))
        for seed in range(seeds)
    ]
    return {
        "what": "noise",
        "lattice": name,
        "radius_mm": 1e3 * radius,
        "rotations": LATTICE,
        "noise_mm": 1e3 * NOISE,
        "taxels": len(quiet.labels),
        "structures": len(quiet.prototypes),
        "adjusted_rand_index": {"worst": min(index), "mean": float(np.mean(index))},
    }
