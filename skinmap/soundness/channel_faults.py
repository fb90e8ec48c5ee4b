"""Faults of channels: dead, stuck, noisy, clipped, coarse, copied, turned, or of no taxel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.soundness.finding import Finding, Kind, finding, named, spans_of, subject
from skinmap.soundness.survey import SIGMA_OF_SECOND, Survey

CUT, FAR = 0.89, 1.5  # confidence in one at the least value of a type, up to so many times as many
SURE = 16.0  # changes that a stretch without any should have had
MODULE, DEAD_MODULE = 3, 6  # channels that hang together for a while, or always
TOGETHER = 0.8  # share of their rows in which channels that hang together both stand still
MANY = 20  # findings of the same kind, or pairs of channels
SAME = 0.3  # steps between two means of the same level
HELD = 0.9  # confidence in a channel that stands still under load
SILENT = 0.2  # share of the rows of a channel at the floor of the skin: silent at rest
NOISY = 4.0  # times the noise of the others
KINDS = 6  # values that a channel must take before its step is judged
COARSE = 2.9  # times the step of the others
WIDE, OFTEN = 8.0, 5.0  # the same, and rows at each value, where rounding hides even steps
FULL_SCALES = {2**bits - 1 for bits in (8, 10, 12, 14, 16)}
FULL, SEVERAL = 0.25, 0.05  # shares of touches, and of channels, at full scale: fewer are usual
OUTLIER = 4.0  # deviations of noise that a step at rest counts for at most
STANDS = {3.0: 5.0, 100.0: 2.5}  # noise [steps]: rows at one value that are more than chance
COPY, RAW = 0.97, 0.9  # correlation of noise without the common part, and with it
MOST_PAIRS = 4_000  # channels whose pairs are compared by correlation
PAIR_ROWS = 4e9  # rows times channels squared
ALIKE = 0.98  # correlation of two courses that are one, by some factor
LASTS, RUNS = 20, 20  # rows without a number that are a stop, in so many stretches at most
MUCH, MOST = 0.01, 0.5  # shares of missing values: that matter, and that leave nothing to judge
AROUND = 0.75  # share of the channels beside one whose touch should reach it
MOST_ASKED = 200  # sound channels that tell how surely a touch reaches one
DOUBT = 0.05  # chance, over all channels, from which a mute one may be sound


def channel_faults(survey: Survey) -> tuple[list[Finding], NDArray[np.bool_]]:
    """Findings, and the channels (n,) that no later question should be asked of."""
    bad = np.zeros(survey.width, bool)
    found: list[Finding] = []
    for look in (_ids, _missing, _constant, _coarse, _thermal):
        found += look(survey, bad)
    clipped = _clipped(survey, bad)
    found += clipped + _stuck(survey, bad, clipped)
    for look in (_copied, _noisy, _sign, _mute):
        found += look(survey, bad)
    return found, bad


def _ids(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    ids, names = survey.track.ids, survey.track.names
    if ids is None:
        return []
    kinds, inverse, counts = np.unique(ids, return_inverse=True, return_counts=True)
    twice = np.flatnonzero(counts[inverse] > 1)
    if len(twice) == 0:
        return []
    numbers = ", ".join(names[one] if names else str(one) for one in kinds[counts > 1][:5])
    text = f"{len(twice)} channels share an id with another (id {numbers}): which is which?"
    return [finding("repeated_id", text, channels=twice)]


def _missing(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Rows and stretches without a number, the share of those that are strewn, and spikes."""
    found = [] if survey.gone is None else _strewn(survey, survey.gone & ~survey.constant, bad)
    if len(survey.spikes):
        channels = np.unique(survey.spikes[:, 1])
        text = (
            f"{len(survey.spikes)} single value{'s'[: len(survey.spikes) > 1]} of "
            f"{named(channels)} lie far outside the span of all others: spikes."
        )
        rows = spans_of(np.unique(survey.spikes[:, 0]))
        found.append(finding("noisy", text, channels=channels, rows=rows, confidence=0.95))
    return found


