"""All that Skinmap must survive, one after the other, and docs/reliability.md of it.

`python -m benchmarks.reliability.soak [--quick] [PART...]` writes benchmarks/results/
reliability.json, part by part, so that a run that is interrupted has lost one, and the page's
tables: promise, test, figure and date; the rest of the page is written by hand. Whole it takes half
a day; `--quick` takes two minutes and keeps nothing. What `make fuzz` tried is taken from
build/fuzz.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS, afresh, commit, table
from benchmarks.live import live, recordings
from benchmarks.reliability import cuts, full_disk, large, stops
from benchmarks.viewer import viewer_soak

FILE = RESULTS / "reliability.json"
PAGE = ROOT / "docs" / "reliability.md"
TESTED = "## Tested in every run of the suite"  # up to the next table: written by hand, and kept
COVERAGE = cuts.CORPUS / "counts.json"
QUICK_DISK = ("export csv", "export .h5", "label -o csv")
UPDATES, SAMPLES = 200_000, 4_320_000  # of window and page; of the loop (a day at 50 Hz)
MOST_GROWN_MB = 5.0  # of the loop
MOST_WINDOW_MB = 20.0  # of window and page, whose pictures are kept in pieces of many sizes
Found = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Part:
    """What is promised, where it is tested, what a run found in words, and the run: quick or not.

    `test` is the module below benchmarks, or a command of make.
    """

    promise: str
    test: str
    figure: Callable[[Found], str]
    run: Callable[[bool], Found]

    def row(self, found: Found | None) -> tuple[str, str, str, str]:
        """Promise, test, figure and date."""
        test = self.test if self.test.startswith("make") else f"benchmarks/{self.test}.py"
        words = ("not measured here", "")
        if found is not None:
            words = self.figure(found), f"{found['date']}, {found['commit'].removesuffix('-dirty')}"
        return self.promise, f"`{test}`", *words


def main() -> int:
    """Run the parts, write the page and print the table; 1 where one of them found a fault."""
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
        now = {"date": datetime.now(UTC).date().isoformat(), "commit": commit()}
        one = {**PARTS[name].run(given.quick), **now}
        # Read again: other parts may have ended in a run beside this one, hours after its start.
        found = {**(found if given.quick else _kept()), name: one}
        if not given.quick:
            FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
            PAGE.write_text(page(found, by_hand()), encoding="utf-8")
    for promise, _, figure, date in rows(found):
        print(f"{promise[:60]:60} {figure[:100]:100} {date}")
    faulty = [name for name, one in found.items() if one.get("faults")]
    print(f"faults in: {', '.join(faulty)}" if faulty else "no faults")
    return 1 if faulty else 0


def _kept() -> dict[str, Any]:
    """What earlier runs found, part by part."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def rows(found: Found) -> list[tuple[str, str, str, str]]:
    """Promise, test, figure and date of all parts."""
    return [part.row(found.get(name)) for name, part in PARTS.items()]


def by_hand() -> str:
    """The part of the page that nobody measures: what tests hold, and what no checksum shows."""
    text = PAGE.read_text(encoding="utf-8")
    return text[text.index(TESTED) : text.index("| kind | files |")]


def page(found: Found, text: str) -> str:
    """The whole page, `text` in the middle of it."""
    counted = ("files", "whole", "said", "refused", "changed")
    kinds = [
        (name, *(str(row[key]) for key in counted), "yes" if row["checked"] else "none",
         str(len(row["faults"])))
        for name, row in found["cuts"]["kinds"].items()
    ]  # fmt: skip
    lines = [
        "# What it survives", "",
        "Written by `make reliability` from what `make soak` and `make fuzz` measured "
        "(`benchmarks/results/reliability.json`).",
        "Faults are those that the runs themselves count.", "",
        "## Measured", "",
        *table(("promise", "test", "figure", "date, commit"), rows(found)), "",
        text.rstrip(), "",
        *table(("kind", *counted, "checksum", "faults"), kinds), "",
    ]  # fmt: skip
    return "\n".join(lines)


def _coverage(_: bool) -> Found:
    """What the last `make fuzz` tried by coverage."""
    kept: dict[str, Any] = {"seconds": 0, "targets": {}}
    if COVERAGE.exists():
        kept = json.loads(COVERAGE.read_text(encoding="utf-8"))
    each = kept["targets"].values()
    runs, faults = sum(one["runs"] for one in each), sum(one["found"] for one in each)
    return {**kept, "runs": runs, "faults": faults}


def _stopped(kind: str) -> Callable[[bool], Found]:
    """Stops by a locked folder, or (quick: of the kind alone) by all signals."""

    def run(quick: bool) -> Found:
        if quick:
            return stops.measure(each=1, names=["simulate"], kinds=[kind])
        return stops.measure(kinds=[kind] if kind == stops.LOCK else stops.KINDS)

    return run


def _locked(one: Found) -> str:
    refused, done = (
        sum(row[key] for row in one["commands"].values()) for key in ("refused", "done")
    )
    return (f"{refused} of {refused + done} refused, in {len(one['commands'])} commands, "
            f"{one['faults']} faults")  # fmt: skip


