"""Long commands stopped at random moments: Ctrl-C, a polite kill, a kill, a halt, a locked folder.

A part of `make soak` (ARGS=stops). After each stop: the exit code of the documents and one line (a
killed process writes none), no result that is not whole under its final name, and no process left.
`LOCK` makes the folder of the result read-only, for a command without root's right to write where
it may not.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT
from benchmarks.harness.timing import process_table
from benchmarks.reliability import full_disk

EACH = 3  # stops of each command by each signal
GONE = 5.0  # seconds until no process may be left
HALT = 0.3  # seconds between SIGSTOP and SIGCONT
LONGEST = 1200.0  # of a command, on a busy machine too [s]
LATE = 60.0  # what ends so long after it was told to has not listened [s]
SKINMAP = "from skinmap.cli.main import main; main()"
LOCK = "LOCK"
CODES = {"SIGINT": 130, "SIGTERM": 143, "SIGKILL": -9, LOCK: 2}
WORDS = {
    "SIGINT": "Error: interrupted", "SIGTERM": "Error: terminated", LOCK: "Error: cannot.*"
}  # fmt: skip
KINDS = ("SIGINT", "SIGTERM", "SIGKILL", "SIGSTOP")
ENDS = ("before", "under_way", "after", "refused", "done")
DROP_FROM_BOUNDS, CAP_DAC_OVERRIDE = 24, 1  # of prctl and of the rights of a process, by Linux


# What stands behind `skinmap`: OUT is where the result goes, IN a recording that is made before.
COMMANDS = {
    "simulate": "simulate kaspar --part left_hand --per-gesture 12 -o OUT.npz",
    "train": "train IN.npz -o OUT.skinmodel",
    "evaluate": "evaluate IN.npz --seeds 1 -o OUT",
    "evaluate --jobs": "evaluate IN.npz --seeds 2 --jobs 2 -o OUT",
    "flatten --jobs": "flatten icub --part left_hand --part left_foot --jobs 2 -o OUT",
    "trade": full_disk.COMMANDS["trade"],
    "calibrate batch": f"calibrate batch {full_disk.BOARD}/patches.csv --jobs 2 -o OUT",
    "calibrate plane": full_disk.COMMANDS["calibrate plane"],
    "calibrate selftouch": full_disk.COMMANDS["calibrate selftouch"],
    "record": "record sim --seconds 2 -o OUT.mcap",
}


def measure(
    *, each: int = EACH, seed: int = 0, names: Sequence[str] = (), kinds: Sequence[str] = KINDS
) -> dict[str, Any]:
    """Stop each command so many times by each signal, at moments drawn from its whole length.

    Returns
    -------
    dict
        `commands`: of each its length [s], how many stops came `before` it began to listen (as a
        shell ends any program), hit it `under_way`, or came `after` its end; `faults` in a line
        each; and the sums. Of locked folders: how many commands were `refused`, and how many had
        `done` their work or could end it by what they had open.
    """
    rng, rows = np.random.default_rng(seed), {}
    with tempfile.TemporaryDirectory(prefix="skinmap-stops-") as name:
        folder = Path(name)
        for command in names or COMMANDS:
            rows[command] = _of_command(command, folder, each, kinds, rng)
            print(f"{command}: {rows[command]}", file=sys.stderr, flush=True)
    return {
        "commands": rows,
        "stops": sum(row[when] for row in rows.values() for when in ENDS),
        "under_way": sum(row["under_way"] for row in rows.values()),
        "faults": sum(len(row["faults"]) for row in rows.values()),
    }


def _of_command(
    name: str, folder: Path, each: int, kinds: Sequence[str], rng: np.random.Generator
) -> dict[str, Any]:
    words, given = COMMANDS[name], folder / "in.npz"
    if " IN." in words and not given.exists():
        wait(start(COMMANDS["simulate"], folder / "in", given))
    began = time.monotonic()
    running = start(words, folder / "whole", given)
    said, code = wait(running)
    took = time.monotonic() - began
    if code not in (0, 3):
        whole = f"the whole command: exit {code}: {said[-200:]}"
        return {"seconds": took, **dict.fromkeys(ENDS, 0), "faults": [whole]}
    names = names_of(result_of(words, folder / "whole"))
    counts = dict.fromkeys(ENDS, 0)
    faults = []
    for number in range(each):
        for kind in kinds:
            place = folder / f"{number}{kind}"
            place.mkdir()
            out = place / "out"
            moment = float(rng.uniform(0.0, took))
            when, fault = stop(words, out, given, kind, moment, names=names)
            counts[when] += 1
            if fault:
                faults.append(f"{kind} after {moment:.2f} s: {fault}")
            shutil.rmtree(place)
    shutil.rmtree(folder / "whole", ignore_errors=True)
    return {"seconds": took, **counts, "faults": faults}


def result_of(words: str, out: Path) -> Path:
    """Where a command that was told `out` puts its result."""
    return out.parent / words.split()[-1].replace("OUT", out.name)


def stop(
    words: str,
    out: Path,
    given: Path,
    kind: str,
    moment: float | None = None,
    *,
    names: frozenset[str] = frozenset(),
) -> tuple[str, str]:
    """Stop a command, or lock its result's folder, after so many seconds, or once it listens.

    `names` are the files that a whole result has, where it is a folder.

    Returns
    -------
    when : str
        It was hit `before` it listened, `under_way` or `after` its end. Of locked folders: the
        command was `refused`, or had `done` its work.
    fault : str
        What was wrong about how it ended, or "".
    """
    locks = kind == LOCK
    running = start(words, out, given, first=_obey if locks else None)
    if reach(running, moment) and not locks:
        said, _ = wait(running)
        return "after", "" if running.returncode in (0, 3) else f"failed: {said[-200:]}"
    folders = [out.parent, *(path for path in out.parent.rglob("*") if path.is_dir())] * locks
    for one in folders:
        one.chmod(0o555)
    if kind == "SIGSTOP":  # it goes on afterwards as if nothing had been
        os.killpg(running.pid, signal.SIGSTOP)
        time.sleep(HALT)
        os.killpg(running.pid, signal.SIGCONT)
    elif kind == "SIGINT":
        os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    elif not locks:
        running.send_signal(getattr(signal, kind))
    told = time.monotonic()
    said, code = wait(running)
    late = time.monotonic() - told
    left = left_of(running.pid)
    for process in left:
        os.kill(process, signal.SIGKILL)
    for one in filter(Path.exists, folders):
        one.chmod(0o755)
    result, when = result_of(words, out), "under_way"
    if locks:
        when = "done" if code in (0, 3) else "refused"
    if left:
        return when, f"{len(left)} processes left after {GONE:g} s"
    if kind not in ("SIGSTOP", LOCK) and late > LATE:
        return when, f"went on for {late:.0f} s"
    if not locks and kind != "SIGKILL" and code == -getattr(signal, kind):  # as any program ends
        when = "after" if result.exists() else "before"
        return when, "" if when == "before" or opens(result, names) else "half a result"
    return when, _judged(kind, code, said, result, names)


def _judged(kind: str, code: int, said: str, result: Path, names: frozenset[str]) -> str:
    """What is wrong about how a stopped command ended; "" where nothing is."""
    done = code in (0, 3)  # it was ready, or goes on as if nothing had happened
    if not done and code != CODES.get(kind, 0):
        return f"exit {code}: {said[-300:]}"
    if "Traceback" in said or "Exception ignored" in said:
        return f"a traceback: {said[-500:]}"
    last = said.strip().splitlines()[-1:]
    if not done and kind != "SIGKILL" and not re.fullmatch(WORDS[kind], "".join(last)):
        return f"said {last}"
    partial = [path.name for path in result.parent.rglob(".skinmap-*")]
    if partial and kind not in ("SIGKILL", LOCK):
        return f"left {partial}"
    if done and not (result.exists() and names_of(result) >= names):
        return f"exit {code} without {sorted(names - names_of(result))[:3] or result.name}"
    half = result.exists() and not opens(result, names)
    return f"half a result: {result.name}" if half else ""


def _obey() -> None:
    """Give up root's right to write anywhere, for the program that is begun."""
    ctypes.CDLL(None, use_errno=True).prctl(DROP_FROM_BOUNDS, CAP_DAC_OVERRIDE, 0, 0, 0)