def _strewn(survey: Survey, gone: NDArray[np.bool_], bad: NDArray[np.bool_]) -> list[Finding]:
    """Rows, stretches of channels and single values that hold no number (t, n)."""
    found = []
    rows = np.flatnonzero((gone | survey.constant).all(axis=1) & gone.any(axis=1))
    if len(rows):
        text = f"{'A row holds' if len(rows) == 1 else f'{len(rows)} rows hold'} no number at all."
        spans, harm = spans_of(rows), 0.6 if len(rows) > 1 else 0.4
        found.append(finding("lost", text, rows=spans, harm=harm))
        gone[rows] = False
    stops: dict[tuple[int, int], list[int]] = {}
    for channel in np.flatnonzero(gone.any(axis=0)).tolist():
        long = [(a, b) for a, b in spans_of(np.flatnonzero(gone[:, channel])) if b - a >= LASTS]
        for a, b in long if len(long) <= RUNS else []:
            stops.setdefault((a, b), []).append(channel)
            gone[a : b + 1, channel] = False
    whole = [
        replace(one, text=subject(one.channels or [], "holds", "hold") + " no number for a while.")
        for (a, b), own in stops.items()
        for one in _in_modules(survey, np.array(own), [[a, b]], "stuck", 0.99)
    ]
    found += _summed(_joined(whole))
    share = gone.mean(axis=0)
    bad |= survey.missing - len(rows) > MOST * (survey.count - len(rows))
    for which, harm in ((share >= MUCH, 0.6), ((share > 0) & (share < MUCH), 0.2)):
        channels = np.flatnonzero(which)
        if len(channels):
            text = f"{share[channels].mean():.1%} of the values of {named(channels)} are missing."
            found.append(finding("lost", text, channels=channels, harm=harm,
                                 do="leave these values out, do not read them as 0"))  # fmt: skip
    return found


def neighbours(survey: Survey, channel: int, reach: int = 4) -> IntArray:
    """Channels beside one: the nearest on the skin where places are known, else in the file."""
    places = survey.track.places
    if places is not None and np.isfinite(places[channel]).all():
        away = np.linalg.norm(places - places[channel], axis=1)
        away[~np.isfinite(away)] = np.inf
        return np.argsort(away)[1 : 2 * reach - 1]
    near = np.arange(max(channel - reach, 0), min(channel + reach + 1, survey.width))
    return near[near != channel]


def episodes(survey: Survey) -> IntArray:
    """(n,) How often each channel is touched."""
    begins = survey.touched[1:] & ~survey.touched[:-1]
    return np.asarray(begins.sum(axis=0) + survey.touched[0])


def _restless(survey: Survey) -> float:
    """Share of the channels that change at rest too."""
    calm = survey.changes[survey.calm][:, ~survey.constant]
    return float((calm.mean(axis=0) > 0.02).mean()) if calm.size else 0.0


