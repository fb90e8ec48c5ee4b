"""Faults of the times of a recording: order, repeats, gaps, bursts, and clocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.clock_lines import UNEXPLAINED, align
from skinmap.errors import InvalidArrayError
from skinmap.soundness.finding import Finding, finding, spans_of
from skinmap.soundness.survey import Survey
from skinmap.soundness.track import UNSURE

GAP = 1.45  # steps from which two rows may have lost some between them
SLOWER = 20  # rows on end that come at another rate
JUMP = 0.7  # steps by which rows behind a gap are later than those before it
CLOSE = 0.3  # of a step: rows that came together
BURST = 3  # rows
SPREAD = 0.12  # of a step: what times of a sensor scatter by at most
AHEAD, ADDED = 8, 2.0  # rows over which independent steps add up, and to how many times one
PAUSE = 20  # rows that even a sensor without a rate lets pass by a gap only
CROWD = 10  # rows behind a step back that cannot stand between those before it by chance
SLIPS = 5000  # backward steps that are looked at one by one
HELD = 3  # rows for which a moving touch stands still only if rows are repeated
ALIKE = 0.5  # cosine between the steps before and behind a repeated row
SHARED = 0.1  # of all rows: those with the time of another
MOST = 0.5  # the same, beside bursts: there a sensor's own program gave no times
FEW_CHANGES = 6  # channels
ONE_WAY = 0.9  # of the channels that change: without noise all do so in one direction
LOADED, RARE = 4, 0.01  # channels away from rest, and the chance that none of them changes
AWAY = 3.0  # rows by which the clocks must differ somewhere
SLOW = 0.15  # seconds by which a skin of foam lags its load


@dataclass(frozen=True, slots=True)
class TimeFaults:
    """Findings, and what mending needs.

    Attributes
    ----------
    findings : list of Finding
    repeated : (t,) bool
        Rows that repeat an earlier one.
    pieces : list of (k,) int
        Rows of each stretch with one clock, in the order of the file.
    step : float
        Seconds between two rows; 0 where unknown.
    """

    findings: list[Finding]
    repeated: NDArray[np.bool_]
    pieces: list[IntArray] = field(default_factory=list)
    step: float = 0.0


def time_faults(survey: Survey) -> TimeFaults:
    """Everything that is wrong with the times of a recording."""
    track, count = survey.track, survey.count
    times = track.times
    if times is None:
        text = "The recording has no times: rate, gaps and order cannot be judged."
        found = [finding("stamps", text, do="record a time with each row")]
        repeated = _repeats(survey, None)
        return TimeFaults(found + _repeated_finding(repeated), repeated, [np.arange(count)])
    found = []
    if track.unit:
        wrong, sure = "read as seconds, the rate is wrong by 1,000 or more", 0.9
        if track.unit == UNSURE:
            wrong, sure = "the rate may be wrong by 1,000", 0.5
        text, do = f"The times are in {track.unit}: {wrong}.", "write the times in seconds"
        found.append(finding("stamps", text, confidence=sure, harm=0.3, do=do))
    repeated = _repeats(survey, times)
    found += _repeated_finding(repeated)
    # Values that repeat at times of their own leave no gap.
    rows = np.flatnonzero(~(repeated & _twins(times)))
    step = _step(times, rows, track.stretches)
    pieces, restarts = _pieces(times, rows, step, track.stretches)
    if restarts:
        text = (
            f"The clock begins anew at row {', '.join(str(a) for a, _ in restarts[:5])}: a time "
            "occurs more than once, and rows cannot be put into order by time."
        )
        found.append(finding("restart", text, rows=restarts))
    slips = [own[times[own] != np.sort(times[own])] for own in pieces]
    slipped = np.sort(np.concatenate(slips)) if slips else np.zeros(0, np.int64)
    if len(slipped):
        text = f"{len(slipped)} rows are out of order: their times run backwards."
        found.append(finding("order", text, rows=spans_of(slipped)))
    ordered = [own[np.argsort(times[own], kind="stable")] for own in pieces]
    if step > 0:
        found += _spacing(times, ordered, step)
    if not any(one.kind == "stamps" for one in found):
        bursts = any(one.kind == "burst" for one in found)
        found += _shared_stamps(times, repeated, track.stretches, MOST if bursts else SHARED)
    return TimeFaults(found, repeated, pieces, step)


def _shared_stamps(
    times: FloatArray, repeated: NDArray[np.bool_], stretches: IntArray | None, share: float
) -> list[Finding]:
    """Whether more than a share of the rows have the time of the row before."""
    same = (np.diff(times) == 0) & ~repeated[1:]
    if stretches is not None:
        same &= np.diff(stretches) == 0
    if same.mean() <= share:
        return []
    text = (
        f"{same.sum()} of {len(times)} rows have the time of the row before: the clock is too "
        "coarse, or the times lost digits, as of seconds since 1970 in four bytes."
    )
    return [finding("stamps", text, rows=spans_of(np.flatnonzero(same) + 1))]


def _step(times: FloatArray, rows: IntArray, stretches: IntArray | None) -> float:
    """The usual time between rows; the mean where most rows come together with another."""
    steps = np.diff(times[rows])
    if stretches is not None:
        steps = steps[np.diff(stretches[rows]) == 0]
    positive = steps[steps > 0]
    if len(positive) == 0:
        return 0.0
    middle = float(np.median(steps[steps >= 0]))
    usual = float(np.clip(positive, 0.0, np.percentile(positive, 99.0)).sum() / len(steps))
    return usual if middle < 0.5 * usual else middle


def _twins(times: FloatArray) -> NDArray[np.bool_]:
    """Rows with a time that an earlier row has."""
    found = np.ones(len(times), bool)
    found[np.unique(times, return_index=True)[1]] = False
    return found


def _repeats(survey: Survey, times: FloatArray | None) -> NDArray[np.bool_]:
    """Rows that repeat an earlier one: the same time and values, or values that cannot recur."""
    equal = survey.changed == 0
    repeated = np.zeros(survey.count, bool)
    values = survey.track.values
    if times is not None:
        groups = survey.track.stretches
        keys = (times,) if groups is None else (times, groups)
        order = np.lexsort((np.arange(len(times)), *keys))
        twin = np.diff(times[order]) == 0
        if groups is not None:
            twin &= np.diff(groups[order]) == 0
        first, second = order[:-1][twin], order[1:][twin]
        same = np.zeros(len(first), bool)
        for start in range(0, len(first), 10_000):
            own = slice(start, start + 10_000)
            same[own] = (values[first[own]] == values[second[own]]).all(axis=1)
        coarse = np.count_nonzero(~same & (second - first == 1))
        if coarse <= 0.1 * np.count_nonzero(same):  # times that mean something
            repeated[second[same]] = True
            repeated[survey.spikes[:, 0]] = False  # only their values held over are alike
            repeated &= ~_made_up_for(times, repeated)
    if survey.track.stretches is not None:
        equal &= np.diff(survey.track.stretches, prepend=-1) == 0
    equal &= ~repeated
    if not equal.any():
        return repeated
    moves = survey.changed[1:]
    moving = moves[moves > 0]
    usual = float(np.median(moving)) if len(moving) else 0.0
    often = usual >= (20 if equal.sum() < 3 else FEW_CHANGES)
    between = np.count_nonzero(moving < usual / 3)
    rows = np.flatnonzero(equal)
    if often and between <= 0.02 * len(moving) + 1 and not _recurs(survey, rows):
        return repeated | equal
    return repeated | _held(survey, rows) | _copies_under_load(survey, rows)


def _copies_under_load(survey: Survey, rows: IntArray) -> NDArray[np.bool_]:
    """Rows without a change between rows of which most loaded channels change: by noise.

    The pattern of a skin that is silent at rest is left alone, and so is a load that is held.
    """
    values, moves = survey.track.values, survey.changed
    some = np.unique(np.linspace(0, survey.count - 1, min(survey.count, 2000)).astype(int))
    silent = np.median(values[some], axis=0).astype(values.dtype)
    loaded = np.concatenate(
        [np.count_nonzero(values[k : k + 4096] != silent, axis=1)
         for k in range(0, survey.count, 4096)]
    )  # fmt: skip
    share = moves / np.maximum(loaded, 1)
    moving = (loaded >= LOADED) & (moves > 0)
    found = np.zeros(survey.count, bool)
    if moving.sum() < 20:
        return found
    usual = min(float(np.median(share[moving])), 0.95)
    for a, b in spans_of(rows):
        sides = moving[a - 1 : a].any() and moving[b + 1 : b + 2].any()
        if not sides or b - a >= HELD or min(share[a - 1], share[b + 1]) <= usual / 3:
            continue
        # Without noise a touch turns at its peak: all of its channels rise, stand and fall.
        step = np.sign(np.diff(values[[max(a - 2, 0), a - 1, b, b + 1]].astype(np.float64), axis=0))
        if (np.abs(step.sum(axis=1)) < ONE_WAY * np.abs(step).sum(axis=1))[[0, 2]].any():
            found[a : b + 1] = (1.0 - usual) ** loaded[a] < RARE
    # Where many rows change little, a few change nothing by chance.
    few = np.count_nonzero(share[moving] < usual / 3)
    chance = float(((1.0 - usual) ** loaded[loaded >= LOADED]).sum())
    return found & (found.sum() > max(few, 3.0 * chance, 2.0))


def _made_up_for(times: FloatArray, repeated: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows of one time behind a gap as long as they are many: a burst of a skin at rest."""
    steps = np.diff(times, prepend=times[0])
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    found = np.zeros(len(times), bool)
    for a, b in spans_of(np.flatnonzero(repeated)):
        if steps[max(a - 1, 0)] > (0.6 * (b - a + 1) + 1.0) * step:
            found[a : b + 1] = True
    return found


