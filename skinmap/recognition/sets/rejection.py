"""When a touch is called unknown: below a confidence chosen on held-out touches, or too young."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, check_finite
from skinmap.errors import InvalidArrayError

UNKNOWN = "unknown"
# Ages at which touches are looked at that go on [s], and how many are needed to say anything.
AGES = (0.02, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5)
ENOUGH = 20
LOST = 0.02  # share of the rightly named held-out touches that may be rejected at most


def rejection_threshold(confidence: ArrayLike, right: ArrayLike, *, lost: float = LOST) -> float:
    """The confidence below which held-out touches are named wrong more often than right.

    Parameters
    ----------
    confidence : (m,) array-like of float
        Of held-out touches, 0 to 1.
    right : (m,) array-like of bool
        Whether each was named right.
    lost : float
        The threshold rejects at most this share of those named right.

    Returns
    -------
    float
        0 where nothing is gained by rejecting.
    """
    sure = np.asarray(confidence, np.float64)
    good = np.asarray(right, bool)
    order = np.argsort(sure, kind="stable")
    # Rejecting the k least sure gains their wrong names and loses their right ones.
    gain = np.concatenate([[0], np.cumsum(np.where(good[order], -1, 1))])
    rejected = np.concatenate([[0], np.cumsum(good[order])])
    gain[rejected > lost * good.sum()] = -1
    best = int(np.argmax(gain))
    if best == 0:
        return 0.0
    upper = sure[order[best]] if best < len(order) else sure[order[-1]]
    return float(0.5 * (sure[order[best - 1]] + upper))


def early_doubt(own: Sequence[Sequence[float]], names: int) -> FloatArray:
    """How far names are to be doubted while a touch goes on, at each of `AGES`.

    Names are learnt from whole touches, and of the beginning of one they are too sure. With a
    doubt of d the probabilities are (1 - d) p + d / c of c names: the d under which the true names
    are the most likely. It never grows with age, and is 0 at the last age. Where no touches say how
    sure to be, any of the names is as likely as another: 1 - 1 / c.

    Parameters
    ----------
    own : sequence over `AGES` of sequence of float
        Probabilities that the true names of held-out touches of this age were given.
    names : int
        c.

    Returns
    -------
    (len(AGES),) float
        0 to 1.
    """
    grid = np.linspace(0.0, 0.99, 100)
    found = np.full(len(AGES), 1.0 - 1.0 / names)
    for number, shares in enumerate(own):
        if len(shares) >= ENOUGH:
            told = (1.0 - grid) * np.array(shares)[:, None] + grid / names
            found[number] = grid[int(np.argmax(np.log(np.maximum(told, 1e-300)).sum(axis=0)))]
        elif number:
            found[number] = found[number - 1]
    found[-1] = 0.0
    return np.asarray(np.minimum.accumulate(found))


def doubt_from(array: ArrayLike) -> FloatArray:
    """The doubt that a model file keeps.

    Raises
    ------
    InvalidArrayError
        Not a share of 0 to 1 for each age.
    """
    doubt = check_finite(array, "doubt", (len(AGES),))
    if (doubt < 0.0).any() or (doubt >= 1.0).any():
        raise InvalidArrayError("a doubt is a share from 0 to 1")
    return doubt
