"""Long commands stopped at random moments: Ctrl-C, a polite kill, a kill, a halt and its end.

`python -m benchmarks.reliability.stops [--each 3] [COMMAND...]` prints one JSON object. After each
stop: the exit code of the documents and one line (a killed process can say nothing), no result
that is not whole under its final name, and no process left.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT

EACH = 3  # stops of each command by each signal
GONE = 5.0  # seconds until no process may be left
HALT = 0.3  # seconds between SIGSTOP and SIGCONT
LONGEST = 1200.0  # of a command, on a busy machine too [s]
LATE = 60.0  # what ends so long after it was told to has not listened [s]
SKINMAP = "from skinmap.cli.main import main; main()"
CODES = {"SIGINT": 130, "SIGTERM": 143, "SIGKILL": -9}
KINDS = ("SIGINT", "SIGTERM", "SIGKILL", "SIGSTOP")


@dataclass(frozen=True, slots=True)
class Long:
    """A long command.

    Attributes
    ----------
    words : tuple of str
        What stands behind `skinmap`; OUT is where the result goes, IN where inputs lie.
    needs : str
        Input that is made before: the name of another command here, or "".
    live : bool
        It ends with its summary and 0 when it is stopped, and what it wrote until then stays.
    """

    words: tuple[str, ...]
    needs: str = ""
    live: bool = False


BOARD = str(ROOT / "docs" / "examples" / "board")
COMMANDS = {
    "simulate": Long(
        ("simulate", "kaspar", "--part", "left_hand", "--per-gesture", "12", "-o", "OUT.npz")
    ),
    "train": Long(("train", "IN.npz", "-o", "OUT.skinmodel"), needs="simulate"),
    "evaluate": Long(("evaluate", "IN.npz", "--seeds", "1", "-o", "OUT"), needs="simulate"),
    "evaluate --jobs": Long(
        ("evaluate", "IN.npz", "--seeds", "2", "--jobs", "2", "-o", "OUT"), needs="simulate"
    ),
    "flatten --jobs": Long(
        (
            "flatten",
            "icub",
            "--part",
            "left_hand",
            "--part",
            "left_foot",
            "--jobs",
            "2",
            "-o",
            "OUT",
        )
    ),
    "trade": Long(
        ("trade", "icub", "--part", "left_hand", "--task", "flatten", "--seeds", "1", "-o", "OUT")
    ),
    "calibrate batch": Long(
        ("calibrate", "batch", f"{BOARD}/patches.csv", "--jobs", "2", "-o", "OUT")
    ),
    "calibrate plane": Long(
        (
            *("calibrate", "plane", f"{BOARD}/plane/presses.npz", "--robot", "icub"),
            *("--part", "right_forearm", "-o", "OUT"),
        )
    ),
    "calibrate selftouch": Long(
        (
            *("calibrate", "selftouch", f"{BOARD}/selftouch", "--robot", "icub"),
            *("--calibrate", "left_forearm", "-o", "OUT"),
        )
    ),
    "record": Long(("record", "sim", "--seconds", "2", "-o", "OUT.mcap"), live=True),
}


def main() -> None:
    """Print what came of each stop."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commands", nargs="*", help="all by default")
    parser.add_argument("--each", type=int, default=EACH)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(json.dumps(measure(each=given.each, seed=given.seed, names=given.commands), indent=2))


def measure(
    *, each: int = EACH, seed: int = 0, names: Sequence[str] = (), kinds: Sequence[str] = KINDS
) -> dict[str, Any]:
    """Stop each command so many times by each signal, at moments drawn from its whole length.

    Returns
    -------
    dict
        `commands`: of each its length [s], how many stops came `before` it began to listen (as a
        shell ends any program), hit it `under_way`, or came `after` its end; `faults` in a line
        each; and the sums.
    """
    rng, rows = np.random.default_rng(seed), {}
    with tempfile.TemporaryDirectory(prefix="skinmap-stops-") as name:
        folder = Path(name)
        for command in names or COMMANDS:
            rows[command] = _of_command(command, folder, each, kinds, rng)
            print(f"{command}: {rows[command]}", file=sys.stderr, flush=True)
    return {
        "commands": rows,
        "stops": sum(row["before"] + row["under_way"] + row["after"] for row in rows.values()),
        "under_way": sum(row["under_way"] for row in rows.values()),
        "faults": sum(len(row["faults"]) for row in rows.values()),
    }