def _recurs(survey: Survey, rows: IntArray) -> bool:
    """Whether rows without a change come back to a pattern of before: a skin silent at rest."""
    starts = np.array([a for a, _ in spans_of(rows)])[:2000]
    patterns = np.ascontiguousarray(survey.track.values[starts])
    _, counts = np.unique(patterns, axis=0, return_counts=True)
    return bool(
        counts[counts > 1].sum() > 0.02 * len(starts)
        or max(b - a + 1 for a, b in spans_of(rows)) > 0.2 * survey.count
    )


def _held(survey: Survey, rows: IntArray) -> NDArray[np.bool_]:
    """Rows at which a touch in motion stands still and then goes on in the same direction."""
    held = np.zeros(survey.count, bool)
    values = survey.track.values
    spans = [(a, b) for a, b in spans_of(rows) if a >= 2 and b + 1 < survey.count]
    lengths = np.array([b - a + 1 for a, b in spans])
    most = HELD
    if len(lengths) > 20:
        usual = int(np.bincount(lengths).argmax())
        if (lengths == usual).mean() > 0.7:  # each row is written several times
            most = max(usual, HELD)
    short = [one for one, k in zip(spans, lengths, strict=True) if k <= most]
    kept = 0
    for a, b in short:
        if min(survey.changed[a - 1], survey.changed[b + 1]) < FEW_CHANGES:
            continue
        before = values[a - 1].astype(np.float64) - values[a - 2]
        after = values[b + 1].astype(np.float64) - values[b]
        size = float(np.linalg.norm(before) * np.linalg.norm(after))
        if size > 0 and float(before @ after) > ALIKE * size:
            held[a : b + 1] = True
            kept += 1
    return held if kept >= 2 else np.zeros(survey.count, bool)