def _kills(beside: int) -> Callable[[bool], Found]:
    """Recorders that are killed beside so many busy programs."""

    def run(quick: bool) -> Found:
        found = recordings.measure(
            kills=1 if quick else 50, minutes=0.1 if quick else 1.0, beside=beside
        )
        killed = found["kills"]
        lost = killed["most_lost_s"] > killed["goal_s"]
        return {**found, "faults": int(lost) + killed["count"] - killed["opened"]}

    return run


def _killed(one: Found) -> str:
    kills = one["kills"]
    return (f"{kills['opened']} of {kills['count']} opened, at most {kills['most_lost_s']:.2f} s "
            f"lost (goal {kills['goal_s']} s)")  # fmt: skip


def _press(quick: bool) -> Found:
    found = live.press_of_torso(0.1 if quick else 10.0)
    return {**found, "faults": abs(found["contacts"] - 1) + found["samples_without"]}


def _long(
    work: Callable[[int], dict[str, Any]], count: int, few: int, most_mb: float
) -> Callable[[bool], Found]:
    """Loop, window or page over many samples, in a process whose memory is its alone."""

    def run(quick: bool) -> Found:
        found: dict[str, Any] = afresh(work, few if quick else count)
        grown = found.get("most_grown_mb", found["grown_mb"]) > most_mb
        return {**found, "faults": int(grown) + int(not found["same_as_fresh"])}

    return run


def _shown(one: Found) -> str:
    return (f"{one['updates']:,} of 200,000 updates, grown by {one['grown_mb']:.1f} MB, "
            f"{one['cpu_ms_per_update']:.2f} ms an update; its end {_end(one)}")  # fmt: skip


def _end(one: Found) -> str:
    return "is that of a fresh start" if one["same_as_fresh"] else "DIFFERS from a fresh start"


SOAK = "make soak"
PARTS = {
    "fuzz": Part(
        "Damage guided by coverage ends in a line: no traceback, no 10 s, no 200 MB", "make fuzz",
        lambda one: f"{one['runs']:,} inputs of {len(one['targets'])} readers, "
        f"{one['faults']} found", _coverage),
    "cuts": Part(
        "Files cut or with a byte changed open whole, say what was lost, or are refused",
        "reliability/cuts",
        lambda one: f"{one['files']:,} files of {len(one['kinds'])} kinds, {one['faults']} faults; "
        f"at most {one['most_mb']:.0f} MB more than the whole file, {one['longest_s']:.1f} s",
        lambda quick: cuts.measure(places=4 if quick else cuts.PLACES)),
    "large": Part(
        "A file of 10 MB, whole, cut or changed, takes less than 200 MB", "reliability/large",
        lambda one: f"{len(one['kinds'])} kinds, at most {one['most_mb']:.0f} MB and "
        f"{one['longest_s']:.1f} s of CPU, {one['faults']} faults",
        lambda quick: large.measure(megabytes=0.2 if quick else large.MEGABYTES)),
    "full disk": Part(
        "A disk without room is one line in every command that writes, and nothing half written",
        "reliability/full_disk",
        lambda one: f"{len(one['commands'])} commands, {one['faults']} faults",
        lambda quick: full_disk.measure(QUICK_DISK if quick else [*full_disk.COMMANDS])),
    "read only": Part(
        "A folder that becomes read-only while a command works is one line, and nothing half "
        "written", "reliability/stops", _locked, _stopped(stops.LOCK)),
    "stops": Part(
        "Ctrl-C, a polite kill, a kill, a halt: a line, the exit code, no process, nothing half "
        "written", "reliability/stops",
        lambda one: f"{one['stops']} stops of {len(one['commands'])} commands, {one['under_way']} "
        f"under way, {one['faults']} faults", _stopped("SIGTERM")),
    "kills": Part("A killed recorder loses at most 0.2 s", "live/recordings", _killed, _kills(0)),
    "kills beside": Part(
        "With the lowest priority beside three busy programs, too", "live/recordings", _killed,
        _kills(3)),
    "press": Part(
        "A press that is held stays one contact", SOAK,
        lambda one: f"{one['minutes']:g} minutes, {one['contacts']} contact, "
        f"{one['samples_without']} samples without", _press),
    "loop": Part(
        "The loop's memory stays", SOAK,
        lambda one: f"{one['samples']:,} of the 4,320,000 samples of a day, grown by at most "
        f"{one['most_grown_mb']:.1f} MB, {one['cpu_ms_a_sample']:.2f} ms a sample; its end "
        f"{_end(one)}", _long(live.soak_icub, SAMPLES, 1500, MOST_GROWN_MB)),
    "window": Part(
        "The window's memory stays", SOAK, _shown,
        _long(viewer_soak.soak_torso, UPDATES, 500, MOST_WINDOW_MB)),
    "page": Part(
        "The page's server keeps its memory", SOAK, _shown,
        _long(viewer_soak.soak_page, UPDATES, 500, MOST_WINDOW_MB)),
}  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
