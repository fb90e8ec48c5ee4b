"""Whole commands in fresh processes: CPU, wall and memory beside imports and necessary work.

The commands are those of README.md, and sizes of meshes and recordings over decades. Each runs
once to fill the cache, then again, the shorter the more often (the longest not at all); the ratio
is its CPU time over that of the imports and the work that its output needs (command_work.py).
Writes benchmarks/results/commands.json, which `make bench-compare` reads too, and its table into
docs/benchmarks.md. `--quick` takes a minute: a few commands, each once more.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT
from benchmarks.harness.bench_doc import write_doc
from benchmarks.harness.record import RESULTS, about, write
from benchmarks.harness.timing import quartiles

TURNS = 3
ALL_TURNS_S = 6.0  # CPU time that a command may take in all turns, if it needs no more for one [s]
LONG_S = 15.0  # a command that takes more is run once: its first run is the one that counts
SIZES = (1_000, 10_000, 100_000)  # vertices of a mesh
PER_GESTURE = (2, 20)  # touches of a recording, of each gesture and part


@dataclass(frozen=True, slots=True)
class Command:
    """A command line of README.md or like one, and the name of its work (empty: none is told)."""

    line: str
    work: str = ""
    arguments: tuple[str, ...] = ()


# By the beginning of their line: what a command's output is made of.
WORK_OF = {
    "inspect icub --part": "inspect_part",
    "flatten icub --part left_arm": "flatten_compare",
    "flatten data/kaspar/meshes/hand.ply": "hand_out",
    "structures": "structures",
    "export": "export",
    "simulate icub --per-gesture": "simulate",
    "train": "train",
    "classify touch.skinmodel touches.npz": "classify",
    "view icub --source sim --screenshot": "still",
    "cache": "nothing",
}
# What does not end by itself, or has an input that another terminal makes.
LEFT_OUT = {
    "--web": "serves until it is closed",
    "--publish": "streams until it is stopped",
    "lsl:demo": "needs a stream from another terminal",
    "touch.mcap": "needs a recording of such a stream",
    "evaluate": "minutes: its own figures are in docs/evaluation.md",
    "anchors --layout": "waits for clicks in a window",
    "--profile": "after `trade`, whose file it takes",
}


LAST = ("demo", "trade", "calibrate batch", "calibrate selftouch")  # the longest
# The quick form: by the beginning of their line.
QUICK = (
    "inspect", "flatten icub", "flatten saddle_1000.ply", "structures", "export", "cache",
    "view icub --part",
)  # fmt: skip


def readme_lines() -> list[str]:
    """The command lines of README.md's list, comments cut off."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.partition("## Commands")[2].partition("\n## ")[0]
    lines = [line.strip() for line in section.splitlines() if line.startswith("    skinmap ")]
    return [line.partition("  #")[0].strip().removeprefix("skinmap ") for line in lines]


def left_out(line: str) -> str:
    """Why a line of README.md is not measured; empty where it is."""
    return next((why for word, why in LEFT_OUT.items() if word in line), "")


def commands(folder: Path) -> Iterator[Command]:
    """All that is measured, what later ones need first."""
    lines = [line for line in readme_lines() if not left_out(line)]
    lines.sort(key=lambda line: not line.startswith(("simulate", "train")))
    for line in sorted(lines, key=lambda line: line.startswith(LAST)):
        work = next((work for start, work in WORK_OF.items() if line.startswith(start)), "")
        yield Command(line, work)
    yield Command("inspect icub --json", "inspect")
    yield Command("flatten icub --json", "flatten")
    yield Command("flatten icub --part left_arm --out one", "flatten_out")
    yield Command("view icub --part left_arm --source sim --screenshot part.png", "still_part")
    for size in SIZES:
        path = folder / f"saddle_{size}.ply"
        _saddle(path, size)
        yield Command(f"flatten {path.name} --json", "mesh", (str(path), "balanced"))
    for count in PER_GESTURE:
        yield Command(
            f"simulate icub --part right_forearm --per-gesture {count} -o few_{count}.npz"
        )
        yield Command(f"classify touch.skinmodel few_{count}.npz --json")


def _saddle(path: Path, vertices: int) -> None:
    import trimesh

    side = round(vertices**0.5)
    x, y = (g.ravel() / (side - 1) for g in np.meshgrid(np.arange(side), np.arange(side)))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + 1, corner + side]),
            np.column_stack([corner + 1, corner + side + 1, corner + side]),
        ]
    )
    points = np.column_stack([x, y, (x - 0.5) ** 2 - (y - 0.5) ** 2])
    trimesh.Trimesh(points, faces, process=False).export(path)


