"""Laws of what is written and read again: recordings, tables, models, profiles of work."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from calibration.response import ResponseCalibration, load_response, save_response
from skinmap.errors import DataFormatError, InvalidArrayError, UnknownNameError
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.parallel.workers import pack, unpack
from skinmap.touch.recording import Recording, save_recordings

from .law import Law, Outside

N, RATE = 12, 50.0


def values(samples: int) -> np.ndarray:
    return np.random.default_rng(samples).integers(0, 256, (samples, N)).astype(np.uint8)


def beside(use: Callable[[Path], Any]) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        return use(Path(folder))


def recorded(samples: int) -> float:
    """Values of an archive that differ once they are read."""

    def there_and_back(folder: Path) -> float:
        events = np.arange(samples) % 2 - 1
        one = Recording("a", np.arange(samples) / RATE, values(samples), events, ("poke",))
        save_recordings([one], folder / "t.npz")
        (found,) = load_recordings(folder / "t.npz")
        return float(
            (found.pressures != one.pressures).sum() + (found.times != one.times).sum()
            + (found.events != events).sum()
        )  # fmt: skip

    return float(beside(there_and_back))


def written(folder: Path, samples: int) -> Path:
    file = McapRecording(folder / "t.mcap", parts=["a"], widths={"raw": [N]}, rate=RATE)
    for row, sample in enumerate(values(samples)):
        file.add("raw", row / RATE, sample)
    file.close()
    return folder / "t.mcap"


def tracked(samples: int) -> float:
    """Values of an MCAP recording that differ once they are read."""

    def there_and_back(folder: Path) -> float:
        return float((read_track(written(folder, samples)).values[:] != values(samples)).sum())

    return float(beside(there_and_back))


def cut(share: float) -> float:
    """Samples of a recording that was cut off which are not what was written."""

    def there_and_back(folder: Path) -> float:
        path = written(folder, 2000)
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])
        found = read_track(path).values[:]
        return float((found != values(2000)[: len(found)]).sum())

    return float(beside(there_and_back))


def answered(taxels: int) -> float:
    """Pressures of a calibration that was written and read against its own."""
    rest = np.rint(60 + np.random.default_rng(0).normal(0, 1.2, (200, taxels)))
    fitted, samples = ResponseCalibration.fit(rest), rest[:5] + 40

    def there_and_back(folder: Path) -> float:
        save_response(fitted, folder / "t.npz")
        again = load_response(folder / "t.npz").apply(samples)
        return float((again != fitted.apply(samples)).sum())

    return float(beside(there_and_back))


def repacked(scale: float) -> float:
    array = scale * np.random.default_rng(0).normal(size=100)
    return float((unpack(pack(array)) != array).sum())


def damaged() -> object:
    def read(folder: Path) -> object:
        (folder / "t.npz").write_bytes(b"PK\3\4 and nothing")
        return load_recordings(folder / "t.npz")

    return beside(read)


LAWS = [
    Law("save_recordings", "size", "all values come back", recorded, 0.0, "bytes are kept",
        (1, 100, 20000),
        (Outside("a damaged file", DataFormatError, damaged),
         Outside("another suffix", UnknownNameError,
                 lambda: beside(lambda p: (p / "t.wav").touch() or load_recordings(p / "t.wav")))),
        "samples"),
    Law("McapRecording", "size", "all values come back", tracked, 0.0, "bytes are kept",
        (1, 100, 2000), unit="samples"),
    Law("read_track", "cut off", "what is read is what was written", cut, 0.0, "chunks have "
        "checksums", (0.3, 0.6, 0.9), unit="of the file left"),
    Law("save_response", "size", "the same pressures", answered, 0.0, "bytes are kept",
        (1, 12, 4326), unit="taxels"),
    Law("pack", "scale", "results come back", repacked, 0.0, "bytes are kept",
        (1e-300, 1e-6, 1.0, 1e6, 1e300),
        (Outside("an array of objects", InvalidArrayError, lambda: pack(np.array([None]))),)),
]  # fmt: skip
