"""Contacts of a grid of capacitive readings: where they are and how large, with an interval.

The readings spread over more cells than a finger covers: a threshold overstates areas 1.5 to 4
times. Shape and strength of a spot give the area instead, learnt from prints that were measured
optically. People differ by about a quarter in a way that readings do not show: intervals come from
people who were left out in turn, so that this difference is part of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidArrayError

if TYPE_CHECKING:
    from sklearn.base import RegressorMixin

ACTIVE = 60.0  # counts: readings above it are a contact's
SMALLEST = 5  # readings of a contact; specks of noise have four at most, fingers six or more
PRINT_MM2 = 8.0  # of the smallest print that counts
SHARE = 0.9  # of the true areas that lie inside their interval
WIDENINGS = np.linspace(1.0, 2.0, 101)  # of intervals
SHAPES = 5  # columns of `Spots.features` that do not depend on the place
EIGHT = np.ones((3, 3), np.int64)  # neighbours of a reading, corners too


class Spots(NamedTuple):
    """Contacts found in readings, k of them.

    Attributes
    ----------
    image : (k,) int
        Number of the image, from 0.
    features : (k, 7) float
        Logarithms of sum, peak, number of readings and spread along rows and columns; and the
        centre [mm].
    places : (k, 6) float
        Centre of the squared readings [mm], and from its strongest reading, and of the readings
        themselves [pitches].
    labels : list of (rows, columns) int
        For each image the spot of a reading, counted from 1; 0 where there is none.
    """

    image: IntArray
    features: FloatArray
    places: FloatArray
    labels: list[IntArray]

    @property
    def centre_mm(self) -> FloatArray:
        """(k, 2) row and column [mm] of the squared readings' centre."""
        return self.places[:, :2]


class Prints(NamedTuple):
    """What covered each of k contacts: `area_mm2 (k,)`, 0 without a print, and `centre_mm (k, 2)`.

    `missed` prints have no contact.
    """

    area_mm2: FloatArray
    centre_mm: FloatArray
    missed: int


class Answers(NamedTuple):
    """Area (k,) with its interval [mm2] and centre (k, 2) [mm] of k contacts."""

    area_mm2: FloatArray
    low: FloatArray
    high: FloatArray
    centre_mm: FloatArray


def find_spots(readings: ArrayLike, *, pitch_mm: float) -> Spots:
    """Find contacts in images (t, rows, columns) of readings [counts].

    Returns
    -------
    Spots
        Connected readings above 60 counts; fewer than five are noise.
    """
    from scipy import ndimage

    image, features, places, labels = [], [], [], []
    for number, reading in enumerate(np.asarray(readings, np.float64)):
        found, count = ndimage.label(reading > ACTIVE, structure=EIGHT)
        kept = np.zeros_like(found)
        for spot in range(1, count + 1):
            own = found == spot
            if own.sum() < SMALLEST:
                continue
            around = ndimage.binary_dilation(own, EIGHT) & (own | (found == 0))
            feature, place = _spot(reading, own, around, pitch_mm)
            image.append(number)
            features.append(feature)
            places.append(place)
            kept[own] = len(image)
        labels.append(np.where(kept > 0, kept, 0).astype(np.int64))
    return Spots(
        np.array(image, np.int64),
        np.array(features).reshape(-1, SHAPES + 2),
        np.array(places).reshape(-1, 6),
        labels,
    )


def _spot(
    reading: FloatArray, own: NDArray[np.bool_], around: NDArray[np.bool_], pitch_mm: float
) -> tuple[list[float], list[float]]:
    """Features and places of one contact, from its readings and the ring around them."""
    cells = np.argwhere(around) + 0.5
    weight = np.clip(reading[around], 0.0, None)
    plain = weight @ cells / weight.sum()
    squared = weight**2 @ cells / (weight**2).sum()
    spread = weight @ (cells - plain) ** 2 / weight.sum()
    peak = np.unravel_index(np.argmax(np.where(own, reading, -np.inf)), own.shape)
    middle = np.array(peak) + 0.5
    shape = np.log([weight.sum(), weight.max(), own.sum(), *np.maximum(spread, 1e-3)])
    centre = squared * pitch_mm
    return [*shape, *centre], [*centre, *(squared - middle), *(plain - middle)]


