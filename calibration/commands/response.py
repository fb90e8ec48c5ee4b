"""`skinmap calibrate response`: baseline, noise, threshold, gain and health of each channel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.calibration_options import FILE, Outputs, outputs, skin_of, skin_options
from calibration.commands.results import Calibrated
from skinmap.commands.options import prints
from skinmap.rows import percent
from skinmap.summary import first_few

if TYPE_CHECKING:
    from calibration.response.response import ResponseCalibration

MAX_UNFIT = 0.05  # share of channels that may be unfit in a skin that works
MAX_NAMED = 40  # unfit channels that a report names


@dataclass(frozen=True, kw_only=True, slots=True)
class ResponseResult(Calibrated):
    """Response of the channels of a skin.

    Attributes
    ----------
    status
        `ok`, or `faulty` where too many channels are unfit.
    channels
        Total number of channels.
    health
        Numbers of channels by state.
    unfit
        Channels that are not to be used.
    restless
        Channels that jump at rest: their thresholds are from their median noise.
    gain
        Whether load curves were found.
    explained
        Share of the answers under load that the curves explain, median of the taxels that answer;
        null without any.
    rate
        Samples a second at which drift is followed.
    fingerprint
        Of the skin; empty without `--part`.
    """

    channels: int
    health: dict[str, int]
    unfit: list[int]
    restless: list[int]
    gain: bool
    explained: float | None
    rate: float
    fingerprint: str


@click.command("response")
@click.argument("rest", type=FILE)
@click.option("--reference", type=FILE, help="Samples and known loads (t, n) of the same moments: "
              ".npz `samples, loads`. Pressures get the unit of the loads.")  # fmt: skip
@skin_options
@outputs("response.npz and the report")
@prints(ResponseResult)
def response(output: Outputs, **given: Any) -> None:
    """Baseline, noise, threshold, gain and health of each channel.

    REST holds five to ten seconds untouched: .npy or .csv (t, n), or .npz with `samples (t, n)` and
    perhaps `rate` (samples a second, else 50) or `times (t,)`, `sign` (-1 where harder presses read
    lower), `modules (n,)` and `thermal (n,)` (channels that feel temperature only).

    \b
    Example:  skinmap calibrate response rest.npy --reference loads.npz -o out
    """
    page = partial(_page, given["rest"].stem)
    output.of("response", partial(work, **given), _lines, _write, page)


def work(
    *, rest: Path, reference: Path | None, robot: str, part: str | None
) -> tuple[ResponseResult, ResponseCalibration]:
    """Learn the response of a skin, and judge its channels."""
    import numpy as np

    from calibration.files.mount_files import rate_of, read_samples, sign_of
    from calibration.response.gain import ReferenceLoads, explained
    from calibration.response.response import RATE, Health, ResponseCalibration, restless

    arrays = read_samples(rest)
    samples = np.asarray(arrays["samples"], np.float64)
    loads = None
    if reference is not None:
        given = read_samples(reference, ("samples", "loads"))
        loads = ReferenceLoads(given["samples"], given["loads"])
    skin, marks = skin_of(robot, part, np.shape(arrays["samples"])[-1])
    found = ResponseCalibration.fit(
        samples,
        loads,
        sign=sign_of(arrays, rest),
        rate=rate_of(arrays, rest) or RATE,
        modules=arrays.get("modules") if skin is None else skin.modules,
        thermal=arrays.get("thermal"),
        fingerprint=marks,
    )
    health = {str(state): int((found.health == state).sum()) for state in Health}
    bad = [state for state in Health if state not in (Health.OK, Health.NEVER_TOUCHED)]
    unfit = np.isin(found.health, bad)
    share = None
    if loads is not None and found.gain is not None and (found.health == Health.OK).any():
        each = explained(found.gain, loads, found.baseline, found.sign)
        share = float(np.nanmedian(each[found.health == Health.OK]))
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
        restless=np.flatnonzero(restless(samples, found.baseline, found.noise)).tolist(),
        gain=found.gain is not None,
        explained=share,
        rate=found.rate,
        fingerprint=marks,
    )
    return result, found


def _write(found: ResponseCalibration, folder: Path) -> list[str]:
    from calibration.response.response import save_response

    save_response(found, folder / "response.npz")
    return ["response.npz"]


def _page(name: str, found: ResponseCalibration, result: ResponseResult) -> str:
    from calibration.commands.pages import judged_page, response_picture

    words = "At rest. A channel is never touched until a load proves it well or dead."
    pictures = [("Channels", response_picture(found), words)]
    return judged_page(f"Response: {name}", result, _lines(result), pictures)


def _lines(result: ResponseResult) -> Iterator[str]:
    states = ", ".join(f"{count} {state}" for state, count in result.health.items() if count)
    yield f"{result.channels} channels: {states}"
    yield f"unfit: {first_few(result.unfit, MAX_NAMED) or 'none'}"
    if result.restless:
        named = first_few(result.restless, MAX_NAMED)
        yield f"touched at rest, or with bursts of noise: {named}; record rest again"
    if result.explained is not None:
        yield f"curves explain {percent(result.explained)} % of the answers under load"
