"""Rest that does not stay: it drifts, or is another one after a load or in another session."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.soundness.finding import Finding, finding, named, subject
from skinmap.soundness.survey import PIECES, USUAL, Survey

STEP = 0.65  # share of the whole change that happens at one place: a step, not a drift
BETWEEN = 8.0  # percentile of a short piece's cells: touches leave it at rest for moments only
HELD, BEYOND = 90.0, 3.0  # percentile of how far levels come back, and how much farther rest moves
INNER = 0.1  # share of a drift that is seen without the first and the last piece
ENOUGH, COVERED = 5, 30  # cells that show a rest: untouched ones, and of any kind
FREE = 0.1  # share of untouched cells below which labels cover rest too
ALL = 0.6  # share of the channels from which it is the whole skin


def rest_faults(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Drift and steps of the rest of sound channels."""
    cells = len(survey.mean)
    lively = np.flatnonzero(~survey.constant & ~bad)
    if cells < 3 * PIECES or len(lively) < 2:
        return []
    level = survey.levels_at(BETWEEN if survey.short else USUAL)
    level = _without_spikes(level[:, lively])
    if survey.loaded:
        return _before_and_after(survey, lively)
    span = float(np.median(survey.span[lively]))
    least = np.maximum(
        6.0 * survey.noise[lively] / np.sqrt(survey.cell), max(1.2 * survey.quantum, 0.05 * span)
    )
    # Loads that are held hide a drift of all in each channel, not in most of them.
    # What channels of a skin that is seldom at rest come back by, all may move by as well.
    held = BEYOND * np.median(_back(level))
    common = _moves(np.median(level, axis=1, keepdims=True), max(np.median(least), held))
    slow, sudden = common if np.any(common) else _moves(level, least)
    slow, sudden = (np.broadcast_to(one, len(lively)) for one in (slow, sudden))
    found = []
    gradual = lively[slow]
    if len(gradual):
        whole = len(gradual) > ALL * len(lively)
        most = float(np.median(np.abs(level[-1] - level[0])[slow]))
        who = "The whole skin drifts" if whole else subject(gradual, "drifts", "drift")
        text = f"{who} by {most:.3g} from begin to end."
        found.append(finding("drift", text, channels=None if whole else gradual, confidence=0.9))
    if sudden.any():
        found.append(_step(survey, lively, np.flatnonzero(sudden), level))
    return found


def _back(level: FloatArray) -> FloatArray:
    """(n,) How far levels (p, n) come back on their way from begin to end."""
    way = np.abs(np.diff(level, axis=0)).sum(axis=0)
    return np.asarray((way - np.abs(level[-1] - level[0])) / 2.0)