def _of_command(
    name: str, folder: Path, each: int, kinds: Sequence[str], rng: np.random.Generator
) -> dict[str, Any]:
    long = COMMANDS[name]
    given = input_of(name, folder)
    began = time.monotonic()
    running = start(long, folder / "whole", given)
    said, code = wait(running)
    took = time.monotonic() - began
    if code not in (0, 3):
        return {"seconds": took, "before": 0, "under_way": 0, "after": 0,
                "faults": [f"the whole command: exit {code}: {said[-200:]}"]}  # fmt: skip
    names = names_of(result_of(long, folder / "whole"))
    counts = {"before": 0, "under_way": 0, "after": 0}
    faults = []
    for number in range(each):
        for kind in kinds:
            place = folder / f"{number}{kind}"
            place.mkdir()
            out = place / "out"
            moment = float(rng.uniform(0.0, took))
            when, fault = stop(long, out, given, kind, moment, names=names)
            counts[when] += 1
            if fault:
                faults.append(f"{kind} after {moment:.2f} s: {fault}")
            shutil.rmtree(place)
    shutil.rmtree(folder / "whole", ignore_errors=True)
    return {"seconds": took, **counts, "faults": faults}


def input_of(name: str, folder: Path) -> Path:
    """The recording that a command needs, made where it is not there yet."""
    given, needs = folder / "in.npz", COMMANDS[name].needs
    if needs and not given.exists():
        wait(start(COMMANDS[needs], folder / "in", given))
    return given


def result_of(long: Long, out: Path) -> Path:
    """Where a command that was told `out` puts its result."""
    return out.parent / long.words[-1].replace("OUT", out.name)


def stop(
    long: Long,
    out: Path,
    given: Path,
    kind: str,
    moment: float | None = None,
    *,
    names: frozenset[str] = frozenset(),
) -> tuple[str, str]:
    """Stop a command after so many seconds, or, without any, once it listens to signals.

    `names` are the files that a whole result has, where it is a folder.

    Returns
    -------
    when : str
        It was hit `before` it listened, `under_way` or `after` its end.
    fault : str
        What was wrong about how it ended, or "".
    """
    running = start(long, out, given)
    if reach(running, moment):
        said, _ = wait(running)
        return "after", "" if running.returncode in (0, 3) else f"failed: {said[-200:]}"
    if kind == "SIGSTOP":  # it goes on afterwards as if nothing had been
        os.killpg(running.pid, signal.SIGSTOP)
        time.sleep(HALT)
        os.killpg(running.pid, signal.SIGCONT)
    elif kind == "SIGINT":
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    else:
        running.send_signal(getattr(signal, kind))
    told = time.monotonic()
    said, code = wait(running)
    late = time.monotonic() - told
    left = left_of(running.pid)
    for process in left:
        os.kill(process, signal.SIGKILL)
    if left:
        return "under_way", f"{len(left)} processes left after {GONE:g} s"
    if kind != "SIGSTOP" and late > LATE:
        return "under_way", f"went on for {late:.0f} s"
    result = result_of(long, out)
    if code == -getattr(signal, kind) and kind != "SIGKILL":  # as any program ends
        when = "after" if result.exists() else "before"
        return when, "" if when == "before" or opens(result, names) else "half a result"
    return "under_way", _judged(kind, code, said, result, names)


