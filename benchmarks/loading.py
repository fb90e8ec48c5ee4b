"""Time and memory to have 1 and 13 parts of the iCub ready: `make bench-loading`.

Each case runs in a process of its own, several times; the imports are measured apart. Results
go to benchmarks/results/loading.json.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path
from statistics import median

REPEATS = 5
CASES = {"1 part": 1, "13 parts": 13}
CHILD = """
import json, resource, sys, time
import numpy, scipy.spatial, scipy.sparse.csgraph, trimesh, yourdfpy, igl, icub_models
import skinmap.io.manifest
def memory(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
imported = memory()
start, wall = time.process_time(), time.perf_counter()
robot = skinmap.load_robot("icub")
parts = robot.parts[-int(sys.argv[1]):]
taxels = sum(len(robot.skin(part)) for part in parts)
print(json.dumps({"cpu_s": time.process_time() - start, "wall_s": time.perf_counter() - wall,
    "imports_mb": imported, "peak_mb": memory(), "taxels": taxels}))
"""


def measure(parts: int) -> dict[str, float]:
    """Medians over fresh processes."""
    runs = []
    for _ in range(REPEATS):
        result = subprocess.run(
            [sys.executable, "-c", CHILD, str(parts)], capture_output=True, text=True, check=True
        )
        runs.append(json.loads(result.stdout.splitlines()[-1]))
    return {key: median(run[key] for run in runs) for key in runs[0]}


def main() -> None:
    """Measure, print and write."""
    rows = {name: measure(parts) for name, parts in CASES.items()}
    for name, row in rows.items():
        extra = row["peak_mb"] - row["imports_mb"]
        print(
            f"{name}: {row['taxels']:.0f} taxels, {row['cpu_s']:.3f} s CPU, {row['wall_s']:.3f} s, "
            f"{extra:.0f} MB above the {row['imports_mb']:.0f} MB of the imports"
        )
    result = {"python": platform.python_version(), "repeats": REPEATS, "rows": rows}
    target = Path(__file__).parent / "results" / "loading.json"
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
