"""`skinmap calibrate response`: baseline, noise, threshold, gain and health of each channel."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.options import FILE, accept_option
from calibration.commands.results import Calibrated, Spread, judged
from skinmap.commands.options import Number, open_robot, out_folder, prints
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.errors import SkinMismatchError
from skinmap.report.present import present

if TYPE_CHECKING:
    from calibration.response.response import ResponseCalibration

MAX_UNFIT = 0.05  # share of channels that may be unfit in a skin that works
MAX_NAMED = 40  # unfit channels that a report names


@dataclass(frozen=True, kw_only=True, slots=True)
class ResponseResult(Calibrated):
    """How the channels of a skin answer.

    Attributes
    ----------
    status
        `ok`, or `faulty` where too many channels are unfit.
    channels
        How many.
    health
        Channels by state.
    unfit
        Channels that are not to be used.
    baseline
        At rest [counts].
    noise
        At rest [counts].
    threshold
        Deviation that is a touch [counts].
    gain
        Whether load curves were found.
    fingerprint
        Of the skin; empty without `--part`.
    seconds
        CPU time of the solution.
    files
        Inside `--out`.
    """

    channels: int
    health: dict[str, int]
    unfit: list[int]
    baseline: Spread
    noise: Spread
    threshold: Spread
    gain: bool
    fingerprint: str
    seconds: float
    files: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True, slots=True)
class ResponseOptions:
    """What was measured, and how.

    Attributes
    ----------
    rest : Path
        Samples untouched.
    reference : Path or None
        Samples under known loads.
    sign : int
        -1 where harder presses read lower.
    rate : float
        Samples a second.
    robot : str
    part : str or None
    """

    rest: Path
    reference: Path | None
    sign: int
    rate: float
    robot: str
    part: str | None


@click.command("response")
@click.argument("rest", type=FILE)
@click.option("--reference", type=FILE, help="Samples under known loads: .npz `samples, loads`.")
@click.option("--sign", type=click.Choice(["1", "-1"]), default="1", show_default=True,
              help="-1 where harder presses read lower.")  # fmt: skip
@click.option("--rate", type=Number(0.0, 10_000.0, min_open=True), default=50.0,
              show_default=True, help="Samples a second.")  # fmt: skip
@click.option(
    "--robot", default="icub", show_default=True, metavar="ROBOT", help="Robot of --part."
)
@click.option("--part", metavar="PART",
              help="Only this part of the robot: the result remembers its skin.")  # fmt: skip
@out_folder("response.npz and the report")
@accept_option()
@profile_option()
@prints(ResponseResult)
def response(sign: str, out: Path | None, accept: bool, as_json: bool, **given: Any) -> None:
    """Baseline, noise, threshold, gain and health of each channel.

    REST holds five to ten seconds untouched: .npy or .csv (t, n), or .npz with `samples (t, n)` and
    perhaps `modules (n,)` and `thermal (n,)` (channels that feel temperature only).

    \b
    Example:  skinmap calibrate response rest.npy --reference loads.npz -o out
    """
    options = ResponseOptions(sign=int(sign), **given)
    with progress(1, "calibrate") as advance:
        advance("response")
        result, found = work(options)
    present(
        result,
        _lines,
        as_json=as_json,
        out=out,
        write=lambda folder: _write(found, folder),
        page=lambda _: _page(options.rest.stem, found, result),
        verdict=result.verdict(accept=accept),
    )


def work(options: ResponseOptions) -> tuple[ResponseResult, ResponseCalibration]:
    """Learn the response of a skin, and judge its channels."""
    import numpy as np

    from calibration.files.mount_files import read_samples
    from calibration.response.gain import ReferenceLoads
    from calibration.response.response import Health, ResponseCalibration

    arrays = read_samples(options.rest)
    loads = None
    if options.reference is not None:
        given = read_samples(options.reference, ("samples", "loads"))
        loads = ReferenceLoads(given["samples"], given["loads"])
    modules, fingerprint = arrays.get("modules"), ""
    if options.part is not None:
        modules, fingerprint = _skin_of(options, np.shape(arrays["samples"])[-1])
    start = time.process_time()
    found = ResponseCalibration.fit(
        arrays["samples"], loads, sign=options.sign, rate=options.rate, modules=modules,
        thermal=arrays.get("thermal"), fingerprint=fingerprint,
    )  # fmt: skip
    seconds = time.process_time() - start
    health = {str(state): int((found.health == state).sum()) for state in Health}
    bad = [state for state in Health if state not in (Health.OK, Health.NEVER_TOUCHED)]
    unfit = np.isin(found.health, bad)
    reasons = []
    if unfit.mean() > MAX_UNFIT:
        words = ", ".join(f"{health[state]} {state}" for state in bad if health[state])
        reasons = [f"{int(unfit.sum())} of {len(found)} channels are unfit: {words}"]
    result = ResponseResult(
        status="faulty" if reasons else "ok",
        reasons=reasons,
        channels=len(found),
        health=health,
        unfit=np.flatnonzero(unfit).tolist(),
        baseline=Spread.of(found.baseline),
        noise=Spread.of(found.noise),
        threshold=Spread.of(found.threshold),
        gain=found.gain is not None,
        fingerprint=fingerprint,
        seconds=seconds,
    )
    return result, found


def _skin_of(options: ResponseOptions, count: int) -> tuple[Any, str]:
    """Modules and fingerprint of a part with as many taxels as there are channels."""
    from skinmap.skin.fingerprint import fingerprint

    part = str(options.part)
    loaded, _ = open_robot(options.robot, (part,))
    skin = loaded.skin(part)
    if len(skin) != count:
        raise SkinMismatchError(f"{part!r} has {len(skin)} taxels, the samples {count} channels")
    return skin.modules, fingerprint(skin)


def _write(found: ResponseCalibration, folder: Path) -> list[str]:
    from calibration.response.response_file import save_response

    save_response(found, folder / "response.npz")
    return ["response.npz"]


def _page(name: str, found: ResponseCalibration, result: ResponseResult) -> str:
    from calibration.commands.pages import judged_page, response_picture

    rows = [
        ("channels", str(result.channels)),
        *((state, str(count)) for state, count in result.health.items()),
        ("baseline, median", f"{result.baseline.median:.1f} counts"),
        ("noise, median", f"{result.noise.median:.2f} counts"),
        ("threshold, median", f"{result.threshold.median:.2f} counts"),
        ("unfit channels", ", ".join(map(str, result.unfit[:MAX_NAMED])) or "none"),
    ]
    words = "At rest. A channel is never touched until a load proves it well or dead."
    pictures = [("Channels", response_picture(found), words)]
    return judged_page(f"Response: {name}", result.verdict(accept=False), rows, pictures)


def _lines(result: ResponseResult) -> Iterator[str]:
    yield from judged(result)
    states = ", ".join(f"{count} {state}" for state, count in result.health.items() if count)
    yield f"{result.channels} channels: {states}"
