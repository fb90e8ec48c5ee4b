"""Laws of live samples and of taxel tables."""

from __future__ import annotations

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError
from skinmap.io.taxels.taxel_table import COLUMNS, read_csv
from skinmap.live.response.sample_checks import SampleChecks
from skinmap.live.sources.source import Block, Counts, StreamInfo

from .law import Law, Outside
from .shapes import lattice, normals

INFO = StreamInfo("laws", ("p",), (8,), 50.0)


def passed(times: np.ndarray, values: np.ndarray | None = None) -> tuple[Counts, int]:
    """Counts after one block, and how many of its values are finite and in range."""
    counts = Counts()
    values = np.zeros((len(times), 8)) if values is None else values
    block = Block(np.asarray(times, float), values, time.perf_counter())
    runs = [v for _, _, v in SampleChecks(INFO, counts, seekable=False).look(block)]
    good = sum(int(((v >= 0) & (v <= 255)).all(axis=1).sum()) for v in runs)
    return counts, good


def burst(size: int) -> float:
    """Samples of one block that are not used."""
    return float(size - passed(np.arange(size) / 50.0)[1])


def gap(missing: int) -> float:
    """Missing samples that are not counted as lost."""
    times = np.concatenate([np.arange(5), 5 + missing + np.arange(5)]) / 50.0
    return float(abs(passed(times)[0].lost - missing))


def mended(value: str) -> float:
    """Samples whose values are not in the range of counts after they were looked at.

    What lies far beyond it is warned of, and nothing else.
    """
    values = np.full((6, 8), 50.0)
    values[2:4, 3] = float(value)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        good = passed(np.arange(6) / 50.0, values)[1]
    far = 510.0 < float(value) < float("inf")
    return float(6 - good) + float(far != (len(told) == 1))


def narrow() -> str:
    counts, _ = passed(np.arange(3) / 50.0, np.zeros((3, 7)))
    return f"{counts.short} counted as short"


def table(scale: float, rows: int = 144, drop: str = "") -> Path:
    lines = [",".join(COLUMNS)]
    for row, (place, normal) in enumerate(zip(lattice(), normals(), strict=True)):
        numbers = ",".join(repr(float(v)) for v in (*(scale * place), *normal))
        lines.append(f"{row},{row // 12},{numbers}")
    folder = Path(tempfile.mkdtemp())
    (folder / "t.csv").write_text("\n".join(lines[: rows + 1]) + drop + "\n")
    return folder / "t.csv"


def read_off(scale: float) -> float:
    return float(np.abs(read_csv(table(scale)).positions - scale * lattice()).max())


LAWS = [
    Law(
        "SampleChecks",
        "size",
        "all samples of a burst are used",
        burst,
        0.0,
        "counted",
        (1, 100, 20000),
        unit="samples in a block",
    ),
    Law(
        "SampleChecks",
        "gaps",
        "lost samples are counted",
        gap,
        0.0,
        "counted",
        (0, 1, 5, 400),
        unit="samples",
    ),
    Law(
        "SampleChecks",
        "input",
        "wild values are replaced or cut off, and counted",
        mended,
        0.0,
        "counted",
        ("nan", "inf", "-inf", "1e300", "-5"),
        (Outside("7 of 8 channels", "3 counted as short", narrow),),
    ),
    Law(
        "read_csv",
        "scale",
        "places come back to the bit",
        read_off,
        0.0,
        "full digits are written",
        (1e-6, 1.0, 1e6),
        (
            Outside(
                "a word", DataFormatError, lambda: read_csv(table(1.0, drop="\nx,1,2,3,4,0,0,1"))
            ),
            Outside(
                "1e999",
                DataFormatError,
                lambda: read_csv(table(1.0, drop="\n900,9,1e999,3,4,0,0,1")),
                "finite",
            ),
            Outside("no taxel", DataFormatError, lambda: read_csv(table(1.0, rows=0))),
        ),
    ),
]
