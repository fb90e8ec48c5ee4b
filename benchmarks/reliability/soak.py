"""All that Skinmap must survive, one after the other, with a table at the end.

`python -m benchmarks.reliability.soak [--quick] [PART...]` writes benchmarks/results/
reliability.json, part by part, so that a run that is interrupted has lost one; `make reliability`
makes docs/reliability.md of it. What `make fuzz` tried is taken from build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS, commit
from benchmarks.reliability import cuts, full_disk, stops
from benchmarks.reliability.page import rows

FILE = RESULTS / "reliability.json"
COUNTS = ROOT / "build" / "fuzz" / "counts.json"
Part = Callable[[bool], Mapping[str, Any]]


def main() -> int:
    """Run the parts and print the table; 1 where one of them found a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help=f"all by default: {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="see whether it runs; nothing is kept")
    given = parser.parse_args()
    strange = [name for name in given.parts if name not in PARTS]
    if strange:
        print(f"no part {strange[0]!r}; the parts are: {', '.join(PARTS)}", file=sys.stderr)
        return 2
    found: dict[str, Any] = {}
    if FILE.exists() and not given.quick:
        found = json.loads(FILE.read_text(encoding="utf-8"))
    for name in given.parts or PARTS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        found[name] = {
            **PARTS[name](given.quick),
            "date": datetime.now(UTC).date().isoformat(),
            "commit": commit(),
        }
        if not given.quick:
            FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    table = rows(found)
    for promise, _, figure, date in table:
        print(f"{promise[:60]:60} {figure[:70]:70} {date}")
    return 1 if any(one.get("faults") for one in found.values()) else 0


def _program(*words: str) -> Any:
    """What a program of the benchmarks prints as JSON."""
    ran = subprocess.run(
        [sys.executable, "-m", *words], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(ran.stdout)


def _fuzzed(_: bool) -> dict[str, Any]:
    """What the last `make fuzz` tried."""
    if not COUNTS.exists():
        return {"seconds": 0, "targets": {}, "runs": 0, "faults": 0}
    kept = json.loads(COUNTS.read_text(encoding="utf-8"))
    each = kept["targets"].values()
    runs, faults = sum(one["runs"] for one in each), sum(one["found"] for one in each)
    return {**kept, "runs": runs, "faults": faults}


def _kills(quick: bool) -> dict[str, Any]:
    """Recorders that are killed, and one on a full disk."""
    kills, minutes = ("2", "0.1") if quick else ("50", "1")
    words = ("benchmarks.live.recordings", "--kills", kills, "--minutes", minutes)
    found: dict[str, Any] = _program(*words)
    killed = found["kills"]
    lost = killed["most_lost_s"] > killed["goal_s"]
    return {**found, "faults": int(lost) + killed["count"] - killed["opened"]}


def _press(quick: bool) -> dict[str, Any]:
    words = ["benchmarks.live.live", "--only", "press", *["--quick"] * quick]
    return dict(_program(*words))


def _loop(quick: bool) -> dict[str, Any]:
    words = ["benchmarks.live.live", "--only", "soak", *["--quick"] * quick]
    found: dict[str, Any] = _program(*words)
    return {**found, "faults": int(found["most_grown_mb"] > MOST_GROWN_MB)}


def _window(quick: bool) -> dict[str, Any]:
    words = ["benchmarks.viewer.viewer_soak", "--updates", "2000" if quick else "200000"]
    return dict(_program(*words))


MOST_GROWN_MB = 5.0  # of the loop
PARTS: dict[str, Part] = {
    "fuzz": _fuzzed,
    "cuts": lambda quick: cuts.measure(places=10 if quick else cuts.PLACES),
    "full disk": lambda _: full_disk.measure(),
    "stops": lambda quick: stops.measure(each=1, names=["simulate"] if quick else ()),
    "kills": _kills,
    "press": _press,
    "loop": _loop,
    "window": _window,
}

if __name__ == "__main__":
    sys.exit(main())
