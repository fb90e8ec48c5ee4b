"""Damage every reader by what makes it take new ways (coverage-guided, with atheris).

    python scripts/fuzz.py [--seconds 5] [--corpus build/fuzz] [TARGET...]

Each target runs in a process of its own (forked after the modules are imported with counters in
them, which takes 15 s of CPU), from real small files and from what an earlier run found worth
keeping, for so many seconds of its CPU: a busy machine tries no fewer. A finding is what
benchmarks/reliability/cuts takes for one (an error or a warning that is not ours, 10 s of CPU
for one input, 200 MB more than whole files took): its input stays in the corpus folder, and one
line says where.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import shutil
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "extremes")]

from benchmarks.reliability import cuts  # noqa: E402 - the tree of this script comes first

BUSY = 20  # times as long as the seconds of CPU that are asked for, until a target is given up
START = 600  # s beyond: libraries are imported with a target's first file
STUCK = 300  # s for one input in compiled code, where no signal of ours is heard
COUNTS = "counts.json"  # inputs tried of each target, for docs/reliability.md
LONGEST = 1 << 16  # bytes: the originals have a few kilobytes


def main(arguments: list[str] | None = None) -> int:
    """Run the targets one after the other; 1 where one of them found something."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", help="all by default")
    parser.add_argument("--seconds", type=int, default=5, help="of CPU for each target (5)")
    parser.add_argument("--corpus", type=Path, default=Path("build/fuzz"))
    given = parser.parse_args(arguments)
    try:
        import atheris
    except ImportError:
        print("atheris is not installed: it comes with the extra `dev`", file=sys.stderr)
        return 2
    with (
        contextlib.redirect_stderr(io.StringIO()),  # a line for each module
        atheris.instrument_imports(include=["skinmap", "calibration", "viewer"]),
    ):
        from damage.catalogue import TARGETS

    strange = [name for name in given.targets if name not in TARGETS]
    if strange:
        print(f"no target {strange[0]!r}; the targets are: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    names = given.targets or list(TARGETS)
    found, kept_at = [], given.corpus / COUNTS
    counts: dict[str, dict[str, int | bool]] = {}
    if given.targets and kept_at.exists():  # what is tried again replaces its own line only
        counts = json.loads(kept_at.read_text(encoding="utf-8"))["targets"]
    for name in names:
        clean, runs = _clean(name, given.corpus, given.seconds)
        counts[name] = {"runs": runs, "found": not clean}
        found += [] if clean else [name]
        keep = {"seconds": given.seconds, "targets": counts}
        kept_at.write_text(json.dumps(keep, indent=1), encoding="utf-8")
    print(f"{len(found)} of {len(names)} targets with a finding", *found)
    return 1 if found else 0


def _clean(name: str, corpus: Path, seconds: int) -> tuple[bool, int]:
    """Run one target in a process of its own; whether it found nothing, and inputs tried."""
    folder = corpus / name
    (folder / "kept").mkdir(parents=True, exist_ok=True)
    before = set(folder.iterdir())
    context = get_context("fork")
    tried = context.Value("q", 0)
    process = context.Process(target=fuzz, args=(name, folder, seconds, tried))
    process.start()
    process.join(seconds * BUSY + START)
    late = process.is_alive()
    if late:
        process.kill()
        process.join()
    said = (folder / "log.txt").read_text(errors="replace")
    if late:
        said += "\nError: not run to its end: the machine was too busy, or an input hangs"
    clean = process.exitcode == 0
    print(f"{name:24} {'nothing' if clean else 'FOUND':8} {tried.value:8,} inputs", flush=True)
    if not clean:
        crashes = sorted(path for path in folder.iterdir() if path.name.partition("-")[2])
        fresh = [path for path in crashes if path not in before] or crashes
        print(f"  inputs: {', '.join(map(str, fresh)) or 'none kept'}; log: {folder / 'log.txt'}")
        lines = [line for line in said.splitlines() if "Error" in line or "Warning" in line]
        print("  " + (lines or said.splitlines() or ["it said nothing"])[-1][:200], flush=True)
    return clean, tried.value


def fuzz(name: str, folder: Path, seconds: int, tried: Synchronized[int]) -> None:
    """Run one target for so long, all it says into log.txt; ends the process."""
    import atheris
    from damage.catalogue import TARGETS

    log = os.open(folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(log, stream)
    target = TARGETS[name]
    with tempfile.TemporaryDirectory(dir=cuts.SCRATCH) as scratch:
        place = Path(scratch)
        target.lay_out(place)
        for number, seed in enumerate(target.seeds()):
            (folder / "kept" / f"original-{number}").write_bytes(seed)
            target.try_one(seed, place)  # what it imports is imported by now
        base, ends = cuts.resident_mb(), time.process_time() + seconds

        def one(data: bytes) -> None:
            if time.process_time() > ends:
                shutil.rmtree(place)
                os._exit(0)  # libFuzzer knows wall time only
            tried.value += 1
            said, _, _ = cuts.trouble(target, data, place, base)
            if said:
                # libFuzzer keeps inputs when the interpreter exits, which a forked one does not do.
                cuts.keep(folder, data)
                print(f"Error: {said}", flush=True)
                os._exit(1)

        options = [
            f"-timeout={STUCK}", "-rss_limit_mb=0", f"-max_len={LONGEST}",
            f"-artifact_prefix={folder}{os.sep}", "-verbosity=0",
        ]  # fmt: skip
        atheris.Setup([__file__, *options, str(folder / "kept")], one)
        atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
