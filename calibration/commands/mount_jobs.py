"""What the commands of mounts and responses share: a result, its files, its verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from calibration.patch.patch_calibration import Status
from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import median_spacing
from skinmap.report.present import emit


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


def finish(
    job: Job,
    out: Path | None,
    accept: bool,
    as_json: bool,
    lines: Callable[[dict[str, Any]], list[str]],
) -> None:
    """Write files, print the result, and exit 3 where it is not to be used."""
    from skinmap.io.output import staged_folder

    good = accept or job.result["status"] == "ok"
    files: list[str] = []
    if out is not None:
        with staged_folder(out) as stage:
            if good:
                job.write(stage)
            job.write_report(stage / ("report.html" if good else "refused.html"))
            files = sorted(path.name for path in stage.iterdir())
    result = {**job.result, "files": files}
    if as_json:
        emit(result)
    else:
        click.echo(str(result["status"]))
        for line in (*(f"  {reason}" for reason in result["reasons"]), *lines(result)):
            click.echo(line)
        for file in files:
            click.echo(str(Path(out or "") / file))
    if not good:
        raise SystemExit(3)