def _judged(kind: str, code: int, said: str, result: Path, names: frozenset[str]) -> str:
    """What is wrong about how a stopped command ended; "" where nothing is."""
    done = code in (0, 3)  # it was just ready, or ends as if nothing had been
    if not done and code != CODES.get(kind, 0):
        return f"exit {code}: {said[-300:]}"
    if "Traceback" in said or "Exception ignored" in said:
        return f"a traceback: {said[-500:]}"
    if not done and kind != "SIGKILL":
        last = said.strip().splitlines()[-1:]
        wanted = "Error: interrupted" if kind == "SIGINT" else "Error: terminated"
        if last != [wanted]:
            return f"said {last}"
    if kind != "SIGKILL":
        partial = [path.name for path in result.parent.rglob(".skinmap-*")]
        if partial:
            return f"left {partial}"
    if done and not (result.exists() and names_of(result) >= names):
        return f"exit {code} without {sorted(names - names_of(result))[:3] or result.name}"
    if not result.exists():
        return ""
    return "" if opens(result, names) else f"half a result: {result.name}"


def names_of(result: Path) -> frozenset[str]:
    """Files of a result that is a folder, without what was only staged in it."""
    every = (path.relative_to(result) for path in result.rglob("*") if path.is_file())
    return frozenset(str(path) for path in every if not path.parts[0].startswith(".skinmap-"))


def opens(result: Path, names: frozenset[str] = frozenset()) -> bool:
    """Whether a result is whole: a file by its reader, a folder by the files it must have.

    Where these are not known, a page or table must be among them.
    """
    import warnings

    from skinmap.classify.model_file import load_classifier
    from skinmap.errors import SkinError
    from skinmap.live.sources.open_recording import open_track

    if result.is_dir():  # what was staged in it vanishes with the next run's temporary names
        there = names_of(result)
        if not there or names:
            return not there or there >= names
        return any(Path(name).suffix in (".html", ".json", ".toml") for name in there)
    readers: Mapping[str, Callable[[Path], object]] = {".skinmodel": load_classifier}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            readers.get(result.suffix, open_track)(result)
    except SkinError:
        return False
    return True


def start(
    long: Long, out: Path, given: Path, first: Callable[[], None] | None = None
) -> subprocess.Popen[str]:
    """Begin a command, in a session of its own; `first` runs in the new process before it.

    It listens to Ctrl-C, also where this program is a background job that does not.
    """

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if first is not None:
            first()

    words = [
        word.replace("OUT", str(out), 1) if word.startswith("OUT")
        else str(given) if word.startswith("IN") else word
        for word in long.words
    ]  # fmt: skip
    return subprocess.Popen(
        [sys.executable, "-c", SKINMAP, *words], cwd=ROOT, text=True, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, preexec_fn=prepare,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


def reach(running: subprocess.Popen[str], moment: float | None) -> bool:
    """Let a command run so many seconds, or until it listens to signals; whether it ended."""
    deadline = time.monotonic() + (LONGEST if moment is None else moment)
    while running.poll() is None and time.monotonic() < deadline:
        if moment is None and _listens(running.pid):
            return False
        time.sleep(0.01)
    return running.poll() is not None


def _listens(process: int) -> bool:
    """Whether a program has taken over what SIGTERM does, as ours do before they begin to work."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def wait(running: subprocess.Popen[str]) -> tuple[str, int]:
    """What a command said on stderr, and its exit code."""
    try:
        _, said = running.communicate(timeout=LONGEST)
    except subprocess.TimeoutExpired:
        os.killpg(running.pid, signal.SIGKILL)
        _, said = running.communicate()
        said += f"\nnot ended after {LONGEST:g} s"
    return said, running.returncode


def left_of(session: int) -> list[int]:
    """Processes of a session that are still there after GONE seconds."""
    deadline = time.monotonic() + GONE
    while (left := _members(session)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def _members(session: int) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(entry.name))
    return found


if __name__ == "__main__":
    main()
