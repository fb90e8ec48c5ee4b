"""What the commands of mounts and responses share: a result, its files, its verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.patch.patch_calibration import Status
from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing


@dataclass(frozen=True, eq=False, slots=True)
class Job:
    """What a command prints, and how its files are written."""

    result: dict[str, Any]
    write: Callable[[Path], None]
    write_report: Callable[[Path], None]


def verdict(judged: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The first status that was judged, ok where none was, and every reason."""
    return {
        "status": str(judged[0][0]) if judged else str(Status.OK),
        "reasons": [reason for _, reason in judged],
    }


def pitch_of(taxels: FloatArray) -> float:
    """Median spacing of the taxels that there are [m]."""
    return median_spacing(taxels[np.isfinite(taxels).all(axis=1)])


def spread(values: FloatArray) -> dict[str, float]:
    """Median, 95th percentile and maximum."""
    return {
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "max": float(values.max()),
    }
