"""Damage every reader by what makes it take new ways (coverage-guided, with atheris).

    python scripts/fuzz.py [--seconds 60] [--corpus build/fuzz] [TARGET...]

Each target runs in a process of its own (forked after the modules are imported with counters in
them, which takes 15 s of CPU), from real small files and from what an earlier run found worth
keeping. A finding is an error or a warning that is not ours, more than 10 s for one file or
more than 2 GB: its input stays in the corpus folder, and one line says how to see it again.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import multiprocessing
import os
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
START = 600  # s beyond those asked for: libraries are imported with a target's first file
SLOWEST = 10  # s for one input: real files of this size take a millisecond
MAX_MEMORY = 2048  # MB of one process: its libraries take 400 of them
COUNTS = "counts.json"  # inputs tried of each target, for docs/reliability.md
LONGEST = 1 << 16  # bytes: the originals have a few kilobytes


def main(arguments: list[str] | None = None) -> int:
    """Run the targets one after the other; 1 where one of them found something."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", help="all by default")
    parser.add_argument("--seconds", type=int, default=60, help="for each target (60)")
    parser.add_argument("--corpus", type=Path, default=Path("build/fuzz"))
    given = parser.parse_args(arguments)
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "extremes")]
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
    found, counts = [], {}
    for name in names:
        clean, runs = _clean(name, given.corpus, given.seconds)
        counts[name] = {"runs": runs, "found": not clean}
        found += [] if clean else [name]
        keep = {"seconds": given.seconds, "targets": counts}
        (given.corpus / COUNTS).write_text(json.dumps(keep, indent=1), encoding="utf-8")
    print(f"{len(found)} of {len(names)} targets with a finding", *found)
    return 1 if found else 0


def _clean(name: str, corpus: Path, seconds: int) -> tuple[bool, int]:
    """Run one target in a process of its own; whether it found nothing, and inputs tried."""
    folder = corpus / name
    (folder / "kept").mkdir(parents=True, exist_ok=True)
    before = set(folder.iterdir())
    process = multiprocessing.get_context("fork").Process(target=fuzz, args=(name, folder, seconds))
    process.start()
    # An input that hangs is found by libFuzzer; this is for a machine too busy even to start.
    process.join(seconds + START)
    late = process.is_alive()
    if late:
        process.kill()
        process.join()
    said = (folder / "log.txt").read_text(errors="replace")
    if late:
        said += "\nthe machine was too busy: not run to its end"
    runs = [line for line in said.splitlines() if line.startswith("stat::number_of_executed")]
    clean = process.exitcode == 0
    print(f"{name:24} {'nothing' if clean else 'FOUND':8} {''.join(runs)[31:]} runs", flush=True)
    if not clean:
        crashes = sorted(path for path in folder.iterdir() if path.name.partition("-")[2])
        fresh = [path for path in crashes if path not in before] or crashes
        print(f"  inputs: {', '.join(map(str, fresh)) or 'none kept'}; log: {folder / 'log.txt'}")
        lines = [line for line in said.splitlines() if "Error" in line or "Warning" in line]
        print("  " + (lines or said.splitlines() or ["it said nothing"])[-1][:200], flush=True)
    tried = re.findall(r"^stat::number_of_executed_units:\s*(\d+)|^#(\d+)\s", said, re.MULTILINE)
    return clean, max((int(one or other) for one, other in tried), default=0)


def fuzz(name: str, folder: Path, seconds: int) -> None:
    """Run one target for so long, all it says into log.txt; ends the process."""
    import atheris
    from damage.catalogue import TARGETS

    log = os.open(folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(log, stream)
    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        target.lay_out(place)
        for number, seed in enumerate(target.seeds()):
            (folder / "kept" / f"original-{number}").write_bytes(seed)
            target.try_one(seed, place)  # what it imports is imported by now
        options = [
            f"-max_total_time={seconds}", f"-timeout={SLOWEST}", f"-rss_limit_mb={MAX_MEMORY}",
            f"-max_len={LONGEST}", f"-artifact_prefix={folder}{os.sep}", "-print_final_stats=1",
            "-verbosity=0",
        ]  # fmt: skip
        atheris.Setup(
            [__file__, *options, str(folder / "kept")],
            lambda data: _one(target, data, place, folder),
        )
        atheris.Fuzz()


def _one(target: object, data: bytes, place: Path, folder: Path) -> None:
    try:
        target.try_one(data, place)  # type: ignore[attr-defined]
    except Exception:
        # libFuzzer keeps inputs when the interpreter exits, which a forked one does not do.
        (folder / f"crash-{hashlib.sha1(data).hexdigest()}").write_bytes(data)
        raise


if __name__ == "__main__":
    sys.exit(main())
