"""docs/reliability.md: promise, test, figure and date, from benchmarks/results/reliability.json.

`python -m benchmarks.reliability.page` writes it; nothing in it is written by hand.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS

PAGE = ROOT / "docs" / "reliability.md"
NOT_RUN = ("not measured here", "")
# Promises that tests keep in every run of the suite: what, and where.
TESTED = [
    ("A worker that is killed changes no bit, local or of a cluster",
     "tests/parallel/test_lost_workers.py"),
    ("A sweep that is interrupted, terminated or killed leaves no process and can be resumed, bit "
     "by bit", "tests/parallel/test_interruption.py, test_resume.py"),
    ("A scheduler that pauses changes no bit; one that is lost is a line, and the sweep goes on "
     "with the next", "tests/parallel/test_lost_scheduler.py"),
    ("Workers of another version and a scheduler that is not there are a line before any work",
     "tests/parallel/test_refusals.py"),
    ("Two recorders on one file: the second one is refused, the first one's file is whole",
     "tests/live/test_recorder.py"),
    ("A slow disk under the recorder drops samples, counts them and keeps memory bounded",
     "tests/live/test_recorder.py"),
    ("A recorder whose thread has no turn loses no burst; samples that come in their time never "
     "wait for a disk", "tests/live/test_recorder.py"),
    ("Fields of 200,000 letters, numbers of as many digits, lists as deep are taken or refused by "
     "each reader", "tests/extremes/test_cuts.py"),
    ("More than 1,000 points at one place are refused, not searched for minutes",
     "tests/geometry/test_surface_lengths.py"),
    ("Two processes share a cache, of two versions too, and never see each other's entries; a "
     "damaged entry is made anew", "tests/test_cache.py"),
    ("A plug-in that raises or hangs costs names and no sample; nonsense is named before training",
     "tests/live/test_loop.py, tests/classify/test_plugins.py"),
    ("Names of parts, robots, touches and files that are code are text in pages, reports, "
     "terminals and file names",
     "tests/extremes/test_faults.py, tests/viewer/web/test_page_faults.py"),
    ("Samples late, twice, out of order, with NaN or of another length are counted, mended or left "
     "out", "tests/live/test_loop.py, test_receiver.py, test_zmq.py"),
    ("Up to half of the samples lost: each is counted", "tests/extremes/test_limits.py"),
    ("Clocks that step by an hour, of the sender or of this machine",
     "tests/live/test_clock_steps.py"),
    ("A publisher that returns is followed; with another skin it is refused",
     "tests/live/test_zmq.py, test_loop.py"),
    ("A page that never reads holds up nobody, and its answers stay bounded",
     "tests/viewer/web/test_hub.py, test_server.py"),
    ("Hosts, origins, tokens, traversal, oversized messages and too many pages are refused",
     "tests/viewer/web/test_guard.py, test_server.py"),
    ("Half a request, headers without end, frames that are none, too many connections: ended, and "
     "others are served", "tests/viewer/web/test_attacks.py"),
    ("Meshes that claim a million million vertices or unfold to them, pictures of 3.6 billion "
     "pixels in them, files of devices: little memory", "tests/io/test_mesh_bombs.py"),
    ("XML entities, zip bombs, chunks that unfold to too much, deep TOML, foreign types in models",
     "tests/io/test_bad_input.py, tests/extremes/test_damage.py, "
     "tests/classify/test_model_file.py"),
    ("A disk that is full or read-only is one line, and what was there stays",
     "tests/io/test_output.py"),
]  # fmt: skip
UNSEEN = """Archives (`.npz`, `.skinmodel`, results to resume, cache entries) have a CRC-32 of
each member, which is compared to the last byte; MCAP has one of each chunk and counts its messages.
**Text and meshes have none**: in CSV, TXT, URDF, XML, TOML, JSON, OBJ, PLY, STL, OFF, GLB, bare
`.npy` and logs a changed digit is another number, and a table that was cut at the end of a line is
a shorter one. Readers refuse what does not fit the format; the rest cannot be seen, and is counted
below as *changed*. Pictures, films, pages, `.vtp` and `.h5` are written for others; nothing here
reads them back.
"""


def main() -> None:
    """Write the page."""
    found = json.loads((RESULTS / "reliability.json").read_text(encoding="utf-8"))
    PAGE.write_text(page(found), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(rows(found))} figures, {len(TESTED)} tests")


def page(found: Mapping[str, Any]) -> str:
    """The whole page."""
    lines = [
        "# What it survives", "",
        "Written by `make reliability` from what `make soak` and `make fuzz` measured "
        "(`benchmarks/results/reliability.json`).",
        "Faults are those that the runs themselves count.", "",
        "## Measured", "",
        "| promise | test | figure | date, commit |", "|---|---|---|---|",
        *(f"| {' | '.join(row)} |" for row in rows(found)), "",
        "## Tested in every run of the suite", "",
        "| promise | test |", "|---|---|",
        *(f"| {promise} | `{test.replace(', ', '`, `')}` |" for promise, test in TESTED), "",
        "## Files cut, and with one byte changed", "", UNSEEN,
        *_kinds(found.get("cuts")),
        "## Files of 10 MB", "", *_large(found.get("large")),
        "## Damaged inputs", "", *_fuzzed(found.get("accidents"), found.get("fuzz")),
        "## Commands stopped at random moments", "", *_stopped(found.get("stops")),
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
    lines = [
        "| kind | files | whole | said | refused | changed | checksum | faults |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in cuts["kinds"].items():
        numbers = (row[key] for key in ("files", "whole", "said", "refused", "changed"))
        cells = [*map(str, numbers), "yes" if row["checked"] else "none", str(len(row["faults"]))]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return [*lines, ""]


def _large(large: Mapping[str, Any] | None) -> list[str]:
    if large is None:
        return ["Not measured here.", ""]
    rest = [
        f"| {name} | {row['megabytes']:.1f} | {row['more_mb']:.0f} | {row['longest_s']:.1f} | "
        f"{len(row['faults'])} |"
        for name, row in large["kinds"].items()
    ]
    return ["| kind | file [MB] | memory [MB] | CPU [s] | faults |", "|---|---|---|---|---|",
            *rest, ""]  # fmt: skip


def _fuzzed(random: Mapping[str, Any] | None, guided: Mapping[str, Any] | None) -> list[str]:
    """Inputs of each reader, at random and by coverage."""
    if not (random and random["targets"]) and not (guided and guided["targets"]):
        return ["Not measured here.", ""]
    none: Mapping[str, Any] = {"targets": {}, "seconds": 0, "inputs": 0}
    random, guided = random or none, guided or none
    lines = [
        f"At random {random['inputs']:,} inputs of each reader, or for {random['seconds']:g} s of "
        f"CPU; then by what makes it take new ways for {guided['seconds']:g} s.", "",
        "| reader | at random | by coverage | found something |", "|---|---|---|---|",
    ]  # fmt: skip
    for name in [*random["targets"], *(guided["targets"].keys() - random["targets"].keys())]:
        one, other = random["targets"].get(name), guided["targets"].get(name)
        counts = [f"{row['runs']:,}" if row else "" for row in (one, other)]
        found = bool(one and one["findings"]) or bool(other and other["found"])
        lines.append(f"| {name} | {' | '.join(counts)} | {'yes' if found else 'no'} |")
    whole = sum(row["runs"] for kind in (random, guided) for row in kind["targets"].values())
    return [*lines, "", f"{whole:,} inputs in all.", ""]


def _stopped(stops: Mapping[str, Any] | None) -> list[str]:
    if stops is None:
        return ["Not measured here.", ""]
    lines = ["| command | length [s] | before it listened | under way | after its end | faults |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for name, row in stops["commands"].items():
        counts = (str(row[key]) for key in ("before", "under_way", "after"))
        lines.append(
            f"| {name} | {row['seconds']:.1f} | {' | '.join(counts)} | {len(row['faults'])} |"
        )
    return [*lines, ""]


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
    ("accidents", "Random damage ends in a line: no traceback, no 10 s, no 200 MB", "make fuzz",
     lambda one: f"{one['runs']:,} inputs of {len(one['targets'])} readers, {one['faults']} found; "
     f"at most {one['most_mb']:.0f} MB, {one['longest_s']:.1f} s"),
    ("fuzz", "Damage guided by coverage ends in a line, too", "make fuzz",
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
     "half written", "benchmarks/reliability/read_only.py",
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
    ("window", "The window's memory stays", SOAK, lambda one: _shown(one)),
    ("page", "The page's server keeps its memory", SOAK, lambda one: _shown(one)),
]  # fmt: skip

if __name__ == "__main__":
    main()
