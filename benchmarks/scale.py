"""One thousand robots: what they would cost by the cost of a few, and how well that foretells many.

Robots are varied iCubs: 4,326 taxels each, stretched by up to 5 % along each axis, every taxel
moved by some 0.05 mm. Each task is a seed, so nothing of a robot is held longer than it is worked
on. `make bench-scale` writes benchmarks/results/scale.json; docs/scale.md has the formula.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scale_robots import robot, timed

from skinmap.parallel.run import each_result
from skinmap.parallel.workers import Workers, open_workers

RESULTS = Path(__file__).parent / "results"
GOAL = 1000  # robots
BASIS = 2  # robots that the estimate is made from
# Robots that are computed: as many as take some 30 s on two cores.
SIZES = {"maps": (1, 10, 50, 200), "structures": (1, 10, 40), "evaluation": (1, 8), "wraps": (1, 8)}
QUICK = {"maps": (1, 4), "structures": (1, 2), "evaluation": (1,), "wraps": (1,)}


def measure(stage: str, count: int, workers: Workers, basis: float) -> dict[str, Any]:
    """So many robots through one stage, beside what `basis` seconds a robot foretold."""
    start = time.perf_counter()
    found = each_result(timed, ((stage, seed) for seed in range(count)), workers=workers)
    rows = [row for _, row in found]
    wall = time.perf_counter() - start
    cpu = sum(row[1] for row in rows)
    return {
        "robots": count,
        "estimated_cpu_s": basis * count,
        "cpu_s": cpu,
        "ratio": cpu / (basis * count),
        "wall_s": wall,
        "share_of_cores": cpu / (wall * workers.jobs),
        "worker_peak_mb": max(row[2] for row in rows),
        "own_peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "result_mean": float(np.mean([row[0] for row in rows])),
    }


def run(sizes: dict[str, tuple[int, ...]], jobs: int) -> dict[str, Any]:
    """All stages: estimate, measurement, and the thousand robots that follow."""
    stages: dict[str, Any] = {}
    with open_workers(Workers(jobs=jobs)) as workers:
        for stage, counts in sizes.items():
            # Other seeds than those measured; the first one warms up what is compiled and read.
            warm = [timed((stage, GOAL + k))[1] for k in range(BASIS + 1)][1:]
            basis = float(np.mean(warm))
            rows = [measure(stage, count, workers, basis) for count in counts]
            best = rows[-1]["cpu_s"] / rows[-1]["robots"]
            stages[stage] = {
                "cpu_s_a_robot": best,
                "estimate_cpu_h_for_goal": best * GOAL / 3600.0,
                "measured": rows,
            }
            print(f"{stage}: {best:.2f} s a robot, {best * GOAL / 60:.0f} min of CPU for {GOAL}")
            for row in rows:
                print(
                    f"  {row['robots']:4d} robots: estimated {row['estimated_cpu_s']:7.1f} s, "
                    f"measured {row['cpu_s']:7.1f} s ({row['ratio']:.2f}), wall "
                    f"{row['wall_s']:6.1f} s, worker {row['worker_peak_mb']:.0f} MB"
                )
    return stages


def main() -> None:
    """Measure and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    os.environ["SKINMAP_CACHE"] = "off"  # a thousand different robots find nothing there
    record = {
        "goal_robots": GOAL,
        "taxels": sum(len(robot().skin(part)) for part in robot().parts),
        "robots_are": "simulated: varied iCubs",
        "jobs": options.jobs,
        "versions": {name: version(name) for name in ("skinmap", "numpy", "scipy")},
        "quick": options.quick,
        "stages": run(QUICK if options.quick else SIZES, options.jobs),
    }
    name = "scale_quick.json" if options.quick else "scale.json"
    folder = Path("build") if options.quick else RESULTS
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