def _moves(level: FloatArray, least: Any) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Channels (n,) of which levels (p, n) drift by at least so much, and of which they step."""
    change = np.diff(level, axis=0)
    total = np.abs(level[-1] - level[0])
    reach = np.ptp(level, axis=0)
    rough = np.abs(change).sum(axis=0)
    # A skin that is seldom at rest (a glove, a mat) shows the loads that it holds.
    limit = np.maximum(least, BEYOND * np.percentile(_back(level), HELD))
    moved = (reach > limit) & (rough < 1.8 * reach) & (total > 0.6 * reach)
    pair = np.abs(change[:-1]) + np.abs(change[1:])
    apart = np.abs(np.median(level[-3:], axis=0) - np.median(level[:3], axis=0))
    largest = pair.max(axis=0)
    even = pair.sum(axis=0) - 2.0 * largest < largest  # on both sides of the largest change
    sudden = moved & (apart > limit) & (largest > STEP * total) & even
    # A load that is held at the begin or at the end moves one piece only.
    return moved & ~sudden & (np.ptp(level[1:-1], axis=0) > INNER * reach), sudden


def _without_spikes(level: FloatArray) -> FloatArray:
    """Levels of pieces without what lasts for one piece only."""
    inner = np.median([level[:-2], level[1:-1], level[2:]], axis=0)
    first, last = np.median(level[:3], axis=0), np.median(level[-3:], axis=0)
    ends = [
        np.where(np.abs(end - near) > np.abs(usual - near), end, usual)
        for end, near, usual in ((level[0], inner[0], first), (level[-1], inner[-1], last))
    ]
    return np.concatenate([ends[:1], inner, ends[1:]])


def _step(
    survey: Survey, lively: NDArray[np.int64], which: NDArray[np.int64], level: FloatArray
) -> Finding:
    """The row at which the rest of channels becomes another one."""
    begin, end = np.median(level[:3], axis=0), np.median(level[-3:], axis=0)
    middle = 0.5 * (begin + end)
    above = survey.mean[:, lively[which]] > middle[which]
    up = (end > begin)[which]
    votes = (above == up).mean(axis=1)  # on the side of the end
    total = np.concatenate([[0.0], np.cumsum(2.0 * votes - 1.0)])
    cell = int(np.clip(np.argmin(total), 1, len(votes) - 1))
    row = survey.rows_of_cells(cell, cell)[0]
    channels = lively[which]
    whole = len(channels) > ALL * len(lively)
    size = float(np.median(np.abs(end - begin)[which]))
    who = "the whole skin" if whole else named(channels)
    text = f"From row {row} on the rest of {who} is another one, by {size:.3g}."
    own = None if whole else channels
    return finding("rest", text, channels=own, rows=[[row, survey.count - 1]], confidence=0.9)


def _before_and_after(survey: Survey, lively: NDArray[np.int64]) -> list[Finding]:
    """Rest at the end of a load on the whole skin beside rest at its beginning."""
    skin = np.median(survey.response[:, lively], axis=1)
    edge = max(len(skin) // 60, 2)
    span = float(np.percentile(skin, 99.0) - np.percentile(skin, 1.0))
    first, last = survey.mean[:edge, lively], survey.mean[-edge:, lively]
    ends = skin[:edge].mean() - skin.min(), skin[-edge:].mean() - skin.min()
    steady = max(np.ptp(skin[:edge]), np.ptp(skin[-edge:])) < 0.05 * span
    if not steady or max(ends) > 0.25 * span:
        return []
    gap = np.median(last, axis=0) - np.median(first, axis=0)
    moved = np.abs(gap) > np.maximum(0.05 * span, 4.0 * survey.noise[lively])
    if moved.mean() < 0.3:
        return []
    text = f"Rest after the load differs from rest before by {np.median(np.abs(gap[moved])):.3g}."
    rows = [[survey.rows_of_cells(len(skin) - edge, len(skin) - 1)[0], survey.count - 1]]
    return [finding("rest", text, channels=lively[moved], rows=rows, confidence=0.8)]


def session_offsets(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Sessions, as the labels name them, whose rests differ."""
    track = survey.track
    if track.events is None or len(set(track.sessions)) < 2:
        return []
    lively = np.flatnonzero(~survey.constant & ~bad)
    spans = []
    for name in dict.fromkeys(track.sessions):
        own = [k for k, one in enumerate(track.sessions) if one == name]
        rows = np.flatnonzero(np.isin(track.events, own))
        if len(rows):
            spans.append((int(rows[0]), int(rows[-1]), name))
    turns = sorted(spans)
    if any(a[1] >= b[0] for a, b in pairwise(turns)):
        return []
    rests, names, where, edges = [], [], [], []
    share = 20.0 if survey.rising else 80.0
    starts = np.arange(len(survey.mean)) * survey.cell
    free = np.logical_and.reduceat(track.events < 0, starts)
    known = [np.count_nonzero(free & (starts >= a) & (starts <= b)) for a, b, _ in turns]
    # Each file is a touch, with rest in it.
    covered = free.mean() < FREE and min(known, default=0) < ENOUGH
    # What lies between two sessions belongs to the nearer one.
    cuts = [0, *((a[1] + b[0]) // 2 for a, b in pairwise(turns)), survey.count - 1]
    for (first, last, name), begin, end in zip(turns, cuts, cuts[1:], strict=False):
        calm = np.flatnonzero(free & (starts >= first) & (starts <= last))
        if len(calm) < ENOUGH:
            calm = np.flatnonzero(free & (starts >= begin) & (starts < end))
        if covered:
            calm = np.arange(survey.cell_of(first), survey.cell_of(last) + 1)
        if len(calm) < (COVERED if covered else ENOUGH):
            continue
        inside = survey.mean[calm][:, lively]
        rests.append(np.percentile(inside, share, axis=0))
        edges.append([np.percentile(x, share, axis=0) for x in np.array_split(inside, 3)])
        names.append(name)
        where.append([first, last])
    if len(rests) < 2:
        return []
    level = np.array(rests)
    edge = np.array(edges)
    steps = np.abs(edge[1:, 0] - edge[:-1, -1]).sum()
    if steps < STEP * np.abs(np.diff(level, axis=0)).sum():  # it drifts
        return []
    usual = np.median(level, axis=0)
    span = np.median(survey.span[lively])
    # As a skin that is seldom at rest moves within a session, so it does between two.
    inside = np.percentile(np.median(np.ptp(edge, axis=1), axis=0), HELD)
    noise = 6.0 * survey.noise[lively] / np.sqrt(survey.cell)
    limit = np.maximum(noise, max(0.03 * span, 1.2 * survey.quantum, inside))
    off = np.abs(level - usual) > limit
    which = np.flatnonzero(off.mean(axis=1) > 0.1)
    if len(which) == 0:
        return []
    several = f"sessions {', '.join(names[k] for k in which[:4])} differ"
    who = several if len(which) > 1 else f"session {names[which[0]]} differs"
    text = f"At rest, {who} from {'each other' if len(which) == len(names) else 'the others'}."
    channels = lively[off[which].any(axis=0)]
    told = None if len(channels) > ALL * len(lively) else channels
    return [finding("rest", text, channels=told, rows=[where[k] for k in which], confidence=0.9)]
