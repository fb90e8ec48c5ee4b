"""Which sizes are left out, and why."""

from __future__ import annotations

import pytest


@pytest.fixture
def measured(monkeypatch):
    """Run `measure` with planted costs: CPU seconds for each 1,000 taxels of a curve."""
    from benchmarks.scale import scaling

    class Planted:
        def __init__(self, _program):
            self.seconds = 1e-3

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def ask(self, curve, n):
            if curve == "fast" and n == 3_000:
                raise scaling.CaseError("fast, 3000: not enough memory")
            row = {"curve": curve, "cpu_s": n * 1e-6}
            return {
                "rows": [row],
                "case_cpu_s": self.seconds * n / 1e3,
                "case_mb": 100.0,
                "fixed_cpu_s": 0.0,
            }

    monkeypatch.setattr(scaling, "Cases", Planted)
    return scaling.measure


def test_all_sizes_are_measured_where_time_and_memory_allow(measured):
    from benchmarks.scale.scaling import CURVES

    found = measured(False)
    left = [row for row in found["curves"] if "left_out" in row]
    assert [(row["curve"], row["taxels"]) for row in left] == [("fast", 3_000)]
    assert left[0]["left_out"] == "fast, 3000: not enough memory"
    assert len(found["curves"]) == sum(map(len, CURVES.values()))
    assert found["exponents"]["meshing"] == pytest.approx(1.0)


def test_what_is_left_out_says_by_how_much(measured, monkeypatch):
    from benchmarks.scale import scaling

    rows = measured(False, budget=0.5)["curves"]
    large = [row["left_out"] for row in rows if row["taxels"] == 1_000_000]
    assert all(one.startswith("would take about ") for one in large)
    assert any("taxels" in row and row["taxels"] == 10_000 and "cpu_s" in row for row in rows)
    monkeypatch.setattr(scaling, "free_mb", lambda: 300.0)
    rows = measured(False)["curves"]
    said = {row["left_out"] for row in rows if row["taxels"] == 10_000}
    assert "would need about 1,000 MB where 300 MB are free" in said
