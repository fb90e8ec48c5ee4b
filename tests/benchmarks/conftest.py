"""A planted run of `make bench`."""

from __future__ import annotations

import pytest


@pytest.fixture
def planted() -> dict:
    """A run of `make bench` as short as can be, with one area that failed."""
    from benchmarks.harness.asked import judge
    from benchmarks.harness.record import about

    case = {"what": "parts loaded", "case": "13", "cpu_s": 0.5, "mb": 20.0, "turns": 3,
            "spread_s": [0.4, 0.5, 0.6], "spread_mb": None}  # fmt: skip
    geometry = {"icub": {"flips": 0, "patches": 22, "seconds": 0.3}}
    ran = {"form": "short", "shorter": "", "load_average": 0.1, "seconds": 1.0, "cpu_seconds": 1.0}
    result = about("short") | {
        "seconds": 60.0,
        "areas": {
            "geometry": ran | {"rows": geometry},
            "live": ran | {"failed": "exit 1: no <network> here"},
            "needs": ran | {"rows": {"cases": [case]}},
        },
    }
    result["asked"] = judge(result)
    return result
