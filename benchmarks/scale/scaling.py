"""Time and memory from 1,000 to 1,000,000 taxels, the peers beside us in the same processes.

Each point of a curve is measured in a process of its own, forked after the imports, which shows its
memory (the largest resident size above that after the input). All curves go on to a size before any
goes on to the next. A point that would take longer than its share, more memory than is free, or
more than what is left of the time of all, by what the size before took, is left out and says so.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.forked import CaseError, Cases
from benchmarks.scale.scaling_cases import turns_at, warm_at

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000, 1_000_000)
DECADES = (1_000, 10_000, 100_000, 1_000_000)
CURVES: Mapping[str, Sequence[int]] = {
    "fast": SIZES,
    "meshing": SIZES,
    "contacts": DECADES,
    "drawing": DECADES,
    "histograms": DECADES,
    "structures": DECADES,
    "balanced": SIZES,  # last, as time may run out
}
LONGEST = 300.0  # CPU time of one point, its input included [s]; a longer one is left out
BUDGET = 1200.0  # CPU time of all points [s]
GROWTH = 1.1  # exponent by which the next size's time is foreseen from the last one's
FREE_SHARE = 0.7  # of the memory that is free a point may be foreseen to take
POINT = ("point_cpu_s", "point_fixed_cpu_s", "point_mb")
PROGRAM = (sys.executable, "-m", "benchmarks.scale.scaling_cases")


def measure(quick: bool, *, longest: float = LONGEST, budget: float = BUDGET) -> dict[str, Any]:
    """Rows of all curves.

    Parameters
    ----------
    quick : bool
        1,000 taxels only.
    longest, budget : float
        CPU time of one point and of all [s].
    """
    rows: list[dict[str, Any]] = []
    last: dict[str, Last] = {}  # of a curve
    spent = 0.0
    with Cases(PROGRAM) as cases:
        for n in SIZES[:1] if quick else SIZES:
            for curve in (name for name, sizes in CURVES.items() if n in sizes):
                left = min(longest, budget - spent)
                reason = last[curve].too_much(n, left) if curve in last else ""
                found = [{"left_out": reason}] if reason else point(cases, curve, n)
                rows += [{"curve": curve, "taxels": n, "peer": False} | row for row in found]
                if "left_out" not in found[0]:
                    last[curve] = Last(n, *(found[0][key] for key in POINT))
                    spent += last[curve].seconds
    return {"curves": in_order(rows), "exponents": exponents(rows), "budget_s": budget}


@dataclass(frozen=True, slots=True)
class Last:
    """What the size before took.

    Attributes
    ----------
    taxels : int
    seconds, fixed : float
        CPU time of the point, and of that what is the same at every size [s].
    mb : float
        Largest size of its process [MB].
    """

    taxels: int
    seconds: float
    fixed: float
    mb: float

    def too_much(self, n: int, left: float) -> str:
        """Why n taxels are left out where `left` seconds are left; "" where they are not."""
        grown = n / self.taxels
        passes = (calls_at(n) / calls_at(self.taxels)) * grown**GROWTH
        seconds = self.fixed + (self.seconds - self.fixed) * passes
        if seconds > left:
            return f"would take about {seconds:.0f} s of {max(left, 0.0):.0f} s left for it"
        mb, free = self.mb * grown, free_mb()
        if mb > FREE_SHARE * free:
            return f"would need about {mb:,.0f} MB where {free:,.0f} MB are free"
        return ""


def calls_at(n: int) -> int:
    """Calls of each task at a size."""
    return 1 + warm_at(n) + turns_at(n)


def free_mb() -> float:
    """Memory that a process can have without another losing its own [MB]; inf if not known."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return float("inf")
    fields = dict(line.split(":", 1) for line in lines)
    return float(fields["MemAvailable"].split()[0]) / 1024


def point(cases: Cases, curve: str, n: int) -> list[dict[str, Any]]:
    """Rows of one curve at one size, one for each of ours and each peer; or what went wrong.

    The first has besides what the whole point took: `POINT`.
    """
    try:
        told = cases.ask(curve, n)
    except CaseError as error:
        return [{"left_out": str(error)}]
    whole = (told[key] for key in ("case_cpu_s", "fixed_cpu_s", "case_mb"))
    told["rows"][0] |= dict(zip(POINT, whole, strict=True))
    return list(told["rows"])


def in_order(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows curve after curve instead of size after size."""
    names = list(dict.fromkeys(row["curve"] for row in rows))
    return sorted(rows, key=lambda row: names.index(row["curve"]))


def exponents(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Slope of log seconds over log taxels of each curve, from 10,000 taxels on."""
    fits = {}
    for name in dict.fromkeys(row["curve"] for row in rows):
        own = [row for row in rows if row["curve"] == name and row.get("cpu_s")]
        points = [(row["taxels"], row["cpu_s"]) for row in own if row["taxels"] >= 9_000]
        if len(points) >= 2:
            fits[name] = float(np.polyfit(*np.log(np.array(points, float)).T, 1)[0])
    return fits


if __name__ == "__main__":
    from benchmarks.harness.record import command

    command(measure, __doc__, "scaling")
