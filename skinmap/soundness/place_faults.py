"""Faults that only a skin of known places shows: channels without one, or with that of another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.soundness.finding import Finding, finding, named, subject
from skinmap.soundness.survey import Survey

BESIDE = 8  # channels that are a channel's neighbours, at most
WIDE = 2.2  # of the usual spacing: neighbours lie so near
FAR = 4.0  # of the usual spacing: another place
AGREE, DISAGREE, ALIKE = 0.2, 0.05, 0.6  # correlations of channels that are touched together
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
    return found + (_elsewhere(survey, rows, places[rows]) if len(rows) >= 12 else [])


def _elsewhere(survey: Survey, rows: NDArray[np.int64], at: FloatArray) -> list[Finding]:
    """Channels that no neighbour agrees with, and channels far away do."""
    answers = np.maximum(survey.response[:, rows], 0.0)
    answers = answers - answers.mean(axis=0)
    size = np.maximum(np.linalg.norm(answers, axis=0), 1e-12)
    alike = (answers.T @ answers) / np.outer(size, size)
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