def match_prints(spots: Spots, prints: Iterator[NDArray[np.uint8]], *, pitch_mm: float) -> Prints:
    """Give each contact the prints (rows, columns) that cover it; several of one contact add up.

    A print belongs to the contact at its centre, or within two pitches of it.
    """
    from scipy import ndimage

    area, moment, missed = np.zeros(len(spots.image)), np.zeros((len(spots.image), 2)), 0
    for labels, touched in zip(spots.labels, prints, strict=True):
        fine = pitch_mm * labels.shape[0] / touched.shape[0]
        parts, count = ndimage.label(touched, structure=EIGHT)
        sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:] * fine**2
        where = np.argwhere(labels > 0)
        for part in np.flatnonzero(sizes >= PRINT_MM2):
            centre = (np.argwhere(parts == part + 1).mean(axis=0) + 0.5) * fine
            far = np.hypot(*((where + 0.5) * pitch_mm - centre).T)
            if not len(far) or far.min() > 2.0 * pitch_mm:
                missed += 1
                continue
            spot = labels[tuple(where[far.argmin()])] - 1
            area[spot] += sizes[part]
            moment[spot] += sizes[part] * centre
    with np.errstate(invalid="ignore"):
        return Prints(area, moment / area[:, None], missed)


@dataclass(frozen=True, eq=False, slots=True)
class AreaModel:
    """Area, interval and centre of contacts.

    Attributes
    ----------
    area
        Logarithm of the area from features.
    offset
        From the centre of readings to that of the print [mm], from places.
    below, above
        Ends of the interval, from the logarithm of the area.
    """

    area: RegressorMixin
    offset: RegressorMixin
    below: float
    above: float

    def answer(self, spots: Spots) -> Answers:
        """Answer for all contacts."""
        if not len(spots.image):
            none = np.zeros(0)
            return Answers(none, none, none, np.zeros((0, 2)))
        log = self.area.predict(spots.features)
        centre = spots.centre_mm + self.offset.predict(spots.places)
        return Answers(np.exp(log), np.exp(log + self.below), np.exp(log + self.above), centre)


def fit_areas(spots: Spots, prints: Prints, person: IntArray) -> AreaModel:
    """Learn areas and centres from contacts with prints.

    Parameters
    ----------
    person : (k,) int
        Of each contact: the interval comes from people left out in turn.

    Raises
    ------
    InvalidArrayError
        Fewer than three people or 30 contacts with a print.
    """
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    good = np.flatnonzero(prints.area_mm2 > 0)
    people = np.unique(person[good])
    if len(people) < 3 or len(good) < 30:
        raise InvalidArrayError(
            f"{len(good)} contacts with a print, of {len(people)} people: areas need 30 of 3 "
            f"people (a contact is {SMALLEST} neighbouring readings above {ACTIVE:g} counts)"
        )
    features, truth = spots.features[good], np.log(prints.area_mm2[good])
    sides = {"groups": person[good], "cv": LeaveOneGroupOut()}
    error = truth - cross_val_predict(_areas(), features, truth, **sides)
    # The middle that makes the mean relative error least: a median in which small areas weigh more.
    order = np.argsort(error)
    weight = np.cumsum(np.exp(-error[order]))
    middle = error[order][np.searchsorted(weight, weight[-1] / 2)]
    ends = _ends(error) * _widening(error, person[good])
    area = _areas().fit(features, truth + middle)
    offset = _squares().fit(spots.places[good], prints.centre_mm[good] - spots.centre_mm[good])
    return AreaModel(area, offset, *(ends - middle).tolist())


def _ends(error: FloatArray) -> FloatArray:
    """Ends (2,) between which 90 % of some errors lie."""
    return np.quantile(error, [(1 - SHARE) / 2, (1 + SHARE) / 2])


def _widening(error: FloatArray, person: IntArray) -> float:
    """Least factor with which intervals from the others hold for 90 % of a person, on average.

    A person's own errors have about as much in common as they differ: the ends between which 90 %
    of a few people's errors lie are too narrow for the next one.
    """
    others = [(error[person == one], _ends(error[person != one])) for one in np.unique(person)]
    for factor in WIDENINGS:
        held = [((factor * low <= own) & (own <= factor * high)).mean()
                for own, (low, high) in others]  # fmt: skip
        if np.mean(held) >= SHARE:
            break
    return float(factor)


def _areas() -> RegressorMixin:
    """Mean of two kinds of curves, each with and without the place on the grid."""
    from sklearn.compose import make_column_transformer
    from sklearn.ensemble import VotingRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVR

    shapes: Callable[[], object] = partial(
        make_column_transformer, ("passthrough", slice(0, SHAPES))
    )
    support = partial(SVR, C=3.0, epsilon=0.1, gamma=0.03)
    return VotingRegressor([
        ("squares", _squares()),
        ("squares of the shape", make_pipeline(shapes(), _squares())),
        ("support", make_pipeline(StandardScaler(), support())),
        ("support of the shape", make_pipeline(shapes(), StandardScaler(), support())),
    ])  # fmt: skip


def _squares() -> RegressorMixin:
    """A polynomial of the second degree, held back by ridge regression."""
    from sklearn.linear_model import RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    steps = (StandardScaler(), PolynomialFeatures(2), StandardScaler())
    return make_pipeline(*steps, RidgeCV(np.logspace(-1, 4, 11)))
