"""Support vector machines on Gram matrices, their parameters chosen by an inner cross-validation.

A Gram matrix is made once for all folds, so that a grid search costs the solver alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.classify.intersection import intersection_kernel
from skinmap.classify.protocols.folds import Fold, FoldKind, Names, make_folds, smallest

INNER_FOLDS = 3
PENALTIES = (1.0, 10.0, 100.0)
# Around 1 / (median squared distance): the width at which a kernel is neither constant nor a comb.
WIDTHS = (0.25, 1.0, 4.0, 16.0)


@dataclass(frozen=True, eq=False, slots=True)
class Kernel:
    """A kernel with one Gram matrix for each value of its own parameter.

    Attributes
    ----------
    name : str
    grams : (g, n, n) float
        Over all n rows, training and test.
    """

    name: str
    grams: FloatArray

    def __post_init__(self) -> None:
        freeze(self, grams=self.grams)


def rbf(rows: FloatArray) -> Kernel:
    """Radial basis functions of several widths on rows (n, d)."""
    square = (rows**2).sum(axis=1)
    gap = np.maximum(square[:, None] + square - 2.0 * rows @ rows.T, 0.0)
    typical = float(np.median(gap[gap > 0])) if (gap > 0).any() else 1.0
    return Kernel("rbf-svm", np.stack([np.exp(-width / typical * gap) for width in WIDTHS]))


def intersection(counts: FloatArray) -> Kernel:
    """Histogram intersection on counts (n, d), scaled so that its mean diagonal is 1."""
    gram = intersection_kernel(counts, counts)
    return Kernel("intersection-svm", (gram / (float(np.diag(gram).mean()) or 1.0))[None])


def cross_validate(
    kernel: Kernel,
    labels: Names,
    events: IntArray,
    folds: Sequence[Fold],
    *,
    kind: FoldKind,
    rng: np.random.Generator,
) -> Names:
    """(n,) the label that each row gets from the fold that did not train on it.

    Penalty and kernel parameter are chosen anew on the training rows of each fold, with inner
    folds of the same kind.
    """
    named = np.empty_like(labels)
    for train, test in folds:
        which, penalty = _choose(kernel, labels, events, train, kind, rng)
        named[test] = _predict(kernel.grams[which], labels, train, test, penalty)
    return named


def _choose(
    kernel: Kernel,
    labels: Names,
    events: IntArray,
    train: IntArray,
    kind: FoldKind,
    rng: np.random.Generator,
) -> tuple[int, float]:
    """Gram matrix and penalty that name most training rows right; the middle without a choice."""
    able = min(INNER_FOLDS, *smallest(kind, labels[train], events[train]).values())
    grid = [(which, c) for which in range(len(kernel.grams)) for c in PENALTIES]
    if able < 2:
        return len(kernel.grams) // 2, PENALTIES[len(PENALTIES) // 2]
    inner = make_folds(kind, labels[train], events[train], folds=able, rng=rng)
    right = [
        sum(
            int(
                np.count_nonzero(
                    _predict(kernel.grams[which], labels, train[fit], train[check], c)
                    == labels[train[check]]
                )
            )
            for fit, check in inner
        )
        for which, c in grid
    ]
    return grid[int(np.argmax(right))]


def _predict(
    gram: FloatArray, labels: Names, train: IntArray, test: IntArray, penalty: float
) -> Names:
    from sklearn.svm import SVC

    machine = SVC(kernel="precomputed", C=penalty).fit(gram[np.ix_(train, train)], labels[train])
    return np.asarray(machine.predict(gram[np.ix_(test, train)]))
