"""When a touch is called unknown: below a confidence chosen on held-out touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

UNKNOWN = "unknown"
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
