"""`skinmap evaluate --protocol load MODEL RECORDING...`: pressures beside those of a chamber."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.cli.evaluate.command import Evaluation, Own, Rows, Settings, write_predictions
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError
from skinmap.recognition.protocols.results import LoadRow, LoadsResult
from skinmap.report.table import Table
from skinmap.rows import percent
from skinmap.touch.load_calibration import LoadCalibration, Zero

if TYPE_CHECKING:
    from skinmap.io.recordings.load_evidence import EvenRows

CALENDAR = 1e9  # times above it are seconds since 1970
ROWS = 4000  # judged at once


class ZeroSetting(Own):
    """Where the zero of a recording comes from."""

    zero: Zero = "auto"


def work(settings: Settings) -> LoadsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A file that is missing, damaged, of another number of taxels or without samples.
    """
    from skinmap.io.recordings.load_evidence import read_evidence

    model, *recordings = settings.recordings
    calibration = LoadCalibration.read(model)
    zero: Zero = settings.own.zero
    rows, written = [], []
    with progress(len(recordings), "load") as advance:
        for path in recordings:
            one = read_evidence(path, needed=False)
            even = one.on_even_rows()
            found = calibration.pressures(even.evidence.samples, even.evidence.times, zero=zero)
            if even.evidence is not one:  # one row for each sample
                found = found[0][even.rows], found[1][even.rows], found[2][even.rows]
            rows.append(_row(calibration, even, found, zero))
            if settings.predictions is not None:
                written.append((one.times, *found))
            advance(path.name)
    if settings.predictions is not None:
        names = ("times", "pressure_bar", "low", "high")
        arrays = {
            name: np.concatenate(each)
            for name, each in zip(names, zip(*written, strict=True), strict=True)
        }
        arrays["recording"] = np.repeat(np.arange(len(written)), [len(one[0]) for one in written])
        write_predictions(settings.predictions, arrays)
    return LoadsResult(
        robot=f"skin of {len(calibration)} taxels",
        model=calibration.model,
        taxels=len(calibration),
        calibrated=int(calibration.answered.sum()),
        rows=rows,
    )


def _row(
    calibration: LoadCalibration,
    even: EvenRows,
    found: tuple[FloatArray, FloatArray, FloatArray],
    zero: Zero,
) -> LoadRow:
    (values, low, high), one = found, even.evidence
    answered = np.isfinite(values)
    zeroed = calibration.session(calibration.cooled(one.samples), one.rate, zero=zero).zeroed
    start = float(one.times[0])
    age = 0.0 if zeroed else (start - calibration.zeroed if start > CALENDAR else None)
    width = float(np.nanmean(high - low)) if answered.any() else None
    rms, holds, unexplained, reason = _beside(even, found)
    return LoadRow(
        recording=one.name,
        rms_bar=rms,
        holds=holds,
        width_bar=width,
        refused=float(1.0 - answered.mean()),
        answered=int(answered.any(axis=0).sum()),
        zeroed=zeroed,
        zero_age_seconds=age,
        unexplained=unexplained,
        reason=reason,
    )


def _beside(
    even: EvenRows, found: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[float | None, float | None, float | None, str]:
    """Error, share of intervals that hold, what alignment leaves open, and why there are none."""
    from skinmap.clock_lines import UNEXPLAINED, align, reference_at

    one = even.evidence
    if not one.kind:
        return None, None, None, ""
    reference = one.on_nominal_rows()
    try:
        lines = align(one.samples, reference, rate=one.rate)
    except InvalidArrayError as error:
        return None, None, None, str(error)
    left = lines[0].unexplained
    if left > UNEXPLAINED:
        words = f"at the best lag {percent(left)} % of its reference are not explained"
        return None, None, left, f"{words} by the samples"
    wanted = reference_at(lines, reference, len(one.samples))[even.rows]
    squares, counts, inside = 0.0, 0, 0
    for start in range(0, len(wanted), ROWS):
        values, low, high = (each[start : start + ROWS] for each in found)
        true = wanted[start : start + ROWS, None]
        good = np.isfinite(values) & np.isfinite(true)
        squares = squares + np.where(good, (values - true) ** 2, 0.0).sum(axis=0)
        counts = counts + good.sum(axis=0)
        load = np.maximum(true, 0.0)  # a reference's noise at rest is no load below 0
        inside += int((good & (low <= load) & (load <= high)).sum())
    own = np.asarray(counts) > 0
    if not own.any():
        return None, None, left, "no taxel answers beside its reference"
    rms = np.sqrt(np.asarray(squares)[own] / np.asarray(counts)[own])
    return float(rms.mean()), inside / int(np.sum(counts)), left, ""


def lines(result: LoadsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {result.calibrated} of them calibrated (model {result.model}); answers "
        "come from the samples and the calibration alone"
    )

    def words(value: float | None) -> str:
        return "none" if value is None else f"{value:.3f}"

    rows: Rows = [
        [
            row.recording, words(row.rms_bar), percent(row.holds), words(row.width_bar),
            percent(row.refused), row.answered,
            _zero_words(row),
        ]
        for row in result.rows
    ]  # fmt: skip
    heads = ["recording", "error [bar]", "inside 90 % [%]", "width [bar]", "refused [%]"]
    yield Table([*heads, "taxels that answer", "zero"], rows)
    for row in result.rows:
        if row.reason:
            yield f"{row.recording}: not judged: {row.reason}"


def _zero_words(row: LoadRow) -> str:
    if row.zeroed or row.zero_age_seconds is None:
        return "its own" if row.zeroed else "the calibration's"
    return f"the calibration's, {row.zero_age_seconds / 3600.0:.1f} h old"


EVALUATIONS = {"load": Evaluation(work, lines, ZeroSetting)}
