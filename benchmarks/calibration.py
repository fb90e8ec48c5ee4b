"""Accuracy and time of calibrations: `make bench-calibration` (`--quick` for a glance).

Evidence is simulated on real boards and links of the iCub, so every accuracy here is simulated;
the truth is named with each table. Times are CPU time of one thread, the wrap of a link's mesh
apart, as it is kept. Results go to benchmarks/results/calibration.json.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

# This file has the name of the package that it measures, and its folder comes first: the
# checkout has to come before it.
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from mounts import drift_rows, mount_rows
from patches import Case, far_apart, icub_cases, simulate_touches
from threadpoolctl import threadpool_limits
from units import unit_rows

from calibration import PatchCalibration, Status, locate_by_touch, wrap_layout
from calibration.target import make_target

RESULT = Path(__file__).parent / "results" / "calibration.json"
TABLES = ("wrap", "touch", "units", "scan", "mount", "drift")
TRUTH = "taxels of the built-in iCub; evidence simulated"
WRAPS = (  # anchors, scale and jitter of the layout [m], goals for median and p95 [mm]
    (3, 1.0, 0.0, None),
    (4, 1.0, 0.0, (1.2, 2.3)),
    (8, 1.0, 0.0, (0.8, 1.7)),
    (4, 1.01, 0.3e-3, (1.2 * 1.15, 2.3 * 1.15)),
    (8, 1.01, 0.3e-3, (0.8 * 1.15, 1.7 * 1.15)),
)
TOUCHES: tuple[tuple[int, dict[str, Any], float | None], ...] = (  # count, how, goal [mm]
    (32, {"noise": 1e-3}, 0.9),
    (64, {"noise": 2e-3, "wrong": 0.3, "dead": 0.2}, 1.3),
    (32, {"noise": 1e-3, "one_module": True}, None),
    (7, {"noise": 1e-3}, None),
)


def wrap_rows(cases: list[Case], repeats: int) -> list[dict[str, Any]]:
    """Boards wrapped by 3, 4 and 8 anchors of 1 mm, with true layouts and with wrong ones."""
    rows = []
    for anchors, scale, jitter, goal in WRAPS:
        runs = []
        for number, case in enumerate(cases):
            for repeat in range(repeats):
                rng = np.random.default_rng([repeat, anchors, number, 1])
                layout = scale * case.layout + rng.normal(0.0, jitter, case.layout.shape)
                taxels = far_apart(layout, anchors, rng)
                points = case.truth[taxels] + rng.normal(0.0, 1e-3, (anchors, 3))
                make_target(case.vertices, case.faces)
                start = time.process_time()
                found = wrap_layout(layout, case.vertices, case.faces, taxels, points, rng=rng)
                runs.append(_measured(found, case.truth, time.process_time() - start))
        rows.append(
            {"anchors": anchors, "scale": scale, "jitter_mm": 1e3 * jitter, "goal_mm": goal}
            | _table_row(runs)
        )
    return rows


def touch_rows(cases: list[Case], repeats: int) -> list[dict[str, Any]]:
    """Boards located by touches alone, gains spread by a quarter."""
    rows = []
    for count, how, goal in TOUCHES:
        runs = []
        for number, case in enumerate(cases):
            if how.get("one_module") and len(np.unique(case.modules)) < 2:
                continue
            for repeat in range(repeats):
                rng = np.random.default_rng([repeat, count, number, 2])
                touches = simulate_touches(case, count, rng, **how)
                make_target(case.vertices, case.faces)
                start = time.process_time()
                found = locate_by_touch(case.layout, case.vertices, case.faces, touches, rng=rng)
                runs.append(_measured(found, case.truth, time.process_time() - start))
        rows.append({"touches": count, **how, "goal_mm": goal} | _table_row(runs))
    return rows


def _measured(found: PatchCalibration, truth: Any, seconds: float) -> dict[str, Any]:
    error = found.positions - truth
    length = 1e3 * np.linalg.norm(error, axis=1)
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    return {
        "median": float(np.median(length)),
        "p95": float(np.percentile(length, 95)),
        "nees": float(square.mean() / 3),
        "seconds": seconds,
        "status": found.status,
    }


def _table_row(runs: list[dict[str, Any]]) -> dict[str, Any]:
    statuses = [str(run["status"]) for run in runs]
    trusted = [run["median"] for run in runs if run["status"] is Status.OK]
    return {
        "runs": len(runs),
        "median_mm": float(np.median([run["median"] for run in runs])),
        "p95_mm": float(np.median([run["p95"] for run in runs])),
        "worst_median_mm": max(run["median"] for run in runs),
        "worst_median_ok_mm": max(trusted, default=None),
        "normalised_error_squared": float(np.mean([run["nees"] for run in runs])),
        "statuses": {name: statuses.count(name) for name in sorted(set(statuses))},
        "seconds": {
            "mean": float(np.mean([run["seconds"] for run in runs])),
            "max": max(run["seconds"] for run in runs),
        },
    }


def scan_table(cases: list[Case], runs: int) -> Any:
    """Rows of scans, none without their optional package."""
    try:
        import open3d  # noqa: F401
    except ImportError:
        print("no table of scans: open3d is not installed", file=sys.stderr)
        return []
    from scans import scan_rows

    return scan_rows(cases, runs)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few patches, few runs")
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument(
        "--only", nargs="+", choices=TABLES, default=TABLES,
        help="measure these tables; the others stay as they are in the file",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    cases = list(icub_cases())
    some = cases[7:8] if options.quick else cases
    repeats = 1 if options.quick else 2
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    commit = done.stdout.strip() or "unknown"
    tables: dict[str, Callable[[], Any]] = {
        "wrap": lambda: wrap_rows(some, repeats),
        "touch": lambda: touch_rows(some, repeats),
        "units": lambda: unit_rows(some),
        "scan": lambda: scan_table(cases, 4 if options.quick else 50),
        "mount": mount_rows,
        "drift": drift_rows,
    }
    kept = {} if set(options.only) == set(TABLES) else json.loads(options.out.read_text())
    measured = {name: tables[name]() for name in TABLES if name in options.only}
    result: dict[str, Any] = {
        "commit": commit,
        "python": platform.python_version(),
        "versions": {name: version(name) for name in ("numpy", "scipy", "pymeshlab")},
        "quick": options.quick,
        "truth": TRUTH,
        "measured_at": dict.fromkeys(kept.keys() & set(TABLES), kept.get("commit"))
        | kept.get("measured_at", {})
        | dict.fromkeys(measured, commit),
        **{name: kept[name] for name in TABLES if name in kept},
        **measured,
    }
    options.out.parent.mkdir(exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    for name, rows in measured.items():
        for row in rows if isinstance(rows, list) else [rows]:
            print(name, json.dumps(row), flush=True)
    return result


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
