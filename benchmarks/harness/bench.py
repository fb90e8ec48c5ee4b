"""All areas in one go, at most 20 minutes on 2 cores: `make bench` (ARGS=--quick: 4 minutes).

Each area runs in a process of its own, one after the other, with one thread; one that fails or
takes too long is reported and the others go on (exit code 1 at the end). Writes
benchmarks/results/{bench,needs}.json and docs/{benchmarks,needs}.md, and prints what was asked for
beside what came out. What is quick or of some areas goes to build/bench.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.harness import areas, asked
from benchmarks.harness.record import RESULTS, about, write
from benchmarks.harness.timing import children_seconds
from benchmarks.scale import needs

KEPT = RESULTS / "bench.json"
BUILD = RESULTS.parents[1] / "build" / "bench"  # of runs with no figures to keep
PROGRAM = (sys.executable, "-m", "benchmarks.harness.bench")  # what a child runs, in ROOT
HEAD = ("format", "commit", "form", "python", "versions", "machine", "threads")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def main(arguments: list[str] | None = None) -> int:
    """Run the areas, write the result and its page, print the table."""
    options = _parser().parse_args(arguments)
    if options.child:
        write(options.out, areas.run(areas.AREAS[options.child], options.form))
        return 0
    form = "quick" if options.quick else "full" if options.full else "short"
    os.environ.update(ONE_THREAD)
    # Ended from outside, it still ends the area that runs.
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    whole = set(options.only) == set(areas.AREAS) and not options.quick
    target = options.out or (KEPT if whole else BUILD / f"bench_{form}.json")
    names = [name for name in areas.AREAS if name in options.only]
    measure_all(names, form, target)
    result = json.loads(target.read_text(encoding="utf-8"))  # what the pages say is in the file
    if target == KEPT:
        write_pages(result)
    asked.print_table(result["asked"])
    print(f"\n{result['seconds']:.0f} s in all; written to {target}")
    for name, area in result["areas"].items():
        if "failed" in area:
            print(f"FAILED {name}: {area['failed']}")
    return 1 if any("failed" in area for area in result["areas"].values()) else 0


def write_pages(result: dict[str, Any]) -> None:
    """The pages in docs of the result that is kept."""
    asked.PAGE.write_text(asked.doc_of(result), encoding="utf-8")
    if rows := result["areas"].get("needs", {}).get("rows"):
        write(needs.RESULT, {key: one for key, one in result.items() if key in HEAD} | rows)
        needs.write_page()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="whether all of it runs (4 minutes)")
    size.add_argument("--full", action="store_true", help="the full form of each area (an hour)")
    parser.add_argument("--only", nargs="+", choices=areas.AREAS, default=[*areas.AREAS])
    parser.add_argument("--out", type=Path, help="JSON to write")
    parser.add_argument("--child", choices=areas.AREAS, help=argparse.SUPPRESS)
    parser.add_argument("--form", default="short", help=argparse.SUPPRESS)
    return parser


def measure_all(names: Sequence[str], form: str, keep: Path) -> dict[str, Any]:
    """Every area's rows, and what they are judged by.

    Parameters
    ----------
    names : sequence of str
        Areas to run.
    form : {"short", "full", "quick"}
    keep : Path
        Written after each area, so that a run that is broken off leaves what it had.
    """
    result: dict[str, Any] = about(form) | {"areas": {}}
    began = time.perf_counter()
    for number, name in enumerate(names, 1):
        area = areas.AREAS[name]
        place = f"{number} of {len(names)}"
        print(f"{name} ({place}): {area.about} ...", file=sys.stderr, flush=True)
        found = measure_one(name, area, form)
        result["areas"][name] = found
        result["seconds"] = time.perf_counter() - began
        result["asked"] = asked.judge(result)
        write(keep, result)
        state = found.get("failed", "done")
        print(f"  {state} ({found['seconds']:.0f} s)", file=sys.stderr, flush=True)
    return result


def measure_one(name: str, area: areas.Area, form: str) -> dict[str, Any]:
    """The rows of one area from a process of its own, or `failed`: why there are none.

    Returns
    -------
    dict
        `rows` or `failed`, `seconds` (wall), `cpu_seconds` (of the process and of all that it
        started), `form`, `shorter` and `load_average` as it began.
    """
    limit = area.seconds * (4.0 if form == "full" else 1.0)
    found: dict[str, Any] = {
        "form": form,
        "shorter": area.shorter if form == "short" else "",
        "load_average": os.getloadavg()[0],
    }
    began, spent = time.perf_counter(), children_seconds()
    with tempfile.TemporaryDirectory() as folder:
        out, said = Path(folder) / "rows.json", Path(folder) / "said.txt"
        command = [*PROGRAM, "--child", name, "--form", form, "--out", str(out)]
        failed = _run(command, said, limit)
        if failed is None:
            found["rows"] = json.loads(out.read_text(encoding="utf-8"))
        else:
            found["failed"] = failed
    found["seconds"] = time.perf_counter() - began
    found["cpu_seconds"] = children_seconds() - spent
    return found


def _run(command: list[str], said: Path, limit: float) -> str | None:
    """Run a process with all that it starts; None, or in one line why it failed."""
    with said.open("w", encoding="utf-8") as file:
        child = subprocess.Popen(
            command, stdout=file, stderr=subprocess.STDOUT, start_new_session=True, cwd=ROOT,
            env={**os.environ, **ONE_THREAD},
        )  # fmt: skip
        try:
            code = child.wait(limit)
        except subprocess.TimeoutExpired:
            return f"took longer than {limit:.0f} s"
        finally:
            _end(child)
    if code == 0:
        return None
    lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return f"exit {code}: {lines[-1].strip()[:300] if lines else 'it said nothing'}"


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a process with those that it left behind: publishers, recorders, a browser."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


if __name__ == "__main__":
    raise SystemExit(main())