def names_of(result: Path) -> frozenset[str]:
    """Files of a result that is a folder, without what was only staged in it."""
    every = (path.relative_to(result) for path in result.rglob("*") if path.is_file())
    return frozenset(str(path) for path in every if not path.parts[0].startswith(".skinmap-"))


def opens(result: Path, names: frozenset[str] = frozenset()) -> bool:
    """Whether a result is whole: a file by its reader, a folder by the files it must have.

    Where these are not known, a page or table must be among them.
    """
    import warnings

    from skinmap.errors import SkinError
    from skinmap.live.sources.open_source import open_track
    from skinmap.recognition.model_file import load_classifier

    if result.is_dir():  # what was staged in it vanishes with the next run's temporary names
        there = names_of(result)
        if not there or names:
            return not there or there >= names
        return any(Path(name).suffix in (".html", ".json", ".toml") for name in there)
    read: Callable[[Path], object]
    read = load_classifier if result.suffix == ".skinmodel" else open_track
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(result)
    except SkinError:
        return False
    return True


def start(
    words: str, out: Path, given: Path, first: Callable[[], None] | None = None
) -> subprocess.Popen[str]:
    """Begin a command, in a session of its own; `first` runs in the new process before it.

    It listens to Ctrl-C, also where this program is a background job that does not.
    """

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if first is not None:
            first()

    every = [
        word.replace("OUT", str(out), 1) if word.startswith("OUT")
        else str(given) if word.startswith("IN") else word
        for word in words.split()
    ]  # fmt: skip
    return subprocess.Popen(
        [sys.executable, "-c", SKINMAP, *every], cwd=ROOT, text=True, start_new_session=True,
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
    while True:
        every = process_table().items()
        left = [pid for pid, one in every if int(one[3]) == session and one[0] != "Z"]
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.05)
