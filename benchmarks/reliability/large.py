"""Files of 10 MB of every kind, whole, cut and with a byte changed: what memory they take.

A part of `make soak` (ARGS=large). They are grown from the originals of tests/extremes/damage: rows
of tables repeated, arrays longer, meshes finer, recordings of more samples. Whether such a file is
read or refused, it may take 200 MB.
"""

from __future__ import annotations

import io
import math
import resource
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reliability.cuts import (
    MOST_MB,
    SCRATCH,
    each_kind,
    load_targets,
    resident_mb,
    sums,
    trouble,
)

if TYPE_CHECKING:
    from damage.target import Target

MEGABYTES = 10.0
LONGEST = 60.0  # CPU seconds for one file
MESHES = (".ply", ".stl", ".obj", ".off", ".glb", ".dae")
BYTES_A_FACE = 50  # of a binary STL; other formats take 20 to 120
LINES = {
    "long field": b'"' + b"a" * 200_000,
    "long number": b"9" * 200_000,
    "many fields": b"1," * 200_000,
    "empty lines": b"\n" * 200_000,
    "blanks": b" " * 200_000,
    "deep lists": b"[" * 200_000,
}  # in the place of a second line of small files
CHANNELS = 4326  # of a whole iCub


def measure(*, megabytes: float = MEGABYTES) -> dict[str, Any]:
    """Memory, time and what was wrong of each kind, each in a process of its own."""
    rows = each_kind(examine, megabytes)
    return {
        "megabytes": megabytes,
        # Meshes come in steps of four: what a larger file took counts by its size.
        "most_mb": max(row["more_mb"] / max(1.0, row["megabytes"] / 10.0) for row in rows.values()),
        **sums(rows),
    }


def examine(name: str, megabytes: float) -> dict[str, Any]:
    """Memory, time and faults of a large file of one kind, in this process."""
    target = load_targets()[name]
    # Compiled code that goes on past the time of `trouble` ends with its process (SIGXCPU, -24).
    used = resource.getrusage(resource.RUSAGE_SELF)
    end = math.ceil(used.ru_utime + used.ru_stime + 5.0 * LONGEST)
    resource.setrlimit(resource.RLIMIT_CPU, (end, end + 5))
    with tempfile.TemporaryDirectory(dir=SCRATCH) as scratch:
        folder = Path(scratch)
        target.lay_out(folder)
        seed = target.seeds()[0]
        target.try_one(seed, folder)  # what it imports is imported by now
        whole = grown(target, seed, round(megabytes * 1e6), folder)
        half = len(whole) // 2
        changed = bytearray(whole)
        changed[half] ^= 0x55
        more, longest, faults = 0.0, 0.0, list[str]()
        head, _, rest = seed.partition(b"\n")
        for how, data in (
            ("whole", whole),
            ("cut", whole[:half]),
            ("changed", bytes(changed)),
            # Beyond what parsers take: fields of csv, digits of whole numbers, depths of JSON.
            *((name, b"\n".join((head, line, rest))) for name, line in LINES.items()),
        ):
            base = resident_mb()
            most = MOST_MB * max(1.0, len(data) / 1e7)
            said, took, took_mb = trouble(target, data, folder, base, longest=LONGEST, most_mb=most)
            more, longest = max(more, took_mb), max(longest, took)
            faults += [f"{how}: {said}"[:200]] if said else []
    return {"megabytes": len(whole) / 1e6, "more_mb": more, "longest_s": longest, "faults": faults}


def grown(target: Target, seed: bytes, size: int, folder: Path) -> bytes:
    """A file of about `size` bytes of the kind of a small one."""
    suffix = Path(target.file).suffix
    if suffix in MESHES and b"<robot" not in seed:
        return _mesh(suffix, size)
    if suffix == ".mcap":
        return _recording(folder / "grown.mcap", size)
    if suffix == ".npy":
        array = np.load(io.BytesIO(seed))
        return _saved(np.resize(array, (1 + size // max(1, array[0].nbytes), *array.shape[1:])))
    if zipfile.is_zipfile(io.BytesIO(seed)):
        return _archive(seed, size)
    lines = seed.splitlines(keepends=True)
    middle = lines[len(lines) // 2]  # a row of a table, an entry of a list
    copies = middle * (size // len(middle) + 1)
    return b"".join([*lines[: len(lines) // 2], copies, *lines[len(lines) // 2 :]])


def _mesh(suffix: str, size: int) -> bytes:
    from trimesh import creation

    steps = max(1, round(np.log(size / BYTES_A_FACE / 20) / np.log(4)))
    made: Any = creation.icosphere(subdivisions=steps).export(file_type=suffix[1:])
    return made.encode() if isinstance(made, str) else bytes(made)


def _recording(path: Path, size: int) -> bytes:
    from skinmap.live.recording.recorder import Recorder
    from skinmap.live.sources.source import Block, StreamInfo

    rng = np.random.default_rng(0)
    recorder = Recorder(path, StreamInfo("grown", ("all",), (CHANNELS,), 50.0))
    for first in range(0, size // CHANNELS, 50):
        values = rng.integers(0, 256, (50, CHANNELS), np.uint8)
        recorder.put(Block((first + np.arange(50)) / 50.0, values, 0.0), patience=LONGEST)
    recorder.close()
    return path.read_bytes()


def _archive(seed: bytes, size: int) -> bytes:
    """Its largest array longer, all other members as they were."""
    with zipfile.ZipFile(io.BytesIO(seed)) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    largest = max(members, key=lambda name: len(members[name]))
    if largest.endswith(".npy"):
        array = np.load(io.BytesIO(members[largest]))
        rows = size // max(1, array[:1].nbytes) if array.ndim else 0
        members[largest] = _saved(np.resize(array, (rows, *array.shape[1:])))
    else:
        members[largest] += bytes(size - len(members[largest]))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as made:
        for name, content in members.items():
            made.writestr(name, content)
    return buffer.getvalue()


def _saved(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()
