"""Speed of the classification of touches: `make bench-classify` (`--quick` for a glance).

Every figure is CPU time of one thread, the median of rounds in which we and the peers take
turns; ratios are the peer's time over ours. Results, with versions and sizes, go to
benchmarks/results/classify.json.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

from histogram_speed import histogram_row
from live_speed import live_rows
from svm_speed import svm_row
from threadpoolctl import threadpool_limits

RESULT = Path(__file__).parent / "results" / "classify.json"
LIBRARIES = ("numpy", "scipy", "scikit-learn", "numba")


def structure_rows() -> list[dict[str, Any]]:
    """Time of the search for structures, from benchmarks/structures.py."""
    try:
        from structures import structure_rows as rows
    except ImportError:
        return []
    return list(rows())


def commit() -> str:
    """The commit that was measured."""
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    return done.stdout.strip() or "unknown"


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, few rounds")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args(arguments)
    quick = options.quick
    shares = ((6, 1.0), (6, 0.03)) if quick else ((1, 1.0), (1, 0.03), (6, 1.0), (6, 0.03))
    result = {
        "commit": commit(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in LIBRARIES},
        "cpu": platform.processor() or platform.machine(),
        "quick": quick,
        "histogram": [histogram_row(rotations, share, quick) for rotations, share in shares],
        "intersection_svm": [svm_row(real, quick) for real in (False, True)],
        "sample_to_labels": live_rows(quick),
        "structures": [] if quick else structure_rows(),
    }
    options.out.parent.mkdir(exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    for key in ("histogram", "intersection_svm", "sample_to_labels", "structures"):
        for row in result[key]:  # type: ignore[attr-defined]
            print(key, json.dumps(row.get("ratios", row)))
    return result


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
