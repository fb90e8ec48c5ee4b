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
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.record import RESULTS
from benchmarks.scale.scale_robots import Row, robot, timed
from skinmap.parallel.pool import LocalPool
from skinmap.parallel.run import each_result
from skinmap.parallel.workers import Workers

GOAL = 1000  # robots
BASIS = 3  # robots that the estimate is made from, in one process: one cold, two warm
SIZES = {"maps": (4, 60), "structures": (2, 8), "evaluation": (2, 6), "wraps": (2, 6)}
QUICK = {"maps": (4,), "structures": (2,), "evaluation": (), "wraps": ()}


@dataclass(frozen=True)
class Estimate:
    """CPU seconds of a new process before its first robot is begun, and of each robot.

    The first robot's surplus (what is compiled and looked up once) counts as part of the start.
    """

    start: float
    robot: float

    def cpu(self, robots: int, processes: int) -> float:
        """CPU seconds of so many robots on so many processes that are started for them."""
        return processes * self.start + robots * self.robot

    def wall(self, robots: int, processes: int) -> float:
        """Seconds on as many cores that do nothing else."""
        return self.cpu(robots, processes) / processes


def sweep(stage: str, seeds: range, jobs: int) -> tuple[list[Row], float]:
    """Robots by new processes; their rows, and the wall time."""
    pool, start = LocalPool(jobs), time.perf_counter()
    try:
        tasks = ((stage, seed) for seed in seeds)
        found = dict(each_result(timed, tasks, workers=Workers(jobs=jobs, pool=pool)))
    finally:
        pool.close()
    return [found[place] for place in range(len(found))], time.perf_counter() - start


def foretell(stage: str) -> Estimate:
    """From robots with other seeds than those that are measured."""
    rows, _ = sweep(stage, range(GOAL, GOAL + BASIS), 1)
    each = float(np.mean([row.seconds for row in rows[1:]]))
    return Estimate(rows[0].total - each, each)


def measure(stage: str, count: int, jobs: int, basis: Estimate) -> dict[str, Any]:
    """So many robots through one stage, beside what was foretold."""
    rows, wall = sweep(stage, range(count), jobs)
    totals: dict[int, float] = {}
    for row in rows:
        totals[row.process] = max(totals.get(row.process, 0.0), row.total)
    cpu, told = sum(totals.values()), basis.cpu(count, len(totals))
    return {
        "robots": count,
        "processes": len(totals),
        "estimated_cpu_s": told,
        "cpu_s": cpu,
        "ratio": cpu / told,
        "estimated_wall_s": told / jobs,
        "wall_s": wall,
        "worker_peak_mb": max(row.peak_mb for row in rows),
        "own_peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "result_mean": float(np.mean([row.result for row in rows])),
    }


def run(sizes: dict[str, tuple[int, ...]], jobs: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each stage: estimate, measurement, and the thousand robots that follow."""
    for stage, counts in sizes.items():
        basis = foretell(stage)
        print(
            f"{stage}: {basis.start:.1f} s to start, {basis.robot:.2f} s a robot; {GOAL} robots: "
            f"{basis.wall(GOAL, jobs) / 60:.0f} min on {jobs} idle cores", flush=True,
        )  # fmt: skip
        rows = []
        for count in counts:
            row = measure(stage, count, jobs, basis)
            rows.append(row)
            print(
                f"  {row['robots']:4d} robots: estimated {row['estimated_cpu_s']:7.1f} s of CPU, "
                f"measured {row['cpu_s']:7.1f} s ({row['ratio']:.2f}), wall "
                f"{row['wall_s']:6.1f} s, worker {row['worker_peak_mb']:.0f} MB", flush=True,
            )  # fmt: skip
        yield (
            stage,
            {
                "estimate": asdict(basis),
                "goal_cpu_s": basis.cpu(GOAL, jobs),
                "goal_wall_s": basis.wall(GOAL, jobs),
                "measured": rows,
            },
        )


def main() -> None:
    """Measure and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--only", choices=SIZES, help="one stage, into the record of the others")
    parser.add_argument("--quick", action="store_true", help="two robots a stage, to build")
    options = parser.parse_args()
    os.environ["SKINMAP_CACHE"] = "off"  # a thousand different robots find nothing there
    record: dict[str, Any] = {
        "goal_robots": GOAL,
        "taxels": sum(len(robot().skin(part)) for part in robot().parts),
        "robots_are": "simulated: varied iCubs",
        "jobs": options.jobs,
        "versions": {name: version(name) for name in ("skinmap", "numpy", "scipy")},
        "quick": options.quick,
        "stages": {},
    }
    path = Path("build/scale_quick.json") if options.quick else RESULTS / "scale.json"
    path.parent.mkdir(exist_ok=True)
    sizes = QUICK if options.quick else SIZES
    if options.only:
        sizes = {options.only: sizes[options.only]}
        if path.exists():  # the other stages as they were measured
            record["stages"] = json.loads(path.read_text(encoding="utf-8"))["stages"]
    for stage, found in run(sizes, options.jobs):
        record["stages"][stage] = found
        path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
