"""Every kind of file cut at a thousand places, and with one byte changed at a thousand places.

A part of `make soak` (ARGS=cuts). A file opens whole, opens with what was lost said, or is refused
with an error of ours. Where its format has a checksum no number may differ
without a word; where it has none that is counted as well.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import get_context
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import joblib
import numpy as np

from benchmarks import ROOT
from benchmarks.harness.timing import peak_mb
from skinmap.errors import SkinError, SkinWarning

if TYPE_CHECKING:
    from damage.target import Target

PLACES = 1000
LONGEST = 10  # seconds for one file of some kilobytes
LONGEST_CPU = 10.0  # CPU seconds for one input: real files of this size take a millisecond
CORPUS = ROOT / "build" / "fuzz"  # of inputs that show a finding
MOST_MB = 200.0  # more memory than the whole file took
# Archives have a CRC-32 of each member, MCAP one of each chunk and of its index.
CHECKED = (
    "recording", "recording-archive", "learning", "mcap", "mcap-touches", "mcap-repair", "model",
    "response", "self-touch", "robot-touches", "presses", "self-touch-part", "wrenches",
    "arrays", "cache", "resume",
)  # fmt: skip
# A file in memory is written and read in half the time, where the system has such a place.
SCRATCH = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
OUTCOMES = ("whole", "said", "refused", "changed")


class TooLongError(Exception):
    """A damaged file that took longer than LONGEST."""


def measure(*, places: int = PLACES, seed: int = 0) -> dict[str, Any]:
    """Counts of each kind, each in a process of its own, and their sums.

    Parameters
    ----------
    places : int
        At which a file is cut, and at which a byte of it is changed.
    seed : int
    """
    rows = each_kind(_examine, places, seed)
    return {
        "places": places,
        "files": sum(row["files"] for row in rows.values()),
        "most_mb": max(row["more_mb"] for row in rows.values()),
        **sums(rows),
    }


def each_kind(examine: Callable[..., dict[str, Any]], *given: Any) -> dict[str, dict[str, Any]]:
    """What a function finds of each kind of file that lies on a disk, in a process of its own."""
    rows = {}
    for name in (name for name, one in load_targets().items() if is_file(one)):
        row, code = apart(examine, name, *given)
        rows[name] = row or {"files": 0, "megabytes": 0.0, "more_mb": 0.0, "longest_s": 0.0,
                             "faults": [f"the process ended with {code}"]}  # fmt: skip
        print(f"{name}: {rows[name]}", file=sys.stderr, flush=True)
    return rows


def sums(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The rows of all kinds, their faults and the longest time [s]."""
    return {
        "kinds": rows,
        "faults": sum(len(row["faults"]) for row in rows.values()),
        "longest_s": max(row["longest_s"] for row in rows.values()),
    }


def load_targets() -> dict[str, Target]:
    """The targets of tests/extremes/damage by name."""
    path = str(ROOT / "tests" / "extremes")
    if path not in sys.path:
        sys.path.insert(0, path)
    from damage.catalogue import TARGETS

    return dict(TARGETS)


def is_file(target: Target) -> bool:
    """Whether the target is a file as it lies on a disk: no message, no inside of an archive."""
    return not target.inside and PurePath(target.file).name != "m"


def apart(work: Callable[..., dict[str, Any]], *given: Any) -> tuple[dict[str, Any] | None, int]:
    """What a function returns in a process of its own, whose memory is its alone.

    None where the process died, and its exit code.
    """
    ours, theirs = get_context("fork").Pipe()
    process = get_context("fork").Process(target=lambda: theirs.send(work(*given)))
    process.start()
    theirs.close()
    try:
        found: dict[str, Any] | None = ours.recv()
    except EOFError:
        found = None
    process.join()
    return found, process.exitcode or 0


def resident_mb() -> float:
    """Memory of this process now [MB], from which its peak is counted afresh."""
    with contextlib.suppress(OSError):  # where the mark cannot be set back the peak stays
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return peak_mb()


def _examine(name: str, places: int, seed: int) -> dict[str, Any]:
    target, rng = load_targets()[name], np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(dir=SCRATCH) as folder:
        return examine(target, Path(folder), places, rng=rng, checked=name in CHECKED)