def _repeated_finding(repeated: NDArray[np.bool_]) -> list[Finding]:
    rows = np.flatnonzero(repeated)
    if len(rows) == 0:
        return []
    share = len(rows) / len(repeated)
    text = (
        f"{len(rows)} rows ({share:.1%}) repeat an earlier row: they are not new samples, and a "
        "split by rows puts copies on both sides."
    )
    return [finding("duplicate", text, rows=spans_of(rows))]


def _pieces(
    times: FloatArray, rows: IntArray, step: float, stretches: IntArray | None
) -> tuple[list[IntArray], list[list[int]]]:
    """Rows with one clock each, and where a clock begins anew in the middle of a stretch."""
    groups = [rows] if stretches is None else [
        rows[stretches[rows] == one] for one in np.unique(stretches[rows])
    ]  # fmt: skip
    pieces: list[IntArray] = []
    restarts: list[list[int]] = []
    for own in groups:
        cuts = _restarts(times[own], step)
        bounds = [0, *cuts, len(own)]
        pieces += [own[a:b] for a, b in pairwise(bounds)]
        restarts += [[int(own[a]), int(own[b - 1])] for a, b in pairwise(bounds[1:])]
    return pieces, restarts


def _restarts(times: FloatArray, step: float) -> list[int]:
    """Rows at which a clock goes back over times that it has shown already."""
    backs = np.flatnonzero(np.diff(times) < 0) + 1
    if len(backs) == 0 or len(backs) > SLIPS or step <= 0:
        return []
    found, begin, done = [], 0, 0
    for back in backs.tolist():
        if back < done:
            continue
        top = times[begin:back].max()
        above = np.flatnonzero(times[back:] > top)
        end = back + int(above[0]) if len(above) else len(times)
        behind = times[back:end]
        low, high = behind.min(), behind.max()
        slots = (high - low) / step + 1.0
        there = np.count_nonzero((times[begin:back] >= low) & (times[begin:back] <= high))
        fills = there < 0.5 * slots  # the rows stood in a hole of those before
        before = end == len(times) and low < times[begin:back].min() - 0.5 * step
        # Rows in another order fill each other's places: no time occurs twice.
        near = np.sort(times[begin:][(times[begin:] >= low) & (times[begin:] <= high)])
        doubled = np.diff(near) < CLOSE * step
        crowded = len(behind) > CROWD and len(near) > 1.5 * slots  # halves a part of a step apart
        if len(behind) >= 3 and (before or (not fills and (doubled.mean() > 0.1 or crowded))):
            found.append(back)
            begin = done = back
        else:
            done = end
    return found


