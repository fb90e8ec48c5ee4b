"""Damage every reader by what makes it take new ways (coverage-guided, with atheris).

    python scripts/fuzz.py [--seconds 60] [--corpus build/fuzz] [TARGET...]

Each target runs in a process of its own, from real small files and from what an earlier run found
worth keeping. A finding is an error or a warning that is not ours, more than 10 s for one file or
more than 2 GB: its input stays in the corpus folder, and one line says how to see it again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
START = 900  # s: the modules are imported with counters in them, 15 s of CPU
SLOWEST = 10  # s for one input: real files of this size take a millisecond
MOST_MEMORY = 2048  # MB of one process: its libraries take 400 of them
LONGEST = 1 << 16  # bytes: the originals have a few kilobytes


def main(arguments: list[str] | None = None) -> int:
    """Run the targets one after the other; 1 where one of them found something."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", help="all by default")
    parser.add_argument("--seconds", type=int, default=60, help="for each target (60)")
    parser.add_argument("--corpus", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--inside", metavar="TARGET", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "extremes")]
    if given.inside:
        fuzz(given.inside, given.corpus / given.inside, given.seconds)
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("atheris is not installed: it comes with the extra `dev`", file=sys.stderr)
        return 2
    from damage.catalogue import TARGETS

    strange = [name for name in given.targets if name not in TARGETS]
    if strange:
        print(f"no target {strange[0]!r}; there is: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    found = [
        name for name in given.targets or TARGETS if not _clean(name, given.corpus, given.seconds)
    ]
    print(f"{len(found)} of {len(given.targets or TARGETS)} targets with a finding", *found)
    return 1 if found else 0


def _clean(name: str, corpus: Path, seconds: int) -> bool:
    """Run one target in a process of its own; whether it found nothing."""
    command = [
        sys.executable, __file__, "--inside", name, "--corpus", str(corpus),
        "--seconds", str(seconds),
    ]  # fmt: skip
    folder = corpus / name
    (folder / "kept").mkdir(parents=True, exist_ok=True)
    # An input that hangs is found by libFuzzer; this is for a machine too busy even to start.
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + START)
        code, said = done.returncode, done.stdout + done.stderr
    except subprocess.TimeoutExpired as error:
        code, said = -1, f"{error.stderr!r}\nthe machine was too busy: not run to its end"
    (folder / "log.txt").write_text(said)
    runs = [line for line in said.splitlines() if line.startswith("stat::number_of_executed")]
    print(
        f"{name:24} {'nothing' if code == 0 else 'FOUND':8} {''.join(runs)[31:]} runs", flush=True
    )
    if code:
        crashes = sorted(path for path in folder.iterdir() if path.name.partition("-")[2])
        print(f"  inputs: {', '.join(map(str, crashes)) or 'none kept'}; log: {folder / 'log.txt'}")
        lines = [line for line in said.splitlines() if "Error" in line or "Warning" in line]
        print("  " + (lines or said.splitlines())[-1][:200], flush=True)
    return code == 0


def fuzz(name: str, folder: Path, seconds: int) -> None:
    """Run one target for so long; ends the process."""
    import atheris

    with atheris.instrument_imports(include=["skinmap", "calibration", "viewer"]):
        from damage.catalogue import TARGETS

    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        target.lay_out(place)
        for number, seed in enumerate(target.seeds()):
            (folder / "kept" / f"original-{number}").write_bytes(seed)
            target.try_one(seed, place)  # what it imports is imported by now
        options = [
            f"-max_total_time={seconds}", f"-timeout={SLOWEST}", f"-rss_limit_mb={MOST_MEMORY}",
            f"-max_len={LONGEST}", f"-artifact_prefix={folder}{os.sep}", "-print_final_stats=1",
            "-verbosity=0",
        ]  # fmt: skip
        atheris.Setup(
            [__file__, *options, str(folder / "kept")], lambda data: _one(target, data, place)
        )
        atheris.Fuzz()


def _one(target: object, data: bytes, place: Path) -> None:
    target.try_one(data, place)  # type: ignore[attr-defined]


if __name__ == "__main__":
    sys.exit(main())
