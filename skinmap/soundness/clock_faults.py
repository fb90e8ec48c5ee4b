"""A reference that runs on another clock than the skin."""

from __future__ import annotations

import numpy as np

from skinmap.clock_lines import UNEXPLAINED, align
from skinmap.errors import InvalidArrayError
from skinmap.soundness.finding import Finding, finding
from skinmap.soundness.survey import Survey

AWAY = 3.0  # rows by which the clocks must differ somewhere


def clock_faults(survey: Survey, step: float) -> list[Finding]:
    """The line of lag between a reference and the skin, or that none fits."""
    reference = survey.track.reference
    if reference is None:
        return []
    rate = 1.0 / step if step > 0 else 50.0
    known = np.flatnonzero(np.isfinite(reference))
    if len(known) < 2:
        return []
    begin = int(known[0])
    reference = np.interp(np.arange(begin, known[-1] + 1), known, reference[known])
    at, own = _own_rows(survey, reference, step)
    values = survey.track.values
    if values.dtype.kind == "f":
        values = np.nan_to_num(values)
    try:
        lines = align(values, own, rate=rate)
    except InvalidArrayError:
        return []
    first = lines[0]
    if first.unexplained > UNEXPLAINED:
        text = "The reference fits no part of the skin: it may belong to another recording."
        return [finding("clocks", text, confidence=0.5, harm=0.2)]
    # From rows at the skin's rate back to rows of the reference as it was recorded.
    offset = first.offset_rows + (1.0 + first.slope) * at[0]
    slope = (1.0 + first.slope) * at[1] - 1.0
    offset -= begin * (1.0 + slope)
    ends = offset + slope * begin, offset + slope * (begin + len(reference) - 1)
    if len(lines) == 1 and max(abs(ends[0]), abs(ends[1])) < max(AWAY, 2.0 * first.residual_rows):
        return []
    breaks = [one.first_row for one in lines[1:]]
    more = f"; rows are lost near reference rows {', '.join(map(str, breaks))}" if breaks else ""
    text = (
        f"The reference runs on another clock: it lags the skin by {ends[0]:.0f} rows at its begin "
        f"and {ends[1]:.0f} at its end{more}."
    )
    return [
        finding(
            "clocks", text, confidence=float(np.clip(1.0 - first.unexplained, 0.5, 0.99)),
            offset_rows=float(offset), slope=float(slope),
            residual_rows=float(first.residual_rows),
        )
    ]  # fmt: skip


def _own_rows(
    survey: Survey, reference: np.ndarray, step: float
) -> tuple[tuple[float, float], np.ndarray]:
    """The reference at the skin's rate, and the line (offset, factor) from its rows to those.

    Without times of its own it has the skin's nominal rate.
    """
    stamps = survey.track.reference_times
    if stamps is None or step <= 0 or len(stamps) < 2:
        return (0.0, 1.0), reference
    own = float(np.median(np.diff(stamps)))
    if own <= 0 or abs(own / step - 1.0) < 0.03:
        return (0.0, 1.0), reference
    count = int(len(reference) * own / step)
    return (0.0, own / step), np.interp(
        np.arange(count) * step / own, np.arange(len(reference)), reference
    )