def _spacing(times: FloatArray, pieces: list[IntArray], step: float) -> list[Finding]:
    """Gaps, bursts and scattered stamps of rows that are in order."""
    gaps: list[tuple[int, int, int]] = []  # row before, row after, rows missing
    bursts: list[list[int]] = []
    scatter, scattered = [], []
    for own in pieces:
        if len(own) < 3:
            continue
        inside = np.zeros(len(own), bool)
        if _adds_up(times[own], step):  # a sensor without a rate: only a long pause is a gap
            gaps += [one for one in _gaps(times, own, inside, step) if one[2] >= PAUSE]
            continue
        steps = np.diff(times[own])
        together = np.flatnonzero(steps < CLOSE * step) + 1
        runs = [
            [a - 1, b] for a, b in spans_of(together)
            if b - a + 2 >= BURST and (a < 2 or steps[a - 2] > 1.2 * step or b - a > 4)
        ]  # fmt: skip
        for a, b in runs:
            inside[a : b + 1] = True
        bursts += [[int(own[a]), int(own[b])] for a, b in runs]
        gaps += _gaps(times, own, inside, step)
        scatter.append(_scatter(times[own], inside, step))
        scattered.append(own)
    found = []
    stamps = _stamps(np.concatenate(scatter), np.concatenate(scattered), step) if scatter else []
    if any(one.rows is None for one in stamps):  # of such times a burst is a part
        bursts, gaps = [], [one for one in gaps if one[2] >= 4]
    for first, last, rate in _slower(gaps, times, step):
        text = f"Rows {first} to {last} come at {rate:.3g} Hz, most others at {1 / step:.3g} Hz."
        stamps.append(finding("stamps", text, rows=[[first, last]], confidence=0.9))
        gaps = [one for one in gaps if not first <= one[0] < last]
    if gaps:
        lost = sum(one[2] for one in gaps)
        text = (
            f"{lost} rows are missing in {len(gaps)} gap{'s' * (len(gaps) > 1)}: motion across a "
            "gap is wrong by as much."
        )
        rows, harm = [[a, b] for a, b, _ in sorted(gaps)], 0.6 if lost > 1 else 0.4
        found.append(finding("lost", text, rows=rows, harm=harm))
    if bursts:
        several = sum(b - a + 1 for a, b in bursts)
        text = (
            f"{several} rows came in {len(bursts)} burst{'s' * (len(bursts) > 1)}: their times are "
            "those of their arrival, and speeds in them are wrong."
        )
        found.append(finding("burst", text, rows=sorted(bursts)))
    return found + stamps


