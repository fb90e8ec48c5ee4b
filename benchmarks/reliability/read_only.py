"""Folders that become read-only while a command works: one line, exit code 2, nothing half written.

`python -m benchmarks.reliability.read_only [--each 3] [COMMAND...]` prints one JSON object. The
commands are those of `stops`; each runs without root's right to write where it may not.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.reliability import stops

EACH = 3  # moments of each command
DROP_FROM_BOUNDS, CAP_DAC_OVERRIDE = 24, 1  # of prctl and of the rights of a process, by Linux


def main() -> None:
    """Print what came of each command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commands", nargs="*", help="all by default")
    parser.add_argument("--each", type=int, default=EACH)
    given = parser.parse_args()
    print(json.dumps(measure(given.commands, each=given.each), indent=2))


def measure(names: Sequence[str] = (), *, each: int = EACH, seed: int = 0) -> dict[str, Any]:
    """Take from each command the right to write its folder, at moments drawn from its length.

    Returns
    -------
    dict
        `commands`: of each its length [s], how many were `refused`, how many had `done` their work
        or could end it by what they had open, and `faults` in a line each; and their sum.
    """
    rng, rows = np.random.default_rng(seed), {}
    with tempfile.TemporaryDirectory(prefix="skinmap-read-only-") as name:
        folder = Path(name)
        for command in names or stops.COMMANDS:
            rows[command] = _of_command(command, folder, each, rng)
            print(f"{command}: {rows[command]}", file=sys.stderr, flush=True)
    return {"commands": rows, "faults": sum(len(row["faults"]) for row in rows.values())}


def _of_command(name: str, folder: Path, each: int, rng: np.random.Generator) -> dict[str, Any]:
    given = stops.input_of(name, folder)
    place = folder / "whole"
    place.mkdir(exist_ok=True)
    began = time.monotonic()
    whole = stops.start(stops.COMMANDS[name], place / name.replace(" ", "-"), given)
    said, code = stops.wait(whole)
    took = time.monotonic() - began
    row: dict[str, Any] = {"seconds": took, "refused": 0, "done": 0, "faults": []}
    if code not in (0, 3):  # or each refusal would be taken for that of its folder
        row["faults"].append(f"the whole command: exit {code}: {said[-200:]}")
        return row
    names = stops.names_of(stops.result_of(stops.COMMANDS[name], place / name.replace(" ", "-")))
    for number in range(each):
        place = folder / f"{name.replace(' ', '-')}{number}"
        place.mkdir()
        moment = float(rng.uniform(0.2, 1.0)) * took
        when, fault = lock(stops.COMMANDS[name], place, given, moment, names=names)
        row[when] += 1
        if fault:
            row["faults"].append(f"after {moment:.2f} s: {fault}")
    return row


def lock(
    long: stops.Long,
    place: Path,
    given: Path,
    moment: float | None = None,
    *,
    names: frozenset[str] = frozenset(),
) -> tuple[str, str]:
    """Lock a command's folder after so many seconds, or once it listens to signals.

    Returns
    -------
    end : str
        It was `refused`, or `done`.
    fault : str
        What was wrong about how it ended, or "".
    """
    out = place / "out"
    running = stops.start(long, out, given, first=_obey)
    stops.reach(running, moment)
    folders = [place, *(path for path in place.rglob("*") if path.is_dir())]
    for one in folders:
        one.chmod(0o555)
    try:
        said, code = stops.wait(running)
        left = stops.left_of(running.pid)
    finally:
        for one in folders:
            if one.exists():
                one.chmod(0o755)
    result = stops.result_of(long, out)
    when = "done" if code in (0, 3) else "refused"
    return when, _judged(said, code, len(left), result, names)


def _judged(said: str, code: int, left: int, result: Path, names: frozenset[str]) -> str:
    if left:
        return f"{left} processes left"
    if "Traceback" in said or code not in (0, 2, 3):
        return f"exit {code}: {said[-500:]}"
    lines = said.strip().splitlines()
    if code == 2 and not (lines and lines[-1].startswith("Error: cannot")):
        return f"said {lines[-1:]}"
    if result.exists() and not stops.opens(result, names):
        return f"half a result: {result.name}"
    return "" if result.exists() or code == 2 else "no result and no word of it"


def _obey() -> None:
    """Give up root's right to write anywhere, for the program that is begun."""
    ctypes.CDLL(None, use_errno=True).prctl(DROP_FROM_BOUNDS, CAP_DAC_OVERRIDE, 0, 0, 0)


if __name__ == "__main__":
    main()
