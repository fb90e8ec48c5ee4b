"""Periodic structures: how many there are, how firm under noise, and how long they take.

`python -m benchmarks.geometry.structures` prints the rows; `benchmarks/classify/classify.py`
takes them from `structure_rows`. CPU time of one thread, median of three after a warm-up.
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
from sklearn.metrics import adjusted_rand_score

import skinmap
from benchmarks.harness.timing import quartiles
from skinmap.arrays import FloatArray
from skinmap.neighbours.offsets import (
    Neighbourhoods,
    concatenate,
    flat_map_directions,
    neighbourhoods,
)
from skinmap.neighbours.structures import RADIUS, Structures, find_structures
from skinmap.skin.layouts import module_layout
from skinmap.skin.sheets import taxel_table, triangle_sheet
from skinmap.touch.prepared_skin import PreparedSkin

REPEATS = 3
RARE = 5
ROBOTS = ("kaspar", "icub")
Placed = tuple[FloatArray, FloatArray, FloatArray]  # positions, normals, reference directions
PARTS = {"right_arm": 49, "right_leg_upper": 39, "torso": 97}  # at most so many, no rotation
LATTICES = {"triangle_12pad": (8e-3, 8.8e-3), "triangle_10pad": (8e-3, 9.15e-3)}
SIZES = {"kaspar": 1.0, "icub": 1.0, "100,000 taxels of 10-pad tiling": 30.0}  # CPU seconds


def structure_rows(*, seeds: int = 5) -> list[dict[str, Any]]:
    """Rows with the key `what`: time, part or noise, and what was measured beside the bound."""
    icub, kaspar = placed("icub"), placed("kaspar")
    large = {"sheet": noisy(tiling("triangle_10pad", 100), 0.1e-3, 0)}
    rows = [
        time_row(name, skins, bound)
        for (name, bound), skins in zip(SIZES.items(), (kaspar, icub, large), strict=True)
    ]
    for part, most in PARTS.items():
        for radius in (RADIUS, 8.6e-3):
            rows.append(part_row(part, icub[part], radius, most))
    for name, radii in LATTICES.items():
        for radius in radii:
            for rotations in (1, 6):
                rows += [
                    noise_row(name, radius, rotations, noise, seeds)
                    for noise in (0.1e-3, 0.25e-3, 0.5e-3)
                ]
    return rows


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


def time_row(name: str, skins: dict[str, Placed], bound: float) -> dict[str, Any]:
    """CPU time of neighbourhoods and structures together, compiled and not."""
    row: dict[str, Any] = {"what": "time", "skin": name, "bound_cpu_s": bound}
    for rotations in (1, 6):
        for key, compiled in (("compiled", True), ("numpy", False)):
            if key == "numpy" and name not in ROBOTS:
                continue  # minutes
            seconds = []
            for _ in range(REPEATS + 1 if compiled else 1):
                start = time.process_time()
                hoods = hoods_of(skins, RADIUS)
                found = find_structures(hoods, rotations=rotations, compiled=compiled)
                seconds.append(time.process_time() - start)
            tail = seconds[1:] or seconds
            row[f"cpu_s_{key}_rotations_{rotations}"] = round(float(np.median(tail)), 3)
            row[f"quartiles_s_{key}_rotations_{rotations}"] = quartiles(tail)
        row["taxels"] = len(found.labels)
        row[f"structures_rotations_{rotations}"] = len(found.prototypes)
        row[f"rare_share_rotations_{rotations}"] = rare_share(found)
    return row


def part_row(part: str, skin: Placed, radius: float, most: int) -> dict[str, Any]:
    """Structures of one part of the iCub, with a hard and a soft radius."""
    row: dict[str, Any] = {"what": "part", "part": part, "radius_mm": 1e3 * radius, "bound": most}
    hard = neighbourhoods(*skin, radius=radius, band=0.0)
    row["hard_radius"] = len(find_structures(hard).prototypes)
    for rotations in (1, 6):
        found = find_structures(neighbourhoods(*skin, radius=radius), rotations=rotations)
        row[f"rotations_{rotations}"] = len(found.prototypes)
        row[f"rare_share_rotations_{rotations}"] = rare_share(found)
    return row


def noise_row(name: str, radius: float, rotations: int, noise: float, seeds: int) -> dict[str, Any]:
    """Adjusted Rand index of labels against the noise-free ones, worst of several seeds."""
    skin = tiling(name, 6)
    quiet = find_structures(neighbourhoods(*skin, radius=radius), rotations=rotations)
    index, count, seconds = [], [], []
    for seed in range(seeds):
        hoods = neighbourhoods(*noisy(skin, noise, seed), radius=radius)
        start = time.process_time()
        found = find_structures(hoods, rotations=rotations)
        seconds.append(time.process_time() - start)
        index.append(float(adjusted_rand_score(quiet.labels, found.labels)))
        count.append(len(found.prototypes))
    return {
        "what": "noise",
        "lattice": name,
        "radius_mm": 1e3 * radius,
        "rotations": rotations,
        "noise_mm": 1e3 * noise,
        "taxels": len(quiet.labels),
        "structures": len(quiet.prototypes),
        "structures_with_noise": [min(count), max(count)],
        "adjusted_rand_index": {"worst": min(index), "mean": float(np.mean(index))},
        "cpu_s": round(float(np.median(seconds)), 3),
    }


def rare_share(found: Structures) -> float:
    """Share of the taxels in structures with fewer than five members."""
    counts = found.counts
    return round(1.0 - float(counts[counts >= RARE].sum()) / max(len(found.labels), 1), 4)


if __name__ == "__main__":
    for line in structure_rows():
        print(json.dumps(line))