def _slower(
    gaps: list[tuple[int, int, int]], times: FloatArray, step: float
) -> list[tuple[int, int, float]]:
    """Rows (first, last) that come evenly at a lower rate [Hz], no whole part of the usual one."""
    begins = np.array(sorted(one[0] for one in gaps), np.int64)
    found = []
    for a, b in spans_of(begins):
        steps = np.diff(times[a : b + 2]) / step
        middle = float(np.median(steps))
        even = np.abs(steps - middle).mean() < 0.1 * middle
        if b - a >= SLOWER and even and abs(middle - round(middle)) > 0.1:
            found.append((int(a), int(b + 1), 1.0 / (middle * step)))
    return found


def _gaps(
    times: FloatArray, own: IntArray, inside: NDArray[np.bool_], step: float
) -> list[tuple[int, int, int]]:
    """Gaps (row before, row after, rows missing) that no shorter step makes up for."""
    calm = np.flatnonzero(~inside)
    if len(calm) < 3:
        return []
    late = times[own[calm]] - step * calm
    steps = np.diff(times[own[calm]]) - step * np.diff(calm)
    spread = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))
    found = []
    for at in np.flatnonzero(steps > (GAP - 1.0) * step).tolist():
        jump = float(np.median(late[at + 1 : at + 6]) - np.median(late[max(at - 4, 0) : at + 1]))
        if jump > max(JUMP * step, 2.5 * spread):
            before, after = own[calm[at : at + 2]].tolist()
            found.append((before, after, max(round(jump / step), 1)))
    return found


def _adds_up(times: FloatArray, step: float) -> bool:
    """Whether rows come at steps of any length: their deviations add up from row to row.

    Those of a writer do not: a row that came late leaves the next one as it was. Steps of whole
    numbers of the usual one are of lost rows.
    """
    steps = np.diff(times) / step
    if len(steps) < 24 * AHEAD or np.median(np.abs(steps - np.rint(steps))) < 0.8 * SPREAD:
        return False
    near, far = (
        float(np.median(np.abs(times[2 * k :] - 2.0 * times[k:-k] + times[: -2 * k])))
        for k in (1, AHEAD)
    )
    return far > ADDED * near


def _scatter(times: FloatArray, inside: NDArray[np.bool_], step: float) -> FloatArray:
    """How far each row's time lies from a running line through its neighbours [steps]."""
    if len(times) < 8:
        return np.zeros(len(times))
    bend = times[2:] - 2.0 * times[1:-1] + times[:-2]
    # A second difference of independent errors of s has a standard deviation of sqrt(6) s.
    found = np.concatenate([[0.0], bend, [0.0]]) / (np.sqrt(6.0) * step)
    near = inside | np.roll(inside, 1) | np.roll(inside, -1)
    return np.where(near | (np.abs(found) > 3.0), 0.0, found)