def _constant(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels that never change: at the level of others at rest dead, elsewhere stuck."""
    still = np.flatnonzero(survey.constant)
    if len(still) == survey.width:
        bad[:] = True
        return [finding("dead", "No channel ever changes.", harm=0.9)]
    if len(still) == 0:
        return []
    often, lively = episodes(survey), ~survey.constant
    sure = np.full(len(still), 0.99)
    if _restless(survey) < 0.6:  # silent at rest: an untouched channel is constant too
        near = [[one for one in neighbours(survey, c) if lively[one]] for c in still.tolist()]
        expected = np.array([np.median(often[one]) if one else 0.0 for one in near])
        expected *= len(still) < 0.5 * survey.width
        few = len(still) <= max(3, 0.04 * survey.width)
        sure = np.where(expected >= (3 if few else 6), 1.0 - np.exp(-expected), 0.0)
    still, sure = still[sure > 0.9], sure[sure > 0.9]
    bad[still] = True
    level = survey.mean[0, still].astype(np.float64)
    low, high = np.percentile(survey.rest[lively], (1.0, 99.0))
    margin = 0.5 * (high - low) + 3.0 * float(np.median(survey.floor[lively]))
    stuck = (level < low - margin) | (level > high + margin)
    stuck &= (level != 0) & (survey.missing[still] == 0)
    found = _in_modules(
        survey, still[~stuck], None, "dead", float(sure[~stuck].mean() if (~stuck).any() else 1)
    )
    if stuck.any():
        own = still[stuck]
        text = subject(own, "stands", "stand") + f" still at {level[stuck][0]:g}."
        found.append(finding("stuck", text, channels=own, confidence=float(sure[stuck].mean())))
    return found


def _in_modules(
    survey: Survey, channels: IntArray, rows: list[list[int]] | None, kind: Kind, sure: float
) -> list[Finding]:
    """Channels with the same fault; many that follow each other are a module too.

    Of those that stand still for a while the module takes the place of its channels.
    """
    found, single = [], channels.tolist()
    where: dict[str, Any] = {"rows": rows, "confidence": sure}
    least = MODULE if rows else DEAD_MODULE
    for first, last in spans_of(channels, join=4 if rows else 2):
        own = channels[(channels >= first) & (channels <= last)]
        if least <= len(own) < survey.width:
            text = f"{len(own)} channels from {first} to {last} hang together: a cable or a board."
            found.append(finding("module", text, channels=own, **where))
            if rows:
                single = [one for one in single if one not in own]
    if single:
        verbs = ("stands still.", "stand still.") if rows else ("never answers.", "never answer.")
        text = subject(single, *verbs)
        found.append(finding(kind, text, channels=single, **where))
    return found


def _cut(survey: Survey) -> NDArray[np.bool_]:
    """(n,) Channels that reach their extreme in several loads, as those that are cut off do."""
    top = survey.high.max(axis=0) if survey.rising else survey.low.min(axis=0)
    at = (survey.high if survey.rising else survey.low) == top
    return np.asarray((at[1:] & ~at[:-1]).sum(axis=0) + at[0] >= 2)


def _stuck(survey: Survey, bad: NDArray[np.bool_], clipped: list[Finding]) -> list[Finding]:
    """Channels that stop for a while, where they should have changed by what they do elsewhere."""
    runs = []
    top = survey.high.max(axis=0) if survey.rising else survey.low.min(axis=0)
    quiet = survey.changes == 0
    # What is cut off stands still at the top under each strong load.
    highest = survey.mean == (top.max() if survey.rising else top.min())
    quiet &= ((survey.mean != top) | ~_cut(survey)) & ~(highest & (highest.mean(axis=0) <= 0.2))
    for one in clipped:
        quiet[:, one.channels] &= survey.mean[:, one.channels] != one.value
    usual, long = _holds(survey, quiet)
    for channel in np.flatnonzero(~survey.constant & ~bad & quiet.any(axis=0)).tolist():
        for first, last, sure in _stops(survey, channel, quiet[:, channel], usual):
            a, b = _exact(survey, channel, first, last)
            runs.append((a, b, channel, sure))
    held = [one for one in runs if one[3] == HELD]
    lasting = {one[2] for one in held if one[1] == survey.count - 1}  # until the end
    if len({one[2] for one in held}) > 0.6 * survey.width or len(lasting) > 0.2 * survey.width:
        runs = [one for one in runs if one[3] != HELD]  # another rest
    found: list[Finding] = []
    left = sorted(runs)
    while left:
        a, b, _, _ = left[0]
        same = [one for one in left if _alike(one, left[0])]
        left = [one for one in left if one not in same]
        faint = same[0][3] == CUT or (same[0][3] == HELD and b - a < 3 * long * survey.cell)
        channels = np.array(sorted(one[2] for one in same))
        if faint:  # chance or a firm hold, but not on several channels to the row
            near = np.searchsorted([a for a, _ in spans_of(channels, 4)], channels, side="right")
            channels = channels[np.bincount(near)[near] >= MODULE]
            if len(channels) == 0:
                continue
        bad[channels] = True
        # All of a module stop and go on together; each may have stood still a little longer.
        span = [[max(one[0] for one in same), min(one[1] for one in same)]]
        found += _in_modules(survey, channels, span, "stuck", float(np.mean([x[3] for x in same])))
    return _summed(_joined(found))


def _alike(one: tuple[int, int, int, float], other: tuple[int, int, int, float]) -> bool:
    """Whether two stretches of rows are nearly the same."""
    shared = min(one[1], other[1]) - max(one[0], other[0]) + 1
    whole = max(one[1], other[1]) - min(one[0], other[0]) + 1
    return shared >= TOGETHER * whole


def _summed(found: list[Finding]) -> list[Finding]:
    """Findings of single channels as one, where they are too many to read."""
    single = [one for one in found if one.kind == "stuck"]
    if len(single) <= MANY:
        return found
    channels = sorted({one for own in single for one in own.channels or ()})
    rows = sorted(span for own in single for span in own.rows or ())
    text = f"{len(channels)} channels stand still for a while, such as {channels[0]}."
    whole = replace(single[0], channels=channels, rows=rows, text=text)
    return [one for one in found if one.kind != "stuck"] + [whole]


def _joined(found: list[Finding]) -> list[Finding]:
    """Findings of the same kind and channels as one, with all their rows."""
    by: dict[tuple[str, tuple[int, ...]], list[Finding]] = {}
    for one in found:
        by.setdefault((one.kind, tuple(one.channels or ())), []).append(one)
    return [
        replace(own[0], rows=sorted(span for one in own for span in one.rows or []))
        for own in by.values()
    ]


def _holds(survey: Survey, quiet: NDArray[np.bool_]) -> tuple[float, float]:
    """Cells for which touched channels stand still at the longest: usually, and one in ten."""
    held = quiet & (survey.response > survey.floor)
    longest = [
        max((b - a + 1 for a, b in spans_of(np.flatnonzero(one))), default=0) for one in held.T
    ]
    usual, long = np.percentile(longest or [0], (40.0, 90.0)).tolist()
    return usual, long


def _stops(
    survey: Survey, channel: int, quiet: NDArray[np.bool_], holds: float
) -> list[tuple[int, int, float]]:
    """Cells in which a channel stands still though it should not, each with a confidence."""
    found = []
    changes = survey.changes[:, channel]
    usable = np.ones(len(changes), bool) if survey.loaded else survey.calm
    own = survey.mean[:, channel]
    span = float(survey.span[channel])
    least = max(float(survey.floor[channel]), 6.0 * survey.quantum, 0.1 * span)
    far = (own - survey.rest[channel]) * survey.sign > least
    lasting = 0
    ends = survey.low.min(axis=0) if survey.rising else survey.high.max(axis=0)
    floor = np.median(ends)  # of a skin that is silent at rest
    floor = floor if (survey.column(channel) == floor).mean() > SILENT else np.nan
    for first, last in spans_of(np.flatnonzero(quiet)):
        length = last - first + 1
        if length < 3 or length * survey.cell < max(40, 0.03 * survey.count):
            continue
        # Noise around a rest below the least value of a type is cut off there, and rare.
        cut = survey.track.values.dtype.kind == "u" and own[first + 1] == 0
        idle = own[first + 1] == floor and not _ignored(survey, channel, first, last)
        apart = np.ones(len(changes), bool)
        apart[max(first - 1, 0) : last + 2] = False
        # Noise of less than a step shows at some levels only: cells at the same one are asked.
        same = apart & (np.abs(own - own[first + 1]) < SAME * survey.quantum)
        fine = survey.noise[channel] < 0.5 * survey.quantum and not cut
        outside = changes[same if fine and same.sum() >= 8 else apart & usable]
        if len(outside) < 8:
            outside = np.zeros(8)
        window = int(np.clip(length // 2, 2, len(outside) // 2))
        total = np.cumsum(np.concatenate([[0.0], outside]))
        calmest = float((total[window:] - total[:-window]).min() / window)
        expected = calmest * length * survey.cell
        if expected > SURE:
            found.append((first, last, CUT if idle or (cut and expected < FAR * SURE) else 0.99))
        elif far[first : last + 1].all() and length > 3 * max(holds, 3):
            again = spans_of(np.flatnonzero(quiet & (own == own[first + 1])), join=2)
            lasting += 1
            if len(again) == 1 and length * survey.cell > 30:  # a rest is come back to
                found.append((first, last, HELD))
    return found if lasting <= 2 else [one for one in found if one[2] != HELD]


def _asked(survey: Survey, channel: int, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(k,) Cells in which most of the usable channels beside one are touched."""
    beside = neighbours(survey, channel, 4 if survey.track.places is not None else 2)
    beside = beside[usable[beside]]
    return np.asarray(survey.touched[:, beside].sum(axis=1) >= max(AROUND * len(beside), 2))


def _ignored(survey: Survey, channel: int, first: int, last: int) -> bool:
    """Whether a channel leaves touches around it without an answer in some cells only."""
    spans = spans_of(np.flatnonzero(_asked(survey, channel, ~survey.constant)), join=2)
    inside = sum(first <= a and b <= last for a, b in spans)
    other = [survey.touched[a : b + 1, channel].any() for a, b in spans if b < first or a > last]
    missed = max(1.0 - sum(other) / max(len(other), 1), 0.1)
    return bool(missed**inside < DOUBT)


def _exact(survey: Survey, channel: int, first: int, last: int) -> tuple[int, int]:
    """First and last row of a stretch without change around some cells."""
    a, b = survey.rows_of_cells(first, last)
    a0, b0 = max(a - survey.cell, 0), min(b + survey.cell, survey.count - 1)
    column = survey.track.values[a0 : b0 + 1, channel]
    value = column[a - a0 + 1]
    other = np.flatnonzero(column != value)
    before, after = other[other < a - a0 + 1], other[other > a - a0 + 1]
    return (a0 + int(before[-1]) + 1 if len(before) else a0), (
        a0 + int(after[0]) - 1 if len(after) else b0
    )


def _windows(survey: Survey, most: int) -> NDArray[np.float64]:
    """Rows (c, k, n) of calm cells spread over the recording."""
    cells = np.flatnonzero(survey.calm)
    wanted = max(most // survey.cell, 2)
    if len(cells) > wanted:
        cells = cells[np.linspace(0, len(cells) - 1, wanted).astype(int)]
    rows = (cells[:, None] * survey.cell + np.arange(survey.cell)).ravel()
    some = np.nan_to_num(survey.track.values[rows].astype(np.float64))
    return some.reshape(len(cells), survey.cell, survey.width)


def _copied(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Pairs of channels with the same values, or with the same noise."""
    lively = np.flatnonzero(~survey.constant & ~bad)
    pairs: set[tuple[int, int]] = set()
    means = np.ascontiguousarray(survey.mean[:, lively].T)
    rich = np.array([len(np.unique(one)) for one in means]) >= 8
    rich &= episodes(survey)[lively] >= 2
    keys: dict[bytes, int] = {}
    for channel, one in zip(lively[rich], means[rich], strict=True):
        twin = keys.setdefault(one.tobytes(), int(channel))
        if twin != channel and (survey.column(twin) == survey.column(channel)).all():
            pairs.add((twin, int(channel)))
    if len(lively) <= MOST_PAIRS and len(lively) > 1 and _restless(survey) > 0.5:
        some = _windows(survey, int(np.clip(PAIR_ROWS / len(lively) ** 2, 200, 8000)))
        fast = np.diff(some[:, :, lively], axis=1).reshape(-1, len(lively))
        most = OUTLIER * np.maximum(survey.noise, survey.steps)[lively]
        fast = np.clip(fast, -most, most)  # one touch that begins is not noise
        raw = fast.copy()
        fast -= np.median(fast, axis=1, keepdims=True)
        size = np.sqrt((fast**2).sum(axis=0))
        alike = (fast.T @ fast) / np.maximum(np.outer(size, size), 1e-30)
        np.fill_diagonal(alike, 0.0)
        usual = np.partition(alike, -2, axis=1)[:, -2] if len(lively) > 3 else np.zeros(len(lively))
        near = [
            (a, b)
            for a, b in np.argwhere(np.triu(alike) > COPY).tolist()
            if max(usual[a], usual[b]) < 0.9 or alike[a, b] > 0.9999
        ]
        if len(near) > MANY:  # so many move for a common reason
            return []
        pairs |= {
            (int(lively[a]), int(lively[b]))
            for a, b in near
            # What stands still carries the median of the others, turned: so do two of them.
            if raw[:, a] @ raw[:, b] > RAW * np.linalg.norm(raw[:, a]) * np.linalg.norm(raw[:, b])
        }
    if len(pairs) > MANY:
        return []
    found = []
    for a, b in sorted(pairs):
        bad[b] = True
        text = f"Channels {a} and {b} carry the same signal: one is a copy of the other."
        found.append(finding("copied", text, channels=[a, b]))
    return found


def _coarse(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels that take steps several times those of the others."""
    usual, steps = survey.quantum, survey.steps
    typical = np.median(survey.span)
    coarse = []
    whole = survey.track.values.dtype.kind in "iub" or usual == np.rint(usual) > 0
    rows = np.unique(np.linspace(0, survey.count - 1, min(survey.count, 20_000)).astype(int))
    for channel in np.flatnonzero((steps > COARSE * usual) & ~bad & ~survey.constant):
        kinds, times = np.unique(
            survey.track.values[rows, channel].astype(np.float64), return_counts=True
        )
        grid = (kinds - kinds[0]) / steps[channel]
        even = np.abs(grid - np.rint(grid)).max() < 1e-3
        # Steps between whole numbers are even but for their rounding.
        if not even and steps[channel] >= WIDE * usual > 0 and np.median(times) >= OFTEN:
            level = np.rint(grid)
            line = np.polyval(np.polyfit(level, kinds, 1), level)
            even = np.abs(kinds - line).max() < 0.75 * usual
        if even and len(kinds) >= KINDS and steps[channel] > 1e-3 * typical:
            coarse.append(int(channel))
    found = []
    if coarse:
        step = float(np.median(steps[coarse]))
        text = subject(coarse, "takes", "take") + f" steps of {step:g}, others of {usual:.3g}."
        bad[coarse] = True  # their noise and their highest value are those of the steps
        found.append(finding("quantised", text, channels=coarse, confidence=0.95))
    lively = ~survey.constant
    own = steps[lively]
    if whole and usual >= 4 and (own % usual == 0).all() and (own > 0).mean() > 0.8:
        text = f"All channels take steps of {usual:g}: lighter touches than that are not seen."
        found.append(finding("quantised", text, confidence=0.9))
    return found


def _clipped(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels whose readings pile up at a value that none goes beyond."""
    lively = np.flatnonzero(~survey.constant & ~bad)
    if len(lively) == 0:
        return []
    found = []
    for side in (1.0, -1.0):
        ends = side * (survey.high if side > 0 else survey.low)[:, lively]
        top = ends.max(axis=0)
        span = survey.span[lively]
        busy = span > 1.5 * survey.floor[lively]
        at = ends == top
        load = at & survey.touched[:, lively]
        near = (ends < top) & (ends >= top - 0.06 * span)
        cells, beside = load.sum(axis=0), near.sum(axis=0)
        other = at.sum(axis=0) - cells
        often = (load[1:] & ~load[:-1]).sum(axis=0) + load[0]
        above = np.abs(top - side * survey.rest[lively]) > 8.0 * survey.quantum
        piled = busy & above & (cells >= 2) & (cells > 1.5 * beside) & (other <= 0.1 * cells)
        plateau = np.array(
            [_flat(survey, int(c), v * side, load[:, k]) if piled[k] else 0.0
             for k, (c, v) in enumerate(zip(lively, top, strict=True))]
        )  # fmt: skip
        piled &= plateau >= 2.0
        kind = survey.track.values.dtype
        full = top.max(initial=0.0)
        if kind.kind in "iu" and full in FULL_SCALES:  # strong touches may reach it
            touched = survey.touched[:, lively].sum(axis=0)
            much = (top == full) & (cells > np.maximum(0.02 * len(at), FULL * touched))
            piled &= (top < full) | (much & (much.sum() > SEVERAL * busy.sum()))
        highest = top[busy].max() if busy.any() else 0.0
        shared = piled & (top == highest)
        # Where noise moves every reading, two stretches that stand at one value are enough.
        noise = survey.floor[lively]
        stands = [(noise > k * survey.quantum) & (plateau > v) for k, v in STANDS.items()]
        own = piled & (often >= np.where(np.any(stands, axis=0), 2, 3)) & (cells >= 6)
        groups = []
        if shared.sum() >= 2 or (shared & (often >= 2)).any():  # one limit: of all that reach it
            groups = [(highest, top == highest)]
        groups += [
            (v, own & (top == v) & (top != highest)) for v in np.unique(top[own]) if v != highest
        ]
        if side > 0 and not groups and kind.kind in "iu" and highest > 255:
            from skinmap.io.recordings.cyskin_arrays import SATURATION

            if highest == SATURATION:  # known of the sensor: one reading tells
                groups = [(highest, top == highest)]
        for value, which in groups:
            channels = lively[which]
            if len(channels):
                text = subject(channels, "is", "are") + f" cut off at {value * side:g}."
                found.append(finding("clipped", text, channels=channels, value=float(value * side)))
    return found


def _flat(survey: Survey, channel: int, value: float, cells: NDArray[np.bool_]) -> float:
    """Mean length of the stretches of rows at a value, in some cells."""
    rows = np.concatenate(
        [np.arange(*survey.rows_of_cells(int(k), int(k))) for k in np.flatnonzero(cells)[:200]]
    )
    at = rows[survey.track.values[rows, channel].astype(np.float32) == np.float32(value)]
    spans = spans_of(at)
    return float(np.mean([b - a + 1 for a, b in spans])) if spans else 0.0


def smooth(series: NDArray[np.float32], width: int) -> FloatArray:
    """Running mean (k, n) over some cells, shorter at both ends."""
    total = np.cumsum(np.concatenate([np.zeros((1, series.shape[1])), series]), axis=0)
    at = np.arange(len(series))
    a, b = np.maximum(at - width // 2, 0), np.minimum(at + width // 2 + 1, len(series))
    return np.asarray((total[b] - total[a]) / (b - a)[:, None])


def _goes_with(courses: FloatArray, common: FloatArray) -> NDArray[np.bool_]:
    """(n,) which courses (k, n) are a common one (k, 1) by some factor."""
    a, b = courses - courses.mean(axis=0), common - common.mean()
    both = (a * b).sum(axis=0)
    return np.asarray(both > ALIKE * np.sqrt((a**2).sum(axis=0) * (b**2).sum()))


def _thermal(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels that follow nothing but a slow course of their own."""
    cells = len(survey.mean)
    if cells < 24 or survey.loaded:
        return []
    touched = episodes(survey) > 0
    slow = smooth(survey.mean, max(cells // 8, 5))
    course = slow.max(axis=0) - slow.min(axis=0)
    edge = max(cells // 16, 2)
    rough = (survey.mean - slow)[edge:-edge]
    fast = np.percentile(np.abs(rough), 99.0, axis=0)
    common = np.median(slow[:, ~bad], axis=1, keepdims=True)
    own = slow - common
    apart = own.max(axis=0) - own.min(axis=0)
    # A taxel that goes the way of the whole skin, by another factor, drifts with it.
    with_skin = _goes_with(slow, common) & (np.ptp(common) > 0.3 * course)
    lively = ~survey.constant & ~bad
    usual = np.percentile(np.abs(rough[:, lively]), 99.0, axis=0)
    limit = np.maximum(4.0 * survey.noise / np.sqrt(survey.cell), 0.6 * survey.quantum)
    flat = fast < np.maximum(limit, 0.15 * course)
    steady = fast < 0.3 * np.median(usual)
    which = lively & flat & ~with_skin & (course > 6.0 * survey.noise) & (apart > 0.5 * course)
    which &= course > np.maximum(3.0 * survey.quantum, 0.25 * np.median(survey.floor[lively]))
    if survey.uniform:
        which &= np.abs(survey.follows) < 0.5
    # Where the channels beside one are touched, it should be; or where most are.
    calm = fast < np.maximum(1.6 * limit, 0.02 * course)
    for c in np.flatnonzero(which & calm):
        calm[c] = touched[neighbours(survey, int(c))].mean() >= 0.5
    which &= calm | (steady & (touched[~bad].mean() >= 0.3))
    channels = np.flatnonzero(which)
    if len(channels) == 0 or len(channels) > 0.35 * survey.width:
        return []
    bad[channels] = True
    text = subject(channels, "follows", "follow") + " a slow course and no touch: temperatures."
    return [finding("thermal", text, channels=channels, confidence=0.9)]


def _noisy(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels several times as noisy at rest as the others, always or for a while."""
    lively = ~survey.constant & ~bad
    if lively.sum() < 3:
        return []
    calm = np.flatnonzero(survey.calm)
    several = 1 if survey.loaded else int(np.clip(len(calm) // 6, 1, 12))
    pieces = np.array_split(calm, several)
    # One touched channel among many leaves a cell calm: its own touch is not noise. Where hands
    # hardly rest these cells lie below the rest of all, which is then that of a light load.
    away = survey.response - np.minimum(np.median(survey.response[calm], axis=0), 0.0)
    rough = np.where(np.abs(away) > survey.floor, np.inf, survey.rough * SIGMA_OF_SECOND)
    level, known = np.zeros((2, several, survey.width))
    for own, at, judged in zip(pieces, level, known, strict=True):
        count = np.isfinite(rough[own]).sum(axis=0)
        some = np.minimum(0.6 * count, len(own) - 1).astype(int)[None]
        judged[:] = lively & (2 * count > len(own))
        at[:] = np.take_along_axis(np.sort(rough[own], axis=0), some, axis=0)[0]
    known = (known > 0) & (known.mean(axis=0) > 0.5)
    usual = float(np.median(level[known])) if known.any() else 0.0
    level = np.where(known, level, usual)
    usual = max(usual, 0.12 * survey.quantum, 0.002 * float(np.median(survey.span[lively])))
    logs = np.log(np.maximum(np.median(level, axis=0)[lively], 0.2 * usual))
    spread = 1.4826 * float(np.median(np.abs(logs - np.median(logs))))
    limit = usual * max(NOISY, float(np.exp(min(4.0 * spread, 2.5))))
    reach = np.percentile(survey.mean, 99.0, axis=0) - np.percentile(survey.mean, 1.0, axis=0)
    share = level / np.maximum(reach, 1e-12)  # a channel of a larger gain has more noise too
    touched = lively & (reach > 10.0 * np.median(level, axis=0) / np.sqrt(survey.cell))
    usual_share = np.median(share[:, touched]) if touched.any() else 0.0
    wild = (level > limit) & lively & (~touched | (share > 2.5 * usual_share))
    if survey.uniform:
        # Cells hide noise: what is left of their agreement from row to row.
        own = survey.mean.std(axis=0)
        wild &= np.abs(survey.follows) * own < 0.9 * np.hypot(own, level)
    found = []
    always = np.flatnonzero(wild.mean(axis=0) >= 0.75)
    # A load that is held for long trembles.
    lowest = np.percentile(survey.mean, 5.0 if survey.rising else 95.0, axis=0)
    held = [np.abs(np.median(survey.mean[own], axis=0) - lowest) > survey.floor for own in pieces]
    wild &= ~np.array(held) | (wild.mean(axis=0) >= 0.75)
    some = np.flatnonzero((wild.mean(axis=0) < 0.75) & (wild.sum(axis=0) >= 2))
    if len(always) and len(always) < 0.4 * survey.width:
        bad[always] = True
        times = float(np.median(level[:, always])) / usual
        text = subject(always, "is", "are") + f" {times:.0f} times as noisy as the others."
        found.append(finding("noisy", text, channels=always, confidence=0.97))
    for channel in some.tolist() if len(some) < 0.2 * survey.width else []:
        spans = [
            [survey.rows_of_cells(int(pieces[a][0]), int(pieces[a][0]))[0],
             survey.rows_of_cells(int(pieces[b][-1]), int(pieces[b][-1]))[1]]
            for a, b in spans_of(np.flatnonzero(wild[:, channel]))
        ]  # fmt: skip
        bad[channel] = True
        text = f"Channel {channel} is noisy for a while."
        found.append(finding("noisy", text, channels=[channel], rows=spans, confidence=0.9))
    return found


def _sign(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels that fall where the others rise."""
    lively = ~survey.constant & ~bad
    if lively.sum() < 4 or survey.two_sided:
        return []
    low, high = np.percentile(survey.fast * survey.sign, (0.5, 99.5), axis=0)
    up, down = high, -low
    least = np.maximum(0.25 * np.median(up[lively]), survey.floor)
    turned = lively & (down > 3.0 * up) & (down > least)
    low, calm, high = np.percentile(survey.mean * survey.sign, (0.5, 25.0, 99.5), axis=0)
    turned &= calm - low > 1.5 * (high - calm)
    if survey.uniform:  # all taxels feel the same
        turned = lively & (survey.follows * np.sign(np.median(survey.follows[lively])) < -0.6)
    # Where a touch fills a piece of the recording: dips from a level that is come back to.
    level = np.median(survey.mean * survey.sign, axis=0)
    dips = survey.mean * survey.sign < 0.5 * (level + low)
    steady = ~(dips[:2].any(axis=0) | dips[-2:].any(axis=0)) & (dips.mean(axis=0) < 0.35)
    deep = (level - low > 4.0 * (high - level)) & (level - low > least)
    if survey.calm.any():  # the level is that of the untouched channel
        at_rest = np.median(survey.mean[survey.calm] * survey.sign, axis=0)
        deep &= np.abs(at_rest - level) < 0.25 * (level - low)
    which = turned | (lively & steady & deep)
    # What is loaded for most of the time falls with others, what is turned against them.
    course = survey.mean - survey.mean.mean(axis=0)
    course /= np.maximum(np.linalg.norm(course, axis=0), 1e-12)
    alike = course[:, which].T @ course[:, lively & ~which]
    against = -alike.min(axis=1, initial=0.0) >= alike.max(axis=1, initial=0.0)
    channels = np.flatnonzero(which)[against]
    if len(channels) == 0 or len(channels) > 0.4 * lively.sum():
        return []
    bad[channels] = True
    text = subject(channels, "falls", "fall") + " where the others rise: the sign is turned."
    return [finding("sign", text, channels=channels, confidence=0.95)]


def _apart(some: NDArray[np.float32], others: NDArray[np.float32]) -> float:
    """By how many errors of its mean some readings lie beyond others."""
    error = max(float(others.std()), 1e-12) / len(some) ** 0.5
    return float(some.mean() - others.mean()) / error


def _mute(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Channels that stay within their noise while those beside them are touched again and again.

    How often the other channels answer in the same place sets the confidence.
    """
    usable, felt = ~survey.constant & ~bad, survey.touched.any(axis=0)
    silent = np.flatnonzero(usable & ~felt)
    others = np.flatnonzero(usable & felt)
    if len(silent) == 0 or len(others) < 3:
        return []

    shares = []
    for channel in others[np.unique(np.linspace(0, len(others) - 1, MOST_ASKED).astype(int))]:
        spans = spans_of(np.flatnonzero(_asked(survey, int(channel), usable)), join=2)
        if len(spans) >= 3:
            answers = [survey.touched[a : b + 1, channel].any() for a, b in spans]
            shares.append(float(np.mean(answers)))
    if len(shares) < 3:
        return []
    missed = max(1.0 - float(np.percentile(shares, 5.0)), 0.1)
    found: dict[int, float] = {}
    for channel in silent.tolist():
        load, own = _asked(survey, channel, usable), survey.response[:, channel]
        chance = survey.width * missed ** len(spans_of(np.flatnonzero(load), join=2))
        # A weak channel, or one at the edge of each touch, still moves with those beside it.
        if chance < DOUBT and _apart(own[load], own[~load]) < 4.0:
            found[channel] = 1.0 - chance
    mute, sure = np.array(list(found), np.int64), float(np.mean([*found.values()] or [0.0]))
    bad[mute] = True
    return _in_modules(survey, mute, None, "dead", sure)
