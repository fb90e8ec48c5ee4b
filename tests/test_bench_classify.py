"""The benchmark of classification runs in its quick form; its figures are no test."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_the_quick_benchmark_of_classification_writes_all_rows(tmp_path):
    pytest.importorskip("numba", reason="the benchmark compares compiled loops")
    out = tmp_path / "classify.json"
    command = [sys.executable, "-m", "benchmarks.classify.classify", "--quick"]
    subprocess.run(
        [*command, "--out", str(out)], check=True, capture_output=True, timeout=300, cwd=ROOT
    )
    told = json.loads(out.read_text())
    assert [row["votes_that_differ"] for row in told["histogram"]] == [0, 0]
    for row in told["intersection_svm"]:
        assert row["largest_difference"] < 1e-9
        assert row["labels_that_differ"] == 0
    assert {row["classifier"] for row in told["sample_to_labels"]} == {
        "contact-geometry",
        "histogram",
    }


def test_the_committed_results_of_classification_hold_what_was_promised():
    told = json.loads((ROOT / "benchmarks" / "results" / "classify.json").read_text())
    assert told.get("form", "full") == "full"
    assert all(row["votes_that_differ"] == 0 for row in told["histogram"])
    assert all(row["largest_difference"] < 1e-9 for row in told["intersection_svm"])
