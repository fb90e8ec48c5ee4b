"""A sparse code of histograms whose scalar products are the intersection kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, hstack
from sklearn.base import BaseEstimator, TransformerMixin

from skinmap.arrays import FloatArray
from skinmap.classify.additive import AdditiveFunction

LEVELS = 64  # steps a bin at most


class UnaryCode(TransformerMixin, BaseEstimator):
    """Each bin cut into steps, and how far each step is filled.

    Counts up to `levels` are cut at every whole number, and the products of their codes are the
    intersection kernel itself; else the steps end at quantiles of the training values, and
    only values within one step are told apart less sharply.

    Maji and Berg, "Max-Margin Additive Classifiers for Detection", ICCV 2009.
    """

    def __init__(self, levels: int = LEVELS) -> None:
        self.levels = levels

    def fit(self, X: FloatArray, y: ArrayLike | None = None) -> UnaryCode:
        """Choose the steps of each bin of histograms (n, d)."""
        ends = []
        for values in X.T:
            seen = np.unique(values[values > 0])
            if len(seen) and seen[-1] <= self.levels and (seen == np.floor(seen)).all():
                seen = np.arange(1.0, seen[-1] + 1.0)
            elif len(seen) > self.levels:
                share = np.linspace(0.0, 1.0, self.levels)
                seen = np.unique(np.quantile(seen, share, method="nearest"))
            ends.append(seen)
        self.ends_ = np.concatenate(ends)
        self.start_ = np.concatenate([[0], np.cumsum([len(end) for end in ends])])
        return self

    def transform(self, X: FloatArray) -> csr_array:
        """(n, steps) code of histograms (n, d)."""
        blocks = []
        for place, values in enumerate(X.T):
            end = self.ends_[self.start_[place] : self.start_[place + 1]]
            begin = np.concatenate([[0.0], end[:-1]])[: len(end)]
            filled = np.clip(values[:, None] - begin, 0.0, end - begin)
            blocks.append(csr_array(filled / np.sqrt(end - begin)))
        return csr_array(hstack(blocks, format="csr"))

    def function(self, weights: FloatArray, intercept: FloatArray) -> AdditiveFunction:
        """The function x -> weights (q, steps) @ code(x) + intercept (q,)."""
        bends, slopes = [], []
        for first, last in zip(self.start_[:-1], self.start_[1:], strict=True):
            end = self.ends_[first:last]
            width = np.diff(end, prepend=0.0)
            bends.append(end)
            slopes.append((weights[:, first:last] / np.sqrt(width)).T)
        return AdditiveFunction(bends, slopes, intercept)