def examine(
    target: Target, folder: Path, places: int, *, rng: np.random.Generator, checked: bool
) -> dict[str, Any]:
    """Damage the originals of one target, and see what comes of each.

    Returns
    -------
    dict
        `files` that were tried, how many opened `whole`, had their losses `said`, were `refused`,
        or gave other numbers without a word (`changed`; a fault where `checked`); `faults`, each
        in a line; `more_mb` than the whole file took; `longest_s` of one file.
    """
    target.lay_out(folder)
    counts, faults, longest = Counter[str](), list[str](), 0.0
    originals = list(target.seeds())
    wholes = [read(target, one, folder)[1] for one in originals]
    before = resident_mb()
    each = -(-places // len(originals))
    for original, whole in zip(originals, wholes, strict=True):
        for how, data in damaged(original, each, rng=rng):
            began = time.monotonic()
            try:
                outcome, found = read(target, data, folder)
            except Exception as error:  # noqa: BLE001 - what else comes is what is looked for
                faults.append(f"{how}: {type(error).__name__}: {error}"[:200])
                continue
            longest = max(longest, time.monotonic() - began)
            if outcome == "whole" and found != whole:
                outcome = "changed"
                if checked:
                    faults.append(f"{how}: another number, without a word")
            counts[outcome] += 1
    more = peak_mb() - before
    if more > MOST_MB:
        faults.append(f"{more:.0f} MB more than the whole file took")
    return {
        "bytes": [len(one) for one in originals],
        "files": counts.total() + len(faults) - checked * counts["changed"],
        **{name: counts[name] for name in OUTCOMES},
        "checked": checked,
        "faults": faults,
        "more_mb": more,
        "longest_s": longest,
    }


def damaged(data: bytes, places: int, *, rng: np.random.Generator) -> list[tuple[str, bytes]]:
    """The data cut at so many places, and with one byte changed at so many; all where they fit."""
    found = []
    for place in _places(len(data), places, rng):
        found.append((f"cut at {place}", data[:place]))
    for place in _places(len(data), places, rng):
        other = (data[place] + int(rng.integers(1, 256))) % 256
        changed = data[:place] + bytes([other]) + data[place + 1 :]
        found.append((f"{other:#04x} at {place}", changed))
    return found


def _places(size: int, places: int, rng: np.random.Generator) -> list[int]:
    """Each byte once where there are so few, and again at random up to the number asked for."""
    once = rng.permutation(size)[:places]
    again = rng.integers(0, size, max(places - size, 0))
    return [int(place) for place in np.concatenate([once, again])]


def trouble(
    target: Target,
    data: bytes,
    folder: Path,
    base: float,
    *,
    longest: float = LONGEST_CPU,
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
    try:
        with _at_most(longest, signal.ITIMER_PROF, signal.SIGPROF):
            target.try_one(data, folder)
    except Exception as error:  # noqa: BLE001 - what else comes is what is looked for
        said = f"{type(error).__name__}: {error}"
    more = peak_mb() - base
    if not said and more > most_mb:
        said = f"memory: {more:.0f} MB more than whole files took"
        resident_mb()  # the next one that takes as much is told apart
    return said, time.process_time() - began, more


def keep(folder: Path, data: bytes) -> Path:
    """Write an input that shows a finding; its file."""
    path = folder / f"crash-{hashlib.sha1(data, usedforsecurity=False).hexdigest()}"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


@contextlib.contextmanager
def _at_most(seconds: float, timer: int, number: int) -> Iterator[None]:
    """A TooLongError in what takes longer by a timer that ends in a signal."""

    def stop(*_: object) -> None:
        raise TooLongError(f"longer than {seconds:g} s for one input")

    before = signal.signal(number, stop)
    signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        signal.setitimer(timer, 0.0)
        signal.signal(number, before)


def read(target: Target, data: bytes, folder: Path) -> tuple[str, str]:
    """How a file opens, "whole", "said" or "refused", and a fingerprint of what it holds.

    Raises
    ------
    Exception
        Any error or warning that is not ours, and TooLongError.
    """
    path = folder / target.file
    path.write_bytes(data)
    with (
        _at_most(LONGEST, signal.ITIMER_REAL, signal.SIGALRM),
        warnings.catch_warnings(record=True) as told,
    ):
        warnings.simplefilter("always")
        try:
            value = target.read(path)
        except SkinError:
            return "refused", ""
    foreign = [one for one in told if not issubclass(one.category, SkinWarning)]
    if foreign:
        raise RuntimeWarning(f"{foreign[0].category.__name__}: {foreign[0].message}")
    lost = bool(told) or bool(getattr(getattr(value, "loss", None), "recovered", False))
    return "said" if lost else "whole", joblib.hash(value)
