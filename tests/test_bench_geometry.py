"""The benchmark of the geometry runs, and its file holds what the documents promise."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def quick(tmp_path_factory) -> dict:
    """The result of `benchmarks/geometry/geometry.py --quick`."""
    out = tmp_path_factory.mktemp("geometry")
    command = [
        sys.executable,
        "-m",
        "benchmarks.geometry.geometry",
        "--quick",
        "--out",
        out / "geometry.json",
    ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run(command, check=True, capture_output=True, env=environment, cwd=ROOT)
    return json.loads((out / "geometry.json").read_text(encoding="utf-8"))


def test_the_geometry_benchmark_measures_us_beside_the_peers(quick):
    rows = {row["method"]: row for row in quick["flattening"] if "method" in row}
    assert {"fast", "balanced", "dirichlet", "libigl LSCM", "libigl SLIM-2 from BFF"} <= set(rows)
    assert all(row["flips"] == 0 for row in rows.values())
    assert all(row["seconds"] > 0 and row["C"] > 0 for row in rows.values())
    # Accuracy is no matter of the machine: 2 steps of SLIM do not reach our descent.
    assert (
        rows["dirichlet"]["symmetric_dirichlet"]
        <= rows["libigl SLIM-2 from BFF"]["symmetric_dirichlet"]
    )
    assert sum(row.get("is_C", False) for row in quick["flattening"]) == 1


def test_the_geometry_benchmark_holds_the_bounds_that_are_no_times(quick):
    icub = quick["icub"]
    assert icub["flips"] == 0
    assert icub["edge_rms_percent"]["worst"] <= 1.4
    assert icub["edge_rms_percent"]["median"] <= 0.5
    assert icub["normals_deg_median"] <= 5.0
    assert icub["normals_within_15_deg_percent"] >= 90.0
    assert {"commit", "versions", "threads", "machine", "format"} <= set(quick)