def _stamps(off: FloatArray, rows: IntArray, step: float) -> list[Finding]:
    """Rows whose times scatter as a writer's do."""
    cell = int(np.clip(len(off) // 20, 10, 200))
    cells = len(off) // cell
    if cells == 0:
        return []
    spread = np.sqrt((off[: cells * cell].reshape(cells, cell) ** 2).mean(axis=1))
    wild = spread > SPREAD
    if wild.mean() < 0.1 or wild.sum() < 2:
        return []
    share = float(np.median(spread[wild]))
    spans = [
        [rows[a * cell], rows[min((b + 1) * cell, len(rows)) - 1]]
        for a, b in spans_of(np.flatnonzero(wild))
    ]
    text = (
        f"The times scatter by {share:.0%} of a step of {step * 1e3:.3g} ms: they are when a "
        "program wrote the rows, not when the sensor measured them."
    )
    some = spans if wild.mean() < 0.8 else None
    return [finding("stamps", text, rows=some, confidence=0.9)]


def clock_faults(survey: Survey, step: float) -> list[Finding]:
    """The line of lag between a reference and the skin, or that none fits."""
    reference = survey.track.reference
    if reference is None:
        return []
    known = np.flatnonzero(np.isfinite(reference))
    if len(known) < 2:
        return []
    begin = int(known[0])
    reference = np.interp(np.arange(begin, known[-1] + 1), known, reference[known])
    factor, own = _own_rows(survey, reference, step)
    values, rate = survey.track.values, 1.0 / step if step > 0 else 50.0
    if values.dtype.kind == "f":  # whole numbers need no copy
        values = np.nan_to_num(values)
    try:
        lines = align(values, own, rate=rate, expected=begin * factor)
    except InvalidArrayError:
        return []
    first = lines[0]
    if first.unexplained > UNEXPLAINED:
        text = "The reference fits no part of the skin: it may belong to another recording."
        return [finding("clocks", text, confidence=0.5, harm=0.2)]
    # From rows at the skin's rate back to rows of the reference as it was recorded.
    slope = (1.0 + first.slope) * factor - 1.0
    offset = first.offset_rows - begin * (1.0 + slope)
    ends = offset + slope * begin, offset + slope * (begin + len(reference) - 1)
    away = max(AWAY, 2.0 * first.residual_rows)
    lags = abs(ends[1] - ends[0]) < away and min(ends) > 0.0 and max(ends) < SLOW * rate
    if len(lines) == 1 and (lags or max(abs(ends[0]), abs(ends[1])) < away):
        return []
    breaks = [one.first_row for one in lines[1:]]
    more = f"; rows are lost near reference rows {', '.join(map(str, breaks))}" if breaks else ""
    text = (
        f"The reference runs on another clock: skin row = {offset:.1f} + {1.0 + slope:.5f} x "
        f"reference row (residual {first.residual_rows:.1f} rows). The offset is "
        f"{ends[0]:.0f} rows at the beginning and {ends[1]:.0f} at the end{more}."
    )
    return [
        finding(
            "clocks", text, confidence=float(np.clip(1.0 - first.unexplained, 0.5, 0.99)),
            offset_rows=float(offset), slope=float(slope),
            residual_rows=float(first.residual_rows),
        )
    ]  # fmt: skip


def _own_rows(survey: Survey, reference: FloatArray, step: float) -> tuple[float, FloatArray]:
    """The rows of the skin in one of the reference, and the reference at the skin's rate.

    Without times of its own it has the skin's nominal rate.
    """
    stamps = survey.track.reference_times
    own = 0.0 if stamps is None or len(stamps) < 2 else float(np.median(np.diff(stamps)))
    if step <= 0 or own <= 0 or abs(own / step - 1.0) < 0.03:
        return 1.0, reference
    rows = np.arange(int(len(reference) * own / step)) * step / own
    return own / step, np.interp(rows, np.arange(len(reference)), reference)
