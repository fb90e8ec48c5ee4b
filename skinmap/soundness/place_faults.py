"""Faults that only a skin of known places shows: channels without one, or with that of another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from skinmap.arrays import FloatArray
from skinmap.soundness.finding import Finding, finding, named, spans_of, subject
from skinmap.soundness.survey import Survey

BESIDE = 8  # channels that are a channel's neighbours, at most
WIDE = 2.2  # of the usual spacing: neighbours lie so near
FAR = 4.0  # of the usual spacing: another place
AGREE, DISAGREE, ALIKE = 0.2, 0.05, 0.6  # correlations of channels that are touched together
TWICE = 2  # episodes of a channel that may have been exchanged with another
FITS = 0.75  # of the median fit of channels to their neighbours, by which an exchanged one fits
TOGETHER = 0.75  # correlation of the median channel with its neighbours, where they share loads
CHANCE = 0.05  # of one pair among all
GAIN = 0.2  # of correlation by which both channels of a pair fit better when exchanged
TOUCHED = 6  # episodes of a channel that is judged
LEAST, MOST = 4, 3000  # channels that sit elsewhere together; of a skin that is judged


def place_faults(survey: Survey, bad: NDArray[np.bool_], often: NDArray[np.int64]) -> list[Finding]:
    """Channels without a place though others have one, and channels that answer elsewhere."""
    places = survey.track.places
    if places is None or survey.width > MOST:
        return []
    known = np.isfinite(places).all(axis=1)
    found = []
    lost = np.flatnonzero(~known & ~survey.constant & ~bad)
    if known.any() and len(lost):
        text = subject(lost, "answers and has", "answer and have") + " no place on the skin."
        found.append(finding("place", text, channels=lost))
    rows = np.flatnonzero(known & ~survey.constant & ~bad & (often >= TOUCHED))
    elsewhere = _elsewhere(survey, rows, places[rows]) if len(rows) >= 12 else []
    rows = np.flatnonzero(known & ~survey.constant & ~bad & (often >= TWICE))
    if not elsewhere and len(rows) >= 12:
        elsewhere = _exchanged(survey, rows, places[rows])
    return found + elsewhere


def _exchanged(survey: Survey, rows: NDArray[np.int64], at: FloatArray) -> list[Finding]:
    """Pairs of channels that each answer as the neighbours of the other do, in both halves."""
    answers = np.maximum(survey.response[:, rows], 0.0)
    away, near = cKDTree(at).query(at, k=min(BESIDE + 1, len(rows)))
    pitch = float(np.median(away[:, 1]))
    near[away > WIDE * pitch] = -1  # too far to feel the same
    beside = [one[1:][one[1:] >= 0] for one in near]
    usual = np.column_stack(
        [np.median(answers[:, own], axis=1) if len(own) >= 2 else np.zeros(len(answers))
         for own in beside]
    )  # fmt: skip
    whole, *halves = (
        _likeness(answers[part], usual[part])
        for part in (slice(None), slice(len(answers) // 2), slice(len(answers) // 2, None))
    )
    gain, *half_gains = (_gain(one) for one in (whole, *halves))
    middle = float(np.median(np.diag(whole)))
    if middle < TOGETHER:  # neighbours that share no load tell no places
        return []
    fit = np.minimum(whole, whole.T)
    apart = cdist(at, at) > WIDE * pitch
    fits = np.where(apart & (fit > FITS * middle) & (np.minimum(*half_gains) > 0.0), gain, 0.0)
    best = fits.argmax(axis=1)
    one = np.arange(len(rows))
    mutual = (best[best] == one) & (one < best) & (fits[one, best] > GAIN)
    # The best of all pairs gains by chance too: by how much, the tail of the others tells.
    left = np.setdiff1d(one, [one[mutual], best[mutual]])
    others = gain[np.ix_(left, left)][apart[np.ix_(left, left)]]
    low, high = np.percentile(others, (99.0, 99.9)) if len(others) else (0.0, 0.0)
    mutual &= fits[one, best] > low + (high - low) * (np.log10(apart.size / CHANCE) - 2.0)
    pairs = [(int(rows[a]), int(rows[best[a]])) for a in np.flatnonzero(mutual)]
    return _boards(pairs)


def _boards(pairs: list[tuple[int, int]]) -> list[Finding]:
    """Exchanged pairs; those of one offset that follow each other are two boards."""
    found = []
    for offset in sorted({b - a for a, b in pairs}):
        for first, last in spans_of(sorted(a for a, b in pairs if b - a == offset), min(offset, 2)):
            ends = [(first, last), (first + offset, last + offset)]
            one, other = (f"{a} to {b}" if b > a else f"{a}" for a, b in ends)
            answers = "each answers as the other's neighbours do"
            if last > first:
                answers = "they answer as the neighbours of those do"
            text = f"Channels {one} and {other} are exchanged: {answers}."
            channels = [channel for a, b in ends for channel in range(a, b + 1)]
            found.append(finding("wiring", text, channels=channels, confidence=0.9))
    return found


def _gain(likeness: FloatArray) -> FloatArray:
    """(n, n) correlation that both channels of a pair win when they are exchanged."""
    gain = likeness - np.diag(likeness)[:, None]
    return np.asarray(np.minimum(gain, gain.T))


def _likeness(answers: FloatArray, usual: FloatArray) -> FloatArray:
    """(n, n) correlation of the answers of each channel with those usual at each place."""
    centred = [one - one.mean(axis=0) for one in (answers, usual)]
    sizes = [np.maximum(np.linalg.norm(one, axis=0), 1e-12) for one in centred]
    return np.asarray(centred[0].T @ centred[1] / np.outer(*sizes))


def _elsewhere(survey: Survey, rows: NDArray[np.int64], at: FloatArray) -> list[Finding]:
    """Channels that no neighbour agrees with, and channels far away do."""
    answers = np.maximum(survey.response[:, rows], 0.0)
    alike = _likeness(answers, answers)
    tree = cKDTree(at)
    away, near = tree.query(at, k=min(BESIDE + 1, len(rows)))
    pitch = float(np.median(away[:, 1]))
    one = np.repeat(np.arange(len(rows)), near.shape[1] - 1)
    other = near[:, 1:].ravel()
    kept = (away[:, 1:].ravel() < WIDE * pitch) & (other < len(rows))
    one, other = one[kept], other[kept]
    agreed = alike[one, other]
    together = agreed > AGREE
    graph = coo_array((np.ones(together.sum()), (one[together], other[together])),
                      shape=(len(rows), len(rows)))  # fmt: skip
    _, group = connected_components(graph, directed=False)
    found: list[int] = []
    partners: set[int] = set()
    for number in np.flatnonzero(np.bincount(group) < 0.4 * len(rows)):
        own = np.flatnonzero(group == number)
        border = np.isin(one, own) & ~np.isin(other, own)
        if len(own) < LEAST or border.sum() < 3 or (agreed[border] < DISAGREE).mean() < 0.8:
            continue
        distant = np.linalg.norm(at[own][:, None] - at[None], axis=2).min(axis=0) > FAR * pitch
        if not distant.any():
            continue
        best = alike[own][:, distant].max(axis=1)
        there = np.flatnonzero(distant)[alike[own][:, distant].argmax(axis=1)]
        apart = np.linalg.norm(at[there] - np.median(at[there], axis=0), axis=1)
        # All belong to one other place, not to one here and one there by chance.
        if (best > ALIKE).mean() >= 0.5 and np.median(apart) < FAR * pitch:
            found += own.tolist()
            partners |= set(there.tolist())
    if not found or len(found) > 0.4 * len(rows):
        return []
    text = (
        f"{named(rows[found]).capitalize()} answer with channels elsewhere, such as "
        f"{int(rows[min(partners)])}, and never with those beside them."
    )
    return [finding("wiring", text, channels=rows[found], confidence=0.9)]
