"""Every reader at random damage, as fast as it reads: an error of ours or a value, nothing else.

`python -m benchmarks.reliability.accidents [--inputs 10000] [--seconds 10] [READER...]` takes the
targets and the accidents of tests/extremes/damage, each reader in a process of its own. A finding
is an error or a warning that is not ours, more than 10 s of CPU for one input, or 200 MB more than
whole files took; its smallest input stays in build/fuzz, where `make fuzz` keeps its counts too.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import ROOT
from benchmarks.reliability.cuts import (
    MOST_MB,
    SCRATCH,
    TooLongError,
    apart,
    load_targets,
    peak_mb,
    resident_mb,
)

if TYPE_CHECKING:
    from damage.target import Target

    Accident = tuple[str, float, float, bytes]

INPUTS, SECONDS = 10_000, 10.0  # of each reader, whichever comes first; seconds of CPU
LONGEST = 10.0  # CPU seconds for one input: real files of this size take a millisecond
STEPS = 4  # accidents of one input at most
ENOUGH = 5  # findings of one reader
BLOCK = 1024  # inputs that are drawn at once
CORPUS = ROOT / "build" / "fuzz"
COUNTS = CORPUS / "accidents.json"


def main() -> int:
    """Damage the readers one after the other; 1 where one of them found something."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", help="all by default")
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of CPU (10)")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    strange = [name for name in given.readers if name not in load_targets()]
    if strange:
        print(f"no reader {strange[0]!r}; they are: {', '.join(load_targets())}", file=sys.stderr)
        return 2
    found: dict[str, Any] = {"inputs": given.inputs, "seconds": given.seconds, "targets": {}}
    if given.readers and COUNTS.exists():  # those of the others stay
        found["targets"] = json.loads(COUNTS.read_text(encoding="utf-8"))["targets"]
    findings = 0
    for name, row in measure(given.readers, given.inputs, given.seconds, given.seed):
        findings += len(row["findings"])
        print(f"{name:24} {row['runs']:7,} inputs, {row['cpu_s']:5.1f} s, {row['more_mb']:4.0f} MB",
              *row["findings"], sep="\n  " if row["findings"] else "", flush=True)  # fmt: skip
        found["targets"][name] = row
        COUNTS.parent.mkdir(parents=True, exist_ok=True)
        COUNTS.write_text(json.dumps(found, indent=1), encoding="utf-8")
    rows = found["targets"].values()
    print(
        f"{sum(row['runs'] for row in rows):,} inputs of {len(rows)} readers, {findings} findings"
    )
    return int(findings > 0)


def measure(
    names: Sequence[str], inputs: int, seconds: float, seed: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each reader's name and what `examine` finds of it."""
    for name in names or list(load_targets()):
        row, code = apart(_examine, name, inputs, seconds, seed)
        if row is None:
            row = {"runs": 0, "cpu_s": 0.0, "more_mb": 0.0, "longest_s": 0.0,
                   "findings": [f"the process ended with {code}"]}  # fmt: skip
        yield name, row


def _examine(name: str, inputs: int, seconds: float, seed: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(dir=SCRATCH) as folder:
        return examine(
            load_targets()[name], Path(folder), inputs, seconds, rng=np.random.default_rng(seed)
        )


def examine(
    target: Target, folder: Path, inputs: int, seconds: float, *, rng: np.random.Generator
) -> dict[str, Any]:
    """Damage one reader's originals so many times, or for so many seconds of CPU.

    Returns
    -------
    dict
        `runs`, `cpu_s`, `longest_s` of one input, `more_mb` than whole files took, and
        `findings`, each in a line that begins with the file that shows it.
    """
    from damage.mutations import mutate

    target.lay_out(folder)
    seeds = target.seeds()
    for seed in seeds:
        target.try_one(seed, folder)  # what it imports is imported by now
    base, began = resident_mb(), time.process_time()
    runs, longest, more, findings = 0, 0.0, 0.0, list[str]()
    for steps in accidents(rng):
        if runs == inputs or time.process_time() - began > seconds or len(findings) == ENOUGH:
            break
        original = seeds[runs % len(seeds)]
        runs += 1
        said, took, took_mb = trouble(target, mutate(original, steps), folder, base)
        longest, more = max(longest, took), max(more, took_mb)
        if said:
            small = fewer(target, original, steps, folder, said.partition(":")[0])
            kept = keep(CORPUS / target.name, mutate(original, small))
            findings.append(f"{kept.relative_to(ROOT)}: {said}"[:300])
    return {
        "runs": runs,
        "cpu_s": time.process_time() - began,
        "longest_s": longest,
        "more_mb": more,
        "findings": findings,
    }


def accidents(rng: np.random.Generator) -> Iterator[list[Accident]]:
    """Accidents without end, of as many kinds as `damage.mutations` has."""
    from damage.mutations import KINDS, WORDS

    while True:
        drawn = rng.random((BLOCK, STEPS, 4))
        for count, rows in zip(rng.integers(1, STEPS + 1, BLOCK), drawn, strict=True):
            yield [
                (KINDS[int(kind * len(KINDS))], float(where), float(other),
                 WORDS[int(word * len(WORDS))])
                for kind, where, other, word in rows[:count]
            ]  # fmt: skip


def trouble(
    target: Target,
    data: bytes,
    folder: Path,
    base: float,
    *,
    longest: float = LONGEST,
    most_mb: float = MOST_MB,
) -> tuple[str, float, float]:
    """What is wrong about how an input is taken ("" where nothing is), and what it took.

    Returns
    -------
    said : str
    seconds : float
        CPU time [s].
    more : float
        Memory beyond `base` that was ever in use since that was taken [MB].
    """
    began, said = time.process_time(), ""
    before = signal.signal(signal.SIGPROF, _too_long)
    signal.setitimer(signal.ITIMER_PROF, longest)
    try:
        target.try_one(data, folder)
    except Exception as error:  # noqa: BLE001 - what else comes is what is looked for
        said = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    more = peak_mb() - base
    if not said and more > most_mb:
        said = f"memory: {more:.0f} MB more than whole files took"
        resident_mb()  # the next one that takes as much is told apart
    return said, time.process_time() - began, more


def fewer(
    target: Target, original: bytes, steps: list[Accident], folder: Path, kind: str
) -> list[Accident]:
    """The accidents without those that the finding does not need."""
    from damage.mutations import mutate

    for step in list(steps):
        rest = [other for other in steps if other is not step]
        again, _, _ = trouble(target, mutate(original, rest), folder, resident_mb())
        if again.partition(":")[0] == kind:
            steps = rest
    return steps


def keep(folder: Path, data: bytes) -> Path:
    """Write an input that shows a finding; its file."""
    path = folder / f"crash-{hashlib.sha1(data, usedforsecurity=False).hexdigest()}"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def _too_long(*_: object) -> None:
    raise TooLongError("too many seconds of CPU for one input")


if __name__ == "__main__":
    sys.exit(main())
