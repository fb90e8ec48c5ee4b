"""`skinmap calibrate response`: what it finds, judges, prints and writes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.commands.mount_jobs import Job, spread, verdict
from calibration.commands.mount_report import response_picture, write_report
from calibration.files.mount_files import (
    read_samples,
)
from calibration.response.gain import ReferenceLoads
from calibration.response.response import Health, ResponseCalibration
from calibration.response.response_file import save_response
from skinmap.errors import SkinMismatchError

if TYPE_CHECKING:
    from skinmap.skin.skin import Skin

MAX_UNFIT = 0.05  # share of channels that may be unfit in a skin that works
UNFIT = (Health.DEAD, Health.STUCK, Health.SATURATED, Health.NOISY)


def response_job(
    rest: Path, reference: Path | None, *, sign: int, rate: float, robot: str, part: str | None
) -> Job:
    """Learn the response of a skin."""
    arrays = read_samples(rest)
    loads = None
    if reference is not None:
        given = read_samples(reference, ("samples", "loads"))
        loads = ReferenceLoads(given["samples"], given["loads"])
    modules, fingerprint = arrays.get("modules"), ""
    if part is not None:
        modules, fingerprint = _skin_of(robot, part, np.shape(arrays["samples"])[-1])
    start = time.process_time()
    found = ResponseCalibration.fit(
        arrays["samples"],
        loads,
        sign=sign,
        rate=rate,
        modules=modules,
        thermal=arrays.get("thermal"),
        fingerprint=fingerprint,
    )
    seconds = time.process_time() - start
    health = {str(state): int((found.health == state).sum()) for state in Health}
    unfit = np.isin(found.health, UNFIT)
    judged: list[tuple[str, str]] = []
    if unfit.mean() > MAX_UNFIT:
        words = ", ".join(f"{health[state]} {state}" for state in UNFIT if health[state])
        judged.append(("faulty", f"{int(unfit.sum())} of {len(found)} channels are unfit: {words}"))
    result = {
        **verdict(judged),
        "channels": len(found),
        "health": health,
        "unfit": np.flatnonzero(unfit),
        "baseline": spread(found.baseline),
        "noise": spread(found.noise),
        "threshold": spread(found.threshold),
        "gain": found.gain is not None,
        "fingerprint": fingerprint,
        "seconds": seconds,
    }

    def write(stage: Path) -> None:
        save_response(found, stage / "response.npz")

    def report(path: Path) -> None:
        rows = [
            ("channels", str(len(found))),
            *((state, str(count)) for state, count in health.items()),
            ("baseline, median", f"{np.median(found.baseline):.1f} counts"),
            ("noise, median", f"{np.median(found.noise):.2f} counts"),
            ("threshold, median", f"{np.median(found.threshold):.2f} counts"),
            ("unfit channels", ", ".join(map(str, np.flatnonzero(unfit)[:40])) or "none"),
        ]
        words = "At rest. A channel is never touched until a load proves it well or dead."
        pictures = [("Channels", response_picture(found), words)]
        write_report(f"Response: {rest.stem}", result, rows, pictures, path)

    return Job(result, write, report)


def _skin_of(robot: str, part: str, count: int) -> tuple[Any, str]:
    """Modules and fingerprint of a part with as many taxels as there are channels."""
    from skinmap.commands.options import open_robot
    from skinmap.skin.fingerprint import fingerprint

    loaded, _ = open_robot(robot, (part,))
    skin: Skin = loaded.skin(part)
    if len(skin) != count:
        raise SkinMismatchError(f"{part!r} has {len(skin)} taxels, the samples {count} channels")
    return skin.modules, fingerprint(skin)


def response_lines(result: dict[str, Any]) -> list[str]:
    """A few lines for people."""
    states = ", ".join(f"{count} {state}" for state, count in result["health"].items() if count)
    return [f"{result['channels']} channels: {states}"]
