"""All that Skinmap must survive, one after the other, with a table at the end.

`python -m benchmarks.reliability.soak [--quick] [PART...]` writes benchmarks/results/
reliability.json, part by part, so that a run that is interrupted has lost one; `make reliability`
makes docs/reliability.md of it. Whole it takes half a day; `--quick` takes two minutes and keeps
nothing. What `make fuzz` tried is taken from build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from benchmarks.harness.record import RESULTS, afresh, commit
from benchmarks.live import live, recordings
from benchmarks.reliability import cuts, full_disk, large, stops
from benchmarks.reliability.page import rows
from benchmarks.viewer import page_soak, viewer_soak

FILE = RESULTS / "reliability.json"
COVERAGE = cuts.CORPUS / "counts.json"
QUICK_DISK = ("export csv", "export .h5", "label -o csv")
UPDATES, SAMPLES = 200_000, 4_320_000  # of window and page; of the loop (a day at 50 Hz)
MOST_GROWN_MB = 5.0  # of the loop
MOST_WINDOW_MB = 20.0  # of window and page, whose pictures are kept in pieces of many sizes
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
    found = {} if given.quick else _kept()
    for name in given.parts or PARTS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        one = {
            **PARTS[name](given.quick),
            "date": datetime.now(UTC).date().isoformat(),
            "commit": commit(),
        }
        # Read again: other parts may have ended in a run beside this one, hours after its start.
        found = {**(found if given.quick else _kept()), name: one}
        if not given.quick:
            FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    for promise, _, figure, date in rows(found):
        print(f"{promise[:60]:60} {figure[:100]:100} {date}")
    faulty = [name for name, one in found.items() if one.get("faults")]
    print(f"faults in: {', '.join(faulty)}" if faulty else "no faults")
    return 1 if faulty else 0


def _kept() -> dict[str, Any]:
    """What earlier runs found, part by part."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def _coverage(_: bool) -> dict[str, Any]:
    """What the last `make fuzz` tried by coverage."""
    kept: dict[str, Any] = {"seconds": 0, "targets": {}}
    if COVERAGE.exists():
        kept = json.loads(COVERAGE.read_text(encoding="utf-8"))
    each = kept["targets"].values()
    runs, faults = sum(one["runs"] for one in each), sum(one["found"] for one in each)
    return {**kept, "runs": runs, "faults": faults}


def _kills(quick: bool, beside: int) -> dict[str, Any]:
    """Recorders that are killed."""
    found = recordings.measure(
        kills=1 if quick else 50, minutes=0.1 if quick else 1.0, beside=beside
    )
    killed = found["kills"]
    lost = killed["most_lost_s"] > killed["goal_s"]
    return {**found, "faults": int(lost) + killed["count"] - killed["opened"]}


def _press(quick: bool) -> dict[str, Any]:
    found = live.press_of_torso(0.1 if quick else 10.0)
    return {**found, "faults": abs(found["contacts"] - 1) + found["samples_without"]}


def _long(work: Callable[[int], dict[str, Any]], count: int, most_mb: float) -> dict[str, Any]:
    """Loop, window or page over many samples, in a process whose memory is its alone."""
    found: dict[str, Any] = afresh(work, count)
    grown = found.get("most_grown_mb", found["grown_mb"]) > most_mb
    return {**found, "faults": int(grown) + int(not found["same_as_fresh"])}


PARTS: dict[str, Part] = {
    "fuzz": _coverage,
    "cuts": lambda quick: cuts.measure(places=4 if quick else cuts.PLACES),
    "large": lambda quick: large.measure(megabytes=0.2 if quick else large.MEGABYTES),
    "full disk": lambda quick: full_disk.measure(QUICK_DISK if quick else [*full_disk.COMMANDS]),
    "read only": lambda quick: (
        stops.measure(each=1, names=["simulate"], kinds=[stops.LOCK])
        if quick
        else stops.measure(kinds=[stops.LOCK])
    ),
    "stops": lambda quick: (
        stops.measure(each=1, names=["simulate"], kinds=["SIGTERM"]) if quick else stops.measure()
    ),
    "kills": lambda quick: _kills(quick, 0),
    "kills beside": lambda quick: _kills(quick, 3),
    "press": _press,
    "loop": lambda quick: _long(live.soak_icub, 1500 if quick else SAMPLES, MOST_GROWN_MB),
    "window": lambda quick: _long(
        viewer_soak.soak_torso, 500 if quick else UPDATES, MOST_WINDOW_MB
    ),
    "page": lambda quick: _long(page_soak.soak, 500 if quick else UPDATES, MOST_WINDOW_MB),
}

if __name__ == "__main__":
    sys.exit(main())