def spent(words: Sequence[str], folder: Path, environment: dict[str, str]) -> dict[str, Any]:
    """CPU and wall time [s], peak memory [MB], exit code and output of a fresh process."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        started = time.perf_counter()
        process = subprocess.Popen(words, cwd=folder, env=environment, stdout=out, stderr=errors)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - started
        out.seek(0)
        errors.seek(0)
        return {
            "cpu_s": used.ru_utime + used.ru_stime,
            "wall_s": wall,
            "mb": used.ru_maxrss / 1024,
            "code": process.returncode,
            "out": out.read().decode(errors="replace"),
            "errors": errors.read().decode(errors="replace")[-300:],
        }


def measure(
    quick: bool, only: str = "", keep: Callable[[list[dict[str, Any]]], object] = len
) -> list[dict[str, Any]]:
    """One row a command; `keep` gets those so far after each."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "docs").symlink_to(ROOT / "docs")
        (folder / "data").symlink_to(ROOT / "data")
        environment = os.environ | {
            "SKINMAP_CACHE": str(folder / "cache"),
            "PYTHONPATH": str(ROOT),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        for command in commands(folder):
            if quick and not command.line.startswith(QUICK):
                continue
            if only and only not in command.line and not command.line.startswith("simulate icub -"):
                continue
            rows.append(_row(command, folder, environment, 1 if quick else TURNS))
            print(_words(rows[-1]), file=sys.stderr, flush=True)
            keep(rows)
    return rows


def _row(command: Command, folder: Path, environment: dict[str, str], most: int) -> dict[str, Any]:
    skinmap = [sys.executable, "-c", "from skinmap.cli.main import main; main()"]
    words = [*skinmap, *shlex.split(command.line)]
    written = folder / words[words.index("-o") + 1] if "-o" in words else None

    def run() -> dict[str, Any]:
        if written is not None and written.is_file():
            written.unlink()  # some commands write no file twice
        return spent(words, folder, environment)

    first = run()
    turns = turns_of(first["cpu_s"], most)
    again = first["cpu_s"] <= LONG_S
    found = [run() for _ in range(turns)] if again else [first]
    for one in (first, *found):
        if one["code"]:
            return {"command": command.line, "failed": one["errors"].strip() or "without a word"}
    cpu = quartiles([one["cpu_s"] for one in found])
    row = {
        "command": command.line,
        "cpu_s": cpu[1],
        "spread_s": cpu if turns > 1 else None,
        "wall_s": float(np.median([one["wall_s"] for one in found])),
        "mb": float(np.median([one["mb"] for one in found])),
        "first_cpu_s": first["cpu_s"] if again else None,
    }
    if command.work:
        row |= _needs(command, folder, environment, turns)
        row["ratio"] = row["cpu_s"] / (row["imports_cpu_s"] + row["work_cpu_s"])
    return row


def turns_of(cpu: float, most: int) -> int:
    """How often a command is run again that took some CPU time [s]: once at least."""
    return int(np.clip(ALL_TURNS_S / max(cpu, 1e-3), 1, most))


def _needs(
    command: Command, folder: Path, environment: dict[str, str], turns: int
) -> dict[str, float]:
    own = [sys.executable, "-m", "benchmarks.scale.command_work", command.work, *command.arguments]
    imports, works = [], []
    for _ in range(turns):
        imports.append(spent([*own, "--imports"], folder, environment)["cpu_s"])
        done = spent(own, folder, environment)
        if done["code"]:
            raise RuntimeError(f"the work of `{command.line}` fails: {done['errors']}")
        works.append(json.loads(done["out"].splitlines()[-1])["cpu_s"])
    return {"imports_cpu_s": float(np.median(imports)), "work_cpu_s": float(np.median(works))}


def _words(row: dict[str, Any]) -> str:
    if "failed" in row:
        return f"FAILED {row['command']}: {row['failed']}"
    ratio = f", {row['ratio']:.2f} x imports and work" if "ratio" in row else ""
    return f"{row['cpu_s']:7.2f} s CPU, {row['mb']:5.0f} MB{ratio}  {row['command']}"


def figures(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The figures that `bench-compare` compares: CPU time and ratio of each command."""
    found = []
    for row in rows:
        if "failed" in row:
            continue
        key = "commands." + "_".join(row["command"].split())
        shown = [("s", "s", row["cpu_s"], row["spread_s"]), ("mb", "MB", row["mb"], None)]
        if "ratio" in row:
            shown.append(("ratio", "times", row["ratio"], None))
        found += [
            {
                "key": f"{key}.{kind}",
                "area": "commands",
                "name": f"skinmap {row['command']}",
                "unit": unit,
                "value": value,
                "better": "less",
                "spread": [spread[0], spread[-1]] if spread else None,
            }
            for kind, unit, value, spread in shown
        ]
    return found


def main() -> int:
    """Measure, write, and say which commands failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="each once, written to build/bench")
    parser.add_argument("--only", default="", help="commands with this in their line")
    parser.add_argument("--out", type=Path, help="file to write instead of benchmarks/results")
    options = parser.parse_args()
    head = about("quick" if options.quick else "full")
    whole = not options.quick and not options.only
    kept = RESULTS / "commands.json"
    target = options.out or (kept if whole else ROOT / "build" / "bench" / "commands.json")
    not_measured = {line: left_out(line) for line in readme_lines() if left_out(line)}

    def keep(rows: list[dict[str, Any]]) -> None:
        write(target, head | {"commands": rows, "left_out": not_measured, "figures": figures(rows)})

    rows = measure(options.quick, options.only, keep)
    if target == kept:
        write_doc(json.loads((RESULTS / "bench.json").read_text(encoding="utf-8")))
    print(f"written to {target}", file=sys.stderr)
    return 1 if any("failed" in row for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
