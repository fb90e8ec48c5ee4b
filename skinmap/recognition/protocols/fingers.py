"""How many fingers touch: counted without training and with, on recordings of real fingers.

Nothing of a recording's rest may help: each taxel's own rest is taken away before (see `above_rest`
of `skinmap.io.recordings.cyskin_arrays`). The control is the same counter, fitted and tested in the
same way, on the first samples of each recording, before the skin is touched: sessions of one class
would give themselves away there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.recognition.protocols.results import CountRow
from skinmap.touch.contacts.contact_geometry import FEATURES, contact_geometry
from skinmap.touch.contacts.rest import felt, find_rest
from skinmap.touch.contacts.skin_geometry import pool_event
from skinmap.touch.prepared_skin import PreparedSkin

HELD = 4  # samples at least that a taxel reads what counts: spikes last for one
FIRST = 3  # samples before anybody touches: the control
MOST = 5  # fingers of a hand
THIRD = 1.0 / 3.0  # of the files, of each class, choose the thresholds
REGIONS = 6  # pieces of the skin, along its longest side, that are left out in turn
TREES = 300
LENGTHS = 30  # tried for each threshold
NEARLY = 0.25  # what a count within one is worth beside an exact one, when thresholds are chosen
WIDTH = FEATURES.index("even_width_mm")


@dataclass(frozen=True, eq=False, slots=True)
class Described:
    """Recordings in numbers that say nothing of where they were made.

    Attributes
    ----------
    numbers : (f, d) float
        Contact geometry of what was held, then of the mean while pressed.
    centres : (f, 3) float
        Centre of the touch [m]; NaN where nothing is touched.
    """

    numbers: FloatArray
    centres: FloatArray

    @property
    def touched(self) -> BoolArray:
        """(f,) whether anything is."""
        return np.asarray(self.numbers[:, : len(FEATURES)].any(axis=1))


def describe(
    skin: PreparedSkin, files: Sequence[NDArray[np.uint8]], *, first: int | None = None
) -> Described:
    """Numbers of recordings (t, n) above their rest, or of their first samples.

    Spikes, stuck taxels and what does not exceed a taxel's own noise count as nothing.
    """
    geometry = skin.geometry
    numbers, centres = [], []
    for pressures in files:
        samples = felt(pressures, find_rest(pressures), geometry.beside)[:first]
        held = np.sort(samples, axis=0)[-min(HELD, len(samples))].astype(np.float64)
        pooled = pool_event(samples)
        numbers.append([contact_geometry(geometry, one) for one in (held, pooled)])
        load = held if held.any() else pooled
        centre = load @ skin.skin.positions / load.sum() if load.any() else np.full(3, np.nan)
        centres.append(centre)
    return Described(np.array(numbers).reshape(len(files), -1), np.array(centres))


def count_by_width(
    found: Described, narrow: float, finger: float, *, number: int = WIDTH
) -> IntArray:
    """(f,) fingers: none where nothing is touched, else one more for each finger's width.

    Parameters
    ----------
    found : Described
    narrow, finger : float
        Spread across the touch of one finger at most, and what each further one adds [mm].
    number : int
        Another of `FEATURES` that grows with the fingers.
    """
    return _counts(found.numbers[:, number], found.touched, np.array(narrow), np.array(finger))


def _counts(
    values: FloatArray, touched: BoolArray, narrow: FloatArray, finger: FloatArray
) -> IntArray:
    """(..., f) fingers by numbers (f,), for thresholds (...)."""
    more = np.ceil((values - narrow[..., None]) / finger[..., None])
    return np.where(touched, np.clip(1 + more, 1, MOST), 0).astype(np.int64)


def fit_thresholds(
    found: Described, fingers: IntArray, rows: BoolArray, number: int
) -> tuple[float, float, float]:
    """What the best two thresholds are worth on some rows (f,), and they."""
    values, touched = found.numbers[rows, number], found.touched[rows]
    middle = float(np.median(values[touched])) if touched.any() else 1.0
    narrow, finger = np.meshgrid(
        np.linspace(0.0, 1.5 * middle, LENGTHS),
        np.linspace(0.1, 1.5, LENGTHS) * max(middle, 1e-3),
        indexing="ij",
    )
    off = np.abs(_counts(values, touched, narrow, finger) - fingers[rows])
    score = (off == 0).mean(axis=-1) + NEARLY * (off <= 1).mean(axis=-1)
    best = int(score.argmax())
    return float(score.flat[best]), float(narrow.flat[best]), float(finger.flat[best])


def chosen_number(
    found: Described, fingers: IntArray, seeds: Sequence[int]
) -> tuple[CountRow, list[str]]:
    """The one of `FEATURES` that counts and its thresholds, by a third of the recordings.

    Judged on the others; and the name of the number, of each seed.
    """
    counts, tests, names = [], [], []
    for seed in seeds:
        third = _third(fingers, np.random.default_rng(seed))
        tried = [fit_thresholds(found, fingers, third, k) for k in range(len(FEATURES))]
        best = max(range(len(tried)), key=lambda k, tried=tried: tried[k][0])  # type: ignore[misc]
        counts.append(count_by_width(found, *tried[best][1:], number=best))
        tests.append(~third)
        names.append(FEATURES[best])
    return judge("a number that the third chose", counts, tests, fingers), names


def trained(
    found: Described,
    fingers: IntArray,
    regions: IntArray,
    seeds: Sequence[int],
    progress: Callable[[str], None] | None = None,
) -> CountRow:
    """Extra trees on contact geometry, each region of the skin left out in turn."""
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    counts, sides = [], {"groups": regions, "cv": LeaveOneGroupOut()}
    for seed in seeds:
        trees = ExtraTreesClassifier(TREES, random_state=seed)
        counts.append(cross_val_predict(trees, found.numbers, fingers, **sides))
        if progress is not None:
            progress("trained")
    every = np.ones(len(fingers), bool)
    return judge("trained, place left out", counts, [every] * len(counts), fingers)


def places(found: Described, count: int = REGIONS) -> IntArray:
    """(f,) region of the skin of each recording: as many recordings in each, side by side.

    Recordings of nothing have no place: they are dealt out.
    """
    where = found.centres
    touched = np.isfinite(where).all(axis=1)
    region = np.arange(len(where)) % count
    if touched.any():
        away = where[touched] - where[touched].mean(axis=0)
        along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
        edges = np.quantile(along, np.arange(1, count) / count)
        region[touched] = np.searchsorted(edges, along)
    return region


def judge(
    method: str, counts: Sequence[IntArray], tests: Sequence[BoolArray], fingers: IntArray
) -> CountRow:
    """What counts (f,) of some repetitions are worth where they are tested (f,); no control yet."""
    exact, near = [], []
    size = 1 + max(int(count.max()) for count in (fingers, *counts))
    confusion = np.zeros((size, size))
    for count, test in zip(counts, tests, strict=True):
        off = np.abs(count - fingers)[test]
        exact.append((off == 0).mean())
        near.append((off <= 1).mean())
        np.add.at(confusion, (fingers[test], count[test]), 1.0 / len(counts))
    return CountRow(
        method=method,
        exact=float(np.mean(exact)),
        within_one=float(np.mean(near)),
        spread=float(np.std(exact)),
        control=np.nan,
        control_within_one=np.nan,
        confusion=confusion.tolist(),
    )


def check_fingers(fingers: IntArray) -> IntArray:
    """Numbers of fingers (f,) that can be judged.

    Raises
    ------
    InvalidArrayError
        Fewer than two different ones, fewer than `REGIONS` recordings of one, or more than a
        hand has.
    """
    names, count = np.unique(fingers, return_counts=True)
    if len(names) < 2 or names.max() > MOST:
        raise InvalidArrayError(
            f"recordings of {', '.join(map(str, names))} fingers; "
            f"expected two or more numbers of 0 to {MOST}"
        )
    if count.min() < REGIONS:
        few = int(names[count.argmin()])
        raise InvalidArrayError(
            f"{count.min()} recordings of {few} fingers; {REGIONS} of each number at least"
        )
    return fingers


def _third(fingers: IntArray, rng: np.random.Generator) -> BoolArray:
    """(f,) a third of the recordings of each number of fingers."""
    chosen = np.zeros(len(fingers), bool)
    for number in np.unique(fingers):
        own = np.flatnonzero(fingers == number)
        chosen[rng.choice(own, max(1, round(THIRD * len(own))), replace=False)] = True
    return chosen
