"""docs/reliability.md: promise, test, figure and date, from benchmarks/results/reliability.json.

`python -m benchmarks.reliability.page` writes the tables of figures; the rest is written by hand.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS, table

PAGE = ROOT / "docs" / "reliability.md"
NOT_RUN = ("not measured here", "")
TESTED = "## Tested in every run of the suite"  # up to the next table: written by hand, and kept


def main() -> None:
    """Write the page."""
    found = json.loads((RESULTS / "reliability.json").read_text(encoding="utf-8"))
    PAGE.write_text(page(found, by_hand()), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(rows(found))} figures")


def by_hand() -> str:
    """The part of the page that nobody measures: what tests hold, and what no checksum shows."""
    text = PAGE.read_text(encoding="utf-8")
    return text[text.index(TESTED) : text.index("| kind | files |")]


def page(found: Mapping[str, Any], text: str) -> str:
    """The whole page, `text` in the middle of it."""
    lines = [
        "# What it survives", "",
        "Written by `make reliability` from what `make soak` and `make fuzz` measured "
        "(`benchmarks/results/reliability.json`).",
        "Faults are those that the runs themselves count.", "",
        "## Measured", "",
        *table(("promise", "test", "figure", "date, commit"), rows(found)), "",
        text.rstrip(), "",
        *_kinds(found.get("cuts")),
    ]  # fmt: skip
    return "\n".join(lines).rstrip() + "\n"


def rows(found: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Promise, test, figure and date of what is measured."""
    return [
        (promise, f"`{test}`", *(NOT_RUN if name not in found else
                                 (figure(found[name]), _when(found[name]))))
        for name, promise, test, figure in MEASURED
    ]  # fmt: skip


def _kinds(cuts: Mapping[str, Any] | None) -> list[str]:
    if cuts is None:
        return []
    counted = ("files", "whole", "said", "refused", "changed")
    kinds = [
        (name, *(str(row[key]) for key in counted), "yes" if row["checked"] else "none",
         str(len(row["faults"])))
        for name, row in cuts["kinds"].items()
    ]  # fmt: skip
    return [*table(("kind", *counted, "checksum", "faults"), kinds), ""]


def _locked(one: Mapping[str, Any]) -> dict[str, int]:
    refused, done = (
        sum(row[key] for row in one["commands"].values()) for key in ("refused", "done")
    )
    return {"refused": refused, "stops": refused + done}


def _kills(one: Mapping[str, Any]) -> str:
    kills = one["kills"]
    return (f"{kills['opened']} of {kills['count']} opened, at most {kills['most_lost_s']:.2f} s "
            f"lost (goal {kills['goal_s']} s)")  # fmt: skip


def _when(one: Mapping[str, Any]) -> str:
    return f"{one['date']}, {one['commit'].removesuffix('-dirty')}"


def _shown(one: Mapping[str, Any]) -> str:
    return (f"{one['updates']:,} of 200,000 updates, grown by {one['grown_mb']:.1f} MB, "
            f"{one['cpu_ms_per_update']:.2f} ms an update; its end {_end(one)}")  # fmt: skip


def _end(one: Mapping[str, Any]) -> str:
    return "is that of a fresh start" if one["same_as_fresh"] else "DIFFERS from a fresh start"


CUTS, SOAK = "benchmarks/reliability/cuts.py", "make soak"
MEASURED = [
    ("fuzz", "Damage guided by coverage ends in a line: no traceback, no 10 s, no 200 MB",
     "make fuzz",
     lambda one: f"{one['runs']:,} inputs of {len(one['targets'])} readers, {one['faults']} found"),
    ("cuts", "Files cut or with a byte changed open whole, say what was lost, or are refused", CUTS,
     lambda one: f"{one['files']:,} files of {len(one['kinds'])} kinds, {one['faults']} faults; at "
     f"most {one['most_mb']:.0f} MB more than the whole file, {one['longest_s']:.1f} s"),
    ("large", "A file of 10 MB, whole, cut or changed, takes less than 200 MB",
     "benchmarks/reliability/large.py",
     lambda one: f"{len(one['kinds'])} kinds, at most {one['most_mb']:.0f} MB and "
     f"{one['longest_s']:.1f} s of CPU, {one['faults']} faults"),
    ("full disk", "A disk without room is one line in every command that writes, and nothing half "
     "written", "benchmarks/reliability/full_disk.py",
     lambda one: f"{len(one['commands'])} commands, {one['faults']} faults"),
    ("read only", "A folder that becomes read-only while a command works is one line, and nothing "
     "half written", "benchmarks/reliability/stops.py",
     lambda one: "{refused} of {stops} refused".format(**_locked(one))
     + f", in {len(one['commands'])} commands, {one['faults']} faults"),
    ("stops", "Ctrl-C, a polite kill, a kill, a halt: a line, the exit code, no process, nothing "
     "half written", "benchmarks/reliability/stops.py",
     lambda one: f"{one['stops']} stops of {len(one['commands'])} commands, {one['under_way']} "
     f"under way, {one['faults']} faults"),
    ("kills", "A killed recorder loses at most 0.2 s", "benchmarks/live/recordings.py", _kills),
    ("kills beside", "With the lowest priority beside three busy programs, too",
     "benchmarks/live/recordings.py", _kills),
    ("press", "A press that is held stays one contact", SOAK,
     lambda one: f"{one['minutes']:g} minutes, {one['contacts']} contact, "
     f"{one['samples_without']} samples without"),
    ("loop", "The loop's memory stays", SOAK,
     lambda one: f"{one['samples']:,} of the 4,320,000 samples of a day, grown by at most "
     f"{one['most_grown_mb']:.1f} MB, {one['cpu_ms_a_sample']:.2f} ms a sample; its end "
     f"{_end(one)}"),
    ("window", "The window's memory stays", SOAK, _shown),
    ("page", "The page's server keeps its memory", SOAK, _shown),
]  # fmt: skip

if __name__ == "__main__":
    main()
