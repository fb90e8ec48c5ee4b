"""Faults of labels and of several recordings together: leaks, and one thing used twice."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from skinmap.arrays import FloatArray, IntArray
from skinmap.soundness.finding import Finding, finding
from skinmap.soundness.survey import Survey
from skinmap.soundness.track import Track

CHANCE = 0.001  # of a leak that is none
SHARED = 40  # rows in a row that two recordings must share
TRACE = 60  # samples in a row that two references must share
MOST_LABELS = 2000
TREES, STAGES = 200, 12  # that vote on labels; stages of a touch, whose course they see
CLEAR = 0.8  # share of the touches that keep their label
MISTAKEN = 0.01  # of the touches of sound labels: those that trees name otherwise, and surely
DOUBTED = 0.05  # chance of so many among sound labels from which they are a remark
SURELY, FEW = 0.45, 0.5  # votes for another label beyond its own, and more of few touches


def set_faults(survey: Survey, bad: NDArray[np.bool_]) -> list[Finding]:
    """Leaks and doubtful labels of one recording."""
    track = survey.track
    if track.events is None or len(track.labels) < 2:
        return []
    rows = [np.flatnonzero(track.events == k) for k in range(min(len(track.labels), MOST_LABELS))]
    kept = [k for k, own in enumerate(rows) if len(own) and track.labels[k]]
    if len(kept) < 2:
        return []
    labels = [track.labels[k] for k in kept]
    own = [rows[k] for k in kept]
    found = _first_frames(survey, labels, own)
    for words, name in ((track.sessions, "session"), (track.people, "person")):
        if len(words) == len(track.labels):
            found += _groups(labels, [words[k] for k in kept], name)
    return found + _unfelt(survey, labels, own, bad) + _misnamed(survey, labels, own, bad)


def _groups(labels: list[str], groups: list[str], name: str) -> list[Finding]:
    """Sessions or people of one label each."""
    if len(set(labels)) < 2 or len(set(groups)) < 2 or not all(groups):
        return []
    pairs = set(zip(groups, labels, strict=True))
    labels_of = Counter(group for group, _ in pairs)
    alone = [label for label, count in Counter(own for _, own in pairs).items() if count == 1]
    several = [group for group, count in Counter(groups).items() if count > 1]
    if len(several) > 1 and all(labels_of[group] == 1 for group in several):
        text = f"The {name} names the label: each {name} holds one label only."
        return [finding("leak", text, confidence=0.97)]
    if alone and len(several) > 1:
        text = (
            f"Labels in one {name} only: {', '.join(sorted(alone)[:5])}; no {name} can be left out."
        )
        return [finding("leak", text, confidence=0.9, harm=0.6)]
    return []


def _first_frames(survey: Survey, labels: list[str], rows: list[IntArray]) -> list[Finding]:
    """Whether what the skin read before each touch names its label."""
    events = survey.track.events
    assert events is not None
    values = survey.track.values
    calm = (events < 0).mean() > 0.02
    frames = []
    for own in rows:
        first = int(own[0])
        if calm:
            before = np.arange(max(first - 6, 0), first)
            before = before[events[before] < 0][:4]
            own = before if len(before) else own[:1]
        frames.append(values[own[:3]].astype(np.float64).mean(axis=0))
    right, chance, count = _nearest(np.nan_to_num(np.array(frames)), labels)
    if count < 8 or right <= chance or _tail(right, count, chance / count) > CHANCE:
        return []
    text = (
        f"Rows before a touch name its label: {right / count:.0%} are right, {chance / count:.0%} "
        "by chance; a model learns the hour of the recording instead of the touch."
    )
    return [finding("leak", text, confidence=1.0 - _tail(right, count, chance / count))]


def _nearest(features: FloatArray, labels: list[str]) -> tuple[int, int, int]:
    """How many the nearest mean of a label names right, left out one at a time; chance; all."""
    kinds, numbers = np.unique(labels, return_inverse=True)
    count = np.bincount(numbers)
    kept = count[numbers] > 1
    if len(kinds) < 2 or kept.sum() < 8:
        return 0, 0, 0
    spread = features.std(axis=0)
    scaled = (features - features.mean(axis=0)) / np.where(spread > 0, spread, np.inf)
    total = np.array([scaled[numbers == k].sum(axis=0) for k in range(len(kinds))])
    right = 0
    for row in np.flatnonzero(kept):
        means = total / count[:, None]
        own = numbers[row]
        means[own] = (total[own] - scaled[row]) / (count[own] - 1)
        right += int(np.argmin(((means - scaled[row]) ** 2).sum(axis=1)) == own)
    return right, int(count.max()), int(kept.sum())


def _tail(right: int, count: int, share: float) -> float:
    """Chance of at least so many successes."""
    if count > 400:
        size = np.sqrt(count * share * (1 - share))
        return float(right <= count * share + 4.5 * size)
    return float(bdtrc(right - 1, count, share))


def _unfelt(
    survey: Survey, labels: list[str], rows: list[IntArray], bad: NDArray[np.bool_]
) -> list[Finding]:
    """Touches that are marked where nothing is felt."""
    good = ~bad & ~survey.constant
    if not good.any():
        return []
    share = survey.response[:, good] / np.maximum(survey.floor[good], 1e-12)
    top = share.max(axis=1)
    # By their own rows: a cell at their end may belong to the touch beside them.
    rest = survey.mean - survey.response * survey.sign

    def response(own: IntArray) -> float:
        several = np.array_split(own, max(len(own) // survey.cell, 1))
        means = np.array([np.nan_to_num(survey.track.values[one]).mean(axis=0) for one in several])
        away = (means - rest[survey.cell_of([one[0] for one in several])]) * survey.sign
        return float((away[:, good] / np.maximum(survey.floor[good], 1e-12)).max())

    felt = np.array([response(own) for own in rows])
    usual = float(np.median(felt))
    quiet = 1.2 * float(np.percentile(top[survey.calm], 98.0)) if survey.calm.any() else 0.0
    empty = np.flatnonzero((felt < 0.6) & (felt < 0.2 * usual) & (felt <= quiet))
    if usual < 2.0 or len(empty) == 0 or len(empty) > 0.5 * len(rows):
        return []
    text = (
        f"{len(empty)} labelled touches are not felt, such as {labels[empty[0]]!r} at row "
        f"{rows[empty[0]][0]}."
    )
    spans = [[int(rows[k][0]), int(rows[k][-1])] for k in empty]
    return [finding("labels", text, rows=spans, confidence=0.95)]


def _misnamed(
    survey: Survey, labels: list[str], rows: list[IntArray], bad: NDArray[np.bool_]
) -> list[Finding]:
    """Touches that trees which never saw them name otherwise, and surely."""
    kinds, numbers = np.unique(labels, return_inverse=True)
    fewest = int(np.bincount(numbers).min())
    if len(kinds) < 2 or fewest < 4 or (bad | survey.constant).all():
        return []
    from sklearn.ensemble import ExtraTreesClassifier  # takes longer to import than all the rest

    features = np.array([_features(survey, own, bad) for own in rows])
    trees = ExtraTreesClassifier(
        TREES, bootstrap=True, oob_score=True, min_samples_leaf=2, random_state=0
    )
    voted = trees.fit(np.nan_to_num(features), numbers).oob_decision_function_
    one = np.arange(len(rows))
    own = voted[one, numbers].copy()
    voted[one, numbers] = 0.0
    margin = np.nan_to_num(voted.max(axis=1) - own)
    wrong = np.flatnonzero(margin > SURELY + FEW / fewest)
    if (margin < 0.0).mean() < CLEAR or len(wrong) == 0:
        return []
    first = wrong[0]
    look = "touch looks" if len(wrong) == 1 else "touches look"
    text = (
        f"{len(wrong)} {look} like another label, such as {labels[first]!r} at row "
        f"{rows[first][0]} like {str(kinds[voted[first].argmax()])!r}."
    )
    spans = [[int(rows[k][0]), int(rows[k][-1])] for k in wrong]
    # Trees mistake a few touches of sound labels as surely: those are a remark.
    few = _tail(len(wrong), len(rows), MISTAKEN) > DOUBTED
    sure, harm = (0.5, 0.2) if few else (0.85, None)
    return [finding("labels", text, rows=spans, confidence=sure, harm=harm)]


def _features(survey: Survey, own: IntArray, bad: NDArray[np.bool_]) -> list[float]:
    """Size, strength, length, course and motion of the touch in some rows."""
    good = ~bad & ~survey.constant
    cells = np.unique(survey.cell_of(own))
    strong = np.maximum(survey.response[cells][:, good], 0.0)
    wide = survey.touched[cells][:, good].sum(axis=1)
    rest = survey.mean[cells[0], good] - survey.response[cells[0], good] * survey.sign
    values = np.nan_to_num(survey.track.values[own][:, good].astype(np.float64))
    starts = np.linspace(0, len(own), min(len(own), STAGES), endpoint=False).astype(int)
    felt = np.add.reduceat(values, starts) / np.diff(np.append(starts, len(own)))[:, None]
    felt = np.maximum((felt - rest) * survey.sign, 0.0)
    felt[felt <= survey.floor[good]] = 0.0
    course = felt.sum(axis=1) / max(float(felt.sum(axis=1).max()), 1e-12)
    held = np.flatnonzero(course >= 0.2 * course.max())
    place = (felt @ np.arange(good.sum()) / np.maximum(felt.sum(axis=1), 1e-12))[held]
    begin, end = felt[held[0]], felt[held[-1]]
    alike = float(begin @ end) / max(float(np.linalg.norm(begin) * np.linalg.norm(end)), 1e-12)
    sizes = [strong.max(), wide.max(), len(own), strong.sum(axis=1).max(), place.std()]
    bends = np.interp(np.linspace(0, len(course) - 1, 8), np.arange(len(course)), course)
    return [
        *np.log1p(sizes).tolist(), alike, float(np.abs(np.diff(course)).sum()), *bends.tolist(),
        float(place[-1] - place[0]), float(np.ptp(place)),
    ]  # fmt: skip


def _hashes(track: Track) -> NDArray[np.uint64]:
    """A number of each row that rows of the same values share, whatever their type."""
    rng = np.random.default_rng(7)
    factors = rng.integers(1, 2**63, track.values.shape[1], dtype=np.uint64) | np.uint64(1)
    found = np.empty(len(track.values), np.uint64)
    for start in range(0, len(found), 4096):
        block = np.ascontiguousarray(track.values[start : start + 4096], np.float32)
        bits = (block + np.float32(0)).view(np.uint32).astype(np.uint64)
        bits ^= bits >> np.uint64(7)
        with np.errstate(over="ignore"):
            found[start : start + 4096] = (bits * factors).sum(axis=1, dtype=np.uint64)
    return found


def shared_recordings(surveys: list[Survey]) -> list[Finding]:
    """Recordings of which one holds the rows of another, and references that are used twice."""
    found = []
    hashed = [(one, _hashes(one.track)) for one in surveys]
    for (one, rows), (two, others) in combinations(hashed, 2):
        files = [one.track.file, two.track.file]
        same = one.width == two.width
        spans = _common(rows, others, one.changed, two.changed) if same else None
        if spans is not None:
            (a, b), (c, d) = spans
            text = (
                f"{b - a + 1} rows of {files[0]} are in {files[1]} too (rows {a} to {b}, there {c} "
                f"to {d}): one recording under two names."
            )
            found.append(finding("repeated_recording", text, files=files, rows=[spans[0]]))
        if run := _shared_trace(one.track.reference, two.track.reference):
            text = (
                f"{run} samples of the reference of {files[0]} are that of {files[1]} too: at most "
                "one of them was measured."
            )
            found.append(finding("repeated_reference", text, files=files))
    return found


def _common(
    one: NDArray[np.uint64], two: NDArray[np.uint64], moved: IntArray, other: IntArray
) -> tuple[list[int], list[int]] | None:
    """The longest stretch of moving rows that two recordings share at one offset."""
    a = np.flatnonzero(moved > 0)
    kinds, first, counts = np.unique(one[a], return_index=True, return_counts=True)
    kinds, first = kinds[counts == 1], a[first[counts == 1]]
    b = np.flatnonzero(other > 0)
    at = np.searchsorted(kinds, two[b])
    hit = np.isin(two[b], kinds)
    if hit.sum() < SHARED:
        return None
    rows, there = first[at[hit]], b[hit]
    offsets, number = np.unique(there - rows, return_counts=True)
    best = offsets[np.argmax(number)]
    if number.max() < SHARED:
        return None
    own = np.sort(rows[there - rows == best])
    return [int(own[0]), int(own[-1])], [int(own[0] + best), int(own[-1] + best)]


def _shared_trace(one: FloatArray | None, two: FloatArray | None) -> int:
    """Length of a moving stretch that two references share sample by sample; 0 for none."""
    if one is None or two is None:
        return 0
    same: dict[tuple[float, ...], int] = {}
    for at in range(0, len(one) - TRACE, TRACE // 2):
        piece = one[at : at + TRACE]
        if len(np.unique(piece)) > TRACE // 4:
            same[tuple(piece[:8].tolist())] = at
    if not same:
        return 0
    starts = {key[0] for key in same}
    longest = 0
    for at in np.flatnonzero(np.isin(two, list(starts))).tolist():
        found = same.get(tuple(two[at : at + 8].tolist()))
        if found is None:
            continue
        length = min(len(one) - found, len(two) - at)
        equal = one[found : found + length] == two[at : at + length]
        run = length if equal.all() else int(np.argmin(equal))
        longest = max(longest, run)
    return longest if longest >= TRACE else 0


def together(surveys: list[Survey]) -> list[Finding]:
    """Findings of several recordings."""
    found = shared_recordings(surveys)
    widths: dict[str, set[int]] = {}
    for one in surveys:
        widths.setdefault(one.track.part, set()).add(one.width)
    if any(len(own) > 1 for own in widths.values()):
        files = [one.track.file for one in surveys]
        said = ", ".join(f"{one.width} in {one.track.file}" for one in surveys[:4])
        text = f"The recordings have different channels: {said}."
        found.append(finding("place", text, files=files, do="examine each skin for itself"))
    return found
